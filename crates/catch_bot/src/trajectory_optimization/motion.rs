//! A whole motion: to the catch, then braking to rest, within every limit.

use catch_body::{JointVector, robot::JointLimits, shape::Cuboid};
use catch_cell::{BSpline, Setpoint, executor::CONTINUITY, spline::DEGREE};

use super::{
    MotionPlanner, Start,
    failure_counter::FailureCounter,
    joint_spline::{End, JointPoints, JointState},
};
use crate::grasp_selection::Grasp;

/// Distance from the acceleration limits that rounding needs, relative.
pub const ROUNDING: f64 = 1e-7;
/// Distance from the position limits that rounding needs, in radians.
const HULL_ROUNDING: f64 = 1e-9;

/// Fractions of the limits that a replan uses where that is enough, so that the next one keeps some room; the
/// paper's method uses no more from rest.
pub(super) const REPLAN_SCALING: LimitScaling = LimitScaling { velocity: 0.95, acceleration: 0.9 };
/// Braking after the catch uses this fraction of the acceleration limits when its duration is chosen; the
/// spline needs room to ramp.
pub(super) const BRAKING_ACCELERATION_FRACTION: f64 = 0.5;
/// Shortest braking in seconds.
const MIN_BRAKING_S: f64 = 0.2;
/// Longest braking in seconds: no joint is faster at the catch than this allows. What is caught must be at
/// rest 0.5 s after the first contact, which may be a little before the catch.
const MAX_BRAKING_S: f64 = 0.45;
/// Fraction of the hand's speed limit that a motion uses where it is looked at.
const HAND_SPEED_FRACTION: f64 = 0.98;
/// Samples between two knots at which velocities are checked, as fractions; the last knot is at rest.
const SPAN_SAMPLES: [f64; 4] = [0.0, 0.25, 0.5, 0.75];

/// Fractions of the velocity and acceleration limits that a motion may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitScaling {
    /// Fraction of the velocity limits.
    pub velocity: f64,
    /// Fraction of the acceleration limits.
    pub acceleration: f64,
}

impl LimitScaling {
    /// Interpolates between these fractions (0) and `other` (1).
    pub(super) fn toward(self, other: Self, by: f64) -> Self {
        let between = |from: f64, to: f64| from + by * (to - from);
        Self {
            velocity: between(self.velocity, other.velocity),
            acceleration: between(self.acceleration, other.acceleration),
        }
    }
}

impl MotionPlanner {
    /// Scaling of the limits for an arm in motion: all there is.
    pub(super) fn moving_scaling(&self) -> LimitScaling {
        LimitScaling { velocity: self.config.velocity_scaling, acceleration: 1.0 - ROUNDING }
    }

    /// The motion to the catch over these control points, and braking after it, which still have to be
    /// [safe](Self::is_safe); `None` if it cannot brake.
    pub(super) fn through(
        &self,
        start_s: f64,
        catch_s: f64,
        control_points: Vec<JointVector>,
        failures: &FailureCounter,
    ) -> Option<BSpline> {
        let knots_s = self.catch_splines.at.knots.iter().map(|knot| start_s + knot * (catch_s - start_s)).collect();
        let to_catch = BSpline { knots_s, control_points };
        let braking = self.braking(&end_of(&to_catch), catch_s, failures)?;
        Some(to_catch.followed_by(&braking))
    }

    /// A motion that ends at a catch, and braking after it; `None` if both do not keep the torque limits and
    /// the clearances. Where braking cannot take over the acceleration at the catch it starts without any.
    pub fn completed(&self, to_catch: BSpline, grasp: &Grasp, failures: &FailureCounter) -> Option<BSpline> {
        let (catch_s, end) = (to_catch.end_s(), end_of(&to_catch));
        let anew = Setpoint { q: end.q, dq: end.dq, ddq: JointVector::zeros() };
        // The acceleration just before the jump is that of no later instant.
        let stops_anew = || self.keeps_torque(&to_catch).then(|| self.braking(&anew, catch_s, failures)).flatten();
        let braking = self.braking(&end, catch_s, failures).or_else(stops_anew)?;
        let trajectory = to_catch.followed_by(&braking);
        self.is_safe(&trajectory, catch_s, grasp).then_some(trajectory)
    }

    /// Time that the first control point of braking from `dq` reaches ahead, in seconds: the braking spline's
    /// first span takes up the acceleration at the catch, and its first velocity control point, q̇ + q̈·h/2,
    /// must keep the velocity limit too.
    pub(super) fn braking_onset_s(&self, dq: &JointVector) -> f64 {
        self.brake_spline.knots[DEGREE + 1] * self.braking_s(dq) / 2.0
    }

    /// Braking from `state` to rest within the joint limits and torques, as quickly as is comfortable.
    pub fn braking(&self, state: &Setpoint, start_s: f64, failures: &FailureCounter) -> Option<BSpline> {
        // Braking begins with the state's own acceleration.
        if !self.keeps_torque_at([state.q, state.dq, state.ddq]) {
            return None;
        }
        let shortest_s = self.braking_s(&state.dq);
        let most_s = MAX_BRAKING_S.max(shortest_s);
        let durations_s = std::iter::successors(Some(shortest_s), |duration_s| Some(duration_s * 1.3)).take(4);
        let over = |duration_s: f64| self.braking_over(state, start_s, duration_s.min(most_s), failures);
        durations_s.filter_map(over).find(|braking| self.keeps_torque(braking))
    }

    /// Duration of braking from `dq`, in seconds.
    fn braking_s(&self, dq: &JointVector) -> f64 {
        (0..self.robot.dof())
            .map(|i| {
                let (acceleration, onset_s) = self.braking_by(&self.robot.joints[i].limits);
                dq[i].abs() / acceleration + onset_s
            })
            .fold(MIN_BRAKING_S, f64::max)
    }

    /// The acceleration by which a joint brakes when the duration is chosen, and the time that it takes to
    /// build up and to vanish.
    fn braking_by(&self, limits: &JointLimits) -> (f64, f64) {
        let acceleration = BRAKING_ACCELERATION_FRACTION * limits.acceleration;
        (acceleration, limits.jerk.map_or(0.0, |jerk| limits.acceleration / jerk))
    }

    /// The highest speed from which a joint brakes in the longest time that there is.
    pub(super) fn max_speed_to_brake_from(&self, limits: &JointLimits) -> f64 {
        let (acceleration, onset_s) = self.braking_by(limits);
        acceleration * (MAX_BRAKING_S - onset_s).max(0.0)
    }

    /// Braking in `duration_s`: one spline per joint, put together.
    fn braking_over(
        &self,
        state: &Setpoint,
        start_s: f64,
        duration_s: f64,
        failures: &FailureCounter,
    ) -> Option<BSpline> {
        let kind = &self.brake_spline;
        let mut control_points = vec![JointVector::zeros(); kind.control_points];
        for i in 0..self.robot.dof() {
            let limits = self.limits(i, state, self.moving_scaling());
            let start = JointState { q: state.q[i], dq: state.dq[i], ddq: state.ddq[i] };
            let points = failures.solution(kind.solve(&start, &End::Rest, duration_s, &limits, 0.0))?;
            set(&mut control_points, i, &points);
        }
        let knots_s = kind.knots.iter().map(|knot| start_s + knot * duration_s).collect();
        Some(BSpline { knots_s, control_points })
    }

    /// Limits of joint `i` for a motion from this state. A joint that starts closer to the end of its range
    /// than the margin may stay there.
    pub fn limits(&self, i: usize, state: &Setpoint, scaling: LimitScaling) -> JointLimits {
        let limits = &self.robot.joints[i].limits;
        JointLimits {
            lower: (limits.lower + self.config.position_margin_rad).min(state.q[i]),
            upper: (limits.upper - self.config.position_margin_rad).max(state.q[i]),
            velocity: limits.velocity * scaling.velocity,
            acceleration: limits.acceleration * scaling.acceleration,
            jerk: limits.jerk.map(|jerk| jerk * (1.0 - ROUNDING)),
            ..*limits
        }
    }

    /// Returns whether position, velocity, acceleration and jerk stay within the arm's own limits, by the
    /// hulls of their control points, of which those of acceleration and jerk are exact.
    pub fn keeps_limits(&self, trajectory: &BSpline) -> bool {
        let BSpline { knots_s: t, control_points } = trajectory;
        let positions = control_points.iter().all(|point| {
            self.robot.joints.iter().enumerate().all(|(i, joint)| {
                (joint.limits.lower - HULL_ROUNDING..=joint.limits.upper + HULL_ROUNDING).contains(&point[i])
            })
        });
        let most = |pick: fn(&JointLimits) -> f64| self.robot.per_joint(|joint| pick(&joint.limits) * (1.0 + ROUNDING));
        let (speed, rate) = (most(|it| it.velocity), most(|it| it.acceleration));
        let velocities = differentiated(control_points, t, DEGREE);
        let accelerations = differentiated(&velocities, &t[1..], DEGREE - 1);
        let within =
            |values: &[JointVector], most: &JointVector| values.iter().all(|it| (most - it.abs()).min() >= 0.0);
        positions
            && within(&velocities, &speed)
            && within(&accelerations, &rate)
            && self.keeps_jerk(trajectory)
            && self.keeps_sampled_speeds(trajectory)
    }

    /// Returns whether the jerk stays within its limit where there is one. A jump of the acceleration at a
    /// repeated knot breaks the limit.
    fn keeps_jerk(&self, spline: &BSpline) -> bool {
        let mut before = None;
        spline.spans().all(|[start_s, end_s]| {
            let [first, last] = [start_s, end_s].map(|time_s| spline.evaluate(time_s)[2]);
            let jump = before.replace(last).map_or(JointVector::zeros(), |before| first - before);
            self.robot.joints.iter().enumerate().all(|(i, joint)| {
                joint.limits.jerk.is_none_or(|most| {
                    let jerk = (last[i] - first[i]) / (end_s - start_s);
                    jerk.abs() <= most * (1.0 + ROUNDING) && jump[i].abs() <= CONTINUITY
                })
            })
        })
    }

    /// Limits of each joint for a motion from `start`.
    pub fn limits_from(&self, start: &Start) -> Vec<JointLimits> {
        let at_rest = start.state.dq == JointVector::zeros();
        let scaling = if at_rest { REPLAN_SCALING } else { self.moving_scaling() };
        (0..self.robot.dof()).map(|i| self.limits(i, &start.state, scaling)).collect()
    }

    /// Returns whether torque limits hold along a motion: at its knots, in the middle between them and at its
    /// end. Between knots accelerations are linear, so that torques peak at knots but for their
    /// velocity-dependent part.
    pub fn keeps_torque(&self, spline: &BSpline) -> bool {
        self.keeps_torque_until(spline, spline.end_s())
    }

    fn keeps_torque_until(&self, spline: &BSpline, last_s: f64) -> bool {
        let spans = spline.spans().take_while(|[start_s, _]| *start_s < last_s);
        let inside_s = spans.flat_map(|[start_s, end_s]| [start_s, 0.5 * (start_s + end_s)]);
        inside_s.chain([last_s]).all(|time_s| self.keeps_torque_at(spline.evaluate(time_s)))
    }

    /// Returns whether torque limits hold in one state: position, velocity and acceleration.
    fn keeps_torque_at(&self, [q, dq, ddq]: [JointVector; 3]) -> bool {
        let torque = self.robot.inverse_dynamics(&q, &dq, &ddq);
        (0..self.robot.dof())
            .all(|i| torque[i].abs() <= self.robot.joints[i].limits.torque * self.config.torque_scaling)
    }

    /// Returns whether the hand's speed, and velocities whose limits depend on the position, keep their
    /// limits: at knots and thrice between them.
    fn keeps_sampled_speeds(&self, spline: &BSpline) -> bool {
        let tables = || self.robot.joints.iter().enumerate().filter(|(_, joint)| joint.velocity_table.is_some());
        let keeps = |time_s: f64| {
            let [q, dq, _] = spline.evaluate(time_s);
            let most = self.config.velocity_scaling;
            tables().all(|(i, joint)| dq[i].abs() <= most * joint.max_speed(q[i], dq[i]))
                && self.hand_speed_left(&q, &dq) >= 1.0 - ROUNDING
        };
        let mut times_s =
            spline.spans().flat_map(|[from_s, to_s]| SPAN_SAMPLES.map(|by| from_s + by * (to_s - from_s)));
        (tables().next().is_none() && self.robot.max_hand_speed_mps.is_none()) || times_s.all(keeps)
    }

    /// Factor by which the hand may be faster than at these velocities, with some room for the times between
    /// samples.
    pub(super) fn hand_speed_left(&self, q: &JointVector, dq: &JointVector) -> f64 {
        self.robot.max_hand_speed_mps.map_or(f64::INFINITY, |most_mps| {
            HAND_SPEED_FRACTION * most_mps / self.robot.hand_speed_mps(q, dq).max(1e-9)
        })
    }

    /// Returns whether speeds, torque limits and clearances hold along a trajectory, the hand holding the
    /// object from the catch on. [Braking](Self::braking) keeps the torque limits anyway.
    pub(super) fn is_safe(&self, trajectory: &BSpline, catch_s: f64, grasp: &Grasp) -> bool {
        let (start_s, end_s) = (trajectory.start_s(), trajectory.end_s());
        // The aperture is chosen later.
        let widest_m = self.gripper.max_width_m;
        // Most collisions occur while braking.
        self.keeps_sampled_speeds(trajectory)
            && self.keeps_clear(trajectory, [catch_s, end_s], widest_m, Some(&grasp.held_G))
            && self.keeps_clear(trajectory, [start_s, catch_s], widest_m, None)
            && self.keeps_torque_until(trajectory, catch_s)
    }

    /// Returns whether the arm at `q` is clear of itself and of the floor, the gripper fully open.
    pub(super) fn stands_clear(&self, q: &JointVector) -> bool {
        self.clearance.least(&self.robot.link_poses(q), self.gripper.max_width_m) >= self.config.clearance_m
    }

    /// Returns whether the arm and the object in its hand keep clear from one time until another, the gripper
    /// `width_m` open.
    ///
    /// At the sampled times, `clearance_m` is kept, and half of it between them: no two parts approach each
    /// other faster than Σ |q̇ᵢ|·rᵢ, rᵢ being the largest extent of the arm and the held object beyond joint
    /// i. A clearance d stays above zero for a time of d over that speed.
    pub(super) fn keeps_clear(
        &self,
        trajectory: &BSpline,
        [start_s, end_s]: [f64; 2],
        width_m: f64,
        held_G: Option<&Cuboid>,
    ) -> bool {
        let fastest_mps = self.fastest_mps(trajectory, held_G);
        let mut time_s = start_s;
        loop {
            let X_WL = self.robot.link_poses(&trajectory.setpoint(time_s).q);
            let mut clearance_m = self.clearance.least(&X_WL, width_m);
            if let Some(held_G) = held_G {
                clearance_m = clearance_m.min(self.clearance.held_clearance(&X_WL, held_G));
            }
            if clearance_m < self.config.clearance_m {
                return false;
            }
            if time_s >= end_s {
                return true;
            }
            time_s = (time_s + clearance_m / fastest_mps).min(end_s);
        }
    }

    /// A bound on the speed at which parts of the arm and what it holds approach each other or the floor,
    /// from the hulls of the velocities.
    fn fastest_mps(&self, spline: &BSpline, held_G: Option<&Cuboid>) -> f64 {
        let velocities = differentiated(&spline.control_points, &spline.knots_s, DEGREE);
        let fastest = velocities.iter().fold(JointVector::repeat(1e-6), |fastest, it| fastest.sup(&it.abs()));
        let held_m = held_G.map_or(0.0, Cuboid::farthest_corner);
        fastest.dot(&self.extents_m.sup(&self.to_gripper_m.add_scalar(held_m)))
    }
}

/// Control points of the derivative of a spline of degree `degree`: cᵢ′ = d·(cᵢ₊₁ − cᵢ)/(tᵢ₊d₊₁ − tᵢ₊₁), and
/// zero where these knots are the same.
fn differentiated(points: &[JointVector], knots_s: &[f64], degree: usize) -> Vec<JointVector> {
    let one = |(i, pair): (usize, &[JointVector])| {
        let span = knots_s[i + degree + 1] - knots_s[i + 1];
        if span > 0.0 { (pair[1] - pair[0]) * (degree as f64 / span) } else { JointVector::zeros() }
    };
    points.windows(2).enumerate().map(one).collect()
}

/// Sets the control points of joint `i`.
pub(super) fn set(points: &mut [JointVector], i: usize, joint: &JointPoints) {
    for (point, value) in points.iter_mut().zip(joint) {
        point[i] = *value;
    }
}

/// State at the end of a motion.
fn end_of(spline: &BSpline) -> Setpoint {
    let [q, dq, ddq] = spline.evaluate(spline.end_s());
    Setpoint { q, dq, ddq }
}

#[cfg(test)]
mod tests {
    use catch_body::{Gripper, robot_file::RobotFiles};
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::trajectory_optimization::Config;

    fn planner() -> MotionPlanner {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
        };
        let gripper = Gripper::from_toml("gripper.toml", include_str!("../../../../assets/grippers/wsg50.toml"));
        MotionPlanner::new(catch_body::Robot::from_files(&files).unwrap(), gripper.unwrap(), Config::default())
    }

    /// A bar that sticks out by 0.6 m from the hand, by two of its corners, and the arm's own parts keep
    /// within the bound on their speed.
    #[test]
    fn nothing_held_is_faster_than_the_bound() {
        let planner = planner();
        let robot = &planner.robot;
        let held_G = Cuboid { centre: Point3::new(0.0, 0.4, 0.0), size: Vector3::new(0.04, 0.8, 0.04) };
        for joint in 0..robot.dof() {
            // The arm stretched out, turned by one joint at a time.
            let (from, mut to) = (JointVector::zeros(), JointVector::zeros());
            to[joint] = 0.5;
            let motion = planner.rest_to_rest(0.0, &from, None, &to, None);
            let Some(motion) = motion else { continue };
            for (held, corners) in [
                (None, [Point3::origin(); 2]),
                (Some(&held_G), [Point3::new(0.02, 0.8, 0.02), Point3::new(-0.02, 0.8, -0.02)]),
            ] {
                let bound_mps = planner.fastest_mps(&motion, held);
                for i in 0..200 {
                    let time_s = motion.end_s() * f64::from(i) / 200.0;
                    let at = |time_s: f64| {
                        let X_WG = robot.gripper_pose(&motion.setpoint(time_s).q);
                        corners.map(|corner| X_WG * corner)
                    };
                    let (before, after) = (at(time_s), at(time_s + 1e-5));
                    let speeds = before.iter().zip(&after).map(|(a, b)| (b - a).norm() / 1e-5);
                    let fastest_mps = speeds.fold(0.0, f64::max);
                    assert!(fastest_mps <= bound_mps, "joint {joint}: {fastest_mps} m/s, bound {bound_mps} m/s");
                }
            }
        }
    }
}
