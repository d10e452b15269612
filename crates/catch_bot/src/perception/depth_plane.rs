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

#[cfg(test)]
mod tests {
    use catch_body::Pose;
    use nalgebra::{Point3, UnitQuaternion};

    use super::*;
    use crate::perception::synthetic::{self, Shape};

    /// Points of the side of an ellipsoid that a camera far above sees, in W.
    fn visible(X_WO: &Pose, semi_axes: [f64; 3]) -> Vec<ScenePoint> {
        let ray_W = Vector3::new(0.0, 0.0, -1.0);
        let shape = nalgebra::Matrix3::from_diagonal(&Vector3::from(semi_axes.map(|it| it.powi(-2))));
        let A = X_WO.rotation.to_rotation_matrix() * shape * X_WO.rotation.inverse().to_rotation_matrix();
        let pixels = (-60..=60).flat_map(|i| (-60..=60).map(move |j| (2e-3 * f64::from(i), 2e-3 * f64::from(j))));
        pixels
            .filter_map(|(x, y)| {
                // The higher of both places at which xᵀ·A·x = 1.
                let across = Vector3::new(x, y, 0.0);
                let (a, b) = (A[(2, 2)], (A * across).z);
                let root = b * b - a * (across.dot(&(A * across)) - 1.0);
                let z = (root >= 0.0).then(|| (root.sqrt() - b) / a)?;
                let p_W = Point3::from(across + Vector3::z() * z + X_WO.translation.vector);
                Some(ScenePoint { p_W, per_depth_W: ray_W, depth_sd_m: 0.01, image: 0 })
            })
            .collect()
    }

    fn tilted(about_x_rad: f64) -> Pose {
        Pose::from_parts(nalgebra::Translation3::new(0.1, -0.2, 1.0), UnitQuaternion::new(Vector3::x() * about_x_rad))
    }

    fn ellipsoid() -> ReferenceModel {
        let mut reference = synthetic::reference(&Shape::Sphere { radius: 0.02 }, 200);
        reference.second_moment_m2 =
            nalgebra::Matrix3::from_diagonal(&Vector3::new(0.02, 0.03, 0.1).map(|it| it * it / 5.0));
        reference
    }

    #[test]
    fn the_visible_side_of_an_ellipsoid_is_as_tilted_as_its_middle() {
        let reference = ellipsoid();
        for about_x_rad in [0.3, 1.0, -0.7] {
            let X_WO = tilted(about_x_rad);
            let plane = DepthPlane::new(&visible(&X_WO, [0.02, 0.03, 0.1]), &reference, 0.5);
            let mut equations = NormalEquations::ZERO;
            let right = plane.add_to(&mut equations, &reference, &X_WO);
            let reversed = plane.add_to(&mut equations, &reference, &tilted(-about_x_rad));
            assert!(right < 0.1 && reversed > 10.0, "{about_x_rad}: {right}, {reversed}");
        }
    }

    /// The gradient is that of the cost, by finite differences.
    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let reference = ellipsoid();
        let plane = DepthPlane::new(&visible(&tilted(0.8), [0.02, 0.03, 0.1]), &reference, 0.5);
        let X_WO = tilted(0.5) * Pose::rotation(Vector3::new(0.1, 0.2, -0.3));
        let cost = |turn: Vector3<f64>| {
            let mut equations = NormalEquations::ZERO;
            plane.add_to(&mut equations, &reference, &(X_WO * Pose::rotation(turn)))
        };
        let mut equations = NormalEquations::ZERO;
        plane.add_to(&mut equations, &reference, &X_WO);
        let gradient = equations.projected(&nalgebra::Matrix3::identity()).1;
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-6);
            let found = (cost(step) - cost(-step)) / 2e-6;
            assert!((found - gradient[axis]).abs() < 1e-4 * gradient.norm(), "{axis}: {found} {gradient}");
        }
    }
}
