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
    silhouette::OutlineRay,
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
    /// Root mean square distance of the outline's rays, where it was used.
    pub outline_residual_m: Option<f64>,
    /// How badly all residuals fit, outliers included: what different starts are compared by.
    pub misfit: f64,
    /// The same as the sensors' noise alone would make it.
    pub noise_m: f64,
    /// Iterations.
    pub iterations: usize,
}

/// Sums over all residuals of one kind at one pose.
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

/// Standard deviations at which a residual's weight has fallen to a quarter (Geman–McClure): 98 % efficient on normal noise.
const OUTLIER_SD: f64 = 5.0;
/// What the weighted mean square of normal residuals then is, in variances: E\[w·u²\]/E\[w\].
const MEAN_SQUARE: f64 = 0.873;

/// Steps on depths alone before it is decided whether the outline is needed.
const FIRST_STEPS: usize = 5;
/// Steps that are taken in full before they are halved.
const FULL_STEPS: usize = 8;
/// Least share of a pixel across the outline that counts: over a pixel, outlines are not straight.
const LEAST_ACROSS: f64 = 0.3;

/// Mean distances below this are all perfect, in metres.
const LEAST_MEAN_M: f64 = 1e-5;
/// How much larger than told the residuals of points and of outline rays are, never less than one. Estimated along, it
/// weighs the two kinds against each other even if nobody told how noisy the depths are.
#[derive(Debug, Clone, Copy)]
struct Scales {
    points: f64,
    outline: f64,
}

/// Brings the reference from `X_WO` onto the scene's points, and its outline onto theirs where the depths are noisy.
pub fn register(
    scene: &mut SceneCloud,
    reference: &ReferenceModel,
    X_WO: &Pose,
    config: &Config,
) -> Result<Fit, PerceptionStatus> {
    // A few steps tell whether the depths are good enough by themselves. If not, they may have led astray: from the start
    // again, with the outline.
    let first = if scene.outline.is_empty() { config.max_iterations } else { FIRST_STEPS.min(config.max_iterations) };
    let (mut fit, mut converged) = iterate(scene, reference, X_WO, config, first, false);
    let with_outline = fit.residual_m > config.outline_above_m && !scene.outline.is_empty();
    if with_outline || !converged {
        let before = fit.iterations;
        let start = if with_outline { *X_WO } else { fit.X_WO };
        (fit, converged) = iterate(scene, reference, &start, config, config.max_iterations, with_outline);
        fit.iterations += before;
    }
    let limit_m = config.max_residual_m + 3.0 * fit.noise_m;
    let outlined = fit.outline_residual_m.is_some_and(|residual_m| residual_m <= config.max_residual_m);
    let believable = (fit.residual_m <= limit_m || outlined) && fit.points >= config.min_points;
    if converged && believable { Ok(fit) } else { Err(PerceptionStatus::NotConverged) }
}

/// At most `max_iterations` Gauss–Newton steps, and whether they came to rest.
pub(super) fn iterate(
    scene: &mut SceneCloud,
    reference: &ReferenceModel,
    start: &Pose,
    config: &Config,
    max_iterations: usize,
    with_outline: bool,
) -> (Fit, bool) {
    let SceneCloud { points: scene_points, outline } = scene;
    let outline = if with_outline { outline.as_mut_slice() } else { &mut [] };
    let counts = [scene_points.len(), outline.len()];
    let mut X_WO = *start;
    let far = Scales { points: f64::INFINITY, outline: f64::INFINITY };
    let mut both = |X_WO: &Pose, scales: &Scales, refine: bool| {
        let points = sum_points(scene_points, reference, X_WO, scales.points, config);
        (points, sum_outline(outline, reference, X_WO, scales.outline, refine, config))
    };
    let typical = |sums: &Sums| (sums.squares / (MEAN_SQUARE * sums.weight.max(1e-12))).sqrt().max(1.0);
    // With infinite scales nothing is an outlier: the typical residual at the start, so that a start that is off does not
    // turn everything to outliers.
    let (mut points, mut rays) = both(&X_WO, &far, false);
    let mut scales = Scales { points: typical(&points), outline: typical(&rays) };
    let mut converged = false;
    let mut in_sd = f64::INFINITY;
    let mut iterations = 0;
    while iterations < max_iterations && !converged {
        iterations += 1;
        (points, rays) = both(&X_WO, &scales, iterations > 2);
        scales = Scales { points: typical(&points), outline: typical(&rays) };
        let (information, gradient) = joined(&points, &rays, &scales);
        let Some(mut step) = step(&information, &gradient, reference.radius_m) else { break };
        if iterations > FULL_STEPS {
            // Full steps may jump to and fro across a kink of the field.
            step *= 0.5;
        }
        X_WO = moved(&X_WO, &step, reference.radius_m);
        let length = step.fixed_rows::<3>(3).norm() + step.fixed_rows::<3>(0).norm() * reference.radius_m;
        in_sd = step.dot(&(information * step)).max(0.0).sqrt();
        converged = length < config.step_tolerance_m || in_sd < config.step_tolerance_sd;
    }
    if !converged {
        (points, rays) = both(&X_WO, &scales, true);
    }
    scales = Scales { points: typical(&points), outline: typical(&rays) };
    let information = with_floor(&joined(&points, &rays, &scales).0, config);
    let weight = points.weight.max(1e-12);
    let fit = Fit {
        X_WO,
        information,
        points: points.weight.round() as usize,
        residual_m: (points.squares_m2 / weight).sqrt(),
        noise_m: (points.variances_m2 / weight).sqrt(),
        outline_residual_m: (rays.weight > 0.0).then(|| (rays.squares_m2 / rays.weight).sqrt()),
        misfit: misfit(&points, &rays, counts),
        iterations,
    };
    let finite = X_WO.to_homogeneous().iter().chain(information.iter()).all(|value| value.is_finite());
    // Kinks of the field can keep the last steps from vanishing; within the noise they do no harm.
    (fit, (converged || in_sd < 0.5) && finite && fit.residual_m.is_finite())
}

/// Normal equations of both kinds, each by what its residuals turned out to be worth.
fn joined(points: &Sums, rays: &Sums, scales: &Scales) -> (Matrix6<f64>, Vector6<f64>) {
    let (a, b) = (scales.points.powi(-2), scales.outline.powi(-2));
    (points.information * a + rays.information * b, points.gradient * a + rays.gradient * b)
}

/// −2 × the log-likelihood of all residuals, outliers included, if they are Laplace distributed with widths that only their
/// mean tells, up to a constant: Σ 2·n·ln(mean |r|) over the two kinds.
fn misfit(points: &Sums, rays: &Sums, counts: [usize; 2]) -> f64 {
    let of = |sums: &Sums, count: usize| {
        let mean_m = sums.distances_m / count.max(1) as f64;
        2.0 * count as f64 * mean_m.max(LEAST_MEAN_M).ln()
    };
    of(points, counts[0]) + of(rays, counts[1])
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

impl Sums {
    const ZERO: Self = Self {
        information: Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6])),
        gradient: Vector6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 1])),
        weight: 0.0,
        squares: 0.0,
        squares_m2: 0.0,
        variances_m2: 0.0,
        distances_m: 0.0,
    };

    /// Adds a residual with its gradient and standard deviation, with the weight of Geman and McClure,
    /// w = 1/(1 + (r/c)²)².
    fn add(&mut self, distance: f64, J: &Vector6<f64>, sd: f64, scale: f64) {
        let in_sd = distance / sd;
        let weight = (1.0 + (in_sd / (OUTLIER_SD * scale)).powi(2)).powi(-2);
        let J = J / sd;
        for i in 0..6 {
            let weighted = weight * J[i];
            self.gradient[i] += weighted * in_sd;
            for j in 0..=i {
                self.information[(i, j)] += weighted * J[j];
            }
        }
        self.weight += weight;
        self.squares += weight * in_sd * in_sd;
        self.squares_m2 += weight * distance * distance;
        self.variances_m2 += weight * sd * sd;
        self.distances_m += distance.abs();
    }
}

fn sum_points(points: &[ScenePoint], reference: &ReferenceModel, X_WO: &Pose, scale: f64, config: &Config) -> Sums {
    let mut sums = Sums::ZERO;
    let observable_W = observable(reference, X_WO);
    for point in points {
        let (distance, gradient_W, sd) = residual(point, reference, X_WO, config);
        sums.add(distance, &jacobian(&point.p_W, &gradient_W, X_WO, &observable_W), sd, scale);
    }
    sums.information.fill_upper_triangle_with_lower_triangle();
    sums
}

fn sum_outline(
    rays: &mut [OutlineRay],
    reference: &ReferenceModel,
    X_WO: &Pose,
    scale: f64,
    refine: bool,
    config: &Config,
) -> Sums {
    let mut sums = Sums::ZERO;
    let observable_W = observable(reference, X_WO);
    for ray in rays {
        let p_W = ray.touch(reference, X_WO, refine);
        let (distance, gradient_O) = reference.distance.at(&X_WO.inverse_transform_point(&p_W));
        let gradient_W = X_WO.rotation * gradient_O;
        // Where the outline runs along the line between the two pixels, it is known better across it.
        let distance_m = (p_W - ray.p_WC).norm();
        let across = gradient_W.dot(&ray.pixel_W).abs().max(LEAST_ACROSS * ray.pixel_W.norm());
        let sd = (config.outline_sd_px * across * distance_m).hypot(config.model_sd_m);
        sums.add(distance, &jacobian(&p_W, &gradient_W, X_WO, &observable_W), sd, scale);
    }
    sums.information.fill_upper_triangle_with_lower_triangle();
    sums
}

/// Projects a small turn, given in W, on what can be seen of it.
fn observable(reference: &ReferenceModel, X_WO: &Pose) -> Matrix3<f64> {
    let R_WO = X_WO.rotation.to_rotation_matrix();
    R_WO * reference.symmetry.observable() * R_WO.transpose()
}

/// Gradient of the distance of a point fixed in W with respect to the pose.
///
/// With R → exp(δθ)·R and t → t + δt: ∂r/∂δθ = −(p − t) × n and ∂r/∂δt = −n, n being the distance's gradient in W.
fn jacobian(p_W: &Point3<f64>, n_W: &Vector3<f64>, X_WO: &Pose, observable_W: &Matrix3<f64>) -> Vector6<f64> {
    let turn = observable_W * n_W.cross(&(p_W.coords - X_WO.translation.vector));
    Vector6::new(turn.x, turn.y, turn.z, -n_W.x, -n_W.y, -n_W.z)
}

/// The Gauss–Newton step, damped a little so that what cannot be observed stays where it was.
fn step(information: &Matrix6<f64>, gradient: &Vector6<f64>, radius_m: f64) -> Option<Vector6<f64>> {
    let along: f64 = (3..6).map(|i| information[(i, i)]).sum();
    let mut damped = *information;
    for i in 0..3 {
        damped[(i, i)] += 1e-6 * along * radius_m * radius_m;
        damped[(i + 3, i + 3)] += 1e-6 * along;
    }
    damped.cholesky().map(|factor| -factor.solve(gradient)).filter(|step| step.iter().all(|x| x.is_finite()))
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
