//! Parameters of a calibration, and the derivatives of measurements by them.
//!
//! Parameters other than the cameras' poses count in their standard deviations, so that each has the prior
//! N(0, 1). The standard deviations of joint zeros and links' surfaces are estimated from the images
//! ([`Shared::tell`]); so is that of the height of each patch, which counts in the standard deviation of
//! surfaces that it begins with.

use std::collections::{BTreeMap, BTreeSet, btree_map::Entry};

use catch_body::{
    Gripper, JointVector, MAX_JOINTS, Pose, Robot,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, SurfacePart},
};
use nalgebra::{Point3, Vector3};

use super::{
    ArmSample,
    coarse::moved,
    measurement::{Measurement, Quantity},
    normal_equations::Row,
};

/// Parameters of each camera: rotation and translation, scale, time offset, growth at edges, its rise with
/// the slope, loss, loss of growth.
pub const OF_CAMERA: usize = 12;
/// The first parameter of a camera that is no part of its pose.
pub const FIRST_NUISANCE: usize = 6;
/// Index of the time offset among a camera's parameters.
pub const TIME_OFFSET: usize = 7;
/// Standard deviation of the scale of a camera's depths.
pub const SCALE_SD: f64 = 0.02;
/// Standard deviation of the time between the clocks of a camera and the arm, in seconds.
pub const TIME_OFFSET_SD_S: f64 = 0.02;
/// Standard deviations of growth, its rise with the slope, loss over the predicted one, and growth that is
/// lost with the last pixel, in pixels.
const GROWTH_SD: [f64; 4] = [3.0, 3.0, 1.0, 1.0];

/// First standard deviation of joint zeros, in radians; the images determine it.
const FIRST_ZERO_SD_RAD: f64 = 5e-4;
/// First standard deviation of links' surfaces, in metres; the images determine it.
pub const FIRST_LINK_SD_M: f64 = 1e-3;
/// Standard deviation of the gripper's mount along each axis, in metres.
const MOUNT_SD_M: f64 = 0.0005;
/// Standard deviation of the rotation of the gripper's mount about each axis, in radians.
const MOUNT_SD_RAD: f64 = 0.00175;
/// Least and greatest ratio of the estimated standard deviations to the first ones.
const TOLD: [f64; 2] = [0.02, 10.0];
/// Edge of the cubes of a patch, in metres: covers, cables and labels are some centimetres long.
const PATCH_M: f64 = 0.04;
/// Images determine at least so much of the height of a patch.
const LEAST_DETERMINED: f64 = 1e-6;
/// Images that determine fewer than so many of the zeros, or surfaces, do not tell their standard deviation.
const DETERMINED: f64 = 0.5;

/// Parameters of one camera.
#[derive(Debug, Clone, Copy)]
pub struct CameraState {
    pub X_WC: Pose,
    /// Scale, time offset, growth, its rise with the slope, loss, and loss of growth, in standard deviations.
    pub nuisance: [f64; OF_CAMERA - FIRST_NUISANCE],
}

impl CameraState {
    pub fn time_offset_s(&self) -> f64 {
        self.nuisance[1] * TIME_OFFSET_SD_S
    }

    /// Correction of a measurement's prediction beyond its rendering, but for what an image's pixels have in
    /// common.
    pub fn correction(&self, it: &Measurement) -> f64 {
        nuisance_columns(it).iter().zip(&self.nuisance).map(|(column, value)| column * value).sum()
    }
}

/// Parameters that all cameras have in common: joint zeros, links' surfaces, mount of the gripper (rotation
/// and translation in G), and how far each patch of a surface rises above its link's: covers, cables, labels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Shared {
    /// Values in standard deviations.
    pub values: Vec<f64>,
    /// Kind of each parameter, and its standard deviation.
    kinds: Vec<(Kind, f64)>,
    /// Standard deviations of joint zeros and links' surfaces, over the first ones, by [`Kind::told`].
    told_sd: [f64; 2],
    /// Patches of links' surfaces, whose heights are the last parameters, in the order of their numbers.
    patches: BTreeMap<Patch, usize>,
    /// Standard deviation of each patch's height over [`FIRST_LINK_SD_M`].
    patch_sd: Vec<f64>,
}

/// A patch of a link's surface: the link, and a cube of its frame.
pub type Patch = (usize, [i32; 3]);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    JointZero(usize),
    LinkSurface(usize),
    MountRotation(usize),
    MountTranslation(usize),
}

impl Kind {
    /// Index of the parameter's standard deviation among those that the images determine.
    fn told(self) -> Option<usize> {
        match self {
            Self::JointZero(_) => Some(0),
            Self::LinkSurface(_) => Some(1),
            Self::MountRotation(_) | Self::MountTranslation(_) => None,
        }
    }
}

impl Shared {
    pub fn new(robot: &Robot) -> Self {
        let zeros = (0..robot.dof()).map(|i| (Kind::JointZero(i), FIRST_ZERO_SD_RAD));
        let links = (0..=robot.dof()).map(|i| (Kind::LinkSurface(i), FIRST_LINK_SD_M));
        let rotation = (0..3).map(|i| (Kind::MountRotation(i), MOUNT_SD_RAD));
        let translation = (0..3).map(|i| (Kind::MountTranslation(i), MOUNT_SD_M));
        let kinds: Vec<(Kind, f64)> = zeros.chain(links).chain(rotation).chain(translation).collect();
        Self { values: vec![0.0; kinds.len()], kinds, told_sd: [1.0; 2], ..Self::default() }
    }

    /// Adds a height for each patch that has none.
    pub fn add_patches(&mut self, patches: &BTreeSet<Patch>) {
        for patch in patches {
            let number = self.patches.len();
            if let Entry::Vacant(vacant) = self.patches.entry(*patch) {
                vacant.insert(number);
                self.patch_sd.push(1.0);
                self.values.push(0.0);
            }
        }
    }

    /// Inverse variance of what is known beforehand of the parameter at a place.
    pub fn prior_information(&self, at: usize) -> f64 {
        let Some((kind, _)) = self.kinds.get(at) else { return self.patch_sd[at - self.kinds.len()].powi(-2) };
        kind.told().map_or(1.0, |group| self.told_sd[group].powi(-2))
    }

    /// Standard deviations that the images tell become what makes the images most likely, given the values
    /// and their variances with the present ones (MacKay, Bayesian interpolation, 1992): τ² = Σ m²/γ, where γ
    /// of the parameters are determined by the images.
    pub fn tell(&mut self, variance: impl Fn(usize) -> f64) {
        let (mut determined, mut squares) = ([0.0; 2], [0.0; 2]);
        for (at, (kind, _)) in self.kinds.iter().enumerate() {
            let Some(group) = kind.told() else { continue };
            determined[group] += 1.0 - variance(at) / self.told_sd[group].powi(2);
            squares[group] += self.values[at].powi(2);
        }
        // Each patch has a standard deviation of its own, which vanishes where nothing rises (sparse Bayesian
        // learning, Tipping 2001).
        for (sd, at) in self.patch_sd.iter_mut().zip(self.kinds.len()..) {
            let determined = 1.0 - variance(at) / sd.powi(2);
            *sd = (self.values[at].powi(2) / determined.max(LEAST_DETERMINED)).sqrt().clamp(TOLD[0], TOLD[1]);
        }
        for ((sd, determined), squares) in self.told_sd.iter_mut().zip(determined).zip(squares) {
            if determined > DETERMINED {
                *sd = (squares / determined).sqrt().clamp(TOLD[0], TOLD[1]);
            }
        }
    }

    /// Place of a patch's height among the parameters.
    fn height_at(&self, patch: Patch) -> Option<usize> {
        self.patches.get(&patch).map(|number| self.kinds.len() + number)
    }

    fn value(&self, kind: Kind) -> f64 {
        let at = self.kinds.iter().position(|(it, _)| *it == kind);
        at.map_or(0.0, |at| self.values[at] * self.kinds[at].1)
    }

    pub fn joint_zero_rad(&self) -> JointVector {
        JointVector::from_fn(|i, _| self.value(Kind::JointZero(i)))
    }

    pub fn link_offset_m(&self, link: usize) -> f64 {
        self.value(Kind::LinkSurface(link))
    }

    /// The arm's surface, the links as thick as they are.
    pub fn surface(&self, robot: &Robot, gripper: &Gripper) -> ArmSurface {
        ArmSurface::new(&robot.clone().with_thicker_links(|link| self.link_offset_m(link)), gripper)
    }
}

/// The arm at one time, as the parameters have it.
pub struct PosedArm<'a> {
    robot: &'a Robot,
    pub X_WL: LinkPoses,
    X_LW: LinkPoses,
    dq: JointVector,
    pub width_m: f64,
    X_WG: Pose,
    shared: &'a Shared,
}

impl<'a> PosedArm<'a> {
    pub fn new(robot: &'a Robot, sample: &ArmSample, shared: &'a Shared) -> Self {
        let mut X_WL = robot.link_poses(&(sample.q + shared.joint_zero_rad()));
        let three = |kind: fn(usize) -> Kind| Vector3::from_fn(|i, _| shared.value(kind(i)));
        // The gripper stands so where its model should; what stands for the last link carries it there.
        let X_GM = moved(&three(Kind::MountTranslation), &three(Kind::MountRotation));
        let mounted_L = robot.X_LG * X_GM;
        X_WL[MAX_JOINTS] *= mounted_L * robot.X_LG.inverse();
        let X_WG = robot.gripper_in(&X_WL);
        let X_LW = X_WL.map(|it| it.inverse());
        Self { robot, X_WL, X_LW, dq: sample.dq, width_m: sample.width_m, X_WG, shared }
    }

    /// The patch of a link's surface that a measurement is of.
    pub fn patch(&self, it: &Measurement, X_WC: &Pose) -> Option<Patch> {
        let SurfacePart::Link(link) = it.part else { return None };
        let p_L = self.X_LW[link] * (X_WC * Point3::from(it.p_C));
        Some((link, [0, 1, 2].map(|i| libm::floor(p_L[i] / PATCH_M) as i32)))
    }

    /// Correction of a measurement's prediction by the height of its patch.
    pub fn patch_correction(&self, it: &Measurement, patch: Option<Patch>) -> f64 {
        let height = patch.and_then(|patch| self.shared.height_at(patch)).map_or(0.0, |at| self.shared.values[at]);
        it.gradient_C.dot(&it.normal_C) * height * FIRST_LINK_SD_M
    }

    /// The derivatives of a measurement by the parameters: those of its camera, those in common, and at last
    /// what its image's pixels have in common, whose standard deviation is `offset_sd`.
    pub fn row(&self, row: &mut Row, it: &Measurement, camera: &CameraState, offset_sd: f64) {
        row.clear();
        let mut add = |at: usize, entry: f64| {
            if entry != 0.0 {
                row.push((at, entry));
            }
        };
        let gradient_W = camera.X_WC.rotation * it.gradient_C;
        let p_W = camera.X_WC * Point3::from(it.p_C);
        let moving_joints = match it.part {
            SurfacePart::Link(link) => link.min(self.robot.dof()),
            SurfacePart::Gripper => self.robot.dof(),
            SurfacePart::Obstacle => 0,
        };
        let by_joint: [f64; MAX_JOINTS] = std::array::from_fn(|i| {
            if i >= moving_joints {
                return 0.0;
            }
            let (axis, origin) = self.robot.joint_axis(&self.X_WL, i);
            axis.dot(&(p_W - origin).cross(&gradient_W))
        });
        let by_time: f64 = by_joint.iter().zip(self.dq.iter()).map(|(by, rate)| by * rate).sum();
        // A surface that stands still moves by −(ω × p + v) in C.
        let turning = it.p_C.cross(&it.gradient_C);
        (0..3).for_each(|axis| add(axis, -turning[axis]));
        (0..3).for_each(|axis| add(axis + 3, -it.gradient_C[axis]));
        for (i, column) in nuisance_columns(it).into_iter().enumerate() {
            let is_time = FIRST_NUISANCE + i == TIME_OFFSET;
            add(FIRST_NUISANCE + i, if is_time { by_time * TIME_OFFSET_SD_S } else { column });
        }
        let is_gripper = it.part == SurfacePart::Gripper;
        let gradient_G = self.X_WG.rotation.inverse() * gradient_W;
        let turning_G = (self.X_WG.inverse() * p_W).coords.cross(&gradient_G);
        let outward = it.gradient_C.dot(&it.normal_C);
        for (i, (kind, sd)) in self.shared.kinds.iter().enumerate() {
            let by = match kind {
                Kind::JointZero(i) => by_joint[*i],
                Kind::LinkSurface(link) if it.part == SurfacePart::Link(*link) => outward,
                Kind::MountRotation(axis) if is_gripper => turning_G[*axis],
                Kind::MountTranslation(axis) if is_gripper => gradient_G[*axis],
                _ => 0.0,
            };
            add(OF_CAMERA + i, by * sd);
        }
        if let Some(at) = self.patch(it, &camera.X_WC).and_then(|patch| self.shared.height_at(patch)) {
            add(OF_CAMERA + at, outward * FIRST_LINK_SD_M);
        }
        add(OF_CAMERA + self.shared.values.len(), if it.is_depth() { offset_sd } else { 0.0 });
    }
}

/// Columns of scale, time offset (left out), growth, its rise with the slope, loss, and loss of growth.
fn nuisance_columns(it: &Measurement) -> [f64; OF_CAMERA - FIRST_NUISANCE] {
    match it.quantity {
        // 1/z of a depth that is measured 1 + s times as large.
        Quantity::InverseDepth => [-it.predicted * SCALE_SD, 0.0, 0.0, 0.0, 0.0, 0.0],
        Quantity::ShownPixels { slope, grazing_px, grazing_edge, .. } => {
            let [growth, rise, loss, growth_loss] = GROWTH_SD;
            [0.0, 0.0, growth, rise * slope, -loss * grazing_px, -growth_loss * grazing_edge]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shared(kinds: Vec<(Kind, f64)>) -> Shared {
        Shared { kinds, told_sd: [1.0; 2], ..Shared::default() }
    }

    /// The standard deviation that measurements of seven joint zeros tell, each of which has this variance by
    /// itself.
    fn told(measured: [f64; 7], variance: f64) -> f64 {
        let kinds = (0..7).map(|i| (Kind::JointZero(i), FIRST_ZERO_SD_RAD)).collect();
        let mut shared = shared(kinds);
        for _ in 0..100 {
            let prior = shared.prior_information(0).recip();
            let gain = prior / (prior + variance);
            shared.values = measured.iter().map(|it| gain * it).collect();
            shared.tell(|_| gain * variance);
        }
        shared.prior_information(0).recip().sqrt()
    }

    /// The mean square of the measurements is the sum of both variances where the images are most likely.
    #[test]
    fn images_tell_how_far_zeros_are_off() {
        let off = [1.5, -1.5, 1.5, -1.5, 1.5, -1.5, 1.5];
        assert!((told(off, 0.25) - 2.0_f64.sqrt()).abs() < 1e-6);
        // Less than the measurements are off by themselves: nothing says that the zeros are off by more than
        // a fraction of that.
        let exact = off.map(|it| it / 6.0);
        assert!(told(exact, 0.25) < 0.2);
    }

    /// What the images show of a patch, with this standard deviation, is its height if it rises above that;
    /// a height within what the images do not know vanishes.
    #[test]
    fn patches_rise_where_images_say_so() {
        let shown = [8.0, 0.3];
        let variance = 0.25;
        let mut shared = shared(Vec::new());
        shared.kinds.push((Kind::LinkSurface(3), FIRST_LINK_SD_M));
        shared.values.push(0.0);
        shared.add_patches(&BTreeSet::from([(3, [0, 0, 1]), (3, [0, 1, 1])]));
        for _ in 0..100 {
            let gain: Vec<f64> = (0..3).map(|at| 1.0 / (1.0 + variance * shared.prior_information(at))).collect();
            (0..2).for_each(|patch| shared.values[1 + patch] = gain[1 + patch] * shown[patch]);
            shared.tell(|at| gain[at] * variance);
        }
        assert!((shared.values[1] - 8.0).abs() < 0.05, "{:?}", shared.values);
        assert!(shared.values[2].abs() < 0.01, "{:?}", shared.values);
    }
}
