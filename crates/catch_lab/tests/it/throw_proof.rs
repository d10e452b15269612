//! Proofs that a whole throw is out of reach: at every time, in every orientation of the gripper, over all
//! redundancy.
//!
//! Branch and bound over times and joint positions. A *piece* is an interval of times and one of positions
//! for each joint. There is no catch in it if one of two things that every catch has cannot be had anywhere
//! in it:
//!
//! * *place*: the grasp centre is where the object is, p_G(q) = p_O(t). With the Jacobian's columns Jᵢ at the
//!   piece's middle, its half widths Δ and Cⱼ ≥ |Jⱼ| anywhere in it,
//!
//!   ```text p_G(q) = p_G + Σ Jᵢ·δqᵢ + e, |e| ≤ ½ Σᵢⱼ C_max(i,j)·Δᵢ·Δⱼ, |∂Jᵢ/∂qⱼ| ≤ C_max(i,j) ``` since
//!   ∂Jᵢ/∂qⱼ = zᵢ × Jⱼ for i ≤ j. Along any direction this also narrows each joint to what the others can
//!   make up for.
//! * *velocity*: J·q̇ = s·v_O with 0 ≤ s ≤ s_max, and for each joint the velocities that it can have on
//!   arrival ([`reachability`](catch_bot::trajectory_optimization::reachability)). A direction λ separates
//!   both sides if max λᵀ·J·q̇ < min λᵀ·s·v_O over the piece.
//!
//! What is left is halved. Torque, the arm itself, the floor and the object's shape bar more, and are not
//! asked.

use catch_body::{JointVector, MAX_JOINTS, dynamics::gravity, robot::Jacobian};
use catch_bot::{
    trajectory_optimization::{
        MAX_SPEED_FRACTION, MotionPlanner, Start,
        motion::LimitScaling,
        reachability::{Interval, ReachableSet},
    },
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::arm::Setpoint;
use catch_paper::unreachable::shortfall;
use nalgebra::{Point3, Vector3};

/// Times of the first pieces, in seconds.
const FIRST_PIECE_S: f64 = 0.01;
/// Velocities of joints and places are bounded a little generously, for rounding, in rad/s and metres.
const ROUNDING_RADPS: f64 = 1e-9;
const ROUNDING_M: f64 = 1e-9;
/// Index of the time among the unknowns, after the joints.
const TIME: usize = MAX_JOINTS;
/// Unknowns: joints and time.
const UNKNOWNS: usize = MAX_JOINTS + 1;

/// Result of a proof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ThrowProof {
    /// There is no catch.
    OutOfReach {
        /// Pieces that were looked at.
        pieces: usize,
    },
    /// There may be one: when all pieces that were allowed had been looked at, this was left.
    Open {
        /// Middle time of the box.
        catch_s: f64,
        /// Middle joint positions of the box.
        q: JointVector,
    },
}

/// A catch of whatever kind: the grasp centre meets the object's centre and moves along with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnyCatch<'a> {
    /// Flight of the object.
    pub flight: &'a FlightTrajectory,
    /// Earliest and latest time of the catch, in seconds.
    pub times_s: [f64; 2],
    /// The centres are at most this far from each other, in metres.
    pub within_m: f64,
}

/// Tries to prove that the arm, at rest at `q` until `start_s`, can make no catch after that within its
/// position, velocity and acceleration limits. It gives up with the first piece beyond `most_pieces` that may
/// hold one.
///
/// # Panics
/// If the times are not finite or not in order.
pub fn prove_out_of_reach(
    planner: &MotionPlanner,
    start_s: f64,
    q: &JointVector,
    any: &AnyCatch<'_>,
    most_pieces: usize,
) -> ThrowProof {
    let at_rest = Start { time_s: start_s, state: Setpoint::at_rest(*q) };
    let proof = Proof { planner, start: &at_rest, any };
    let [begin_s, end_s] = any.times_s;
    assert!(begin_s.is_finite() && end_s.is_finite() && begin_s <= end_s, "times in order: {:?}", any.times_s);
    let mut begin_s = begin_s.max(start_s);
    let mut pieces = 0;
    let mut left = Vec::new();
    while begin_s <= end_s {
        let until_s = (begin_s + FIRST_PIECE_S).min(end_s);
        let mut piece = [Interval { low: f64::NEG_INFINITY, high: f64::INFINITY }; UNKNOWNS];
        piece[TIME] = Interval { low: begin_s, high: until_s };
        left.push(piece);
        while let Some(piece) = left.pop() {
            pieces += 1;
            let Some((piece, longest)) = proof.narrowed(piece) else { continue };
            let middle = piece.map(|it| it.middle());
            if pieces >= most_pieces {
                return ThrowProof::Open { catch_s: middle[TIME], q: JointVector::from_fn(|i, _| middle[i]) };
            }
            let mut halves = [piece; 2];
            halves[0][longest].high = middle[longest];
            halves[1][longest].low = middle[longest];
            left.extend(halves);
        }
        // The last piece ends with the times, which may be an instant.
        begin_s = if until_s < end_s { until_s } else { f64::INFINITY };
    }
    ThrowProof::OutOfReach { pieces }
}

/// Times and joint positions.
type Piece = [Interval; UNKNOWNS];

/// The arm in the middle of a piece, and how much changes within it.
struct Middle {
    J: Jacobian,
    p_G: Point3<f64>,
    /// Half of the piece's width in each unknown, Δ.
    half: [f64; UNKNOWNS],
    /// Bounds of the Jacobian's columns, C.
    columns: [f64; MAX_JOINTS],
}

/// The object around the middle time of a piece.
struct Flown {
    p: Vector3<f64>,
    v: Vector3<f64>,
    /// A bound on its acceleration.
    acceleration: f64,
}

struct Proof<'a> {
    planner: &'a MotionPlanner,
    start: &'a Start,
    any: &'a AnyCatch<'a>,
}

impl Proof<'_> {
    /// Returns the part of a box that may hold a catch, and the unknown that moves most in it.
    fn narrowed(&self, mut piece: Piece) -> Option<(Piece, usize)> {
        // From rest, who can arrive somewhere at some velocity can do so later: waiting first.
        let from = &self.start.state.q;
        let scaling = LimitScaling { velocity: 1.0, acceleration: 1.0 };
        let reaches = self.planner.reaches(self.start, piece[TIME].high - self.start.time_s, scaling);
        for i in 0..MAX_JOINTS {
            let Some(joint) = self.planner.robot.joints.get(i) else {
                piece[i] = Interval { low: 0.0, high: 0.0 };
                continue;
            };
            let (limits, far) = (&joint.limits, reaches[i].displacements());
            let able =
                Interval { low: limits.lower.max(from[i] + far.low), high: limits.upper.min(from[i] + far.high) };
            piece[i] = piece[i].intersection(&able);
            if piece[i].is_empty() {
                return None;
            }
        }
        let (middle, flown) = (self.middle(&piece), self.flown(&piece[TIME]));
        let piece = self.where_the_object_is(&piece, &middle, &flown)?;
        if self.cannot_move_along(&piece, &middle, &flown, &reaches) {
            return None;
        }
        let moved = |i: usize| piece[i].half_width() * if i == TIME { flown.v.norm() } else { middle.columns[i] };
        let longest = (0..UNKNOWNS).max_by(|&a, &b| moved(a).total_cmp(&moved(b)))?;
        Some((piece, longest))
    }

    fn middle(&self, piece: &Piece) -> Middle {
        let robot = &self.planner.robot;
        let q = JointVector::from_fn(|i, _| piece[i].middle());
        let half = piece.map(|it| it.half_width());
        let X_WL = robot.link_poses(&q);
        let p_G = robot.gripper_in(&X_WL) * self.planner.gripper.grasp_centre();
        let J = robot.jacobian(&X_WL, &p_G);
        // The length of a column is changed by the joints after it only, by no more than their columns each.
        let (mut columns, mut changed) = ([0.0; MAX_JOINTS], 0.0);
        for i in (0..robot.dof()).rev() {
            columns[i] = J.fixed_view::<3, 1>(3, i).norm() + changed;
            changed += half[i] * columns[i];
        }
        Middle { J, p_G, half, columns }
    }

    fn flown(&self, times_s: &Interval) -> Flown {
        let (flight, time_s) = (self.any.flight, times_s.middle());
        let (p, v) = (flight.pose_at(time_s).translation.vector, flight.twist_at(time_s).linear);
        let margin = 0.5 + 0.05 * v.norm();
        let acceleration = gravity().norm() + flight.drag_per_m.abs() * (v.norm() + margin).powi(2);
        // True unless the object becomes faster than that meanwhile.
        let holds = acceleration * times_s.half_width() < margin;
        Flown { p, v, acceleration: if holds { acceleration } else { f64::INFINITY } }
    }

    /// The part of a piece where the grasp centre may be at the object.
    fn where_the_object_is(&self, piece: &Piece, middle: &Middle, flown: &Flown) -> Option<Piece> {
        let half = &middle.half;
        let mut error = self.any.within_m + ROUNDING_M + 0.5 * flown.acceleration * half[TIME] * half[TIME];
        for j in 0..MAX_JOINTS {
            let before: f64 = half[..j].iter().sum();
            error += middle.columns[j] * half[j] * (before + 0.5 * half[j]);
        }
        let gap = middle.p_G.coords - flown.p;
        let mut aside = half.map(|it| Interval { low: -it, high: it });
        let toward = gap.try_normalize(1e-9).unwrap_or(Vector3::x());
        for along in [toward, Vector3::x(), Vector3::y(), Vector3::z()] {
            let mut row = [-along.dot(&flown.v); UNKNOWNS];
            for (i, it) in row[..MAX_JOINTS].iter_mut().enumerate() {
                *it = along.dot(&middle.J.fixed_view::<3, 1>(3, i));
            }
            let off = along.dot(&gap);
            narrow(&row, Interval { low: off - error, high: off + error }, &mut aside)?;
        }
        Some(std::array::from_fn(|i| {
            let at = piece[i].middle();
            Interval { low: at + aside[i].low, high: at + aside[i].high }
        }))
    }

    /// Returns whether no joint velocity that is possible at the catch moves the grasp centre along with the
    /// object.
    fn cannot_move_along(
        &self,
        piece: &Piece,
        middle: &Middle,
        flown: &Flown,
        reaches: &[ReachableSet; MAX_JOINTS],
    ) -> bool {
        let bounds = std::array::from_fn(|i| {
            let far = reaches[i].displacements();
            let at = |q: f64| reaches[i].terminal_velocities((q - self.start.state.q[i]).clamp(far.low, far.high));
            // Both ends rise with the displacement.
            Interval { low: at(piece[i].low).low - ROUNDING_RADPS, high: at(piece[i].high).high + ROUNDING_RADPS }
        });
        let Some(lambda) = shortfall(&middle.J, &flown.v, &bounds) else { return false };
        let (half, columns) = (&middle.half, &middle.columns);
        let reached: f64 = (0..MAX_JOINTS)
            .map(|i| {
                let varied: f64 = (0..MAX_JOINTS).map(|k| half[k] * columns[i.max(k)]).sum();
                let along = lambda.dot(&middle.J.fixed_view::<3, 1>(3, i));
                let fastest = bounds[i].low.abs().max(bounds[i].high.abs());
                scaled(&bounds[i], along).high + varied * lambda.norm() * fastest
            })
            .sum();
        let faster = flown.acceleration * half[TIME] * lambda.norm();
        reached < (MAX_SPEED_FRACTION * (lambda.dot(&flown.v) - faster)).min(0.0)
    }
}

/// Interval of the values times `factor`.
fn scaled(values: &Interval, factor: f64) -> Interval {
    let ends = [factor * values.low, factor * values.high];
    Interval { low: ends[0].min(ends[1]), high: ends[0].max(ends[1]) }
}

/// Narrows unknowns to where `Σ rowᵢ·xᵢ + rest` can be zero; `None` if nowhere.
fn narrow(row: &[f64; UNKNOWNS], rest: Interval, unknowns: &mut [Interval; UNKNOWNS]) -> Option<()> {
    /// Coefficients below this are no help.
    const SMALL: f64 = 1e-6;
    const ROUNDING: f64 = 1e-12;
    let terms: [Interval; UNKNOWNS] = std::array::from_fn(|i| scaled(&unknowns[i], row[i]));
    let low: f64 = rest.low + terms.iter().map(|it| it.low).sum::<f64>();
    let high: f64 = rest.high + terms.iter().map(|it| it.high).sum::<f64>();
    if low > 0.0 || high < 0.0 {
        return None;
    }
    for ((coefficient, term), unknown) in row.iter().zip(&terms).zip(unknowns) {
        if coefficient.abs() > SMALL {
            // Interval that all other unknowns leave to it.
            let left = scaled(&Interval { low: term.high - high, high: term.low - low }, 1.0 / coefficient);
            *unknown = unknown.intersection(&Interval { low: left.low - ROUNDING, high: left.high + ROUNDING });
            if unknown.is_empty() {
                return None;
            }
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_bot::trajectory_optimization::Config;
    use catch_lab::planner_cases;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// A catch that there is stays in every piece that holds it, however large or small: at a place that
        /// the joints can reach, moving along at the highest velocities that they can have there, which is
        /// lost first.
        #[test]
        fn a_catch_is_never_lost(
            ways in prop::array::uniform7(0.0f64..=1.0), toward in prop::array::uniform3(-1.0f64..=1.0),
            fraction in 0.1f64..2.0, lead_s in 0.1f64..0.9, drag_per_m in -0.05f64..0.05,
            smallness in 0.0f64..14.0, sizes in prop::array::uniform8(-4.0f64..1.0),
            asides in prop::array::uniform8(0.0f64..=1.0),
        ) {
            let (robot, gripper) = planner_cases::arm(None, ("test", "robot")).unwrap();
            let planner = MotionPlanner::new(robot, gripper, Config::default());
            let start = Start { time_s: 0.05, state: Setpoint::at_rest(planner.robot.ready_q) };
            let (from, catch_s) = (start.state.q, start.time_s + lead_s);
            let reaches = planner.reaches(&start, lead_s, LimitScaling { velocity: 1.0, acceleration: 1.0 });
            let mut q = from;
            for (i, joint) in planner.robot.joints.iter().enumerate() {
                let far = reaches[i].displacements();
                let (low, high) = (far.low.max(joint.limits.lower - q[i]), far.high.min(joint.limits.upper - q[i]));
                q[i] += low + ways[i] * (high - low);
            }
            let X_WL = planner.robot.link_poses(&q);
            let p_WOcm = planner.robot.gripper_in(&X_WL) * planner.gripper.grasp_centre();
            let J = planner.robot.jacobian(&X_WL, &p_WOcm).fixed_rows::<3>(3).into_owned();
            let dq = JointVector::from_fn(|i, _| {
                let fast = reaches[i].terminal_velocities(q[i] - from[i]);
                if J.column(i).dot(&Vector3::from(toward)) > 0.0 { fast.high } else { fast.low }
            });
            let v_WOcm = J * dq / (fraction.min(1.0) * MAX_SPEED_FRACTION);
            let flight = FlightTrajectory { time_s: catch_s, p_WOcm, v_WOcm, drag_per_m, ..FlightTrajectory::default() };

            let any = AnyCatch { flight: &flight, times_s: [0.0, 1.0], within_m: 0.0 };
            let proof = Proof { planner: &planner, start: &start, any: &any };
            let catch: [f64; UNKNOWNS] = std::array::from_fn(|i| if i == TIME { catch_s } else { q[i] });
            let mut piece = catch.map(|at| Interval { low: at, high: at });
            for (k, i) in (0..planner.robot.dof()).chain([TIME]).enumerate() {
                let most = if i == TIME { FIRST_PIECE_S } else { libm::exp2(-smallness) };
                let size = most * libm::exp2(sizes[k].min(0.0));
                piece[i] = Interval { low: catch[i] - asides[k] * size, high: catch[i] + (1.0 - asides[k]) * size };
            }
            let Some((left, _)) = proof.narrowed(piece) else { return Err(TestCaseError::fail("the catch is lost")) };
            for i in 0..UNKNOWNS {
                prop_assert!(left[i].low <= catch[i] + 1e-9 && catch[i] <= left[i].high + 1e-9, "{i}: {left:?}");
            }
        }
    }
}
