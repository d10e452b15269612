//! Forces of contacts during a step.
//!
//! Contacts are critically damped springs, which the solver takes as implicit constraints in small steps,
//! with a second pass without springs that takes out the velocities that these have added (Catto, Soft
//! Constraints, 2011, and Solver2D, 2024). Each pass is projected Gauss–Seidel from the impulses of the step
//! before, with Coulomb's cone at each point.

use nalgebra::{Matrix3, Vector3};

use super::{
    colliders::{Body, Load, Touch},
    machine::{Coordinates, Machine, Posture, Stop},
};
use crate::convert::{from_vector, to_vector};

/// Natural frequency of contacts with an object whose file names no stiffness, and the highest of any, in Hz:
/// a finger sinks 0.2 mm into a bottle at most. Chosen.
const HARD_HZ: f64 = 400.0;
/// Critically damped: restitution is not the spring's business.
const DAMPING_RATIO: f64 = 1.0;
/// Most passes of the solver over all contacts, and the change of velocities below which they end, in m/s.
const MOST_SWEEPS: usize = 16;
const SAME_MPS: f64 = 1e-5;
/// Fastest that a spring pushes apart, in m/s.
const MOST_APART_MPS: f64 = 3.0;

/// Velocities of everything that moves: of the machine's coordinates and of the object's centre of mass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Velocities {
    pub machine: Coordinates,
    pub linear: Vector3<f64>,
    pub angular: Vector3<f64>,
}

/// Mass properties by which the bodies respond to impulses.
pub(super) struct Masses<'a> {
    pub machine: &'a Machine,
    pub posture: &'a Posture,
    /// Square root of the object's mass; W with W·Wᵀ its inertia about its centre of mass in W, and W⁻¹.
    pub root_kg: f64,
    pub roots_W: [Matrix3<f64>; 2],
    pub p_WC: Vector3<f64>,
}

impl Masses<'_> {
    /// Velocities in mass-weighted coordinates, w = Lᵀ·v with M = L·Lᵀ. In them a row J of velocities is
    /// J·L⁻ᵀ, and the change by a unit impulse along it, M⁻¹·Jᵀ, is the row itself.
    pub fn weighted(&self, velocities: &Velocities) -> Velocities {
        Velocities {
            machine: self.posture.factor.l().tr_mul(&velocities.machine),
            linear: velocities.linear * self.root_kg,
            angular: self.roots_W[0].tr_mul(&velocities.angular),
        }
    }

    /// The reverse.
    pub fn unweighted(&self, weighted: &Velocities) -> Velocities {
        Velocities {
            machine: self.posture.factor.l_dirty().tr_solve_lower_triangular_unchecked(&weighted.machine),
            linear: weighted.linear / self.root_kg,
            angular: self.roots_W[1].tr_mul(&weighted.angular),
        }
    }
}

/// Velocity of one point relative to another along a direction, as a function of all velocities.
#[derive(Debug, Clone)]
pub(super) struct Row {
    weighted: Velocities,
    /// Change of the relative velocity by a unit impulse: one over the effective mass.
    pub mobility_per_kg: f64,
}

impl Row {
    fn new(masses: &Masses, of: &Velocities) -> Self {
        let weighted = Velocities {
            machine: masses.posture.factor.l_dirty().solve_lower_triangular_unchecked(&of.machine),
            linear: of.linear / masses.root_kg,
            angular: masses.roots_W[1] * of.angular,
        };
        let mut row = Self { weighted, mobility_per_kg: 0.0 };
        row.mobility_per_kg = row.velocity(&weighted);
        row
    }

    /// Rows of the pushed body at a touch relative to the pushing one: along the normal, and in two
    /// directions across.
    fn at(masses: &Masses, touch: &Touch) -> [Self; 3] {
        let [one, other] = touch.across();
        [touch.normal, one, other].map(|direction| {
            let mut of = Velocities::default();
            for (body, sign) in [(touch.pushed, 1.0), (touch.pushing, -1.0)] {
                match body {
                    Body::Fixed => {}
                    Body::Link(link) => {
                        of.machine += masses.machine.row(masses.posture, link, direction, &touch.point) * sign;
                    }
                    Body::Object => {
                        of.linear = direction * sign;
                        of.angular = (touch.point - masses.p_WC).cross(&direction) * sign;
                    }
                }
            }
            Self::new(masses, &of)
        })
    }

    /// The relative velocity at mass-weighted velocities.
    pub fn velocity(&self, weighted: &Velocities) -> f64 {
        let Velocities { machine, linear, angular } = &self.weighted;
        machine.dot(&weighted.machine) + linear.dot(&weighted.linear) + angular.dot(&weighted.angular)
    }

    /// Changes these by an impulse along the row.
    pub fn push(&self, weighted: &mut Velocities, impulse_ns: f64) {
        let Velocities { machine, linear, angular } = &self.weighted;
        weighted.machine += machine * impulse_ns;
        weighted.linear += linear * impulse_ns;
        weighted.angular += angular * impulse_ns;
    }
}

/// A spring as the solver takes it: the fraction of a gap that is closed per second, and factors of the
/// effective mass and of the impulse.
#[derive(Debug, Clone, Copy)]
struct Spring {
    rate_per_s: f64,
    mass_factor: f64,
    impulse_factor: f64,
}

impl Spring {
    /// Spring of a natural frequency, for a solver's step.
    fn new(frequency_hz: f64, step_s: f64) -> Self {
        let omega = std::f64::consts::TAU * frequency_hz;
        let damped = 2.0 * DAMPING_RATIO + step_s * omega;
        let stiff = step_s * omega * damped;
        Self { rate_per_s: omega / damped, mass_factor: stiff / (1.0 + stiff), impulse_factor: 1.0 / (1.0 + stiff) }
    }
}

/// Two bodies that cannot pass through each other.
pub(super) struct Unilateral {
    pub row: Row,
    gap_m: f64,
    spring: Spring,
    /// True if the spring is that of the object, and not a means against overlaps of hard bodies.
    is_soft: bool,
    /// True if a contact that bore nothing may close in the solver's step.
    meets: bool,
    /// Impulse in a solver's step, and in all of them.
    impulse_ns: f64,
    pub total_ns: f64,
}

impl Unilateral {
    fn new(row: Row, gap_m: f64, spring: Spring, is_soft: bool, impulse_ns: f64) -> Self {
        Self { row, gap_m, spring, is_soft, meets: false, impulse_ns, total_ns: 0.0 }
    }

    /// Applies the impulse before the move: a contact that closes may close its gap and no more; then its
    /// spring takes over. Returns the change of the relative velocity, in m/s.
    fn press(&mut self, velocities: &mut Velocities, step_s: f64) -> f64 {
        let Spring { rate_per_s, mass_factor, impulse_factor } = self.spring;
        if self.meets {
            return self.push(velocities, self.gap_m.max(0.0) / step_s, 1.0, 0.0);
        }
        let rate_per_s = if self.gap_m > 0.0 { 1.0 / step_s } else { rate_per_s };
        self.push(velocities, (rate_per_s * self.gap_m).max(-MOST_APART_MPS), mass_factor, impulse_factor)
    }

    /// Applies the impulse after the move, without the velocities at which a gap closed or springs separated
    /// hard bodies.
    fn relax(&mut self, velocities: &mut Velocities, step_s: f64) -> f64 {
        // A gap that stayed open closes in a later step, by the whole impulse that restitution multiplies.
        let is_open = self.gap_m > 0.0 && self.impulse_ns == 0.0;
        if is_open || self.is_soft && !self.meets {
            return 0.0;
        }
        self.push(velocities, self.gap_m.max(0.0) / step_s, 1.0, 0.0)
    }

    fn push(&mut self, velocities: &mut Velocities, bias_mps: f64, mass_factor: f64, impulse_factor: f64) -> f64 {
        let wanted_ns = -(self.row.velocity(velocities) + bias_mps) / self.row.mobility_per_kg * mass_factor;
        let impulse_ns = (self.impulse_ns * (1.0 - impulse_factor) + wanted_ns).max(0.0);
        let change_ns = impulse_ns - self.impulse_ns;
        self.row.push(velocities, change_ns);
        self.impulse_ns = impulse_ns;
        (change_ns * self.row.mobility_per_kg).abs()
    }
}

/// Impulses of the object's rebound at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rebound {
    /// Normal impulse that the compression has left behind, and the normal impulse so far.
    least_ns: f64,
    pub normal_ns: f64,
    friction_ns: [f64; 2],
}

/// A touch, its rows and its impulses.
pub(super) struct Contact {
    pub touch: Touch,
    pub normal: Unilateral,
    /// Rebound of the object after the step, if there is one.
    pub rebound: Option<Rebound>,
    /// Rows in two directions across the normal.
    friction: [Row; 2],
    friction_ns: [f64; 2],
}

impl Contact {
    /// Returns whether the contact bore a load in the step, and none in the one before.
    pub fn is_new(&self) -> bool {
        self.normal.total_ns > 0.0 && self.touch.load.normal_n == 0.0
    }

    /// Load with which the next step begins; `step_s` is the solver's.
    pub fn load(&self, step_s: f64) -> Load {
        let [one, other] = self.touch.across();
        let friction_ns = one * self.friction_ns[0] + other * self.friction_ns[1];
        let friction_n = to_vector(&(friction_ns / step_s));
        Load { normal_n: self.normal.impulse_ns / step_s, friction_n }
    }

    /// Applies the normal impulse with which a rebound begins.
    pub fn begin_rebound(&mut self, velocities: &mut Velocities, impulse_ns: f64) {
        self.normal.row.push(velocities, impulse_ns);
        self.rebound = Some(Rebound { least_ns: impulse_ns, normal_ns: impulse_ns, friction_ns: [0.0; 2] });
    }

    /// Adds what ends an approach, and friction. Returns by how much a relative velocity changes, in m/s.
    pub fn rebound_once(&mut self, velocities: &mut Velocities, friction: f64) -> Option<f64> {
        let Rebound { least_ns, normal_ns, friction_ns } = self.rebound.as_mut()?;
        let row = &self.normal.row;
        let change_ns = (*normal_ns - row.velocity(velocities) / row.mobility_per_kg).max(*least_ns) - *normal_ns;
        row.push(velocities, change_ns);
        *normal_ns += change_ns;
        let rubbed_mps = rub(&self.friction, friction_ns, velocities, friction * *normal_ns);
        Some(rubbed_mps.max((change_ns * row.mobility_per_kg).abs()))
    }
}

/// Applies as much friction as ends the sliding, but no more than `most_ns`. Returns by how much a relative
/// velocity changes, in m/s.
fn rub(rows: &[Row; 2], friction_ns: &mut [f64; 2], velocities: &mut Velocities, most_ns: f64) -> f64 {
    let wanted: [f64; 2] =
        std::array::from_fn(|i| friction_ns[i] - rows[i].velocity(velocities) / rows[i].mobility_per_kg);
    let size_ns = wanted[0].mul_add(wanted[0], wanted[1] * wanted[1]).sqrt();
    let factor = if size_ns > most_ns { most_ns / size_ns } else { 1.0 };
    let mut largest_mps = 0.0f64;
    for ((row, impulse_ns), wanted_ns) in rows.iter().zip(friction_ns).zip(wanted) {
        let change_ns = wanted_ns * factor - *impulse_ns;
        row.push(velocities, change_ns);
        *impulse_ns += change_ns;
        largest_mps = largest_mps.max((change_ns * row.mobility_per_kg).abs());
    }
    largest_mps
}

/// All contacts of a step, and the stops of the fingers that are met in it.
#[derive(Default)]
pub(super) struct Contacts {
    pub contacts: Vec<Contact>,
    stops: Vec<Unilateral>,
    friction: f64,
    /// Time step of the solver.
    step_s: f64,
}

impl Contacts {
    /// Begins a step. `stiffness_npm` is the object's, none if it is hard; `step_s` is the solver's.
    pub fn begin(
        &mut self,
        masses: &Masses,
        (touches, stops): (&[Touch], &[Option<Stop>]),
        (friction, stiffness_npm): (f64, Option<f64>),
        step_s: f64,
    ) {
        (self.friction, self.step_s) = (friction, step_s);
        let hard = Spring::new(HARD_HZ, step_s);
        let contact = |touch: &Touch| {
            let [row, one, other] = Row::at(masses, touch);
            let is_soft = stiffness_npm.is_some() && touch.pushed == Body::Object;
            let spring = stiffness_npm.filter(|_| is_soft).map_or(hard, |stiffness_npm| {
                // A part that presses at several points divides the stiffness among them.
                let points = touches.iter().filter(|it| it.part == touch.part).count() as f64;
                let frequency_hz = (stiffness_npm / points * row.mobility_per_kg).sqrt() / std::f64::consts::TAU;
                Spring::new(frequency_hz.min(HARD_HZ), step_s)
            });
            let rubbed_ns = from_vector(touch.load.friction_n) * step_s;
            Contact {
                friction: [one, other],
                friction_ns: touch.across().map(|direction| rubbed_ns.dot(&direction)),
                normal: Unilateral::new(row, touch.gap_m, spring, is_soft, touch.load.normal_n * step_s),
                rebound: None,
                touch: touch.clone(),
            }
        };
        self.contacts.clear();
        self.contacts.extend(touches.iter().map(contact));
        let stop = |&Stop { coordinate, free, gap_m }: &Stop| {
            let machine = Coordinates::ith(coordinate, free);
            Unilateral::new(Row::new(masses, &Velocities { machine, ..Velocities::default() }), gap_m, hard, false, 0.0)
        };
        self.stops.clear();
        self.stops.extend(stops.iter().flatten().map(stop));
    }

    /// Takes one step of the solver: `moved` moves the bodies with the velocities.
    pub fn advance(&mut self, masses: &Masses, velocities: &mut Velocities, moved: impl FnOnce(&Velocities)) {
        let weighted = &mut masses.weighted(velocities);
        for contact in &self.contacts {
            contact.normal.row.push(weighted, contact.normal.impulse_ns);
            for (row, impulse_ns) in contact.friction.iter().zip(contact.friction_ns) {
                row.push(weighted, impulse_ns);
            }
        }
        self.stops.iter().for_each(|it| it.row.push(weighted, it.impulse_ns));
        self.unilaterals().for_each(|it| it.meets = it.impulse_ns == 0.0);
        self.sweep(weighted, Unilateral::press);
        moved(&masses.unweighted(weighted));
        let step_s = self.step_s;
        for it in self.unilaterals() {
            it.gap_m += it.row.velocity(weighted) * step_s;
        }
        self.sweep(weighted, Unilateral::relax);
        *velocities = masses.unweighted(weighted);
        for it in self.unilaterals() {
            it.total_ns += it.impulse_ns;
        }
    }

    /// Passes over all contacts until none changes a velocity any more.
    fn sweep(&mut self, velocities: &mut Velocities, pass: fn(&mut Unilateral, &mut Velocities, f64) -> f64) {
        let (step_s, friction) = (self.step_s, self.friction);
        for _ in 0..MOST_SWEEPS {
            let rubbed = |Contact { friction: rows, friction_ns, normal, .. }: &mut Contact| {
                rub(rows, friction_ns, velocities, friction * normal.impulse_ns)
            };
            let rubbed_mps = self.contacts.iter_mut().map(rubbed).fold(0.0, f64::max);
            let pushed_mps = self.unilaterals().map(|it| pass(it, velocities, step_s)).fold(0.0, f64::max);
            if rubbed_mps.max(pushed_mps) < SAME_MPS {
                break;
            }
        }
    }

    fn unilaterals(&mut self) -> impl Iterator<Item = &mut Unilateral> {
        self.stops.iter_mut().chain(self.contacts.iter_mut().map(|it| &mut it.normal))
    }
}
