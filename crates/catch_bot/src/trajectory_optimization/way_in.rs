//! The object's way into the gripper: it must touch neither fingers nor housing before the fingers have closed.

use catch_body::{Pose, shape::Cuboid};
use nalgebra::{UnitQuaternion, Vector3};

use super::{CatchPlan, Planner, arrival::Arrival};
use crate::{
    grasp_selection::{self, Entry, Grasp, GraspSet},
    trajectory_prediction::{FlightTrajectory, Passage},
};

/// How long, how far and in how many steps before the catch the object's way into the gripper is checked. In a step an object at
/// 6 m/s moves by 6 mm; in one of 5 ms it would get past the edge of a finger.
const WAY_IN_S: f64 = 0.08;
const WAY_IN_M: f64 = 0.15;
const WAY_IN_STEPS: usize = 80;
const STEP_S: f64 = WAY_IN_S / WAY_IN_STEPS as f64;
/// While the fingers close a touch does little harm: there each fifth step does.
const COARSE: usize = 5;

/// An object on its way into the gripper, to be held by one of its grasps.
#[derive(Clone, Copy)]
pub(super) struct Entering<'a> {
    pub flight: &'a FlightTrajectory,
    pub catch_s: f64,
    pub grasp: &'a Grasp,
    pub grasps: &'a GraspSet,
    pub config: &'a grasp_selection::Config,
}

/// What stood in an object's way when it was last looked at. It is looked at first the next time: what is in the way of one
/// motion mostly is in that of the next, too.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Obstacle {
    /// The point of its outline that touched the gripper on a straight way.
    straight: usize,
    /// The step before the catch, and the point that touched the moving gripper then.
    step: usize,
    point: usize,
}

impl Planner {
    /// Whether the object can come into a gripper that is fully open and does not turn, at `v_GO` in G, without touching it.
    pub(super) fn enters_straight(&self, v_GO: &Vector3<f64>, entering: &Entering, last: &mut Obstacle) -> bool {
        let Some(direction) = v_GO.try_normalize(1e-6) else { return true };
        let (outline, margin_m) = (&entering.grasps.outline, entering.config.way_in_margin_m);
        let [left, right] = self.gripper.fingers(self.gripper.max_width_m);
        let boxes = [left, right, self.gripper.body()];
        let X_GO = entering.grasp.X_OG.inverse();
        let R_GO = X_GO.rotation.to_rotation_matrix();
        let way = Way::new(direction * -WAY_IN_M);
        let touches = |i: &usize| {
            let from = R_GO * outline[*i].coords + X_GO.translation.vector;
            boxes.iter().any(|it| way.meets(it, margin_m, &from))
        };
        let likely = Some(last.straight).filter(|i| *i < outline.len() && touches(i));
        let touching = likely.or_else(|| (0..outline.len()).find(touches));
        last.straight = touching.unwrap_or(last.straight);
        touching.is_none()
    }

    /// The narrowest opening with which the object touches neither fingers nor housing on its way into the moving gripper,
    /// the fingers closing in time for the catch; `None` if there is none.
    pub(super) fn opening(
        &self,
        plan: &CatchPlan,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        config: &grasp_selection::Config,
    ) -> Option<f64> {
        self.first_that_lets_in(&self.openings(&plan.grasp), plan, flight, grasps, config)
    }

    /// The first of these openings with which a plan lets the object in.
    pub(super) fn first_that_lets_in(
        &self,
        openings: &[f64],
        plan: &CatchPlan,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        config: &grasp_selection::Config,
    ) -> Option<f64> {
        let entering = Entering { flight, catch_s: plan.catch_s, grasp: &plan.grasp, grasps, config };
        let X_WG = |time_s: f64| self.robot.gripper_pose(&plan.trajectory.setpoint(time_s).q);
        self.first_of(openings, X_WG, &entering, &mut Obstacle::default())
    }

    /// Openings that are tried, the narrowest first.
    fn openings(&self, grasp: &Grasp) -> [f64; 4] {
        let (narrow, wide) = (grasp.open_width_m, self.gripper.max_width_m);
        [0.0, 0.25, 0.5, 1.0].map(|share| narrow + share * (wide - narrow))
    }

    /// Whether there is such an opening if the gripper passes through `X_WG` at the catch as `arrival` wants it to, at an even
    /// velocity: most motions that would fail in the end are told from that alone.
    pub(super) fn lets_in(&self, X_WG: &Pose, arrival: &Arrival, entering: &Entering, last: &mut Obstacle) -> bool {
        let centre = X_WG * self.gripper.grasp_centre();
        let v_WG = entering.flight.twist_at(entering.catch_s).linear * arrival.speed_fraction;
        let passing = |time_s: f64| {
            let after_s = time_s - entering.catch_s;
            let turn = UnitQuaternion::from_scaled_axis(arrival.w_WG * after_s);
            let origin = centre + v_WG * after_s + turn * (X_WG.translation.vector - centre.coords);
            Pose::from_parts(origin.coords.into(), turn * X_WG.rotation)
        };
        self.first_of(&self.openings(entering.grasp), passing, entering, last).is_some()
    }

    /// The first of these openings that lets the object in while the gripper moves through `X_WG`.
    fn first_of(
        &self,
        openings: &[f64],
        X_WG: impl Fn(f64) -> Pose,
        entering: &Entering,
        last: &mut Obstacle,
    ) -> Option<f64> {
        let Entering { flight, catch_s, grasp, grasps, config } = *entering;
        let passage = Passage::of(flight, catch_s);
        // Where the object is too far away to touch anything, nothing need be looked at.
        let near_m = grasps.radius_m + self.gripper.fingertip_y_m().hypot(self.gripper.max_width_m);
        let mut way = [None; WAY_IN_STEPS + 1];
        let closing = config.closing(&self.gripper);
        let lead_s = config.contact_lead_s(&passage.velocity_in(&X_WG, &(grasp.X_OG * self.gripper.grasp_centre())));
        openings.iter().copied().find(|open_m| {
            let way_m = open_m - grasp.object_width_m;
            let standing_s = lead_s + closing.duration_s(way_m);
            let is_asked = |step: &usize| STEP_S * *step as f64 > standing_s || step.is_multiple_of(COARSE);
            let first = Some(last.step).filter(is_asked);
            let others = (0..=WAY_IN_STEPS).filter(|step| is_asked(step) && Some(*step) != first);
            first.into_iter().chain(others).all(|step| {
                let before_s = STEP_S * step as f64;
                let X_GO = way[step]
                    .get_or_insert_with(|| X_WG(catch_s - before_s).inverse() * passage.pose_at(catch_s - before_s));
                if X_GO.translation.vector.norm() >= near_m {
                    return true;
                }
                // How far the fingers have closed by then; toward the end less and less space is left on purpose.
                let width_m = grasp.object_width_m + closing.remaining_m(way_m, before_s - lead_s);
                let margin_m = config.way_in_margin_m.min((width_m - grasp.object_width_m) / 4.0);
                let entry = Entry::new(&self.gripper, width_m, margin_m - 1e-4);
                let touching = entry.obstacle(&grasps.outline, grasps.radius_m, X_GO, last.point);
                if let Some(point) = touching {
                    (last.step, last.point) = (step, point);
                }
                touching.is_none()
            })
        })
    }
}

/// A straight way, the same for many points.
struct Way {
    /// One over its components, huge where they vanish.
    inverse: Vector3<f64>,
}

impl Way {
    fn new(along: Vector3<f64>) -> Self {
        Self { inverse: along.map(|it| if it.abs() < 1e-12 { 1e12 } else { 1.0 / it }) }
    }

    /// Whether a point that starts at `from` comes within `margin_m` of a box: the parts of its way between each pair of faces
    /// (Kay & Kajiya, Ray tracing complex scenes, 1986).
    fn meets(&self, cuboid: &Cuboid, margin_m: f64, from: &Vector3<f64>) -> bool {
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..3 {
            let half = cuboid.size[axis] / 2.0 + margin_m;
            let at = cuboid.centre[axis] - from[axis];
            let (one, two) = ((at - half) * self.inverse[axis], (at + half) * self.inverse[axis]);
            enter = enter.max(one.min(two));
            leave = leave.min(one.max(two));
        }
        enter <= leave
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use proptest::prelude::*;

    proptest! {
        /// Against points along the way.
        #[test]
        fn a_way_meets_a_box_where_one_of_its_points_is_inside(
            from in prop::array::uniform3(-0.3f64..0.3), way in prop::array::uniform3(-0.5f64..0.5),
        ) {
            let cuboid = Cuboid { centre: Point3::new(0.02, 0.0, -0.01), size: Vector3::new(0.1, 0.2, 0.05) };
            let (from, way) = (Vector3::from(from), Vector3::from(way));
            let nearest = (0..=2000).map(|i| {
                let at = from + way * (f64::from(i) / 2000.0);
                ((at - cuboid.centre.coords).abs() - cuboid.size / 2.0).max()
            }).fold(f64::INFINITY, f64::min);
            let meets = Way::new(way).meets(&cuboid, 0.01, &from);
            prop_assert!(meets || nearest > 0.01);
            prop_assert!(!meets || nearest < 0.011);
        }
    }
}
