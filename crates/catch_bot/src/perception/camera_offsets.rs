//! Offset of each camera, from flights that all of them see.
//!
//! Poses that rest on one image each are compared with the predicted flight. Let camera i alone be off, by t:
//! its positions differ by t on average from the flight that the others see. That flight differs from the
//! predicted one by a displacement and a velocity, which follow from the positions of the others. Sums over
//! each camera's positions are all that is needed, and throws add up.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::{ObjectPose, silhouette_shift::SIGNIFICANT};

/// Estimate of a camera's offset from throws: information, and its product with the offset.
#[derive(Debug, Clone, Copy, Default)]
pub struct CameraOffset {
    information: Matrix3<f64>,
    pull: Vector3<f64>,
}

/// Σ Aᵀ·W·A over a camera's positions p + δp − τ·δv of information W and age τ, which differ by r from the
/// predicted flight, A = [1, −τ, r]: normal equations for δp and δv, and beside them the squares. And the
/// number of positions.
type Sums = (SMatrix<f64, 7, 7>, f64);

/// A camera, a pose that rests on one image of it, how much older that is than the predicted flight, and how
/// far from it.
type Sighting<'a> = (usize, &'a ObjectPose, f64, Vector3<f64>);

/// Least standard deviation of a registration of a single image, in metres.
const IMAGE_SD_M: f64 = 0.001;
/// Images of a camera that tell something.
const MIN_IMAGES: f64 = 4.0;
/// Cameras among which one that differs can be found.
pub const MIN_CAMERAS: usize = 3;
/// Fraction by which the estimate from earlier throws counts after each new one.
const REMEMBERED: f64 = 0.8;

/// Inverse covariance of the position of a pose, less what is not known of its orientation and of directions
/// that the image does not tell.
fn of_position(pose: &ObjectPose) -> Option<Matrix3<f64>> {
    let block = |i, j| pose.information.fixed_view::<3, 3>(i, j).into_owned();
    let turns = (block(0, 0) + Matrix3::identity()).try_inverse()?;
    let shifts = block(3, 3) - block(3, 0) * turns * block(0, 3) + Matrix3::identity();
    (shifts.try_inverse()? + Matrix3::from_diagonal_element(IMAGE_SD_M.powi(2))).try_inverse()
}

/// Offset of a camera from the others, and the ratio of the variance of these positions to the given one.
fn offset((own, _): &Sums, (others, count): &Sums) -> Option<(CameraOffset, f64)> {
    let factor = others.fixed_view::<6, 6>(0, 0).into_owned().cholesky()?;
    let pull = others.fixed_view::<6, 1>(0, 6);
    let flight = factor.solve(&pull);
    let scale = (others[(6, 6)] - pull.dot(&flight)) / (3.0 * count - 6.0);
    let covariance = own.fixed_view::<3, 3>(0, 0).try_inverse()?;
    let by_flight = covariance * own.fixed_view::<3, 6>(0, 0);
    let offset = covariance * own.fixed_view::<3, 1>(0, 6) - by_flight * flight;
    let information = (covariance + by_flight * factor.inverse() * by_flight.transpose()).try_inverse()?;
    Some((CameraOffset { information, pull: information * offset }, scale.max(1.0)))
}

/// The camera that is off by more than a bound, if there is one: the one that explains most. Others may have
/// seemed to be off by that one, so that all begin anew.
pub fn displaced(offsets: &mut [CameraOffset], bound_m: f64) -> Option<usize> {
    let estimates = offsets.iter().map(CameraOffset::estimate).enumerate();
    let (camera, (squares, offset)) = estimates.max_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    // Along the offset t its standard deviation is |t|/√(tᵀ·C⁻¹·t).
    let least_m = offset.norm() * (1.0 - SIGNIFICANT / squares.max(f64::MIN_POSITIVE).sqrt());
    (least_m > bound_m).then(|| offsets.fill(CameraOffset::default())).map(|()| camera)
}

impl CameraOffset {
    /// Estimates of all cameras' offsets from one throw.
    pub fn of_throw<'a>(images: impl Iterator<Item = Sighting<'a>>, cameras: usize) -> Vec<Self> {
        let mut sums: Vec<Sums> = vec![Default::default(); cameras];
        for (camera, pose, age_s, shift_m) in images {
            let mut A = SMatrix::<f64, 3, 7>::identity();
            A.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(-age_s);
            A.set_column(6, &shift_m);
            let weighted = A.transpose() * of_position(pose).unwrap_or_default();
            (sums[camera].0, sums[camera].1) = (sums[camera].0 + weighted * A, sums[camera].1 + 1.0);
        }
        sums.iter_mut().filter(|it| it.1 < MIN_IMAGES).for_each(|it| *it = Default::default());
        let all: Sums = sums.iter().fold(Default::default(), |all, it| (all.0 + it.0, all.1 + it.1));
        let told = sums.iter().filter(|it| it.1 > 0.0).count();
        let found = |own: &Sums| offset(own, &(all.0 - own.0, all.1 - own.1)).filter(|_| told >= MIN_CAMERAS);
        let found: Vec<_> = sums.iter().map(found).collect();
        // Positions vary as much as they do where the camera that is off is not among them.
        let least = found.iter().flatten().map(|it| it.1).fold(f64::INFINITY, f64::min);
        let scaled = |it: Self| Self { information: it.information / least, pull: it.pull / least };
        found.into_iter().map(|it| it.map_or_else(Self::default, |it| scaled(it.0))).collect()
    }

    /// Adds what another throw tells.
    pub fn add(&mut self, other: &Self) {
        self.information = self.information * REMEMBERED + other.information;
        self.pull = self.pull * REMEMBERED + other.pull;
    }

    /// Reduction of the sum of squared residuals if this camera is off, and the offset.
    fn estimate(&self) -> (f64, Vector3<f64>) {
        let offset = self.information.try_inverse().unwrap_or_default() * self.pull;
        (self.pull.dot(&offset), offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::synthetic::Normal;
    use catch_body::Pose;
    use nalgebra::{Matrix6, UnitQuaternion};

    const CAMERAS: usize = 3;
    /// Standard deviations across and along a line of sight.
    const SD_M: [f64; 3] = [0.002, 0.002, 0.012];

    fn pose(information: Matrix6<f64>) -> ObjectPose {
        ObjectPose {
            capture_s: 0.0,
            X_WO: Pose::identity(),
            information,
            points: 100,
            residual_m: 0.0,
            points_mismatch: None,
            silhouette_mismatch: None,
            iterations: 1,
            registered_globally: false,
        }
    }

    /// A throw that is predicted wrongly, and whose images show it as far off as the cameras are.
    /// One camera may be left out.
    fn throw(off_m: &[Vector3<f64>; CAMERAS], left_out: Option<usize>, normal: &mut Normal) -> Vec<CameraOffset> {
        let (p, v) = (normal.vector() * 0.005, normal.vector() * 0.01);
        let mut images = Vec::new();
        for i in 0..60 {
            let (camera, age_s) = (i % CAMERAS, 0.01 * (60 - i) as f64);
            let R_WC = UnitQuaternion::from_euler_angles(0.4, 2.0 * camera as f64, -0.3);
            let error_m = R_WC * normal.vector().component_mul(&Vector3::from(SD_M));
            // As in an image of a ball, whose orientation it does not tell.
            let mut information = Matrix6::zeros();
            let R: Matrix3<f64> = R_WC.to_rotation_matrix().into_inner();
            let of_image = R * Matrix3::from_diagonal(&Vector3::from(SD_M).map(|sd| sd.powi(-2))) * R.transpose();
            information.fixed_view_mut::<3, 3>(3, 3).copy_from(&of_image);
            images.push((camera, pose(information), age_s, p - v * age_s + off_m[camera] + error_m));
        }
        images.retain(|it| Some(it.0) != left_out);
        CameraOffset::of_throw(images.iter().map(|it| (it.0, &it.1, it.2, it.3)), CAMERAS)
    }

    /// Estimates after some throws.
    fn after(off_m: &[Vector3<f64>; CAMERAS], throws: usize, normal: &mut Normal) -> [CameraOffset; CAMERAS] {
        let mut sums = [CameraOffset::default(); CAMERAS];
        for _ in 0..throws {
            sums.iter_mut().zip(throw(off_m, None, normal)).for_each(|(sum, it)| sum.add(&it));
        }
        sums
    }

    /// The camera with an offset is named in any direction, however the prediction is off.
    #[test]
    fn a_camera_that_is_off_by_two_centimetres_is_named() {
        for seed in 0..100 {
            let mut normal = Normal::new(seed);
            let (camera, mut off_m) = (seed as usize % CAMERAS, [Vector3::zeros(); CAMERAS]);
            off_m[camera] = normal.vector().normalize() * 0.02;
            let mut sums = after(&off_m, 4, &mut normal);
            let found_m = sums[camera].estimate().1;
            assert!((found_m - off_m[camera]).norm() < 0.007, "{seed}: {found_m}");
            assert_eq!(displaced(&mut sums, 0.008), Some(camera), "{seed}");
        }
    }

    /// The camera with an offset names no other one, nor do its images from before it was left out because
    /// the arm or flights had named it.
    #[test]
    fn a_camera_that_is_off_names_no_other_one() {
        for seed in 0..100 {
            let mut normal = Normal::new(seed);
            let (camera, mut off_m) = (seed as usize % CAMERAS, [Vector3::zeros(); CAMERAS]);
            off_m[camera] = normal.vector().normalize() * 0.02;
            let mut sums = [CameraOffset::default(); CAMERAS];
            let mut is_named = false;
            for count in 0..20 {
                let left_out = (is_named || (count > 0 && seed % 2 == 0)).then_some(camera);
                sums.iter_mut().zip(throw(&off_m, left_out, &mut normal)).for_each(|(sum, it)| sum.add(&it));
                let named = displaced(&mut sums, 0.008);
                assert!(named.is_none_or(|it| it == camera), "{seed} {count}: {named:?}");
                is_named |= named.is_some();
            }
            assert!(is_named || seed % 2 == 0, "{seed}");
        }
    }

    #[test]
    fn cameras_that_stand_right_are_not_named() {
        let mut normal = Normal::new(1);
        for throws in 0..400 {
            let mut sums = after(&[Vector3::zeros(); CAMERAS], 1 + throws % 5, &mut normal);
            assert_eq!(displaced(&mut sums, 0.0), None, "{throws}: {sums:?}");
        }
    }

    /// With two cameras, the one that is off cannot be identified.
    #[test]
    fn two_cameras_tell_nothing() {
        let mut normal = Normal::new(1);
        let pose = pose(Matrix6::identity() * 1e6);
        let images = (0..40).map(|i| (i % 2, &pose, 0.01 * i as f64, normal.vector() * 0.02));
        let found = CameraOffset::of_throw(images, CAMERAS);
        assert!(found.iter().all(|it| it.estimate().0 == 0.0), "{found:?}");
    }
}
