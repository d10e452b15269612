//! Motions from one pose to another that no brain plans: to the waiting pose, before a throw.

use catch_body::{JointVector, Robot};
use catch_cell::{ArmTrajectory, BSpline, LimitKind, TrajectoryId, executor::PeakRatios};

/// A motion that begins and ends at rest, straight in joint space, at a fraction of the limits of velocity,
/// acceleration and jerk. It looks for no obstacle.
pub fn straight(id: u64, start_s: f64, [from, to]: [JointVector; 2], robot: &Robot, fraction: f64) -> ArmTrajectory {
    let over = |duration_s: f64| {
        let knots = [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0].map(|it| start_s + it / 3.0 * duration_s);
        BSpline { knots_s: knots.to_vec(), control_points: vec![from, from, from, to, to, to] }
    };
    let peaks = PeakRatios::of(robot, &over(1.0));
    let ratio = |kind: LimitKind| peaks.highest(kind) / fraction;
    let [velocity, acceleration, jerk] = [LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk].map(ratio);
    let hand = ratio(LimitKind::HandSpeed);
    let duration_s = velocity.max(hand).max(acceleration.sqrt()).max(libm::cbrt(jerk)).max(0.1);
    ArmTrajectory { id: TrajectoryId(id), spline: over(duration_s) }
}
