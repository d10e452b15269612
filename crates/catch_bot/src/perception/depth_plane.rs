//! What depths tell of an object that they are too noisy to show the shape of: the plane through them.
//!
//! A banana 4 m from a stereo camera is four pixels wide, and its depths err by 3 cm. Its outline is known to
//! a part of a pixel, but a banana whose stem is turned towards the camera and one whose stem is turned away
//! have the same outline (Necker's reversal). The depths of some hundred pixels tell them apart: their mean
//! is the object's distance, and their slope across the image is how it is tilted.

use catch_body::Pose;
use nalgebra::{Matrix2, Matrix3x2, Vector2, Vector3};

use super::{ReferenceModel, normal_equations::NormalEquations, point_cloud::ScenePoint};

/// Mean distance of the visible surface in front of an object's centre, in inner radii: two thirds for a
/// ball.
const FACING_RADII: f64 = 2.0 / 3.0;
/// Standard deviation of the plane through the visible surface beside that of the reference, in inner radii.
const PLANE_SD_RADII: f64 = 0.5;

/// The plane through the points of one image.
pub(super) struct DepthPlane {
    /// Mean of the points.
    p_W: Vector3<f64>,
    /// Unit vector along the mean ray, and two across.
    along_W: Vector3<f64>,
    across_W: Matrix3x2<f64>,
    /// Mean square of where the points lie across, in m², and the slopes of their depths there.
    spread_m2: Matrix2<f64>,
    slopes: Vector2<f64>,
    /// Variances of the plane in m²: of its mean, and at a distance of one standard deviation of the points.
    mean_m2: f64,
    tilt_m2: f64,
}

impl DepthPlane {
    /// Lays the plane through the points of one image, of whose depths' variance this fraction is common.
    pub fn new(image: &[ScenePoint], reference: &ReferenceModel, common_fraction: f64) -> Self {
        let count = image.len().max(1) as f64;
        let ([mut p_W, mut ray_W], mut depth_sd_m) = ([Vector3::zeros(); 2], 0.0);
        for point in image {
            p_W += point.p_W.coords / count;
            ray_W += point.per_depth_W / count;
            depth_sd_m += point.depth_sd_m / count;
        }
        let along_W = ray_W.normalize();
        let beside = if along_W.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let right_W = along_W.cross(&beside).normalize();
        let across_W = Matrix3x2::from_columns(&[right_W, along_W.cross(&right_W)]);
        let (mut spread_m2, mut with_depth_m2) = (Matrix2::identity() * 1e-9, Vector2::zeros());
        for point in image {
            let from_mean_W = point.p_W.coords - p_W;
            let across = across_W.tr_mul(&from_mean_W);
            spread_m2 += across * across.transpose() / count;
            with_depth_m2 += across * (along_W.dot(&from_mean_W) / count);
        }
        let slopes = spread_m2.try_inverse().map_or(Vector2::zeros(), |it| it * with_depth_m2);
        let depth_m2 = ray_W.norm_squared() * depth_sd_m * depth_sd_m;
        let own_m2 = depth_m2 * (1.0 - common_fraction) / count;
        let shape_m = PLANE_SD_RADII * reference.inner_radius_m;
        let tilt_m2 = own_m2 + shape_m * shape_m;
        let mean_m2 = tilt_m2 + depth_m2 * common_fraction;
        Self { p_W, along_W, across_W, spread_m2, slopes, mean_m2, tilt_m2 }
    }

    /// Adds how the plane differs from that of the reference at a pose, and returns the mean square of the
    /// tilt, in standard deviations.
    ///
    /// With the reference's second moment C in W, the slopes are Cₐₐ⁻¹·Cₐ_d, where a is across the ray and d
    /// along it: exact for ellipsoids, whose visible side is as tilted as their middle.
    pub fn add_to(&self, equations: &mut NormalEquations, reference: &ReferenceModel, X_WO: &Pose) -> f64 {
        let Self { along_W, across_W, spread_m2, .. } = self;
        let R_WO = X_WO.rotation.to_rotation_matrix();
        let beyond_m = along_W.dot(&(self.p_W - X_WO.translation.vector)) + FACING_RADII * reference.inner_radius_m;
        let n_O = R_WO.transpose() * along_W;
        equations.add(&nalgebra::Point3::origin(), &n_O, 1.0 / self.mean_m2, beyond_m / self.mean_m2);

        let C_O = reference.second_moment_m2;
        let across_O = R_WO.transpose().matrix() * across_W;
        let across_m2: Matrix2<f64> = across_O.tr_mul(&(C_O * across_O));
        let (Some(inverse), Some(root)) = (across_m2.try_inverse(), spread_m2.cholesky()) else { return 0.0 };
        let slopes: Vector2<f64> = inverse * across_O.tr_mul(&(C_O * n_O));
        let residual = root.l().tr_mul(&(self.slopes - slopes));
        // R → R·exp(δ) changes R·C·Rᵀ by R·(δ×·C + (δ×·C)ᵀ)·Rᵀ.
        let by_turn: [Vector2<f64>; 3] = std::array::from_fn(|axis| {
            let turned = Vector3::ith(axis, 1.0).cross_matrix() * C_O;
            let change = turned + turned.transpose();
            let across_change: Matrix2<f64> = across_O.tr_mul(&(change * across_O));
            -root.l().tr_mul(&(inverse * (across_O.tr_mul(&(change * n_O)) - across_change * slopes)))
        });
        for i in 0..2 {
            let [x, y, z] = by_turn.map(|it| it[i]);
            equations.add_row(&[x, y, z, 0.0, 0.0, 0.0], 1.0 / self.tilt_m2, residual[i] / self.tilt_m2);
        }
        0.5 * residual.norm_squared() / self.tilt_m2
    }
}
