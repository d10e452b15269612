//! The object's way into the gripper: it must touch neither fingers nor housing before the fingers have
//! closed.

use catch_body::{Gripper, Pose, shape::Cuboid};
use nalgebra::{Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{CatchPlan, CatchSearch, Incoming, terminal_velocity::TerminalVelocity};
use crate::{
    grasp_selection::{Grasp, GraspSet},
    trajectory_prediction::LocalFlight,
};

/// Time and distance before the catch over which the object's approach to the gripper is checked, and number
/// of stretches: over 5 ms a point's path in G is straight to 0.1 mm. While the fingers close a contact does
/// little harm: there the ends of the stretches alone are checked, until the fingers should touch the object,
/// at the catch at the latest.
const APPROACH_S: f64 = 0.08;
const APPROACH_M: f64 = 0.15;
const STRETCHES: usize = 16;
const STRETCH_S: f64 = APPROACH_S / STRETCHES as f64;

/// An object on its way into the gripper, to be held by one of its grasps.
#[derive(Clone, Copy)]
pub(super) struct Entering<'a> {
    pub incoming: &'a Incoming<'a>,
    /// The flight near the catch.
    pub local_flight: &'a LocalFlight,
    pub grasp: &'a Grasp,
}

/// Obstacle on the object's approach that was found last. It is checked first the next time: an obstacle to
/// one motion mostly is one to the next, too.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Obstacle {
    /// The point of its outline that touched the gripper on a straight way.
    straight: usize,
    /// The stretch before the catch, and the point that touched the moving gripper there.
    stretch: usize,
    point: usize,
}

impl CatchSearch {
    /// Returns whether the object can enter a gripper that is fully open and does not rotate, at `v_GO` in G,
    /// without touching it.
    pub(super) fn straight_approach_is_free(
        &self,
        v_GO: &Vector3<f64>,
        entering: &Entering,
        last: &mut Obstacle,
    ) -> bool {
        let Some(direction) = v_GO.try_normalize(1e-6) else { return true };
        let Incoming { grasps, config, .. } = *entering.incoming;
        let open = Hand::new(&self.motion.gripper, self.motion.gripper.max_width_m, config.approach_margin_m);
        let end = entering.grasp.X_OG.inverse();
        let start = Translation3::from(direction * -APPROACH_M) * end;
        let [start, end] = [start, end].map(|X_GO| Place::new(&X_GO));
        let touching = open.touched_by(grasps, &start, &end, last.straight);
        last.straight = touching.unwrap_or(last.straight);
        touching.is_none()
    }

    /// The narrowest opening with which the object touches neither fingers nor housing on its way into the
    /// moving gripper, the fingers closing in time for the catch; `None` if there is none.
    pub(super) fn aperture(&self, plan: &CatchPlan, incoming: &Incoming, local_flight: &LocalFlight) -> Option<f64> {
        let entering = Entering { incoming, local_flight, grasp: &plan.grasp };
        self.first_with_free_approach(&self.apertures(&plan.X_WG, &entering), plan, &entering)
    }

    /// The first of these openings with which a plan lets the object in.
    pub(super) fn first_with_free_approach(
        &self,
        apertures: &[f64],
        plan: &CatchPlan,
        entering: &Entering,
    ) -> Option<f64> {
        let X_WG = |time_s: f64| self.motion.robot.gripper_pose(&plan.trajectory.setpoint(time_s).q);
        self.first_of(apertures, X_WG, entering, &mut Obstacle::default())
    }

    /// Openings that are tried, the narrowest first: up to the widest that any grasp needs, where the fingers
    /// wait, and at last as wide as the hand opens. An object that enters while it spins may need that.
    fn apertures(&self, X_WG: &Pose, entering: &Entering) -> [f64; 5] {
        let (narrow, wide) =
            (entering.grasp.aperture_m, entering.incoming.grasps.waiting_width_m(&self.motion.gripper));
        let between = |fraction: f64| narrow + fraction * (wide - narrow);
        let first_two = self.pre_closed_m(X_WG, entering).map_or([narrow, between(0.25)], |it| [it, narrow]);
        [first_two[0], first_two[1], between(0.5), wide, self.motion.gripper.max_width_m]
    }

    /// Aperture at which slow fingers wait for an object that is to be held at `X_WG`, in metres, not wider
    /// than the grasp's own; `None` for fast ones.
    pub(super) fn pre_closed_m(&self, X_WG: &Pose, entering: &Entering) -> Option<f64> {
        let Entering { incoming, local_flight, grasp } = *entering;
        let sd_m = || {
            let closing_W = X_WG.rotation * Vector3::x();
            let covariance = incoming.flight.covariance_at(local_flight.time_s).fixed_view::<3, 3>(0, 0).into_owned();
            (covariance * closing_W).dot(&closing_W).max(0.0).sqrt()
        };
        let margin_m = incoming.config.pre_closing_margin_m(&self.motion.gripper, sd_m)?;
        Some((grasp.object_width_m + 2.0 * margin_m).min(grasp.aperture_m))
    }

    /// Returns whether the approach is free with some aperture if the gripper passes through `X_WG` at the
    /// catch as `terminal_velocity` wants it to, at an even velocity: that alone rejects most motions that
    /// would fail in the end.
    pub(super) fn approach_is_free(
        &self,
        X_WG: &Pose,
        terminal_velocity: &TerminalVelocity,
        entering: &Entering,
        last: &mut Obstacle,
    ) -> bool {
        let centre = X_WG * self.motion.gripper.grasp_centre();
        let v_WG = terminal_velocity.v_WG;
        let passing = |time_s: f64| {
            let after_s = time_s - entering.local_flight.time_s;
            let turn = UnitQuaternion::from_scaled_axis(terminal_velocity.w_WG * after_s);
            let origin = centre + v_WG * after_s + turn * (X_WG.translation.vector - centre.coords);
            Pose::from_parts(origin.coords.into(), turn * X_WG.rotation)
        };
        self.first_of(&self.apertures(X_WG, entering), passing, entering, last).is_some()
    }

    /// The first of these openings that lets the object in while the gripper moves through `X_WG`.
    fn first_of(
        &self,
        apertures: &[f64],
        X_WG: impl Fn(f64) -> Pose,
        entering: &Entering,
        last: &mut Obstacle,
    ) -> Option<f64> {
        let Entering { incoming: Incoming { grasps, config, .. }, local_flight, grasp } = *entering;
        let catch_s = local_flight.time_s;
        let closing = config.closing(&self.motion.gripper);
        let v_G = local_flight.velocity_in(&X_WG, &(grasp.X_OG * self.motion.gripper.grasp_centre()));
        let lead_s = config.contact_lead_s(&v_G, &grasp.centre_past_G(&self.motion.gripper));
        let mut way = [None; STRETCHES + 1];
        apertures.iter().copied().find(|open_m| {
            let travel_m = open_m - grasp.object_width_m;
            let standing_s = lead_s + closing.duration_s(travel_m);
            // The hand with the aperture at that time; toward the end less and less space is left on purpose.
            let hand = |before_s: f64| {
                let width_m = grasp.object_width_m + closing.remaining_m(travel_m, before_s - lead_s);
                let margin_m = config.approach_margin_m.min((width_m - grasp.object_width_m) / 4.0);
                Hand::new(&self.motion.gripper, width_m, margin_m - 1e-4)
            };
            let mut knot = |number: usize| {
                let before_s = STRETCH_S * number as f64;
                let X_GO = || X_WG(catch_s - before_s).inverse() * local_flight.pose_at(catch_s - before_s);
                (before_s, *way[number].get_or_insert_with(|| Place::new(&X_GO())))
            };
            let mut touching = |stretch: usize| {
                let ((start_s, start), (end_s, end)) = (knot(stretch + 1), knot(stretch));
                let sweep = |from_s: f64, from: &Place| hand(from_s).touched_by(grasps, from, &end, last.point);
                let stands = (start_s > standing_s).then(|| sweep(start_s, &start)).flatten();
                stands.or_else(|| (lead_s..=standing_s).contains(&end_s).then(|| sweep(end_s, &end)).flatten())
            };
            let others = (0..STRETCHES).filter(|stretch| *stretch != last.stretch);
            let found =
                std::iter::once(last.stretch).chain(others).find_map(|stretch| Some((stretch, touching(stretch)?)));
            if let Some((stretch, point)) = found {
                (last.stretch, last.point) = (stretch, point);
            }
            found.is_none()
        })
    }
}

/// An object's pose in G.
#[derive(Clone, Copy)]
struct Place {
    R_GO: Rotation3<f64>,
    p_GO: Vector3<f64>,
}

impl Place {
    fn new(X_GO: &Pose) -> Self {
        Self { R_GO: X_GO.rotation.to_rotation_matrix(), p_GO: X_GO.translation.vector }
    }

    fn y_of(&self, point: &Point3<f64>) -> f64 {
        self.R_GO.matrix().row(1).tr_dot(&point.coords) + self.p_GO.y
    }

    fn of(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.R_GO * point.coords + self.p_GO
    }
}

/// Fingers and housing at one instant, and how far away an object must stay.
struct Hand {
    boxes: [Cuboid; 3],
    margin_m: f64,
}

impl Hand {
    fn new(gripper: &Gripper, width_m: f64, margin_m: f64) -> Self {
        let [left, right] = gripper.fingers(width_m);
        Self { boxes: [left, right, gripper.body()], margin_m }
    }

    /// The point of an object's outline that touches it on the straight way between two places of the object;
    /// the point `likely` is looked at before all others.
    fn touched_by(&self, grasps: &GraspSet, start: &Place, end: &Place, likely: usize) -> Option<usize> {
        let meets = |it: &Cuboid, radius_m: f64, [start, end]: [Vector3<f64>; 2]| {
            let half = it.size.add_scalar(2.0 * (radius_m + self.margin_m)) / 2.0;
            segment_meets(&half, &(start - it.centre.coords), &(end - it.centre.coords))
        };
        let near = self.boxes.map(|it| meets(&it, grasps.radius_m, [start.p_GO, end.p_GO]).then_some(it));
        if near.iter().all(Option::is_none) {
            return None;
        }
        // Nothing of the hand is beyond the fingertips.
        let tips_m = near.iter().flatten().map(|it| it.centre.y + it.size.y / 2.0).fold(f64::NEG_INFINITY, f64::max);
        let touches = |i: &usize| {
            let point = &grasps.surface_points[*i];
            if [start, end].iter().all(|it| it.y_of(point) > tips_m + self.margin_m) {
                return false;
            }
            let way = [start, end].map(|it| it.of(point));
            near.iter().flatten().any(|it| meets(it, 0.0, way))
        };
        if likely < grasps.surface_points.len() && touches(&likely) {
            return Some(likely);
        }
        (0..grasps.surface_points.len()).find(touches)
    }
}

/// Returns whether a line segment passes through a box about the origin: its parts between each pair of faces
/// must have one in common (Kay & Kajiya, Ray tracing complex scenes, 1986).
fn segment_meets(half: &Vector3<f64>, start: &Vector3<f64>, end: &Vector3<f64>) -> bool {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        let (start, end, half) = (start[axis], end[axis], half[axis]);
        if start.min(end) > half || start.max(end) < -half {
            return false;
        }
        // Where the way runs along the faces both are infinite, and it is between them all the time.
        let (one, two) = ((-half - start) / (end - start), (half - start) / (end - start));
        enter = enter.max(one.min(two));
        leave = leave.min(one.max(two));
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Compares the test of a segment with points along it.
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
            let from = from - cuboid.centre.coords;
            let meets = segment_meets(&(cuboid.size / 2.0).add_scalar(0.01), &from, &(from + way));
            prop_assert!(meets || nearest > 0.01);
            prop_assert!(!meets || nearest < 0.011);
        }
    }
}
