//! The general, nonlinear form of the paper's trajectory optimization (III-D): all joints' control points at
//! once.
//!
//! ```text
//!     min   ½w·Σ|Pᵢ − q₀|² + ρ·Σ max(0, |e| − tolerance)
//!     P, s
//!     s.t.  q(0), q̇(0), q̈(0) as they are,   position, velocity and acceleration limits on control points,   s as it is given
//! ```
//! P are the control points of a cubic B-spline, s the fraction of the object's velocity at which the gripper
//! moves along, e the errors at the waypoints ([`Waypoint`]): pose of the gripper and velocity of one of its
//! points. The arm may have any kinematics; no closed form is asked for. What the closed forms of
//! [`MotionPlanner`](catch_bot::trajectory_optimization::MotionPlanner) solve exactly and faster, this solves
//! as the paper does.
//!
//! Sequential quadratic programming with an exact penalty in a trust region (Fletcher, Practical Methods of
//! Optimization, section 14.4, Sℓ₁QP): the limits are linear in P and kept by every iterate, the errors are
//! linearized and may be broken at a price. So what comes out never breaks a limit, and where the waypoints
//! cannot be met it comes as close as it can.

pub mod interior_point;
mod layout;
mod problem;
pub mod waypoint;

use catch_body::{JointVector, quadratic_program::ProgramFailure};
use catch_cell::{BSpline, arm::Setpoint, spline::DEGREE};
use layout::{Layout, PRICE};
pub use problem::{Problem, Solution};
pub use waypoint::{Tolerance, Waypoint};

/// Quadratic programs at most.
const ITERATIONS: usize = 25;
/// Trust region at the start, in radians, and the smallest that is worth a step.
const RADIUS: f64 = 0.5;
const LEAST_RADIUS: f64 = 1e-9;
/// Corrections at most once the objective has converged or time is up, of what excess, and in what trust
/// region, relative to it.
const CORRECTIONS: usize = 3;
const CORRECTABLE: f64 = 1e-4;
const CORRECTION_RADIUS: f64 = 100.0;
/// An excess below this is none.
pub const MET: f64 = 1e-8;
/// A model that promises to gain less than this, relative, has converged.
const LEAST_GAIN: f64 = 1e-9;

impl Problem<'_> {
    /// Number of control points.
    pub fn control_points(&self) -> usize {
        self.knots_s.len() - DEGREE - 1
    }

    /// The motion, sought from a guess of its control points.
    ///
    /// # Errors
    /// If no motion from this start keeps the limits, or none was found that does.
    pub fn solve(&self, guess: &[JointVector]) -> Result<Solution, ProgramFailure> {
        let layout = Layout::new(self);
        let limits = layout.limit_rows(self).ok_or(ProgramFailure::Infeasible)?;
        let mut x = layout.feasible(&limits, guess, self.speed_fraction, self.stretch_guess)?;
        let mut now = layout.linearize(self, &x);
        let mut radius = RADIUS;
        let mut iterations = 0;
        while iterations < ITERATIONS && radius > LEAST_RADIUS {
            // Any motion that meets the waypoints within their tolerances will do.
            if layout.excess(self, &now) < MET {
                break;
            }
            iterations += 1;
            let Ok(candidate) = layout.program(self, &limits, &x, &now, radius).minimize(layout.padded(&x)) else {
                radius *= 0.25;
                continue;
            };
            let candidate = candidate.rows(0, layout.variables()).into_owned();
            let step = &candidate - &x;
            let merit = layout.objective(self, &x) + PRICE * layout.violation(self, &now, None);
            let promised =
                merit - layout.objective(self, &candidate) - PRICE * layout.violation(self, &now, Some((&x, &step)));
            if promised < LEAST_GAIN * (1.0 + merit.abs()) {
                break;
            }
            let next = layout.linearize(self, &candidate);
            let violation = layout.violation(self, &next, None);
            let gained = merit - layout.objective(self, &candidate) - PRICE * violation;
            // Near the end the linearization's error hides what the objective gains; a violation that halves
            // is progress, too.
            let halves = violation < 0.5 * layout.violation(self, &now, None);
            if gained > 0.1 * promised || halves {
                if gained > 0.7 * promised && step.amax() > 0.9 * radius {
                    radius *= 2.0;
                }
                (x, now) = (candidate, next);
            } else {
                radius = 0.3 * step.amax().min(radius);
            }
        }
        // Steps along a curved constraint leave behind what its curvature costs (Maratos 1978); short ones
        // take it away.
        let most = iterations + CORRECTIONS;
        while iterations < most && (MET..CORRECTABLE).contains(&layout.excess(self, &now)) {
            iterations += 1;
            let radius = CORRECTION_RADIUS * layout.excess(self, &now);
            let found = layout.program(self, &limits, &x, &now, radius).minimize(layout.padded(&x));
            let Ok(candidate) = found.map(|it| it.rows(0, layout.variables()).into_owned()) else { break };
            let next = layout.linearize(self, &candidate);
            if layout.excess(self, &next) < layout.excess(self, &now) {
                (x, now) = (candidate, next);
            }
        }
        let (start_s, stretch) = (self.knots_s[0], layout.stretch_of(&x));
        let knots_s = self.knots_s.iter().map(|knot_s| start_s + (knot_s - start_s) * stretch).collect();
        let knots_s = if layout.stretch.is_some() { knots_s } else { self.knots_s.clone() };
        let spline = BSpline { knots_s, control_points: layout.control_points(&x) };
        Ok(Solution { spline, excess: layout.excess(self, &now) })
    }

    /// Excess of the worst error of some motion over its tolerance.
    pub fn excess_of(&self, motion: impl Fn(f64) -> Setpoint, fraction: f64) -> f64 {
        let of_waypoint = |waypoint: &Waypoint| {
            let at = motion(waypoint.time_s);
            waypoint.excess(&waypoint.linearize(self.robot, &at.q, &at.dq, fraction))
        };
        self.waypoints.iter().map(of_waypoint).fold(0.0, f64::max)
    }

    /// The first control points, which the start leaves no choice about.
    ///
    /// P₀ = q, P₁ = q + q̇·h₁/3, and P₂ from q̈ = 2·(V₁ − V₀)/h₁ with V the control points of the velocity,
    /// h₁ being the first span.
    fn fixed_points(&self) -> Vec<JointVector> {
        if !self.keeps_start {
            return Vec::new();
        }
        let t = &self.knots_s;
        let first_span = t[DEGREE + 1] - t[1];
        let P1 = self.start.q + self.start.dq * (first_span / 3.0);
        let V1 = self.start.dq + self.start.ddq * (first_span / 2.0);
        vec![self.start.q, P1, P1 + V1 * ((t[DEGREE + 2] - t[2]) / 3.0)]
    }
}

/// Knots of a motion with `points` control points and equal spans.
pub fn clamped_knots(start_s: f64, end_s: f64, points: usize) -> Vec<f64> {
    let spans = points - DEGREE;
    let inner = (1..spans).map(|i| start_s + (end_s - start_s) * i as f64 / spans as f64);
    [start_s; DEGREE + 1].into_iter().chain(inner).chain([end_s; DEGREE + 1]).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use catch_body::{Robot, robot::JointLimits, robot_file::RobotFiles};
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    pub fn iiwa() -> Robot {
        Robot::from_files(&RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
        })
        .unwrap()
    }

    /// A catch that is reached by construction: the end of a motion of 0.5 s that uses half of what the
    /// joints can do.
    fn problem<'a>(robot: &'a Robot, toward: &JointVector) -> Problem<'a> {
        let start = Setpoint::at_rest(robot.ready_q);
        let limits: Vec<JointLimits> = robot.joints.iter().map(|joint| joint.limits).collect();
        let q = JointVector::from_fn(|i, _| {
            let Some(limits) = limits.get(i) else { return 0.0 };
            let by = 0.5 * (limits.acceleration * 0.5 * 0.5 / 4.0).min(limits.velocity * 0.25);
            (start.q[i] + toward[i] * by).clamp(limits.lower + 0.1, limits.upper - 0.1)
        });
        let waypoint = Waypoint {
            time_s: 0.5,
            X_WG: robot.gripper_pose(&q),
            v_WO: Vector3::new(-1.5, -2.5, -3.0),
            p_GP: Point3::new(0.0, 0.0833, 0.0),
            fraction: None,
            tolerance: Tolerance::NONE,
        };
        Problem {
            robot,
            knots_s: clamped_knots(0.0, 0.5, 8),
            start,
            keeps_start: true,
            stretch: [1.0; 2],
            stretch_guess: 1.0,
            limits,
            waypoints: vec![waypoint],
            speed_fraction: 0.0,
            comfortable_q: Some(robot.comfortable_q),
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// A motion that starts, ends and moves as required keeps every limit, whether or not it gets there;
        /// nearly all get there.
        #[test]
        fn limits_hold_and_the_start_is_exact(toward in prop::array::uniform7(-1.0f64..1.0)) {
            let robot = iiwa();
            let problem = problem(&robot, &robot.joint_vector(&toward).unwrap());
            let guess = vec![problem.start.q; 8];
            let found = problem.solve(&guess).unwrap();
            let [q, dq, ddq] = found.spline.evaluate(0.0);
            prop_assert!((q - problem.start.q).amax() < 1e-12);
            prop_assert!(dq.amax() < 1e-10 && ddq.amax() < 1e-9);
            for i in 0..=200 {
                let [q, dq, ddq] = found.spline.evaluate(0.5 * f64::from(i) / 200.0);
                for (j, limits) in problem.limits.iter().enumerate() {
                    prop_assert!(q[j] <= limits.upper + 1e-8 && q[j] >= limits.lower - 1e-8);
                    prop_assert!(dq[j].abs() <= limits.velocity);
                    prop_assert!(ddq[j].abs() <= limits.acceleration);
                }
            }
            prop_assert!(found.excess < MET, "{}", found.excess);
        }
    }

    /// Joints that are free at the start, a duration within bounds, no limit of acceleration: as in the
    /// authors' code.
    #[test]
    fn a_start_within_tolerances_leaves_the_joints_free() {
        let robot = iiwa();
        let mut problem = problem(&robot, &JointVector::from_fn(|i, _| if i < 7 { 0.6 } else { 0.0 }));
        let X_WG = robot.gripper_pose(&problem.start.q);
        let tolerance = Tolerance { position_m: 0.02, rotation_error_rad: 0.1, velocity_mps: 0.4 };
        let (p_GP, v_WO) = (Point3::origin(), Vector3::zeros());
        let start = Waypoint { time_s: 0.0, X_WG, p_GP, v_WO, fraction: Some(1.0), tolerance };
        problem.waypoints[0].tolerance = tolerance;
        problem.waypoints.push(start);
        problem.keeps_start = false;
        problem.stretch = [0.98, 1.02];
        problem.speed_fraction = 0.3;
        problem.comfortable_q = None;
        problem.limits.iter_mut().for_each(|limits| limits.acceleration = f64::INFINITY);
        let found = problem.solve(&[problem.start.q; 8]).unwrap();
        assert!(found.excess < MET, "{found:?}");
        let end_s = found.spline.end_s();
        assert!((0.49..=0.51).contains(&end_s), "{end_s}");
        let [q, dq, _] = found.spline.evaluate(0.0);
        assert!((robot.gripper_pose(&q).translation.vector - X_WG.translation.vector).amax() <= 0.02 + 1e-6);
        assert!(robot.gripper_twist(&q, &dq).linear.amax() <= 0.4 + 1e-6);
        for i in 0..=200 {
            let [_, dq, _] = found.spline.evaluate(end_s * f64::from(i) / 200.0);
            assert!(problem.limits.iter().enumerate().all(|(j, limits)| dq[j].abs() <= limits.velocity * (1.0 + 1e-6)));
        }
    }

    #[test]
    fn what_is_out_of_reach_is_approached_within_the_limits() {
        let robot = iiwa();
        let mut problem = problem(&robot, &JointVector::repeat(0.2));
        problem.waypoints[0].X_WG.translation.vector.z += 3.0;
        let found = problem.solve(&[problem.start.q; 8]).unwrap();
        assert!(found.excess > 1.0);
        let start = robot.gripper_pose(&problem.start.q).translation.vector.z;
        assert!(robot.gripper_pose(&found.spline.evaluate(0.5)[0]).translation.vector.z > start + 0.02);
    }
}
