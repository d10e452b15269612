//! Grasp selection (paper, III-C): where and how to hold the object.
//!
//! What depends on the object's shape alone is done once, from its reference scan: Darboux frames at sampled
//! points become gripper poses in the object's frame, and those that collide, close on nothing or would slip
//! are dropped ([`GraspSet`]). In flight the paper's heuristics rank what is left ([`heuristics`]):
//! "strength", "catchability" and "comfort". What the arm can reach is asked by trajectory optimization.

pub mod darboux;
pub mod fit;
pub mod heuristics;

use std::collections::BTreeMap;

use catch_body::{DriveControl, Gripper, Pose, gripper::Closing, quantity, shape::Cuboid, symmetry::Symmetry};
use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::perception::ReferenceModel;
use darboux::darboux_frame;
pub use fit::GraspFailure;
pub use heuristics::{Approach, Passing, RankedGrasp};

/// Settings of grasp selection.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// The centre of mass may be this much farther from the palm than the grasp centre: a long object that
    /// flies toward the palm end first.
    pub max_overhang_m: quantity::error_m,
    /// Free space on each side between the object and the open fingers, in metres, for the prediction's
    /// uncertainty. Where the gripper does not open so far there is less, not less than the approach margin.
    pub finger_margin_m: quantity::error_m,
    /// Least part of the finger margin that must be left while the object enters the gripper, in metres.
    pub approach_margin_m: quantity::error_m,
    /// Speed of closing in m/s, the fingers relative to each other; the gripper's own limit if nothing is
    /// said.
    pub closing_speed_mps: quantity::drive_speed_mps<Option<f64>>,
    /// Acceleration at which the fingers close, in m/s²; the gripper's largest if it is not set.
    pub closing_acceleration_mps2: quantity::drive_acceleration_mps2<Option<f64>>,
    /// The fingers should touch the object when its centre still has this far to go across them to the grasp
    /// centre, in metres: the way on which they brake it.
    pub finger_braking_distance_m: quantity::error_m,
    /// Braking distance of an object that flies along the fingers toward the palm, from which it would
    /// bounce, in metres: fingers that close slowly should touch it as soon as it is between them.
    pub palm_braking_distance_m: quantity::error_m,
    /// Reduction of the palm braking distance for soft objects, in metres: the distance becomes
    /// [`Config::palm_braking_distance_m`] less this times 1/e − 1, e being [`Config::restitution`], at least
    /// 0.3; it may be negative. An object that bounces fast must be held before it reaches the palm; a slow
    /// one may be held on its way back, when all of it is between the fingers.
    pub palm_rebound_distance_m: quantity::error_m,
    /// Expected coefficient of restitution of the object on the gripper, 0 to 1; a typical 0.5 if it is not
    /// set.
    pub restitution: quantity::fraction<Option<f64>>,
    /// Weights of the heuristics.
    pub weights: heuristics::Weights,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            max_overhang_m: 0.06,
            finger_margin_m: 0.012,
            approach_margin_m: 0.003,
            closing_speed_mps: None,
            closing_acceleration_mps2: None,
            finger_braking_distance_m: 0.007,
            palm_braking_distance_m: 0.008,
            palm_rebound_distance_m: 0.017,
            restitution: None,
            weights: heuristics::Weights::default(),
        }
    }
}

/// Parameters for sampling the grasp candidates of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling<'a> {
    /// Points of the cloud at which Darboux frames are tried at most, each in four orientations.
    pub most: usize,
    /// Points that are tried at least.
    pub fewest: usize,
    /// Grasps with which sampling ends, rotated ones aside, once the fewest points are tried.
    pub enough: usize,
    /// Each grasp is also tried rotated by these angles about the direction in which the fingers close, in
    /// radians: they meet the surface as squarely, but come from elsewhere.
    pub turns_rad: &'a [f64],
}

impl Sampling<'static> {
    /// The paper draws 2,000 points in every call; here they are drawn once. An object as large as the
    /// gripper opens can be held at few places.
    pub const DEFAULT: Self =
        Self { most: 4000, fewest: 250, enough: 250, turns_rad: &[-1.05, -0.52, 0.52, 1.05, 1.57] };
}

/// Seed of the draw.
const SEED: u64 = 1;
/// Neighbourhood of a Darboux frame in metres. The paper's code has 2 mm on a cloud of 2.5 mm spacing; a
/// wider one keeps the noise of the scan out of the directions.
const DARBOUX_RADIUS_M: f64 = 0.008;
/// Grasps that are handed on for each catch time.
pub const KEPT: usize = 60;
/// Fingers that need longer than this to close by the finger margin on both sides, in seconds, are slow: they
/// wait nearer to the object, so that less is left to close and the motion can be corrected for longer.
const SLOW_CLOSING_S: f64 = 0.25;
/// Margin at which slow fingers wait, in standard deviations of the predicted position along the direction of
/// closing on each side, not less than the approach margin nor more than the finger margin.
const PRE_CLOSING_SD: f64 = 3.0;

impl Config {
    /// Closing motion of the fingers: their speed and acceleration.
    pub fn closing(&self, gripper: &Gripper) -> Closing {
        Closing {
            speed_mps: match gripper.drive.control {
                DriveControl::SpeedAndForce => self.closing_speed_mps.unwrap_or(gripper.max_speed_mps),
                DriveControl::Position | DriveControl::TwoState => gripper.max_speed_mps,
            },
            acceleration_mps2: self.closing_acceleration_mps2.unwrap_or(gripper.max_acceleration_mps2),
        }
    }

    /// Margin at which slow fingers wait on each side of an object whose position along the direction of
    /// closing has this standard deviation, in metres; `None` for fingers that are fast, or cannot wait
    /// anywhere.
    pub fn pre_closing_margin_m(&self, gripper: &Gripper, sd_m: impl FnOnce() -> f64) -> Option<f64> {
        let is_slow = self.closing(gripper).duration_s(2.0 * self.finger_margin_m) > SLOW_CLOSING_S;
        let can_wait = gripper.drive.control != DriveControl::TwoState;
        (is_slow && can_wait).then(|| (PRE_CLOSING_SD * sd_m()).max(self.approach_margin_m).min(self.finger_margin_m))
    }

    /// The coefficient of restitution that is expected.
    pub fn expected_restitution(&self) -> f64 {
        self.restitution.unwrap_or(TYPICAL_RESTITUTION)
    }

    /// Lead of the finger contact over the passage of the held point at the grasp centre, in seconds, for an
    /// object that moves at `v_G` in G. It is the time by which the object's centre, then `past_G` from the
    /// grasp centre, passes earlier, plus the time over the braking distance: across the fingers (along z_G),
    /// or along them toward the palm (along −y_G). Negative where the fingers should touch afterwards.
    ///
    /// An object that is squeezed at its centre stays; one whose centre has passed hangs out on the other
    /// side. Along the fingers the centre does not count: the palm may be in its way.
    pub fn contact_lead_s(&self, v_G: &Vector3<f64>, past_G: &Vector3<f64>) -> f64 {
        let rebound_distance_m = self.palm_rebound_distance_m * (1.0 / self.expected_restitution().max(SOFTEST) - 1.0);
        let palm_travel_m = self.palm_braking_distance_m - rebound_distance_m;
        let braking = self.finger_braking_distance_m * v_G.z.abs() + palm_travel_m * (-v_G.y).max(0.0);
        (past_G.xz().dot(&v_G.xz()) + braking) / v_G.norm_squared().max(1.0)
    }
}

/// Coefficient of restitution of objects for which none is given.
const TYPICAL_RESTITUTION: f64 = 0.5;
/// Least coefficient of restitution that is assumed: an object touched still later would be gone if it
/// bounced after all.
const SOFTEST: f64 = 0.3;

/// A way of holding the object, fixed to the object.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    /// Pose of the gripper in the object's frame when the fingers close.
    pub X_OG: Pose,
    /// Width of the object between the fingers, in metres.
    pub object_width_m: f64,
    /// Narrowest opening before the catch, in metres.
    pub aperture_m: f64,
    /// "Strength": distance of the centre of mass from the gripper's y axis, in metres; less is better.
    pub strength_m: f64,
    /// Distance by which the centre of mass is farther from the palm than the grasp centre, in metres.
    pub overhang_m: f64,
    /// Box in G that contains the object in the closed hand.
    pub held_G: Cuboid,
}

impl Grasp {
    /// Vector from the grasp centre to the object's centre of mass when the fingers close, in G.
    pub fn centre_past_G(&self, gripper: &Gripper) -> Vector3<f64> {
        self.X_OG.inverse().translation.vector - gripper.grasp_centre().coords
    }
}

/// All grasp candidates one object that its shape allows.
#[derive(Debug, Clone)]
pub struct GraspSet {
    /// The grasps.
    pub grasps: Vec<Grasp>,
    /// Number of the other sampled candidates for each reason of their failure.
    failures: BTreeMap<GraspFailure, usize>,
    /// Surface samples of the object in O, few points for clearance checks on the approach.
    pub surface_points: Vec<Point3<f64>>,
    /// Distance of the farthest of them from the centre of mass, in metres.
    pub radius_m: f64,
    /// Rotations about the centre of mass under which the object looks the same: turned by one of them, a
    /// grasp holds it alike.
    pub symmetry: Symmetry,
    /// The widest opening that any of the grasps asks for, in metres; `None` without grasps. A hand that
    /// waits no wider has less to close: slow fingers that wait wide open for a thin object are late.
    pub widest_aperture_m: Option<f64>,
    /// Closing and approaching direction of every grasp, in O.
    axes: Vec<[Vector3<f64>; 2]>,
}

impl GraspSet {
    /// Opening at which a gripper waits for the object, in metres.
    pub fn waiting_width_m(&self, gripper: &Gripper) -> f64 {
        self.widest_aperture_m.unwrap_or(gripper.max_width_m)
    }

    /// Samples Darboux frames on the reference cloud and keeps the grasps that fit, until there are enough.
    pub fn sample(reference: &ReferenceModel, gripper: &Gripper, config: &Config) -> Self {
        Self::sample_as(&Sampling::DEFAULT, reference, gripper, config)
    }

    /// Samples grasps with other parameters than the defaults.
    pub fn sample_as(sampling: &Sampling<'_>, reference: &ReferenceModel, gripper: &Gripper, config: &Config) -> Self {
        let mut rng = Pcg64::seed_from_u64(SEED);
        let (mut grasps, mut failures) = (Vec::new(), BTreeMap::new());
        // A ball looks the same from everywhere.
        let turns_rad: &[f64] = if reference.symmetry == Symmetry::Sphere { &[] } else { sampling.turns_rad };
        let samples = if reference.points.is_empty() { 0 } else { sampling.most };
        let mut not_turned = 0;
        for sample in 0..samples {
            if sample >= sampling.fewest && not_turned >= sampling.enough {
                break;
            }
            let index = rng.random_range(0..reference.points.len());
            let frame = darboux_frame(&reference.points, &reference.normals, index, DARBOUX_RADIUS_M);
            let [least, most] = frame.principal;
            for closing in [least, -least, most, -most] {
                // The gripper looks along the inward normal (y) and closes along a principal direction (x).
                let approach = -frame.normal;
                let R_OG = Rotation3::from_basis_unchecked(&[closing, approach, closing.cross(&approach)]);
                let R_OG = UnitQuaternion::from_rotation_matrix(&R_OG);
                let grasp = match fit::fit_gripper(reference, gripper, config, &frame.point, R_OG) {
                    Ok(grasp) => grasp,
                    Err(failure) => {
                        *failures.entry(failure).or_default() += 1;
                        continue;
                    }
                };
                let held = grasp.X_OG * gripper.grasp_centre();
                grasps.push(grasp);
                not_turned += 1;
                grasps.extend(turns_rad.iter().filter_map(|&turn| {
                    let R_OG = R_OG * UnitQuaternion::from_scaled_axis(Vector3::x() * turn);
                    fit::fit_gripper(reference, gripper, config, &held, R_OG).ok()
                }));
            }
        }
        let axes = grasps.iter().map(|it| [it.X_OG * Vector3::x(), it.X_OG * Vector3::y()]).collect();
        let surface_points = surface_points(&reference.points);
        let radius_m = surface_points.iter().map(|point| point.coords.norm()).fold(0.0, f64::max);
        let widest_aperture_m = grasps.iter().map(|grasp| grasp.aperture_m).max_by(f64::total_cmp);
        Self { grasps, failures, surface_points, radius_m, symmetry: reference.symmetry, widest_aperture_m, axes }
    }

    /// The distance from the gripper's origin at which the farthest of the grasps holds the object's origin,
    /// in metres.
    pub fn farthest_held_m(&self) -> f64 {
        self.grasps.iter().map(|grasp| grasp.X_OG.translation.vector.norm()).fold(0.0, f64::max)
    }

    /// Reasons for which sampled candidates failed, the most frequent first.
    pub fn failures(&self) -> String {
        let mut reasons: Vec<_> = self.failures.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let reasons: Vec<String> = reasons.iter().map(|(failure, count)| format!("{count}: {failure}")).collect();
        format!("of the places tried {}", reasons.join(", "))
    }

    /// The best grasps for an object in pose `X_WO` that flies at `v_WO`, best first, among those whose pose
    /// X_OG the gripper `may_reach`; and whether there are any if it need not.
    ///
    /// `v_WO` is the velocity in W in m/s, `base` the origin of the arm's base in W in metres.
    pub fn rank(
        &self,
        X_WO: &Pose,
        v_WO: &Vector3<f64>,
        base: &Point3<f64>,
        config: &Config,
        may_reach: impl Fn(&Pose) -> bool,
    ) -> (Vec<RankedGrasp>, bool) {
        let passing = Passing::new(X_WO, v_WO, base, &config.weights);
        if !passing.moves() {
            return (Vec::new(), false);
        }
        let mut any = false;
        let mut ranked: Vec<RankedGrasp> = self
            .grasps
            .iter()
            .zip(&self.axes)
            .enumerate()
            .filter(|(_, (_, axes))| passing.can_be_caught(axes))
            .inspect(|_| any = true)
            .filter(|(_, (grasp, _))| may_reach(&grasp.X_OG))
            .map(|(index, (grasp, axes))| passing.rank(index, grasp, axes))
            .collect();
        let better = |a: &RankedGrasp, b: &RankedGrasp| a.cost.total_cmp(&b.cost).then(a.index.cmp(&b.index));
        if ranked.len() > KEPT {
            ranked.select_nth_unstable_by(KEPT, better);
            ranked.truncate(KEPT);
        }
        ranked.sort_unstable_by(better);
        (ranked, any)
    }
}

/// Points that outline an object at most.
const SURFACE_POINTS: usize = 450;
/// Length of the edges of the smallest cells of which one point is kept.
const SMALLEST_CELL_M: f64 = 0.003;

/// A cloud with few points that still has corners and edges: of each cell of a grid the point that is
/// farthest from the centre of mass.
fn surface_points(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let distance = |i: usize| points[i].coords.norm();
    let in_cells = |cell_m: f64| {
        let mut farthest = BTreeMap::new();
        for (i, point) in points.iter().enumerate() {
            let cell = (point.coords / cell_m).map(|it| it.floor() as i64);
            let kept = farthest.entry([cell.x, cell.y, cell.z]).or_insert(i);
            if distance(i) > distance(*kept) {
                *kept = i;
            }
        }
        farthest
    };
    let mut cell_m = SMALLEST_CELL_M;
    let mut kept = in_cells(cell_m);
    while kept.len() > SURFACE_POINTS {
        cell_m *= 1.1;
        kept = in_cells(cell_m);
    }
    kept.into_values().map(|i| points[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A finger meets a box at its edges, where the corners are far away.
    #[test]
    fn surface_points_keep_the_edges_of_a_box() {
        let half = Vector3::new(0.019, 0.045, 0.088);
        let steps = (half * 2.0 / 0.0025).map(|it: f64| it.round() as usize);
        let mut points = Vec::new();
        for (i, j, k) in
            (0..=steps.x).flat_map(|i| (0..=steps.y).flat_map(move |j| (0..=steps.z).map(move |k| (i, j, k))))
        {
            let at = [(i, steps.x), (j, steps.y), (k, steps.z)].map(|(step, steps)| step as f64 / steps as f64);
            if at.iter().any(|it| [0.0, 1.0].contains(it)) {
                points.push(Point3::from((Vector3::from(at) * 2.0 - Vector3::repeat(1.0)).component_mul(&half)));
            }
        }
        let kept = surface_points(&points);
        assert!(kept.len() <= SURFACE_POINTS && kept.len() > SURFACE_POINTS / 2, "{}", kept.len());
        let is_on_edge = |it: &&Point3<f64>| (0..3).filter(|i| (it[*i].abs() - half[*i]).abs() < 1e-9).count() >= 2;
        for point in points.iter().filter(is_on_edge) {
            let nearest_m = kept.iter().filter(is_on_edge).map(|it| (it - point).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest_m < 0.018, "no point of the edge within {nearest_m} m of {point}");
        }
    }
}
