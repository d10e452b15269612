//! Registration by Gauss–Newton on the signed distance field.
//!
//! Minimizes Σ ρ(f(X_OW · pᵢ)/σᵢ) over X_WO, f being the signed distance from the reference and pᵢ the
//! scene's points: what ICP with point-to-plane distances alternates towards (Chen and Medioni, Object
//! modelling by registration of multiple range images, 1992), without searching for correspondences
//! (Fitzgibbon, Robust registration of 2D and 3D point sets, 2003).

use catch_body::Pose;
use nalgebra::{Matrix3, Matrix6, Translation3, UnitQuaternion, Vector6};

use super::{
    Config, PerceptionStatus, ReferenceModel, common_noise,
    depth_plane::DepthPlane,
    normal_equations::{CommonError, MEAN_SQUARE, NormalEquations, Sums},
    point_cloud::{PointResidual, SceneCloud, ScenePoint, mean_sd_m},
    reference::MODEL_SD_M,
    silhouette::Silhouette,
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
    /// The residual of the points that the sensors' noise alone would make.
    pub noise_m: f64,
    /// Root mean square by which the silhouette's bounds are broken, where it was used.
    pub silhouette_residual_m: Option<f64>,
    /// Mean square of the points' residuals in standard deviations; `None` where no depth tells the shape.
    pub points_mismatch: Option<f64>,
    /// Mean square of the silhouette rays' residuals in standard deviations, where the silhouette was used,
    /// or as much as depths too noisy to show a shape are tilted otherwise, if that is more.
    pub silhouette_mismatch: Option<f64>,
    /// −2 × the log-likelihood of all residuals, outliers included, up to a constant: by it different starts
    /// are compared.
    pub robust_cost: f64,
    /// Iterations.
    pub iterations: usize,
}

/// Depth noise in radii of the object from which on depths are left aside where there is a silhouette.
const HOPELESS_RADII: f64 = 0.5;
/// A point's variance of its own is this fraction of all of it or more, whatever the points of an image have
/// in common.
const LEAST_OWN: f64 = 1e-3;
/// The mean square of a tilt is of two slopes and scatters more than that of a silhouette, of hundreds of
/// rays: it counts divided by this.
const TILT_SCATTER: f64 = 3.0;
/// Silhouettes in so many images tell how far away an object is.
const ENOUGH_SILHOUETTES: usize = 3;
/// Steps that turn back and do not get shorter jump to and fro across a kink of the field, later ones that do
/// not get shorter do so some other way: they are halved.
const FREE_STEPS: usize = 8;
/// Unless they are longer than this many standard deviations, and so still on their way.
const JUMPING_SD: f64 = 10.0;
/// A start whose first step is shorter than this many standard deviations was near already, as the prediction
/// of a tracked object is. Then steps may be longer by this factor to count as come to rest, because none of
/// them has far to go.
const NEAR_SD: f64 = 10.0;
const NEAR_TOLERANCE: f64 = 2.0;
/// Mean distances of points below this are all perfect, in metres.
const LEAST_MEAN_M: f64 = 1e-5;
/// The silhouette's scale falls to this fraction from one step to the next at most: bounds close in on the
/// pose gradually.
const LEAST_SHRINKING: f64 = 0.6;

/// Ratios of the residuals of points and of silhouette rays to their configured standard deviations, never
/// less than one. Estimated along with the pose, they weigh the two kinds against each other even where the
/// depth noise is not configured.
#[derive(Debug, Clone, Copy)]
struct Scales {
    points: f64,
    silhouette: f64,
}

/// Progress of a registration.
#[derive(Default)]
struct Pace {
    iterations: usize,
    /// True if the steps have come to rest.
    at_rest: bool,
    /// Distance by which the surface was moved, in metres.
    moved_m: f64,
    /// The last step before it was damped, and its length in standard deviations of the pose.
    step: Vector6<f64>,
    step_sd: f64,
    damping: f64,
    /// Steps shorter than this have come to rest.
    tolerance_sd: f64,
}

impl Pace {
    /// The part of a step that is taken: all of it, unless the steps jump to and fro.
    fn damped(&mut self, step: &Vector6<f64>, information: &Matrix6<f64>) -> Vector6<f64> {
        let step_sd = step.dot(&(information * step)).max(0.0).sqrt();
        if self.iterations == 1 && step_sd < NEAR_SD {
            self.tolerance_sd *= NEAR_TOLERANCE;
        }
        let turns_back = step.dot(&(information * self.step)) < 0.0;
        if (turns_back || self.iterations > FREE_STEPS) && step_sd < JUMPING_SD && step_sd > 0.7 * self.step_sd {
            self.damping *= 0.5;
        }
        (self.step_sd, self.step) = (step_sd, *step);
        step * self.damping
    }

    /// Length of the last step that was taken, in standard deviations of the pose.
    fn last_sd(&self) -> f64 {
        self.damping * self.step_sd
    }

    /// Counts a step that moved the surface by a length.
    fn note(&mut self, length_m: f64) {
        self.moved_m += length_m;
        self.at_rest = length_m < STEP_TOLERANCE_M || self.last_sd() < self.tolerance_sd;
    }
}

/// Sums over points and rays at a pose.
#[derive(Default)]
struct Summed {
    on_points: Sums,
    on_rays: Sums,
    /// Mean square of the tilt of depths that show no shape, in standard deviations.
    tilted: f64,
    equations: NormalEquations,
}

impl Summed {
    fn fit(
        &self,
        (X_WO, information): (Pose, Matrix6<f64>),
        depths: &Depths<'_>,
        silhouette: &Silhouette,
        noise_m: f64,
    ) -> Fit {
        let Self { on_points, on_rays, .. } = self;
        let (weight, has_shape) = (on_points.weight.max(1e-12), !depths.residuals.is_empty());
        Fit {
            X_WO,
            information,
            points: if has_shape { on_points.weight.round() as usize } else { depths.points.len() },
            residual_m: if has_shape { (on_points.squares_m2 / weight).sqrt() } else { noise_m },
            noise_m: if has_shape { (on_points.variances_m2 / weight).sqrt() } else { noise_m },
            silhouette_residual_m: (!silhouette.is_empty())
                .then(|| (on_rays.squares_m2 / on_rays.weight.max(1.0)).sqrt()),
            points_mismatch: has_shape.then(|| on_points.squares / weight),
            silhouette_mismatch: (!silhouette.is_empty())
                .then(|| silhouette.mean_square().max(self.tilted / TILT_SCATTER)),
            robust_cost: robust_cost(on_points, depths.residuals.len()) + silhouette.cost() + 2.0 * self.tilted,
            iterations: 0,
        }
    }
}

/// Fewer points than this give no pose.
pub const MIN_POINTS: usize = 6;
/// Largest root mean square residual that is believed, in metres, beside three standard deviations of depth
/// noise: wrong orientations left 6 mm.
pub const MAX_RESIDUAL_M: f64 = 0.005;
/// Most iterations of one registration.
const MAX_ITERATIONS: usize = 20;
/// A registration has converged when a step is shorter than this in metres, and at the object's surface.
const STEP_TOLERANCE_M: f64 = 2e-6;
/// A registration has also converged when a step is shorter than this fraction of the pose's standard
/// deviation.
const STEP_TOLERANCE_SD: f64 = 0.1;
/// Standard deviations in radians and metres that every pose has at least, because points of one frame err
/// together.
const FLOOR_SD: [f64; 2] = [1e-3, 5e-5];

/// Registration of a reference onto scenes.
#[derive(Debug, Clone, Copy)]
pub struct Registration<'a> {
    /// The object.
    pub reference: &'a ReferenceModel,
    /// Settings.
    pub config: &'a Config,
    /// Standard deviation in metres of a point's distance from the reference without noise of its depth.
    pub model_sd_m: f64,
}

impl<'a> Registration<'a> {
    /// Creates the registration of points with the reference's own error and the noise of their depths.
    pub fn new(reference: &'a ReferenceModel, config: &'a Config) -> Self {
        Self { reference, config, model_sd_m: MODEL_SD_M }
    }

    /// Brings the reference from `X_WO` onto the scene's points, and if wanted its silhouette onto theirs.
    ///
    /// # Errors
    /// Where the steps do not come to rest, or too far from the points.
    pub fn register(
        &self,
        scene: &mut SceneCloud,
        X_WO: &Pose,
        with_silhouette: bool,
    ) -> Result<Fit, PerceptionStatus> {
        let (fit, converged) = self.iterate(scene, X_WO, MAX_ITERATIONS, with_silhouette);
        let limit_m = MAX_RESIDUAL_M + 3.0 * fit.noise_m;
        // Depths that are off by as much as the object is large are noise, whatever was told; then the
        // silhouette vouches for itself.
        let is_noise = fit.residual_m > HOPELESS_RADII * self.reference.radius_m;
        let outlined = is_noise && fit.silhouette_residual_m.is_some_and(|residual_m| residual_m <= MAX_RESIDUAL_M);
        let believable = (fit.residual_m <= limit_m || outlined) && fit.points >= MIN_POINTS;
        if converged && believable { Ok(fit) } else { Err(PerceptionStatus::NotConverged) }
    }

    /// Takes at most `max_iterations` Gauss–Newton steps, and returns whether they came to rest.
    pub(super) fn iterate(
        &self,
        scene: &mut SceneCloud,
        start: &Pose,
        max_iterations: usize,
        with_silhouette: bool,
    ) -> (Fit, bool) {
        let reference = self.reference;
        let noise_m = scene.mean_noise_m();
        let SceneCloud { points, silhouette, residuals, .. } = scene;
        let mut none = Silhouette::default();
        let silhouette = if with_silhouette { silhouette } else { &mut none };
        let shapeless_above_m =
            if silhouette.is_empty() { f64::INFINITY } else { HOPELESS_RADII * reference.inner_radius_m };
        let mut depths = Depths::new(points, residuals, shapeless_above_m);
        depths.planes = self.planes(&depths);
        let mut X_WO = *start;
        let observable = reference.symmetry.observable();
        silhouette.find(reference, &X_WO);
        // With infinite scales nothing is an outlier: the typical residual at the start, so that a start that
        // is off does not turn everything to outliers.
        self.measure(&mut depths, &X_WO);
        let mut on_points = Sums::default();
        for it in &*depths.residuals {
            on_points.weigh(it.distance_m, it.sd_m, f64::INFINITY);
        }
        let mut scales =
            Scales { points: typical(&on_points), silhouette: silhouette.typical_violation(f64::INFINITY).max(1.0) };
        silhouette.choose(0.0, scales.silhouette);
        let mut summed = Summed::default();
        let (step_sd, damping, tolerance_sd) = (f64::INFINITY, 1.0, STEP_TOLERANCE_SD);
        let mut pace = Pace { step_sd, damping, tolerance_sd, ..Pace::default() };
        while pace.iterations < max_iterations && !pace.at_rest {
            if pace.iterations > 0 {
                self.measure(&mut depths, &X_WO);
            }
            pace.iterations += 1;
            summed = self.sum_all(&depths, silhouette, &X_WO, &mut scales);
            let (information, gradient) = summed.equations.projected(&observable);
            let Some(step) = step(&information, &gradient, reference.radius_m) else { break };
            let step = pace.damped(&step, &information);
            let length_m;
            (X_WO, length_m) = moved(&X_WO, &step, reference.radius_m);
            pace.note(length_m);
            if !silhouette.is_empty() {
                silhouette.follow(reference, &X_WO, pace.moved_m, scales.silhouette);
                let scale = silhouette.typical_violation(scales.silhouette).max(1.0);
                pace.at_rest &= scale > 0.7 * scales.silhouette;
                scales.silhouette = scale.max(LEAST_SHRINKING * scales.silhouette);
            }
        }
        if !pace.at_rest {
            self.measure(&mut depths, &X_WO);
            summed = self.sum_all(&depths, silhouette, &X_WO, &mut scales);
        }
        let information = in_world(&summed.equations.projected(&observable).0, &X_WO);
        let fit = Fit { iterations: pace.iterations, ..summed.fit((X_WO, information), &depths, silhouette, noise_m) };
        let finite = X_WO.to_homogeneous().iter().chain(fit.information.iter()).all(|value| value.is_finite());
        // Kinks of the field can keep the last steps from vanishing; within the noise they do no harm.
        (fit, (pace.at_rest || pace.last_sd() < 1.0) && finite && fit.residual_m.is_finite())
    }

    /// The normal equations of both kinds at a pose that points and rays have been brought to, each by what
    /// its residuals turn out to be worth.
    fn sum_all(&self, depths: &Depths<'_>, silhouette: &mut Silhouette, X_WO: &Pose, scales: &mut Scales) -> Summed {
        let on_points = self.sum_points(depths.residuals, scales.points);
        let on_rays = silhouette.sum(scales.silhouette);
        scales.points = typical(&on_points);
        let mut equations = on_rays.equations;
        equations.add_scaled(&on_points.equations, scales.points.powi(-2));
        let planes = depths.planes.iter().flatten();
        let tilted = planes.map(|plane| plane.add_to(&mut equations, self.reference, X_WO)).sum();
        Summed { on_points, on_rays, tilted, equations }
    }

    /// The plane through the depths of each image whose single depths do not show the object's shape. The
    /// silhouettes of several images tell more.
    fn planes(&self, depths: &Depths<'_>) -> [Option<DepthPlane>; ENOUGH_SILHOUETTES - 1] {
        let common_fraction =
            self.config.depth_common_fraction.filter(|_| depths.images().nth(ENOUGH_SILHOUETTES - 1).is_none());
        let mut planes = depths
            .images()
            .filter(|image| !depths.has_shape(image))
            .filter_map(|image| Some(DepthPlane::new(image, self.reference, common_fraction?, self.config.edge_px())));
        std::array::from_fn(|_| planes.next())
    }

    /// Sums over the points. The error that the depths of each image have in common is eliminated.
    fn sum_points(&self, residuals: &[PointResidual], scale: f64) -> Sums {
        let mut sums = Sums::default();
        let Some(told) = self.config.depth_common_fraction else {
            for PointResidual { p_O, n_O, distance_m, sd_m, .. } in residuals {
                let curvature = sums.weigh(*distance_m, *sd_m, scale) / (sd_m * sd_m);
                sums.equations.add(p_O, n_O, curvature, curvature * distance_m);
            }
            return sums;
        };
        let [own, common] = common_noise::fractions(told, residuals, scale);
        for image in residuals.chunk_by(|a, b| a.image == b.image) {
            let mut of_image = CommonError::new(0.0);
            for PointResidual { p_O, n_O, distance_m, sd_m, by_depth_m, .. } in image {
                let variance_m2 = sd_m * sd_m;
                let own_m2 = (variance_m2 - (1.0 - own) * by_depth_m * by_depth_m).max(LEAST_OWN * variance_m2);
                let curvature = sums.weigh(*distance_m, *sd_m, scale) / own_m2;
                let slope = curvature * distance_m;
                sums.equations.add(p_O, n_O, curvature, slope);
                of_image.add(p_O, n_O, curvature, slope, common.sqrt() * by_depth_m);
            }
            sums.equations.eliminate(&of_image);
        }
        sums
    }

    /// Brings the residuals of all points whose depths tell the shape to a pose.
    ///
    /// σ² = (σ_z·c)² + (σ_z²·(1 − c²)/2r)² + σ_model² with c = ∂r/∂z: noise moves the point along its ray,
    /// where the ray grazes the surface to second order only, by what a surface of the object's thickness r
    /// bends.
    fn measure(&self, depths: &mut Depths<'_>, X_WO: &Pose) {
        let Self { reference, model_sd_m, .. } = *self;
        let R_OW = X_WO.rotation.to_rotation_matrix().transpose();
        for residual in &mut *depths.residuals {
            let point = &depths.points[residual.point];
            residual.p_O = (R_OW * (point.p_W.coords - X_WO.translation.vector)).into();
            (residual.distance_m, residual.n_O) = reference.distance.at(&residual.p_O);
            let mut variance = model_sd_m * model_sd_m;
            if point.depth_sd_m > 0.0 {
                let along = residual.n_O.dot(&(R_OW * point.per_depth_W));
                let depth_variance = point.depth_sd_m * point.depth_sd_m;
                residual.by_depth_m = point.depth_sd_m * along;
                let bent = depth_variance * (1.0 - along * along).max(0.0) * 0.5 / reference.inner_radius_m;
                variance += depth_variance * along * along + bent * bent;
            }
            residual.sd_m = variance.sqrt();
        }
    }
}

/// The points of a scene, image by image.
struct Depths<'a> {
    points: &'a [ScenePoint],
    /// Residuals of the points of the images whose depths show the object's shape.
    residuals: &'a mut Vec<PointResidual>,
    /// Depths with a larger standard deviation tell no shape: nothing that the object's silhouette does not
    /// say better, and the field is no measure of how they err.
    shapeless_above_m: f64,
    /// What the depths of the other images tell.
    planes: [Option<DepthPlane>; ENOUGH_SILHOUETTES - 1],
}

impl<'a> Depths<'a> {
    fn new(points: &'a [ScenePoint], residuals: &'a mut Vec<PointResidual>, shapeless_above_m: f64) -> Self {
        residuals.clear();
        let depths = Self { points, residuals, shapeless_above_m, planes: std::array::from_fn(|_| None) };
        let mut first = 0;
        for image in depths.images() {
            if depths.has_shape(image) {
                let residual =
                    |(point, &ScenePoint { image, .. })| PointResidual { point, image, ..Default::default() };
                depths.residuals.extend((first..).zip(image).map(residual));
            }
            first += image.len();
        }
        depths
    }

    fn images(&self) -> impl Iterator<Item = &'a [ScenePoint]> + use<'a> {
        self.points.chunk_by(|a, b| a.image == b.image)
    }

    fn has_shape(&self, image: &[ScenePoint]) -> bool {
        self.shapeless_above_m == f64::INFINITY || mean_sd_m(image) <= self.shapeless_above_m
    }
}

/// Root mean square of the points' residuals in multiples of what it should be, at least one.
fn typical(sums: &Sums) -> f64 {
    (sums.squares / (MEAN_SQUARE * sums.weight.max(1e-12))).sqrt().max(1.0)
}

/// −2 × the log-likelihood of residuals, outliers included, if they are Laplace distributed with a width that
/// only their mean tells, up to a constant: 2·n·ln(mean |r|).
fn robust_cost(sums: &Sums, count: usize) -> f64 {
    if count == 0 {
        return 0.0;
    }
    2.0 * count as f64 * libm::log((sums.distances_m / count as f64).max(LEAST_MEAN_M))
}

/// The Gauss–Newton step in O, damped a little so that what cannot be observed stays where it was.
fn step(information: &Matrix6<f64>, gradient: &Vector6<f64>, radius_m: f64) -> Option<Vector6<f64>> {
    let along: f64 = (3..6).map(|i| information[(i, i)]).sum();
    let mut damped = *information;
    for i in 0..3 {
        damped[(i, i)] += 1e-6 * along * radius_m * radius_m;
        damped[(i + 3, i + 3)] += 1e-6 * along;
    }
    damped.cholesky().map(|factor| -factor.solve(gradient)).filter(|step| step.iter().all(|x| x.is_finite()))
}

/// The pose moved by a step in O, cut to what the distance field can be trusted for, and how far that moves
/// the surface.
fn moved(X_WO: &Pose, step: &Vector6<f64>, radius_m: f64) -> (Pose, f64) {
    let (turn, shift) = (step.fixed_rows::<3>(0), step.fixed_rows::<3>(3));
    let cut = (0.5 / turn.norm()).min(2.0 * radius_m / shift.norm()).min(1.0);
    let X_WO = Pose::from_parts(
        Translation3::from(X_WO.translation.vector + X_WO.rotation * (shift * cut)),
        X_WO.rotation * UnitQuaternion::from_scaled_axis(turn * cut),
    );
    (X_WO, cut * (shift.norm() + turn.norm() * radius_m))
}

/// Information on turns and shifts in O as one on turns and shifts in W, less what is never known better.
fn in_world(information: &Matrix6<f64>, X_WO: &Pose) -> Matrix6<f64> {
    let R_WO: Matrix3<f64> = *X_WO.rotation.to_rotation_matrix().matrix();
    let mut both = Matrix6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(&R_WO);
    both.fixed_view_mut::<3, 3>(3, 3).copy_from(&R_WO);
    with_floor(&(both * information * both.transpose()))
}

/// The information that remains when an error of such a size is added: (H⁻¹ + F)⁻¹ = H − H·(H + F⁻¹)⁻¹·H,
/// which also holds where H has no inverse.
fn with_floor(information: &Matrix6<f64>) -> Matrix6<f64> {
    // No `powi`: of constants compilers may make another last bit.
    let [turn, shift] = FLOOR_SD.map(|sd| 1.0 / (sd * sd));
    let floor = Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let Some(factor) = (information + floor).cholesky() else { return Matrix6::zeros() };
    let remaining = information - information * factor.solve(information);
    (remaining + remaining.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::perception::{reference::DISTANCE_GRID_M, synthetic};

    #[test]
    fn normal_equations_hold_the_derivative_of_the_distance() {
        let (reference, config) = (synthetic::reference(&synthetic::Shape::banana(), 200), Config::default());
        let registration = Registration::new(&reference, &config);
        let X_WO = Pose::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.4, -0.5, 0.6));
        let (mut squares, mut checked) = ([0.0_f64; 6], 0);
        for (point, normal) in reference.points.iter().zip(&reference.normals).step_by(37) {
            let scene = [ScenePoint {
                p_W: X_WO * (point + normal * 0.003),
                per_depth_W: Vector3::z(),
                depth_sd_m: 0.0,
                pixel_m: 0.0,
                image: 0,
            }];
            let measured = |X_WO: &Pose| {
                let mut residuals = Vec::new();
                registration.measure(&mut Depths::new(&scene, &mut residuals, f64::INFINITY), X_WO);
                residuals
            };
            let distance = |X_WO: &Pose| measured(X_WO)[0].distance_m;
            let sums = registration.sum_points(&measured(&X_WO), f64::INFINITY);
            let (_, gradient) = sums.equations.projected(&Matrix3::identity());
            let curvature = MODEL_SD_M.powi(-2);
            for i in 0..6 {
                // Wide enough to average over the cells of the grid, whose gradients disagree a little: one
                // cell, a lever arm being 5 cm.
                let half_m = DISTANCE_GRID_M / 2.0;
                let h = if i < 3 { half_m / 0.05 } else { half_m };
                let at = |sign: f64| {
                    let mut step = Vector6::zeros();
                    step[i] = sign * h;
                    distance(&moved(&X_WO, &step, 1.0).0)
                };
                let numeric = (at(1.0) - at(-1.0)) / (2.0 * h);
                let analytic = gradient[i] / (curvature * distance(&X_WO));
                assert!((numeric - analytic).abs() < 0.03, "{i}: {numeric} {analytic}");
                squares[i] += (numeric - analytic).powi(2);
            }
            checked += 1;
        }
        assert!(checked > 10);
        // Single cells may be rough, next to the banana's ends; a wrong formula is wrong everywhere.
        let off = squares.map(|square| (square / f64::from(checked)).sqrt());
        assert!(off.iter().all(|off| *off < 0.01), "{off:?}");
    }

    /// However many pixels an image has, the error that its depths have in common remains; and whatever was
    /// told of it, the scatter of the pixels shows what each of them has by itself.
    #[test]
    fn what_depths_have_in_common_is_not_averaged_away() {
        const SD_M: f64 = 0.004;
        let reference = synthetic::reference(&synthetic::Shape::banana(), 200);
        let facing = reference.points.iter().zip(&reference.normals).filter(|(_, normal)| normal.z < -0.5);
        let facing: Vec<nalgebra::Point3<f64>> = facing.map(|(p_W, _)| *p_W).collect();
        // Standard deviations of a turn and of the distance, by the true and the told fraction.
        let sd = |truly: f64, told: f64| {
            let own_m = (1.0 - truly).sqrt() * SD_M;
            let point = |(i, p_W): (usize, &nalgebra::Point3<f64>)| ScenePoint {
                p_W: p_W + Vector3::z() * if i % 2 == 0 { own_m } else { -own_m },
                per_depth_W: Vector3::z(),
                depth_sd_m: SD_M,
                pixel_m: 0.0,
                image: 0,
            };
            let points: Vec<ScenePoint> = facing.iter().enumerate().map(point).collect();
            let config = Config { depth_common_fraction: Some(told), ..Config::default() };
            let registration = Registration::new(&reference, &config);
            let mut residuals = Vec::new();
            registration.measure(&mut Depths::new(&points, &mut residuals, f64::INFINITY), &Pose::identity());
            let sums = registration.sum_points(&residuals, f64::INFINITY);
            let information = sums.equations.projected(&Matrix3::identity()).0;
            [0, 5].map(|i| information[(i, i)].sqrt().recip())
        };
        let (alone, common) = (sd(0.0, 0.0), sd(0.5, 0.5));
        assert!(alone[1] < 4e-4, "{alone:?}");
        assert!(common[1] > 0.9 * 0.5_f64.sqrt() * SD_M, "{common:?}");
        for told in [0.0, 1.0] {
            let wrong = sd(0.5, told);
            assert!(wrong[1] > 0.8 * common[1], "{told}: {wrong:?} instead of {common:?}");
            assert!(wrong[0] > 0.8 * common[0] && wrong[0] < 1.5 * common[0], "{told}: {wrong:?}, {common:?}");
        }
    }
}
