//! What depths tell of an object that they are too noisy to show the shape of: the plane through them.
//!
//! A banana 4 m from a stereo camera is four pixels wide, and its depths err by 3 cm. Its outline is known to
//! a part of a pixel, but a banana whose stem is turned towards the camera and one whose stem is turned away
//! have the same outline (Necker's reversal). The depths of some hundred pixels tell them apart: their mean
//! is the object's distance, and their slopes across the image are those of the side that faces the camera.

use catch_body::{Pose, pose::across};
use nalgebra::{Matrix2, Matrix3, Point3, Rotation3, Vector2, Vector3};

use super::{ReferenceModel, normal_equations::NormalEquations, point_cloud::ScenePoint, thinning::stride};

/// Standard deviation by which the places of an object's points are blurred, by the width of edges: pixels
/// beside the object that show its depth spread them across the image, and flatten slopes.
const SPREAD_FRACTION: f64 = 0.7;
/// Points of the reference, about, that stand for the side that faces a camera; what the object itself hides
/// counts, too.
const FACING_POINTS: usize = 200;
/// Step of the finite differences of slopes.
const DIFFERENCE_RAD: f64 = 0.01;
/// Standard deviation of the plane through the visible surface beside that of the reference, in inner radii.
const PLANE_SD_RADII: f64 = 0.15;

/// The plane through the points of one image.
pub(super) struct DepthPlane {
    /// Mean of the points.
    p_W: Vector3<f64>,
    /// Two unit vectors across the mean ray, and one along it, as columns.
    R_WC: Matrix3<f64>,
    /// Mean square of where the points lie across, in m², and the slopes of their depths there.
    spread_m2: Matrix2<f64>,
    slopes: Vector2<f64>,
    /// Variances of the plane in m²: of its mean, and at a distance of one standard deviation of the points.
    mean_m2: f64,
    tilt_m2: f64,
    /// Variance in m² by which the places of the points are blurred.
    blur_m2: f64,
}

impl DepthPlane {
    /// Lays the plane through the points of one image, of whose depths' variance this fraction is common.
    pub fn new(image: &[ScenePoint], reference: &ReferenceModel, common_fraction: f64, edge_px: u32) -> Self {
        let count = image.len().max(1) as f64;
        let ([mut p_W, mut ray_W], [mut depth_sd_m, mut pixel_m]) = ([Vector3::zeros(); 2], [0.0; 2]);
        for point in image {
            p_W += point.p_W.coords / count;
            ray_W += point.per_depth_W / count;
            depth_sd_m += point.depth_sd_m / count;
            pixel_m += point.pixel_m / count;
        }
        let along_W = ray_W.normalize();
        let right_W = across(&along_W);
        let R_WC = Matrix3::from_columns(&[right_W, along_W.cross(&right_W), along_W]);
        let (mut spread_m2, mut with_depth_m2) = (Matrix2::identity() * 1e-9, Vector2::zeros());
        for point in image {
            let from_mean = R_WC.tr_mul(&(point.p_W.coords - p_W));
            spread_m2 += from_mean.xy() * from_mean.xy().transpose() / count;
            with_depth_m2 += from_mean.xy() * (from_mean.z / count);
        }
        let slopes = spread_m2.try_inverse().map_or(Vector2::zeros(), |it| it * with_depth_m2);
        let depth_m2 = ray_W.norm_squared() * depth_sd_m * depth_sd_m;
        let own_m2 = depth_m2 * (1.0 - common_fraction) / count;
        let shape_m = PLANE_SD_RADII * reference.inner_radius_m;
        let tilt_m2 = own_m2 + shape_m * shape_m;
        let mean_m2 = tilt_m2 + depth_m2 * common_fraction;
        let blur_m = SPREAD_FRACTION * f64::from(edge_px) * pixel_m;
        Self { p_W, R_WC, spread_m2, slopes, mean_m2, tilt_m2, blur_m2: blur_m * blur_m }
    }

    /// Adds how the plane differs from that of the reference at a pose, and returns the mean square of the
    /// tilt, in standard deviations.
    pub fn add_to(&self, equations: &mut NormalEquations, reference: &ReferenceModel, X_WO: &Pose) -> f64 {
        let Some(root) = self.spread_m2.cholesky() else { return 0.0 };
        let R_OC = X_WO.rotation.inverse().to_rotation_matrix() * self.R_WC;
        let (depth_m, slopes) = facing(reference, &R_OC, self.blur_m2);
        let n_O = R_OC.column(2).into_owned();
        let beyond_m = self.R_WC.column(2).dot(&(self.p_W - X_WO.translation.vector)) - depth_m;
        equations.add(&Point3::origin(), &n_O, 1.0 / self.mean_m2, beyond_m / self.mean_m2);

        let residual = root.l().tr_mul(&(self.slopes - slopes));
        // A small rotation δ of the object is one of −δ of the camera about it.
        let by_turn: [Vector2<f64>; 3] = std::array::from_fn(|axis| {
            let turned = Rotation3::new(-Vector3::ith(axis, DIFFERENCE_RAD)) * R_OC;
            let (_, turned_slopes) = facing(reference, &turned, self.blur_m2);
            -root.l().tr_mul(&(turned_slopes - slopes)) / DIFFERENCE_RAD
        });
        for i in 0..2 {
            let [x, y, z] = by_turn.map(|it| it[i]);
            equations.add_row(&[x, y, z, 0.0, 0.0, 0.0], 1.0 / self.tilt_m2, residual[i] / self.tilt_m2);
        }
        0.5 * residual.norm_squared() / self.tilt_m2
    }
}

/// Regression of the depths of the side of the reference that faces a camera far away, whose axes in O are
/// the columns of `R_OC`, as its pixels would have it: mean depth beyond the origin of O, and slopes of the
/// depths across the image.
fn facing(reference: &ReferenceModel, R_OC: &Matrix3<f64>, blur_m2: f64) -> (f64, Vector2<f64>) {
    let stride = stride(reference.points.len(), FACING_POINTS);
    let along_O = R_OC.column(2);
    let (mut weights, mut mean, mut squares) = (1e-12, Vector3::zeros(), Matrix3::identity() * 1e-18);
    for (p_O, n_O) in reference.points.iter().zip(&reference.normals).step_by(stride) {
        let weight = -n_O.dot(&along_O);
        if weight > 0.0 {
            let p_C = R_OC.tr_mul(&p_O.coords);
            weights += weight;
            mean += p_C * weight;
            squares += p_C * p_C.transpose() * weight;
        }
    }
    let mean = mean / weights;
    let spread = squares / weights - mean * mean.transpose();
    let across = (spread.fixed_view::<2, 2>(0, 0) + Matrix2::identity() * blur_m2).try_inverse();
    (mean.z, across.map_or(Vector2::zeros(), |it| it * spread.fixed_view::<2, 1>(0, 2)))
}

#[cfg(test)]
mod tests {
    use catch_body::Pose;
    use nalgebra::{Point3, UnitQuaternion};

    use super::*;

    const SEMI_AXES: [f64; 3] = [0.02, 0.03, 0.1];

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
                Some(ScenePoint { p_W, per_depth_W: ray_W, depth_sd_m: 0.01, pixel_m: 2e-3, image: 0 })
            })
            .collect()
    }

    fn tilted(about_x_rad: f64) -> Pose {
        Pose::from_parts(nalgebra::Translation3::new(0.1, -0.2, 1.0), UnitQuaternion::new(Vector3::x() * about_x_rad))
    }

    /// An ellipsoid with points that are as dense everywhere, in no order.
    fn ellipsoid(semi_axes: [f64; 3]) -> ReferenceModel {
        let (axes, golden) = (Vector3::from(semi_axes), std::f64::consts::PI * (3.0 - 5.0_f64.sqrt()));
        let on_sphere = (0..2000).map(|i| 7 * i % 2000).map(|i| {
            let z: f64 = 1.0 - (f64::from(i) + 0.5) / 1000.0;
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            Vector3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vector3::z() * z
        });
        let (mut points, mut normals, mut area) = (Vec::new(), Vec::new(), 0.0);
        for n in on_sphere {
            // By so much is the surface stretched there.
            let normal = n.component_div(&axes);
            area += normal.norm() * axes.min();
            while area > 1.0 {
                area -= 1.0;
                points.push(Point3::from(n.component_mul(&axes)));
                normals.push(normal.normalize());
            }
        }
        ReferenceModel { points, normals, inner_radius_m: axes.min(), ..ReferenceModel::default() }
    }

    /// Of an ellipsoid the side that faces a camera is as tilted as its middle: with the second moment C the
    /// slopes are Cₐₐ⁻¹·Cₐ_d. Blur flattens them.
    #[test]
    fn the_facing_side_of_an_ellipsoid_is_as_tilted_as_its_second_moment() {
        let reference = ellipsoid(SEMI_AXES);
        let C_O = Matrix3::from_diagonal(&Vector3::from(SEMI_AXES.map(|it| it * it)));
        for about_x_rad in [0.3, 1.0, -0.7] {
            let R_OC = Rotation3::new(Vector3::x() * about_x_rad).into_inner();
            let C_C = R_OC.tr_mul(&(C_O * R_OC));
            let expected = C_C[(1, 2)] / C_C[(1, 1)];
            let [(depth_m, sharp), (_, blurred)] = [0.0, 1e-3].map(|blur_m2| facing(&reference, &R_OC, blur_m2));
            assert!((sharp.y - expected).abs() < 0.05 * expected.abs(), "{sharp}, {expected}");
            assert!(blurred.y.abs() < 0.9 * sharp.y.abs(), "{blurred}");
            assert!(depth_m < 0.0, "the facing side is before the middle");
        }
    }

    #[test]
    fn the_reversed_orientation_is_far_less_likely() {
        let reference = ellipsoid(SEMI_AXES);
        for about_x_rad in [0.3, 1.0, -0.7] {
            let X_WO = tilted(about_x_rad);
            let plane = DepthPlane::new(&visible(&X_WO, SEMI_AXES), &reference, 0.5, 0);
            let mut equations = NormalEquations::default();
            let right = plane.add_to(&mut equations, &reference, &X_WO);
            let reversed = plane.add_to(&mut equations, &reference, &tilted(-about_x_rad));
            assert!(right < 0.1 && reversed > 10.0, "{about_x_rad}: {right}, {reversed}");
        }
    }

    /// The gradient is that of the cost, by finite differences.
    #[test]
    fn the_gradient_is_that_of_the_cost() {
        let reference = ellipsoid(SEMI_AXES);
        let plane = DepthPlane::new(&visible(&tilted(0.8), SEMI_AXES), &reference, 0.5, 0);
        let X_WO = tilted(0.5) * Pose::rotation(Vector3::new(0.1, 0.2, -0.3));
        let cost = |turn: Vector3<f64>| {
            let mut equations = NormalEquations::default();
            plane.add_to(&mut equations, &reference, &(X_WO * Pose::rotation(turn)))
        };
        let mut equations = NormalEquations::default();
        plane.add_to(&mut equations, &reference, &X_WO);
        let gradient = equations.projected(&nalgebra::Matrix3::identity()).1;
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-6);
            let found = (cost(step) - cost(-step)) / 2e-6;
            assert!((found - gradient[axis]).abs() < 0.02 * gradient.norm(), "{axis}: {found} {gradient}");
        }
    }
}
