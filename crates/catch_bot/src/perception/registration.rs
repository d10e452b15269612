//! Registration by Gauss–Newton on the signed distance field.
//!
//! Minimizes Σ ρ(f(X_OW · pᵢ)/σᵢ) over X_WO, f being the signed distance from the reference and pᵢ the scene's points: what
//! ICP with point-to-plane distances alternates towards (Chen and Medioni, Object modelling by registration of multiple
//! range images, 1992), without searching for correspondences (Fitzgibbon, Robust registration of 2D and 3D point sets,
//! 2003).

use catch_body::Pose;
use nalgebra::{Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::{
    Config, PerceptionStatus, ReferenceModel,
    point_cloud::{SceneCloud, ScenePoint},
};

/// A pose that a registration arrived at.
#[derive(Debug, Clone, Copy)]
pub struct Fit {
    /// The pose.
    pub X_WO: Pose,
    /// Inverse covariance of (rotation vector in W, position in W).
    pub information: Matrix6<f64>,
    /// Points that it rests on.
    pub points: usize,
    /// Root mean square distance of those points.
    pub residual_m: f64,
    /// Mean distance of all points, outliers included: what different starts are compared by.
    pub mean_distance_m: f64,
    /// The same as the sensors' noise alone would make it.
    pub noise_m: f64,
    /// Iterations.
    pub iterations: usize,
}

/// Sums over all residuals at one pose.
#[derive(Debug, Clone, Copy)]
struct Sums {
    /// Σ w J Jᵀ and Σ w J r, J being the gradient of r/σ with respect to (rotation vector, position).
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Σ w and Σ w r², in standard deviations, and Σ w r² in m².
    weight: f64,
    squares: f64,
    squares_m2: f64,
    /// Σ w σ² in m².
    variances_m2: f64,
    /// Σ |r| in metres, without weights.
    distances_m: f64,
}

/// Standard deviations at which a point's weight has fallen to a quarter (Geman–McClure).
const OUTLIER_SD: f64 = 3.0;

/// Brings the reference from `X_WO` onto the scene's points.
pub fn register(
    scene: &SceneCloud,
    reference: &ReferenceModel,
    X_WO: &Pose,
    config: &Config,
) -> Result<Fit, PerceptionStatus> {
    let (fit, converged) = iterate(scene, reference, X_WO, config, config.max_iterations);
    let limit_m = config.max_residual_m + 3.0 * fit.noise_m;
    let believable = fit.residual_m <= limit_m && fit.points >= config.min_points;
    if converged && believable { Ok(fit) } else { Err(PerceptionStatus::NotConverged) }
}

/// At most `max_iterations` Gauss–Newton steps, and whether they came to rest.
pub(super) fn iterate(
    scene: &SceneCloud,
    reference: &ReferenceModel,
    start: &Pose,
    config: &Config,
    max_iterations: usize,
) -> (Fit, bool) {
    let mut X_WO = *start;
    let mut scale = initial_scale(scene, reference, &X_WO, config);
    let mut converged = false;
    let mut in_sd = f64::INFINITY;
    let mut iterations = 0;
    while iterations < max_iterations && !converged {
        iterations += 1;
        let sums = accumulate(scene, reference, &X_WO, scale, config);
        let Some(step) = step(&sums, reference.radius_m) else { break };
        X_WO = moved(&X_WO, &step, reference.radius_m);
        scale = (sums.squares / sums.weight.max(1e-12)).sqrt().max(1.0);
        let length = step.fixed_rows::<3>(3).norm() + step.fixed_rows::<3>(0).norm() * reference.radius_m;
        in_sd = step.dot(&(sums.information * step)).max(0.0).sqrt() / scale;
        converged = length < config.step_tolerance_m || in_sd < config.step_tolerance_sd;
    }
    let sums = accumulate(scene, reference, &X_WO, scale, config);
    let weight = sums.weight.max(1e-12);
    let residual_sd = (sums.squares / weight).sqrt();
    // Noise that turned out larger than told makes the pose as much more uncertain.
    let information = with_floor(&(sums.information / residual_sd.powi(2).max(1.0)), config);
    let fit = Fit {
        X_WO,
        information,
        points: sums.weight.round() as usize,
        residual_m: (sums.squares_m2 / weight).sqrt(),
        mean_distance_m: sums.distances_m / scene.points.len().max(1) as f64,
        noise_m: (sums.variances_m2 / weight).sqrt(),
        iterations,
    };
    let finite = X_WO.to_homogeneous().iter().chain(information.iter()).all(|value| value.is_finite());
    // Kinks of the field can keep the last steps from vanishing; within the noise they do no harm.
    (fit, (converged || in_sd < 0.5) && finite && residual_sd.is_finite())
}

/// Distance of a point from the reference in metres, its gradient with respect to the point in W, and its standard deviation.
///
/// σ² = (σ_z · ∂r/∂z)² + σ_model²: noise moves the point along its ray.
fn residual(point: &ScenePoint, reference: &ReferenceModel, X_WO: &Pose, config: &Config) -> (f64, Vector3<f64>, f64) {
    let (distance, gradient_O) = reference.distance.at(&X_WO.inverse_transform_point(&point.p_W));
    let gradient_W = X_WO.rotation * gradient_O;
    let from_depth = point.depth_sd_m * gradient_W.dot(&point.per_depth_W);
    (distance, gradient_W, from_depth.hypot(config.model_sd_m))
}

/// Typical residual at the start in standard deviations, so that a start that is off does not turn all points to outliers.
fn initial_scale(scene: &SceneCloud, reference: &ReferenceModel, X_WO: &Pose, config: &Config) -> f64 {
    let squares: f64 = scene
        .points
        .iter()
        .map(|point| {
            let (distance, _, sd) = residual(point, reference, X_WO, config);
            (distance / sd).powi(2)
        })
        .sum();
    (squares / scene.points.len().max(1) as f64).sqrt().max(1.0)
}

fn accumulate(scene: &SceneCloud, reference: &ReferenceModel, X_WO: &Pose, scale: f64, config: &Config) -> Sums {
    let mut sums = Sums {
        information: Matrix6::zeros(),
        gradient: Vector6::zeros(),
        weight: 0.0,
        squares: 0.0,
        squares_m2: 0.0,
        variances_m2: 0.0,
        distances_m: 0.0,
    };
    let R_WO = X_WO.rotation.to_rotation_matrix();
    let observable_W = R_WO * reference.symmetry.observable() * R_WO.transpose();
    for point in &scene.points {
        let (distance, gradient_W, sd) = residual(point, reference, X_WO, config);
        // ρ of Geman and McClure: w = 1/(1 + (r/c)²)².
        let in_sd = distance / sd;
        let weight = (1.0 + (in_sd / (OUTLIER_SD * scale)).powi(2)).powi(-2);
        let J = jacobian(&point.p_W, &gradient_W, X_WO, &observable_W) / sd;
        sums.information.syger(weight, &J, &J, 1.0);
        sums.gradient += J * (weight * in_sd);
        sums.weight += weight;
        sums.squares += weight * in_sd * in_sd;
        sums.squares_m2 += weight * distance * distance;
        sums.variances_m2 += weight * sd * sd;
        sums.distances_m += distance.abs();
    }
    sums.information.fill_upper_triangle_with_lower_triangle();
    sums
}

/// Gradient of the distance of a point fixed in W with respect to the pose.
///
/// With R → exp(δθ)·R and t → t + δt: ∂r/∂δθ = −(p − t) × n and ∂r/∂δt = −n, n being the distance's gradient in W.
fn jacobian(p_W: &Point3<f64>, n_W: &Vector3<f64>, X_WO: &Pose, observable_W: &Matrix3<f64>) -> Vector6<f64> {
    let turn = observable_W * n_W.cross(&(p_W.coords - X_WO.translation.vector));
    Vector6::new(turn.x, turn.y, turn.z, -n_W.x, -n_W.y, -n_W.z)
}

/// The Gauss–Newton step, damped a little so that what cannot be observed stays where it was.
fn step(sums: &Sums, radius_m: f64) -> Option<Vector6<f64>> {
    let along: f64 = (3..6).map(|i| sums.information[(i, i)]).sum();
    let mut damped = sums.information;
    for i in 0..3 {
        damped[(i, i)] += 1e-6 * along * radius_m * radius_m;
        damped[(i + 3, i + 3)] += 1e-6 * along;
    }
    damped.cholesky().map(|factor| -factor.solve(&sums.gradient)).filter(|step| step.iter().all(|x| x.is_finite()))
}

/// The pose moved by a step, cut to what the distance field can be trusted for.
fn moved(X_WO: &Pose, step: &Vector6<f64>, radius_m: f64) -> Pose {
    let (turn, shift) = (step.fixed_rows::<3>(0), step.fixed_rows::<3>(3));
    let cut = (0.5 / turn.norm()).min(2.0 * radius_m / shift.norm()).min(1.0);
    Pose::from_parts(
        Translation3::from(X_WO.translation.vector + shift * cut),
        UnitQuaternion::from_scaled_axis(turn * cut) * X_WO.rotation,
    )
}

/// The information that remains when an error of the configured size is added: (H⁻¹ + F)⁻¹ = H − H·(H + F⁻¹)⁻¹·H, which
/// also holds where H has no inverse.
fn with_floor(information: &Matrix6<f64>, config: &Config) -> Matrix6<f64> {
    let [turn, shift] = [config.rotation_floor_rad, config.position_floor_m].map(|sd| sd.max(1e-9).powi(-2));
    let floor = Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let Some(factor) = (information + floor).cholesky() else { return Matrix6::zeros() };
    let remaining = information - information * factor.solve(information);
    (remaining + remaining.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::synthetic;

    #[test]
    fn jacobian_is_the_derivative_of_the_distance() {
        let (reference, config) = (synthetic::reference(&synthetic::Shape::banana(), 200), Config::default());
        let X_WO = Pose::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.4, -0.5, 0.6));
        let mut checked = 0;
        for (point, normal) in reference.points.iter().zip(&reference.normals).step_by(37) {
            let p_W = X_WO * (point + normal * 0.003);
            let scene = ScenePoint { p_W, per_depth_W: Vector3::z(), depth_sd_m: 0.0 };
            let (_, gradient_W, _) = residual(&scene, &reference, &X_WO, &config);
            let analytic = jacobian(&p_W, &gradient_W, &X_WO, &Matrix3::identity());
            for i in 0..6 {
                let h = 1e-7;
                let at = |sign: f64| {
                    let mut step = Vector6::zeros();
                    step[i] = sign * h;
                    residual(&scene, &reference, &moved(&X_WO, &step, 1.0), &config).0
                };
                let numeric = (at(1.0) - at(-1.0)) / (2.0 * h);
                assert!((numeric - analytic[i]).abs() < 2e-3, "{i}: {numeric} {}", analytic[i]);
                checked += 1;
            }
        }
        assert!(checked > 50);
    }
}
