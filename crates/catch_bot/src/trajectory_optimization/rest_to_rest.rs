//! Motions from rest to rest: to put an object down, and back to the ready pose.

use catch_body::JointVector;
use catch_cell::BSpline;

use super::MotionPlanner;
use crate::grasp_selection::Grasp;

/// Fractions of the velocity and acceleration limits that these motions use at first: nothing hurries them.
const VELOCITY_FRACTION: f64 = 0.5;
const ACCELERATION_FRACTION: f64 = 0.3;
/// Shortest duration in seconds.
const SHORTEST_S: f64 = 0.3;
/// Factor by which each further try takes longer, and number of tries.
const SLOWER: f64 = 1.4;
const TRIES: usize = 5;
/// Control points of one motion, besides those that keep its ends at rest.
const POINTS: usize = 13;

impl MotionPlanner {
    /// A motion that starts at rest in `from` at `start_s` and ends at rest in `to`, through `via` at rest if
    /// that is given; `grasp` tells what the hand holds on the way, if anything. `None` if it does not keep
    /// the limits and the clearances, however slow.
    pub fn rest_to_rest(
        &self,
        start_s: f64,
        from: &JointVector,
        via: Option<&JointVector>,
        to: &JointVector,
        grasp: Option<&Grasp>,
    ) -> Option<BSpline> {
        let mut stretched = 1.0;
        for _ in 0..TRIES {
            let motion = match via {
                None => self.straight(start_s, from, to, stretched),
                Some(via) => {
                    let first = self.straight(start_s, from, via, stretched);
                    let second = self.straight(first.end_s(), via, to, stretched);
                    first.followed_by(&second)
                }
            };
            if self.keeps_limits(&motion) && self.keeps_torque(&motion) {
                let width_m = grasp.map_or(self.gripper.max_width_m, |it| it.object_width_m);
                let span_s = [motion.start_s(), motion.end_s()];
                return self.keeps_clear(&motion, span_s, width_m, grasp.map(|it| &it.held_G)).then_some(motion);
            }
            stretched *= SLOWER;
        }
        None
    }

    /// Straight in joint space, close to the quintic polynomial u³·(10 − 15·u + 6·u²) of the relative time u.
    /// That is at most 1.875 and 5.78 times as fast as evenly, in velocity and acceleration, and 60 times in
    /// jerk.
    fn straight(&self, start_s: f64, from: &JointVector, to: &JointVector, stretched: f64) -> BSpline {
        let needed_s = |i: usize| {
            let (limits, way) = (&self.robot.joints[i].limits, (to[i] - from[i]).abs());
            let by_velocity = 1.875 * way / (VELOCITY_FRACTION * limits.velocity);
            let by_acceleration = (5.78 * way / (ACCELERATION_FRACTION * limits.acceleration)).sqrt();
            let by_jerk = limits.jerk.map_or(0.0, |jerk| libm::cbrt(60.0 * way / jerk));
            by_velocity.max(by_acceleration).max(by_jerk)
        };
        let duration_s = stretched * (0..self.robot.dof()).map(needed_s).fold(SHORTEST_S, f64::max);
        // The first and the last three control points are the ends: position, velocity and acceleration stand
        // still there.
        let control_points: Vec<JointVector> = (0..POINTS + 4)
            .map(|i| {
                let u = ((i as f64 - 2.0) / (POINTS - 1) as f64).clamp(0.0, 1.0);
                from + (to - from) * (u * u * u * (10.0 - 15.0 * u + 6.0 * u * u))
            })
            .collect();
        let spans = control_points.len() - 3;
        let inner = (1..spans).map(|i| start_s + duration_s * i as f64 / spans as f64);
        let knots_s = [start_s; 4].into_iter().chain(inner).chain([start_s + duration_s; 4]).collect();
        BSpline { knots_s, control_points }
    }
}
