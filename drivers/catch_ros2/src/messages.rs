//! The messages, and plans as messages.

use catch_body::{JointVector, Robot as Arm};
use catch_cell::Setpoint;
use catch_driver::braking::{CYCLE_S, Executed, brake};
use ros2_client::{Message, builtin_interfaces::Time};
use serde::{Deserialize, Serialize};

/// Time from a message's arrival until its first point, in seconds. Until then the controller interpolates
/// from where it is: what the message took to arrive, a few milliseconds of way, is spread over it.
const FIRST_S: f64 = 0.1;
/// Time from one point to the next in seconds.
const STEP_S: f64 = 0.01;
/// Most cycles that braking takes.
const MOST_CYCLES: usize = 5000;

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Time; zero stands for the time of arrival.
    pub stamp: Time,
    /// Frame.
    pub frame_id: String,
}

/// `builtin_interfaces/Duration`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Duration {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds of the next one.
    pub nanosec: u32,
}

/// `trajectory_msgs/JointTrajectoryPoint`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectoryPoint {
    /// In radians.
    pub positions: Vec<f64>,
    /// In rad/s.
    pub velocities: Vec<f64>,
    /// In rad/s².
    pub accelerations: Vec<f64>,
    /// Empty: torques are the controller's.
    pub effort: Vec<f64>,
    /// Time since the start of the trajectory.
    pub time_from_start: Duration,
}

/// `trajectory_msgs/JointTrajectory`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// Its stamp is zero: the trajectory starts as it arrives.
    pub header: Header,
    /// Names of the joints, in the order of the values.
    pub joint_names: Vec<String>,
    /// Points, in the order of their times.
    pub points: Vec<JointTrajectoryPoint>,
}
impl Message for JointTrajectory {}

/// `sensor_msgs/JointState`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When it was so.
    pub header: Header,
    /// Names of the joints, in the order of the values.
    pub name: Vec<String>,
    /// In radians.
    pub position: Vec<f64>,
    /// In rad/s; may be empty.
    pub velocity: Vec<f64>,
    /// In N·m; may be empty.
    pub effort: Vec<f64>,
}
impl Message for JointState {}

impl JointState {
    /// Positions and velocities of the joints of an arm; `None` without a position of each. A broadcaster has
    /// NaN for what its hardware does not measure: such a velocity counts as zero.
    pub fn of(&self, arm: &Arm) -> Option<[JointVector; 2]> {
        let mut found = [JointVector::zeros(); 2];
        for (i, joint) in arm.joints.iter().enumerate() {
            let at = self.name.iter().position(|it| *it == joint.name)?;
            let measured = |of: &[f64]| of.get(at).copied().filter(|it| it.is_finite());
            found[0][i] = measured(&self.position)?;
            found[1][i] = measured(&self.velocity).unwrap_or(0.0);
        }
        Some(found)
    }
}

/// Everything from `now_s` until `end_s`, when the arm is at rest: the rest of what is executed, and what
/// comes next.
pub fn planned(arm: &Arm, [now_s, end_s]: [f64; 2], setpoint: impl Fn(f64) -> Setpoint) -> JointTrajectory {
    let count = ((end_s - now_s - FIRST_S) / STEP_S).ceil().max(0.0) as usize;
    let from_start = |i: usize| FIRST_S + i as f64 * STEP_S;
    let last = (count, Setpoint { dq: JointVector::zeros(), ddq: JointVector::zeros(), ..setpoint(end_s) });
    let points = (0..count).map(|i| (i, setpoint(now_s + from_start(i)))).chain([last]);
    trajectory(arm, points.map(|(i, it)| (from_start(i), it)))
}

/// The way from a motion to rest within the arm's limits. It is told as it would be without the time that the
/// message takes to arrive.
pub fn braking(arm: &Arm, mut executed: Executed) -> JointTrajectory {
    let mut points = Vec::new();
    for cycle in 1..=MOST_CYCLES {
        let is_last = executed.is_at_rest();
        executed = executed.then(brake(&executed, arm));
        let time_s = cycle as f64 * CYCLE_S;
        if time_s >= FIRST_S && (is_last || cycle % 10 == 0) {
            let none = JointVector::zeros();
            let [dq, ddq] = if is_last { [none; 2] } else { [executed.dq(), executed.ddq()] };
            points.push((time_s, Setpoint { q: executed.q(), dq, ddq }));
            if is_last {
                break;
            }
        }
    }
    trajectory(arm, points.into_iter())
}

fn trajectory(arm: &Arm, points: impl Iterator<Item = (f64, Setpoint)>) -> JointTrajectory {
    let of_joints = |it: &JointVector| it.iter().take(arm.dof()).copied().collect::<Vec<_>>();
    let point = |(time_s, Setpoint { q, dq, ddq }): (f64, Setpoint)| JointTrajectoryPoint {
        positions: of_joints(&q),
        velocities: of_joints(&dq),
        accelerations: of_joints(&ddq),
        effort: Vec::new(),
        time_from_start: Duration { sec: time_s as i32, nanosec: (time_s.fract() * 1e9) as u32 },
    };
    JointTrajectory {
        header: Header { stamp: Time::ZERO, frame_id: String::new() },
        joint_names: arm.joints.iter().map(|it| it.name.clone()).collect(),
        points: points.map(point).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::robot_file::RobotFiles;
    use catch_cell::ArmTrajectory;
    use catch_driver::motion;

    fn fr3() -> Arm {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/fr3/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/fr3/robot.toml"),
        };
        Arm::from_files(&files).unwrap()
    }

    /// A motion that uses half of the limits, over half a radian.
    fn half(arm: &Arm) -> ArmTrajectory {
        motion::straight(1, 0.0, [arm.ready_q, arm.ready_q + JointVector::ith(0, 0.5)], arm, 0.5)
    }

    fn seconds(it: &JointTrajectoryPoint) -> f64 {
        f64::from(it.time_from_start.sec) + f64::from(it.time_from_start.nanosec) * 1e-9
    }

    /// Position of the first joint so long after the arrival, as the controller documents it for points that
    /// have velocities and accelerations: a polynomial of fifth degree from one to the next, and at first
    /// from where it is.
    fn interpolated(from: &Setpoint, message: &JointTrajectory, time_s: f64) -> f64 {
        let mut before = (0.0, [from.q[0], from.dq[0], from.ddq[0]]);
        for point in &message.points {
            let there = (seconds(point), [point.positions[0], point.velocities[0], point.accelerations[0]]);
            if time_s < there.0 {
                let (duration_s, [p, v, a], [q, w, b]) = (there.0 - before.0, before.1, there.1);
                let x = (time_s - before.0) / duration_s;
                // Scaled to a duration of one; the last three coefficients meet the end.
                let [v, w, a, b] = [v * duration_s, w * duration_s, a * duration_s.powi(2), b * duration_s.powi(2)];
                let [d, e, f] = [q - p - v - a / 2.0, w - v - a, b - a];
                let [c3, c4, c5] = [10.0 * d - 4.0 * e + f / 2.0, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + f / 2.0];
                return p + x * (v + x * (a / 2.0 + x * (c3 + x * (c4 + x * c5))));
            }
            before = there;
        }
        before.1[0]
    }

    /// In mid-motion the rest of the plan is told anew. A controller that gets it some milliseconds late goes
    /// on within the limits, and ends where the plan ends.
    #[test]
    fn a_splice_that_arrives_late_breaks_no_limit() {
        let arm = fr3();
        let plan = half(&arm);
        let middle_s = plan.end_s() / 2.0;
        for late_s in [0.0, 0.002, 0.005, 0.01] {
            let message = planned(&arm, [middle_s, plan.end_s()], |time_s| plan.setpoint(time_s));
            assert!(message.points.windows(2).all(|it| seconds(&it[0]) < seconds(&it[1])));
            let last = message.points.last().unwrap();
            assert_eq!((&last.velocities, &last.accelerations), (&vec![0.0; 7], &vec![0.0; 7]));
            assert!((last.positions[0] - arm.ready_q[0] - 0.5).abs() < 1e-9);
            let from = plan.setpoint(middle_s + late_s);
            let at = |ms: i32| interpolated(&from, &message, f64::from(ms) * 1e-3);
            let end_ms = (1e3 * seconds(last)) as i32 - 2;
            let speed = (0..end_ms).map(|ms| (at(ms + 1) - at(ms)).abs() * 1e3).fold(0.0, f64::max);
            let change = |ms: i32| (at(ms + 2) - 2.0 * at(ms + 1) + at(ms)).abs() * 1e6;
            let acceleration = (0..end_ms).map(change).fold(0.0, f64::max);
            let limits = &arm.joints[0].limits;
            assert!(speed < limits.velocity && acceleration < limits.acceleration, "{late_s}: {speed} {acceleration}");
            if late_s == 0.0 {
                let off = |ms: i32| (at(ms) - plan.setpoint(middle_s + f64::from(ms) * 1e-3).q[0]).abs();
                assert!((0..end_ms).map(off).fold(0.0, f64::max) < 1e-4, "the controller follows the plan");
            }
        }
    }

    /// Braking ends at rest, in the direction of the motion, and soon.
    #[test]
    fn braking_ends_at_rest() {
        let arm = fr3();
        let plan = half(&arm);
        let at = |i: i32| plan.setpoint(plan.end_s() / 2.0 - f64::from(i) * CYCLE_S).q;
        let message = braking(&arm, Executed([0, 1, 2].map(at)));
        let last = message.points.last().unwrap();
        assert!(last.velocities.iter().chain(&last.accelerations).all(|it| *it == 0.0));
        let way = last.positions[0] - at(0)[0];
        assert!(way > 0.01 && last.positions[0] < arm.ready_q[0] + 0.5 && seconds(last) < plan.end_s(), "{way}");
    }

    #[test]
    fn joints_are_found_by_their_names() {
        let arm = fr3();
        let header = Header { stamp: Time::ZERO, frame_id: String::new() };
        let name: Vec<String> =
            arm.joints.iter().map(|it| it.name.clone()).rev().chain(["finger".to_owned()]).collect();
        let mut state = JointState {
            header,
            position: (0..name.len()).map(|i| i as f64).collect(),
            name,
            velocity: Vec::new(),
            effort: Vec::new(),
        };
        let [q, dq] = state.of(&arm).unwrap();
        assert_eq!((q[0], q[6], dq), (6.0, 0.0, JointVector::zeros()));
        state.velocity = vec![f64::NAN; state.name.len()];
        assert_eq!(state.of(&arm), Some([q, dq]));
        for unknown in [f64::NAN, f64::INFINITY] {
            let unmeasured = JointState { position: vec![unknown; state.name.len()], ..state.clone() };
            assert_eq!(unmeasured.of(&arm), None);
        }
        state.name[3] = "another".to_owned();
        assert_eq!(state.of(&arm), None);
    }
}
