//! Motion from a start to given joint positions at a given time: the end velocities and the splines, found
//! together.
//!
//! The velocities at the catch are chosen within what each joint can have on arrival, first by the exact
//! bounds of [`super::reachability`], which are optimistic for a spline. A joint whose spline program is
//! infeasible there gets the spline's own extreme as its bound on that side, and the velocities are chosen
//! anew. What is left feasible shrinks to exactly what splines can do, and usually no cut or one is enough.

use catch_body::{JointVector, MAX_JOINTS, Pose, quadratic_program::ProgramFailure, robot::Jacobian};
use nalgebra::{Rotation3, Vector3};

use super::{
    CatchSplines, Incoming, MotionPlanner, Start,
    failure_counter::FailureCounter,
    joint_spline::{End, JointPoints, JointState, Onset},
    motion::{BRAKING_ACCELERATION_FRACTION, LimitScaling, set},
    reachability::{Interval, ReachableSet},
    terminal_velocity::{FOLLOWING, TerminalVelocity, Weights, terminal_velocity},
};
use crate::trajectory_prediction::LocalFlight;

/// Distance from the extreme velocity of a spline at which another one surely has it, in rad/s.
const INSIDE: f64 = 1e-7;

/// Any velocity.
const UNLIMITED: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };

/// Point-to-point problem: the required state at the catch, and the start.
#[derive(Debug)]
pub struct PointToPoint<'a> {
    /// The arm and its limits.
    pub planner: &'a MotionPlanner,
    /// Programs of the joints' splines.
    pub splines: &'a CatchSplines,
    /// Start of the motion.
    pub start: &'a Start,
    /// Time of the catch, in seconds on the cell's clock.
    pub catch_s: f64,
    /// Joint positions then.
    pub q: JointVector,
    /// Velocity of the object then.
    pub v_WO: Vector3<f64>,
    /// Coefficient of restitution with which the object bounces off the gripper.
    pub restitution: f64,
    /// Jacobian of the grasp centre at `q`.
    pub jacobian: Jacobian,
    /// Fractions of the limits that the motion may use.
    pub scaling: LimitScaling,
    /// Weights of the choice of the end velocities.
    pub weights: Weights,
    /// Weights with which the hand follows the object, and the gripper's orientation in W then; `None` if it
    /// keeps to the object's direction.
    pub following: Option<(Rotation3<f64>, Vector3<f64>)>,
    /// True if a braking spline is to follow.
    pub brakes: bool,
    /// Counts what fails numerically.
    pub failures: &'a FailureCounter,
}

/// End velocities, and the control points of splines that have them.
pub type Reached = (TerminalVelocity, Vec<JointVector>);

impl PointToPoint<'_> {
    /// The best velocities within `bounds`, slowed down where the hand would be too fast.
    pub fn terminal_velocity(&self, bounds: &[Interval; MAX_JOINTS]) -> Option<TerminalVelocity> {
        let found = terminal_velocity(&self.jacobian, &self.v_WO, bounds, &self.weights, self.following.as_ref());
        let found = self.failures.solution(found)?;
        let left = self.planner.hand_speed_left(&self.q, &found.dq);
        if left >= 1.0 {
            return Some(found);
        }
        let slowed = found.scaled(left);
        let is_within = |(dq, bound): (&f64, &Interval)| (bound.low..=bound.high).contains(dq);
        slowed.dq.iter().zip(bounds).all(is_within).then_some(slowed)
    }

    /// The best velocities within `bounds` that splines can have, `None` if there are none or their speed
    /// fraction is not above `least`.
    pub fn best(&self, mut bounds: [Interval; MAX_JOINTS], least: f64) -> Option<Reached> {
        let dof = self.planner.robot.dof();
        let mut points = vec![JointVector::zeros(); self.splines.at.control_points];
        let last_speeds = self.speeds_that_withstand_impact();
        for (bound, last) in bounds.iter_mut().zip(&last_speeds) {
            *bound = bound.intersection(last);
        }
        for _ in 0..=2 * dof {
            let terminal_velocity = self.terminal_velocity(&bounds).filter(|it| it.speed_fraction > least)?;
            let onset_s = self.brakes.then(|| self.planner.braking_onset_s(&terminal_velocity.dq));
            let mut all = true;
            for (i, bound) in bounds.iter_mut().enumerate().take(dof) {
                let joint = self.joint(i, terminal_velocity.dq[i], &last_speeds[i], onset_s);
                if let Some(joint) = self.failures.solution(joint) {
                    set(&mut points, i, &joint);
                } else {
                    all = false;
                    *bound = self.cut(i, terminal_velocity.dq[i], bound, &last_speeds[i], onset_s)?;
                }
            }
            if all {
                return Some((terminal_velocity, points));
            }
        }
        None
    }

    /// The velocity limits less what the object's impact may add on either side: a smooth object that bounces
    /// off a finger pushes it along the normal n of the contact, by (1 + e)·v·n/(1/m + n·J·M⁻¹·Jᵀ·n),
    /// whichever direction that is; motors are too slow to answer. Joints keep to them shortly before the
    /// catch, too: what hits the gripper mostly does so early.
    fn speeds_that_withstand_impact(&self) -> [Interval; MAX_JOINTS] {
        let robot = &self.planner.robot;
        let mut added = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        if let Some(mass_kg) = self.planner.config.object_mass_kg
            && let Some(inertia) = self.failures.factor(robot.mass_matrix(&self.q).cholesky())
        {
            let (angular, linear) = (self.jacobian.fixed_rows::<3>(0), self.jacobian.fixed_rows::<3>(3));
            for side in [-0.5, 0.5] {
                let finger_W = self.following.map_or(Vector3::zeros(), |(R_WG, _)| {
                    R_WG * Vector3::new(side * self.planner.gripper.max_width_m, 0.0, 0.0)
                });
                let at_finger = linear - finger_W.cross_matrix() * angular;
                let of_impulse = inertia.solve(&at_finger.transpose());
                let mobility = at_finger * of_impulse;
                for n_W in normals() {
                    let approach_mps = self.v_WO.dot(&n_W);
                    let impulse_ns =
                        (1.0 + self.restitution) * approach_mps / (1.0 / mass_kg + n_W.dot(&(mobility * n_W)));
                    for (added, dq) in added.iter_mut().zip(&(of_impulse * (n_W * impulse_ns))) {
                        *added = Interval { low: added.low.min(*dq), high: added.high.max(*dq) };
                    }
                }
            }
        }
        std::array::from_fn(|i| {
            let [low, high] = robot.joints.get(i).map_or([0.0; 2], |joint| joint.velocity_range(self.q[i]));
            Interval { low: low - added[i].low, high: high - added[i].high }
        })
    }

    /// Splines for velocities that are known to be easy, `None` if they are not.
    pub fn splines_for(&self, terminal_velocity: &TerminalVelocity) -> Option<Vec<JointVector>> {
        let mut points = vec![JointVector::zeros(); self.splines.at.control_points];
        for i in 0..self.planner.robot.dof() {
            let joint = self.joint(i, terminal_velocity.dq[i], &UNLIMITED, None);
            set(&mut points, i, &self.failures.solution(joint)?);
        }
        Some(points)
    }

    /// The bounds of joint `i` cut to what a spline can do, on the side on which it cannot have the end
    /// velocity `dq`.
    fn cut(&self, i: usize, dq: f64, bound: &Interval, last: &Interval, onset_s: Option<f64>) -> Option<Interval> {
        let (start, limits) = (self.state(i), self.limits(i));
        let extreme = |sign: f64| {
            let last_speed = speed_toward(last, sign);
            let onset = self.onset(i, last_speed, onset_s);
            let end = End::Extreme { q: self.q[i], sign, last_speed, onset };
            let found = self.splines.range.end_velocity(&start, &end, self.duration_s(), &limits);
            let found = self.failures.solution(found)?;
            // A hair inside, so that rounding cannot make the program for this end infeasible.
            Some(found - sign * INSIDE)
        };
        let upper_first = bound.high - dq < dq - bound.low;
        for side in [upper_first, !upper_first] {
            let at = extreme(if side { 1.0 } else { -1.0 })?;
            if side && at < dq {
                return Some(Interval { low: bound.low.min(at), high: at });
            }
            if !side && at > dq {
                return Some(Interval { low: at, high: bound.high.max(at) });
            }
        }
        None
    }

    fn joint(&self, i: usize, dq: f64, last: &Interval, onset_s: Option<f64>) -> Result<JointPoints, ProgramFailure> {
        let last_speed = speed_toward(last, dq);
        let ddq = self.onset(i, last_speed, onset_s).map_or([f64::NEG_INFINITY, f64::INFINITY], |it| {
            [(-it.velocity - dq) / it.duration_s, (it.velocity - dq) / it.duration_s]
        });
        let end = End::At { q: self.q[i], dq, ddq, last_speed };
        let comfortable = self.planner.robot.comfortable_q[i];
        self.splines.at.solve(&self.state(i), &end, self.duration_s(), &self.limits(i), comfortable)
    }

    fn duration_s(&self) -> f64 {
        self.catch_s - self.start.time_s
    }

    fn limits(&self, i: usize) -> catch_body::robot::JointLimits {
        let mut limits = self.planner.limits(i, &self.start.state, self.scaling);
        let (joint, state) = (&self.planner.robot.joints[i], &self.start.state);
        if joint.velocity_table.is_some() {
            // The limit falls towards the end of the range: what holds where a joint arrives holds on the
            // way.
            let at_catch = joint.max_speed(self.q[i], self.q[i] - state.q[i]) * self.scaling.velocity;
            limits.velocity = limits.velocity.min(at_catch.max(state.dq[i].abs()));
        }
        limits
    }

    fn state(&self, i: usize) -> JointState {
        let state = &self.start.state;
        JointState { q: state.q[i], dq: state.dq[i], ddq: state.ddq[i] }
    }

    fn onset(&self, i: usize, last_speed: f64, onset_s: Option<f64>) -> Option<Onset> {
        let velocity = self.planner.robot.joints[i].limits.velocity * self.planner.moving_scaling().velocity;
        let velocity = velocity.min(last_speed);
        onset_s.map(|duration_s| Onset { duration_s, velocity })
    }
}

/// The highest speed within `velocities` in the direction of `dq`.
fn speed_toward(velocities: &Interval, dq: f64) -> f64 {
    if dq < 0.0 { -velocities.low } else { velocities.high }
}

/// Normals of contacts that are looked at: to the faces, edges and corners of a cube, one of each two
/// opposite ones, which have the same impulse.
fn normals() -> impl Iterator<Item = Vector3<f64>> {
    (14..27).map(|i| Vector3::new(i % 3, i / 3 % 3, i / 9).map(|part| f64::from(part - 1)).normalize())
}

impl MotionPlanner {
    /// Reachable set of each joint `time_s` after the start.
    pub fn reaches(&self, start: &Start, time_s: f64, scaling: LimitScaling) -> [ReachableSet; MAX_JOINTS] {
        std::array::from_fn(|i| {
            let limits = self.robot.joints.get(i).map(|joint| joint.limits);
            let velocity = limits.map_or(0.0, |it| it.velocity * scaling.velocity);
            ReachableSet {
                start_velocity: start.state.dq[i].clamp(-velocity, velocity),
                velocity,
                acceleration: limits.map_or(1.0, |it| it.acceleration * scaling.acceleration),
                time_s,
            }
        })
    }

    /// Positions that the joints can have within their ranges, reaching what they can.
    pub fn ranges(&self, joints: &[ReachableSet; MAX_JOINTS], q: &JointVector) -> [[f64; 2]; MAX_JOINTS] {
        let margin = self.config.position_margin_rad;
        std::array::from_fn(|i| {
            let Some(joint) = self.robot.joints.get(i) else { return [0.0; 2] };
            let far = joints[i].displacements();
            [(joint.limits.lower + margin).max(q[i] + far.low), (joint.limits.upper - margin).min(q[i] + far.high)]
        })
    }

    /// The task of catching at `q`, on the move, with braking to follow.
    pub(super) fn point_to_point<'a>(
        &'a self,
        (start, incoming): (&'a Start, &Incoming<'a>),
        local_flight: &LocalFlight,
        X_WG: &Pose,
        q: &JointVector,
        scaling: LimitScaling,
    ) -> PointToPoint<'a> {
        let X_WL = self.robot.link_poses(q);
        PointToPoint {
            planner: self,
            splines: &self.catch_splines,
            start,
            catch_s: local_flight.time_s,
            q: *q,
            v_WO: local_flight.V_WO.linear,
            restitution: incoming.config.expected_restitution(),
            jacobian: self.robot.jacobian(&X_WL, &(X_WG * self.gripper.grasp_centre())),
            scaling,
            weights: Weights::BALANCED,
            following: Some((X_WG.rotation.to_rotation_matrix(), FOLLOWING)),
            brakes: true,
            failures: incoming.failures,
        }
    }

    /// The velocities that joints can have at `q`, within what they can reach and what leaves them room to
    /// brake; `None` if they cannot be there.
    pub(super) fn terminal_velocity_bounds(
        &self,
        joints: &[ReachableSet; MAX_JOINTS],
        from: &JointVector,
        q: &JointVector,
    ) -> Option<[Interval; MAX_JOINTS]> {
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for (i, joint) in self.robot.joints.iter().enumerate() {
            let displacement = q[i] - from[i];
            let far = joints[i].displacements();
            if displacement < far.low || displacement > far.high {
                return None;
            }
            // v² = 2·a·s leaves room to brake before the end of the joint's range.
            let braking = BRAKING_ACCELERATION_FRACTION * joint.limits.acceleration;
            let room = |distance: f64| (2.0 * braking * distance.max(0.0)).sqrt();
            let margin = self.config.position_margin_rad;
            let below = q[i] - joint.limits.lower - margin;
            let above = joint.limits.upper - margin - q[i];
            if below < 0.0 || above < 0.0 {
                return None;
            }
            let stoppable = Interval { low: -room(below), high: room(above) };
            let most = self.max_speed_to_brake_from(&joint.limits);
            let [low, high] = joint.velocity_range(q[i]).map(|it| self.config.terminal_velocity_scaling * it);
            let gentle = Interval { low: low.max(-most), high: high.min(most) };
            bounds[i] = joints[i].terminal_velocities(displacement).intersection(&stoppable).intersection(&gentle);
        }
        Some(bounds)
    }
}

#[cfg(test)]
mod tests {
    use catch_body::{Gripper, Robot, robot_file::RobotFiles};
    use catch_cell::Setpoint;

    use super::*;
    use crate::{
        grasp_selection::{self, GraspSet},
        perception::{ReferenceModel, synthetic},
        trajectory_optimization::Config,
        trajectory_prediction::FlightTrajectory,
    };

    /// The impulse of an impact is proportional to 1 + e, and so is the room that is left for it.
    #[test]
    fn the_room_for_an_impact_is_that_of_the_configured_restitution() {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
        };
        let gripper = Gripper::from_toml("gripper.toml", include_str!("../../../../assets/grippers/wsg50.toml"));
        let (robot, gripper) = (Robot::from_files(&files).unwrap(), gripper.unwrap());
        let config = Config { object_mass_kg: Some(0.2), ..Config::default() };
        let planner = MotionPlanner::new(robot, gripper, config);
        let scan = synthetic::scan(&synthetic::Shape::ball(), 40);
        let reference = ReferenceModel::from_scan(&scan);
        let grasps = GraspSet::sample(&reference, &planner.gripper, &Default::default());
        let q = planner.robot.ready_q;
        let X_WG = planner.robot.gripper_pose(&q);
        let start = Start { time_s: 0.0, state: Setpoint::at_rest(q) };
        let flight = FlightTrajectory { v_WOcm: Vector3::new(-3.0, -2.0, -1.0), ..FlightTrajectory::default() };
        let failures = FailureCounter::default();
        let room = |restitution: Option<f64>| {
            let config = grasp_selection::Config { restitution, ..Default::default() };
            let incoming = Incoming { flight: &flight, grasps: &grasps, config: &config, failures: &failures };
            let local_flight = flight.local_flight_at(0.0);
            let scaling = planner.moving_scaling();
            let task = planner.point_to_point((&start, &incoming), &local_flight, &X_WG, &q, scaling);
            let kept = task.speeds_that_withstand_impact();
            let joints = planner.robot.joints.iter().enumerate();
            joints.map(|(i, joint)| joint.velocity_range(q[i])[1] - kept[i].high).collect::<Vec<f64>>()
        };
        let [dead, ball, unknown] = [Some(0.0), Some(0.75), None].map(room);
        for (i, dead) in dead.iter().enumerate() {
            assert!((ball[i] - 1.75 * dead).abs() < 1e-12, "joint {i}");
            assert!((unknown[i] - 1.5 * dead).abs() < 1e-12, "joint {i}");
        }
        assert!(dead.iter().any(|it| *it > 0.01), "an impact that moves nothing");
    }
}
