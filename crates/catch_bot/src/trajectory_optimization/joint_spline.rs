//! The motion of one joint as a cubic B-spline whose control points solve a quadratic program (paper, III-D).
//!
//! With the catch's time and the joint's position and velocity there given, nothing couples the joints any
//! more: the paper's optimization falls apart into one small program per joint. In normalized time τ = t/T
//!
//! ```text
//!     min   ∫ q″(τ)² dτ + λ ∫ (q(τ) − q₀)² dτ + μ · (q″ at the last knots)²
//!     s.t.  q, q′, q″ at the start as they are; q and q′ at the end as chosen
//!           q_min ≤ q ≤ q_max,   |q′| ≤ v_max·T,   |q″| ≤ a_max·T²,   |q‴| ≤ j_max·T³ where there is a limit
//! ```
//! Bounds are put on the control points of q, q′, q″ and q‴. The hull property makes them sufficient
//! everywhere; for q″, which is piecewise linear, and q‴, which is piecewise constant, they are exact. The
//! last term keeps the gripper's velocity steady before the catch: the paper's pre-grasp constraints, 30 ms
//! before the grasp, in a form that cannot make the problem infeasible.

mod bounded;
mod ends;

use catch_body::{
    quadratic_program::{Hessian, MAX_VARIABLES, ProgramFailure, Row, Square, Variables},
    robot::JointLimits,
};
use catch_cell::spline::{DEGREE, basis};

use bounded::{Bounded, Combination, Quantity};

pub use ends::{End, EndKind, Ends, JointState, Onset};

/// Most control points of one spline.
const MAX_POINTS: usize = 16;

/// Control points of one joint; those beyond the spline's number are zero.
pub type JointPoints = [f64; MAX_POINTS];

/// Control points of the velocity that lie shortly before the end, and at it: two spans.
const LAST_VELOCITIES: usize = 3;

/// Weight on the velocity at the end where nothing but it matters: above it the limits alone decide.
const EXTREME: f64 = 1e4;

/// The quadratic program with everything that does not depend on the joint, factorized.
#[derive(Debug, Clone)]
pub struct JointSpline {
    /// Knots in normalized time.
    pub knots: Vec<f64>,
    /// Number of control points.
    pub control_points: usize,
    ends: Ends,
    /// Bounded quantities that do not depend on the free variables, and those that do, with their rows over
    /// them.
    given: Vec<Bounded>,
    bounded: Vec<Bounded>,
    rows: Vec<Row>,
    /// Rows before those of the jerk, which come last: arms without such a limit leave them out.
    rows_without_jerk: usize,
    /// Velocity and acceleration at the end.
    last: [Combination; 2],
    /// Cost over control points, variable by variable, for the gradient.
    cost_rows: Vec<Combination>,
    pulls: Vec<f64>,
    hessian: Hessian,
}

/// Bounds of each quantity of a motion of this duration, in units of the duration.
fn ranges(end: &End, duration_s: f64, limits: &JointLimits) -> impl Fn(Quantity) -> [f64; 2] {
    let (velocity, acceleration) = (limits.velocity * duration_s, limits.acceleration * duration_s * duration_s);
    let jerk = limits.jerk.map_or(f64::INFINITY, |it| it * duration_s.powi(3));
    let unbounded = [f64::NEG_INFINITY, f64::INFINITY];
    let (last, last_speed) = match end {
        End::At { ddq, last_speed, .. } => (ddq.map(|it| it * duration_s * duration_s), *last_speed),
        End::Extreme { last_speed, .. } => (unbounded, *last_speed),
        End::Rest => (unbounded, limits.velocity),
    };
    let (position, last_velocity) = ([limits.lower, limits.upper], velocity.min(last_speed * duration_s));
    move |of| match of {
        Quantity::Position => position,
        Quantity::Velocity => [-velocity, velocity],
        Quantity::LastVelocity => [-last_velocity, last_velocity],
        Quantity::Acceleration => [-acceleration, acceleration],
        Quantity::LastAcceleration => last,
        Quantity::Jerk => [-jerk, jerk],
    }
}

impl JointSpline {
    /// A spline over spans of the given relative lengths. `comfort_weight` is λ, `steady_end_weight` μ.
    ///
    /// # Panics
    /// With more spans than there is room for: the layouts are constants of this crate.
    pub fn new(spans: &[f64], ends: Ends, comfort_weight: f64, steady_end_weight: f64) -> Self {
        let knots = clamped_knots(spans);
        let control_points = spans.len() + DEGREE;
        assert!(control_points <= MAX_POINTS, "too many spans");

        let identity: Vec<Combination> =
            (0..control_points).map(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)))).collect();
        let velocity = differentiated(&identity, &knots, DEGREE);
        let acceleration = differentiated(&velocity, &knots[1..knots.len() - 1], DEGREE - 1);
        let jerk = differentiated(&acceleration, &knots[2..knots.len() - 2], DEGREE - 2);

        let (mut cost, comfort) = integrals(&knots, control_points, comfort_weight);
        if ends.end == EndKind::At {
            for combination in &acceleration[acceleration.len() - 2..] {
                for i in 0..control_points {
                    for j in 0..control_points {
                        cost[i][j] += steady_end_weight * combination[i] * combination[j];
                    }
                }
            }
        }

        let mut spline = Self {
            knots,
            control_points,
            ends,
            given: Vec::new(),
            bounded: Vec::new(),
            rows: Vec::new(),
            rows_without_jerk: 0,
            last: [velocity[velocity.len() - 1], acceleration[acceleration.len() - 1]],
            cost_rows: Vec::new(),
            pulls: Vec::new(),
            hessian: Hessian::new(&Square::identity()).expect("the identity is positive definite"),
        };
        assert!(spline.free() <= MAX_VARIABLES, "too many spans");
        spline.bound(&identity, &velocity, &acceleration, &jerk);
        let cost_row = |variable| std::array::from_fn(|j| spline.lifted(variable).map(|i| cost[i][j]).sum());
        spline.cost_rows = (0..spline.free()).map(cost_row).collect();
        spline.pulls = (0..spline.free()).map(|variable| spline.lifted(variable).map(|i| comfort[i]).sum()).collect();
        let mut H = Square::identity();
        for variable in 0..spline.free() {
            let row = reduced(&spline.cost_rows[variable], &spline);
            for other in 0..spline.free() {
                H[(variable, other)] = row[other];
            }
        }
        spline.hessian = Hessian::new(&H).expect("the cost of a spline is strictly convex");
        spline
    }

    /// Notes what the limits bound: the control points of the position and of its derivatives, those of the
    /// jerk last.
    fn bound(
        &mut self,
        position: &[Combination],
        velocity: &[Combination],
        acceleration: &[Combination],
        jerk: &[Combination],
    ) {
        let ends = self.ends;
        let last = acceleration[acceleration.len() - 1];
        let quantities = position
            .iter()
            .map(|it| Bounded::new(*it, Quantity::Position))
            .chain(velocity.iter().enumerate().map(|(i, it)| {
                let is_last = ends.end != EndKind::Rest && i + LAST_VELOCITIES >= velocity.len();
                Bounded::new(*it, if is_last { Quantity::LastVelocity } else { Quantity::Velocity })
            }))
            .chain(acceleration.iter().map(|it| Bounded::new(*it, Quantity::Acceleration)))
            .chain((ends.end == EndKind::At).then(|| Bounded::new(last, Quantity::LastAcceleration)))
            .chain(jerk.iter().map(|it| Bounded::new(*it, Quantity::Jerk)));
        for quantity in quantities {
            let row = Row::new(reduced(&quantity.combination, self));
            // The lifted end of a spline at rest is one and the same point, bounded once.
            if row.is_zero() {
                self.given.push(quantity);
            } else {
                self.bounded.push(quantity);
                self.rows.push(row);
            }
        }
        self.rows_without_jerk = self.bounded.iter().filter(|it| it.of != Quantity::Jerk).count();
    }

    /// Control points of the best motion of a joint over `duration_s`.
    ///
    /// # Errors
    /// If no spline of this kind keeps the limits, or none was found that does.
    pub fn solve(
        &self,
        start: &JointState,
        end: &End,
        duration_s: f64,
        limits: &JointLimits,
        comfortable: f64,
    ) -> Result<JointPoints, ProgramFailure> {
        let fixed = self.fixed_points(start, end, duration_s);
        let mut gradient = Variables::zeros();
        for variable in 0..self.free() {
            gradient[variable] = dot(&self.cost_rows[variable], &fixed) - comfortable * self.pulls[variable];
        }
        if let End::Extreme { sign, .. } = end {
            // Of a clamped spline q′ = 3·(cₙ₋₁ − cₙ₋₂)/h: the higher the last free point, the lower the
            // velocity.
            gradient[self.free() - 1] += sign * EXTREME;
        }

        let range = ranges(end, duration_s, limits);
        // Quantities without free variables keep their bounds, or no motion does.
        let holds = self.given.iter().all(|quantity| {
            let ([low, high], value) = (range(quantity.of), quantity.dot(&fixed));
            let rounding = 1e-9 * (1.0 + value.abs());
            value >= low - rounding && value <= high + rounding
        });
        if !holds {
            return Err(ProgramFailure::Infeasible);
        }
        let count = if limits.jerk.is_some() { self.rows.len() } else { self.rows_without_jerk };
        let mut bounds = [[0.0; 2]; 4 * MAX_POINTS];
        for (bound, quantity) in bounds.iter_mut().zip(&self.bounded[..count]) {
            let offset = quantity.dot(&fixed);
            *bound = range(quantity.of).map(|it| it - offset);
        }
        let x = if let End::Extreme { onset: Some(onset), .. } = end {
            // q̈ + q̇/d in ± v/d, times T².
            let fraction = duration_s / onset.duration_s;
            let both: Combination = std::array::from_fn(|i| self.last[1][i] + self.last[0][i] * fraction);
            let (most, offset) = (onset.velocity * duration_s * fraction, dot(&both, &fixed));
            bounds[count] = [-most - offset, most - offset];
            let mut rows = [Row::new(Variables::zeros()); 4 * MAX_POINTS];
            rows[..count].copy_from_slice(&self.rows[..count]);
            rows[count] = Row::new(reduced(&both, self));
            self.hessian.minimize(&gradient, &rows[..=count], &bounds[..=count], 0)?
        } else {
            self.hessian.minimize(&gradient, &self.rows[..count], &bounds[..count], 0)?
        };
        let mut points = fixed;
        for variable in 0..self.free() {
            for index in self.lifted(variable) {
                points[index] += x[variable];
            }
        }
        Ok(points)
    }

    /// Velocity at the end of the best motion.
    ///
    /// # Errors
    /// Those of [`solve`](Self::solve).
    pub fn end_velocity(
        &self,
        start: &JointState,
        end: &End,
        duration_s: f64,
        limits: &JointLimits,
    ) -> Result<f64, ProgramFailure> {
        let points = self.solve(start, end, duration_s, limits, start.q)?;
        let h = (1.0 - self.knots[self.control_points - 1]) * duration_s;
        Ok((points[self.control_points - 1] - points[self.control_points - 2]) * DEGREE as f64 / h)
    }

    /// Control points that the start dictates.
    fn given_at_start(&self) -> usize {
        if self.ends.start_acceleration { 3 } else { 2 }
    }

    fn free(&self) -> usize {
        let given_at_end = if self.ends.end == EndKind::Position { 1 } else { 2 };
        self.control_points - self.given_at_start() - given_at_end
    }

    /// The control points that a variable moves: one, or, at an end at rest, the last three together.
    fn lifted(&self, variable: usize) -> std::ops::Range<usize> {
        let first = variable + self.given_at_start();
        let rests = self.ends.end == EndKind::Rest && variable + 1 == self.free();
        first..if rests { self.control_points } else { first + 1 }
    }

    /// The control points that start and end dictate; the free ones are zero.
    fn fixed_points(&self, start: &JointState, end: &End, duration_s: f64) -> [f64; MAX_POINTS] {
        let mut points = [0.0; MAX_POINTS];
        let knots = &self.knots;
        // End derivatives of a clamped spline: q′ = 3·(c₁ − c₀)/h₁ and q″ = 2·(q′₁ − q′₀)/h₁ with q′₁ = 3·(c₂
        // − c₁)/h₂, where h₁ is the first span and h₂ the first two (Piegl & Tiller, eq. 3.7).
        let [h1, h2] = [knots[4], knots[5]];
        let (dq, ddq) = (start.dq * duration_s, start.ddq * duration_s * duration_s);
        points[0] = start.q;
        points[1] = start.q + dq * h1 / 3.0;
        if self.ends.start_acceleration {
            points[2] = points[1] + (dq + ddq * h1 / 2.0) * h2 / 3.0;
        }
        match end {
            End::At { q, dq, .. } => {
                let h = 1.0 - knots[self.control_points - 1];
                points[self.control_points - 1] = *q;
                points[self.control_points - 2] = q - dq * duration_s * h / 3.0;
            }
            End::Extreme { q, .. } => points[self.control_points - 1] = *q,
            End::Rest => {}
        }
        points
    }
}

/// Knots from 0 to 1 of a spline that begins and ends in its control points, over spans of these relative
/// lengths.
fn clamped_knots(spans: &[f64]) -> Vec<f64> {
    let total: f64 = spans.iter().sum();
    let mut knots = vec![0.0; DEGREE + 1];
    let mut at = 0.0;
    for span in spans {
        at += span / total;
        knots.push(at);
    }
    let last = knots.len() - 1;
    knots[last] = 1.0;
    knots.extend([1.0; DEGREE]);
    knots
}

/// Nodes and weights of Gauss–Legendre with four points, which integrates degree 7: exact for the square of a
/// cubic.
const NODES: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
    (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
];

/// ∫ (q″)² + λ·q² over the control points as a quadratic form, and ∫ λ·q as a linear one.
fn integrals(
    knots: &[f64],
    points: usize,
    comfort_weight: f64,
) -> ([[f64; MAX_POINTS]; MAX_POINTS], [f64; MAX_POINTS]) {
    let mut cost = [[0.0; MAX_POINTS]; MAX_POINTS];
    let mut comfort = [0.0; MAX_POINTS];
    for pair in knots[DEGREE..=points].windows(2) {
        for (node, weight) in NODES {
            let half = (pair[1] - pair[0]) / 2.0;
            let (first, [values, _, second]) = basis(knots, pair[0] + half * (1.0 + node));
            for i in 0..=DEGREE {
                comfort[first + i] += comfort_weight * weight * half * values[i];
                for j in 0..=DEGREE {
                    let product = second[i] * second[j] + comfort_weight * values[i] * values[j];
                    cost[first + i][first + j] += weight * half * product;
                }
            }
        }
    }
    (cost, comfort)
}

/// A combination of control points as one of the free variables.
fn reduced(combination: &Combination, spline: &JointSpline) -> Variables {
    let mut variables = Variables::zeros();
    for variable in 0..spline.free() {
        variables[variable] = spline.lifted(variable).map(|i| combination[i]).sum();
    }
    variables
}

fn dot(combination: &Combination, points: &[f64; MAX_POINTS]) -> f64 {
    combination.iter().zip(points).map(|(a, b)| a * b).sum()
}

/// Control points of the derivative of a spline of degree `degree` over `knots`: cᵢ′ = d·(cᵢ₊₁ − cᵢ)/(tᵢ₊d₊₁
/// − tᵢ₊₁).
fn differentiated(points: &[Combination], knots: &[f64], degree: usize) -> Vec<Combination> {
    points
        .windows(2)
        .enumerate()
        .map(|(i, pair)| {
            let factor = degree as f64 / (knots[i + degree + 1] - knots[i + 1]);
            std::array::from_fn(|j| factor * (pair[1][j] - pair[0][j]))
        })
        .collect()
}
