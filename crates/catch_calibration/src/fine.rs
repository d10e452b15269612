//! Fine alignment: robust Gauss–Newton on inverse depths and silhouettes of all cameras together.

use std::collections::BTreeSet;

use catch_body::{Gripper, Robot, ray_cast::SurfacePart, statistics::median_in_place};
use catch_cell::CameraModel;
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

use super::{
    ArmSample, AveragedImage, Config, Residuals,
    averaged_image::StillImage,
    coarse::moved,
    correlation::Correlation,
    covariance::{self, Equations},
    depths,
    measurement::Measurement,
    normal_equations::{ImageEquations, ImageInformation, Row},
    parameters::{CameraState, FIRST_NUISANCE, OF_CAMERA, Patch, PosedArm, Shared},
    rendering::Rendering,
    silhouettes,
};

/// Residuals beyond so many standard deviations count less and less (Huber), and beyond so many more not at
/// all.
const HUBER_SD: f64 = 2.5;
const OUTLIER_SD: f64 = 6.0;
/// Standard deviation of the number of pixels on a line of which nothing is known yet.
const FIRST_SHOWN_SD_PX: f64 = 4.0;
/// First standard deviations of depths and of what an image's depths have in common, over that of the data
/// sheet.
const FIRST_DEPTH_SD: f64 = 4.0;
const FIRST_COMMON_SD: f64 = 1.0;
/// Standard deviations over the data sheet's, and in pixels, that no images have less than.
const LEAST_DEPTH_SD: f64 = 0.2;
const LEAST_SHOWN_SD_PX: f64 = 0.3;
/// Steps, at most; of the first ones each takes some of the images and looks farther for silhouettes.
const STEPS: usize = 9;
const FIRST_STEPS: usize = 3;
const REWEIGHTED_STEPS: usize = 6;
const OF_FIRST_IMAGES: usize = 3;
const FIRST_SILHOUETTE_PX: usize = 12;
/// Last steps whose mean tells whether the estimate still moves.
const AVERAGED_STEPS: usize = 3;
/// Steps smaller than this, in metres and radians, end it.
pub const SMALL: f64 = 2e-5;
/// Correlations are taken from one in so many images.
const CORRELATED_IMAGES: usize = 4;

/// A camera as it is given beforehand, and its images.
pub struct Observed<'a> {
    /// Intrinsics of the camera.
    pub camera: &'a CameraModel,
    pub images: Vec<&'a AveragedImage>,
    pub still: StillImage,
}

/// Measurements and model that are compared.
pub struct Problem<'a> {
    pub robot: &'a Robot,
    pub gripper: &'a Gripper,
    pub arm: &'a [ArmSample],
    pub cameras: Vec<Observed<'a>>,
    pub config: &'a Config,
}

/// Result of the fine alignment.
pub struct Estimate {
    pub cameras: Vec<CameraState>,
    pub shared: Shared,
    /// Covariance of the parameters of all cameras. None where the equations have no solution.
    pub covariance: Option<DMatrix<f64>>,
    pub residuals: Vec<Residuals>,
    /// The last steps of each camera in the mean, as its pose's covariance counts: rotation in rad and
    /// translation in m.
    pub last_step: Vec<Vector6<f64>>,
}

/// Robust spread of the residuals of one camera, and how many of them say no more than one.
#[derive(Debug, Clone, Copy)]
struct Spread {
    depth_per_m: f64,
    /// Of what the depths of a single image have in common.
    common_per_m: f64,
    shown_px: f64,
    depth_correlation: f64,
    shown_correlation: f64,
}

/// Extent of a step: its images, and whether correlations are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pass {
    /// A step with some images, silhouettes far around.
    First,
    /// A step with all images.
    All,
    /// A step with all images, in which neighbours' correlation is estimated.
    Correlating,
}

struct State<'a> {
    problem: &'a Problem<'a>,
    cameras: Vec<CameraState>,
    shared: Shared,
    spreads: Vec<Spread>,
    /// Offset that the depths of each image have in common, in 1/m.
    offsets: Vec<Vec<f64>>,
    residuals: Vec<Residuals>,
    last_step: Vec<Vector6<f64>>,
    /// Patches of links' surfaces that images show.
    patches: BTreeSet<Patch>,
}

impl Problem<'_> {
    /// The estimate that is found from a coarse one.
    pub fn solve(&self, coarse: Vec<CameraState>) -> Estimate {
        let spread = Spread {
            depth_per_m: FIRST_DEPTH_SD * self.config.inverse_depth_sd_per_m,
            common_per_m: FIRST_COMMON_SD * self.config.inverse_depth_sd_per_m,
            shown_px: FIRST_SHOWN_SD_PX,
            depth_correlation: 1.0,
            shown_correlation: 1.0,
        };
        let mut state = State {
            problem: self,
            shared: Shared::new(self.robot),
            spreads: vec![spread; coarse.len()],
            offsets: self.cameras.iter().map(|it| vec![0.0; it.images.len()]).collect(),
            residuals: vec![Residuals::default(); coarse.len()],
            last_step: vec![Vector6::repeat(f64::INFINITY); coarse.len()],
            cameras: coarse,
            patches: BTreeSet::new(),
        };
        for step in 0..STEPS {
            state.step(if step < FIRST_STEPS { Pass::First } else { Pass::All });
            if step > FIRST_STEPS && state.last_step.iter().all(|it| it.amax() < SMALL) {
                break;
            }
        }
        // The correlation of neighbours changes the weights, and so the optimum.
        state.step(Pass::Correlating);
        let (mut equations, mut steps) = (None, Vec::new());
        for _ in 0..REWEIGHTED_STEPS {
            // Two steps' equations at once would double the memory.
            drop(equations.take());
            equations = state.step(Pass::All);
            steps.push(state.last_step.clone());
            if state.last_step.iter().all(|it| it.amax() < SMALL) {
                break;
            }
        }
        let State { cameras, shared, residuals, mut last_step, .. } = state;
        // Pixels at edges come and go, so steps about the optimum do not vanish, but their mean does.
        for (camera, last) in last_step.iter_mut().enumerate() {
            let recent: Vec<_> = steps.iter().rev().take(AVERAGED_STEPS).map(|it| it[camera]).collect();
            let mean = recent.iter().sum::<Vector6<f64>>() / recent.len() as f64;
            *last = if mean.norm() < last.norm() { mean } else { *last };
        }
        let covariance = equations.and_then(|it| covariance::of_cameras(&it, cameras.len()));
        Estimate { cameras, shared, covariance, residuals, last_step }
    }
}

impl Spread {
    /// Standard deviation of what the depths of an averaged image have in common, in 1/m.
    fn offset_sd(&self, image: &AveragedImage) -> f64 {
        self.common_per_m / (image.count as f64).sqrt()
    }
}

impl State<'_> {
    /// Takes one Gauss–Newton step. Returns the equations, if they have a solution.
    fn step(&mut self, pass: Pass) -> Option<Equations> {
        let shared_from = OF_CAMERA * self.cameras.len();
        let size = shared_from + self.shared.values.len();
        let (mut information, mut pull) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let (mut of_images, mut images) = (Vec::new(), Vec::new());
        let mut of_offsets = vec![Vec::new(); self.cameras.len()];
        for camera in 0..self.cameras.len() {
            let linearized = self.linearized(camera, pass);
            let place =
                move |i: usize| if i < OF_CAMERA { OF_CAMERA * camera + i } else { shared_from + i - OF_CAMERA };
            for (image, mut own) in linearized {
                own.places.iter_mut().for_each(|it| *it = place(*it));
                own.add_to(&mut information, 1.0);
                own.add_pull_to(&mut pull);
                images.push(own);
                of_images.push((camera, image));
            }
        }
        // The priors.
        for (camera, state) in self.cameras.iter().enumerate() {
            for i in 0..OF_CAMERA {
                let at = OF_CAMERA * camera + i;
                let is_pose = i < FIRST_NUISANCE;
                information[(at, at)] += if is_pose { 1e-6 } else { 1.0 };
                pull[at] -= if is_pose { 0.0 } else { state.nuisance[i - FIRST_NUISANCE] };
            }
        }
        for (i, value) in self.shared.values.iter().enumerate() {
            let prior = self.shared.prior_information(i);
            information[(shared_from + i, shared_from + i)] += prior;
            pull[shared_from + i] -= value * prior;
        }
        let factor = information.cholesky()?;
        let change = factor.solve(&pull);
        for (camera, state) in self.cameras.iter_mut().enumerate() {
            let by = change.rows(OF_CAMERA * camera, OF_CAMERA);
            let [turn, p] = [0, 3].map(|first| Vector3::new(by[first], by[first + 1], by[first + 2]));
            state.X_WC *= moved(&p, &turn);
            self.last_step[camera] = by.fixed_rows::<6>(0).into_owned();
            state.nuisance.iter_mut().enumerate().for_each(|(i, value)| *value += by[FIRST_NUISANCE + i]);
        }
        self.shared.values.iter_mut().enumerate().for_each(|(i, value)| *value += change[shared_from + i]);
        for ((camera, image), own) in of_images.into_iter().zip(&images) {
            let offset_sd = self.spreads[camera].offset_sd(self.problem.cameras[camera].images[image]);
            let (by, variance) = own.common_change(&change);
            self.offsets[camera][image] += offset_sd * by;
            of_offsets[camera].push((image, offset_sd * variance.sqrt()));
        }
        for (camera, of_offsets) in of_offsets.iter().enumerate() {
            self.note_offsets(camera, of_offsets);
        }
        let inverse = factor.inverse();
        if pass != Pass::First {
            self.shared.tell(|i| inverse[(shared_from + i, shared_from + i)]);
            self.shared.add_patches(&self.patches);
        }
        Some(Equations { inverse, images, change })
    }

    /// The equations of each image of a camera; its spread and residuals become those of these images.
    fn linearized(&mut self, camera: usize, pass: Pass) -> Vec<(usize, ImageInformation)> {
        let Problem { robot, gripper, arm, config, cameras } = self.problem;
        let surface = self.shared.surface(robot, gripper);
        let Observed { camera: intrinsics, images, still } = &cameras[camera];
        let (state, spread) = (self.cameras[camera], self.spreads[camera]);
        let model = CameraModel { X_WC: state.X_WC, ..(*intrinsics).clone() };
        let wide = Config { silhouette_px: FIRST_SILHOUETTE_PX, ..(*config).clone() };
        let seen = if pass == Pass::First { &wide } else { *config };
        let time_offset_s = state.time_offset_s();
        let size = OF_CAMERA + self.shared.values.len() + 1;
        let mut errors = Errors::default();
        let mut patches = BTreeSet::new();
        let (mut found, mut row) = (Vec::new(), Row::new());
        let mut all = Vec::new();
        for (i, image) in images.iter().enumerate() {
            let Some(sample) = image.arm(arm, time_offset_s) else { continue };
            if pass == Pass::First && i % OF_FIRST_IMAGES != 0 {
                continue;
            }
            let posed = PosedArm::new(robot, &sample, &self.shared);
            let rendering = Rendering::new(&model, &surface, &posed.X_WL, posed.width_m);
            found.clear();
            depths::measure(&mut found, &rendering, &model, Some(image), seen);
            silhouettes::measure(&mut found, &rendering, &model, Some((image, still)), seen);
            let (offset_sd, offset) = (spread.offset_sd(image), self.offsets[camera][i]);
            let mut equations = ImageEquations::new(size, offset / offset_sd);
            let mut residuals: Vec<(Measurement, f64)> = Vec::new();
            for it in &found {
                let in_common = if it.is_depth() { offset } else { 0.0 };
                let patch = posed.patch(it, &state.X_WC);
                patches.extend(patch);
                let correction = state.correction(it) + posed.patch_correction(it, patch);
                let residual = it.residual() - correction - in_common;
                let (sd, correlated, sds) = if it.is_depth() {
                    (spread.depth_per_m, spread.depth_correlation, &mut errors.of_depths)
                } else {
                    (spread.shown_px, spread.shown_correlation, &mut errors.of_silhouettes)
                };
                let size = residual.abs() * it.weight.sqrt();
                sds.push(size);
                if size > OUTLIER_SD * sd {
                    errors.outliers += 1;
                    continue;
                }
                let robust = (HUBER_SD * sd / size).min(1.0);
                posed.row(&mut row, it, &state, offset_sd);
                // What stands still is seen in all images with the same errors: of its model, and of the
                // place of its edges between pixels.
                let repeated = if it.part == SurfacePart::Link(0) { images.len() as f64 } else { 1.0 };
                equations.add(&row, residual, it.weight * robust / (sd * sd * correlated * repeated));
                if pass == Pass::Correlating && i % CORRELATED_IMAGES == 0 {
                    residuals.push((*it, residual));
                }
            }
            errors.correlation.add(&residuals);
            all.push((i, equations.eliminated()));
        }
        self.patches.extend(patches);
        self.note(camera, errors, pass);
        all
    }

    /// The spread of what a camera's images have in common becomes that of the offsets that were found, each
    /// with its standard deviation: a step of expectation maximization. The data sheet may be wrong.
    fn note_offsets(&mut self, camera: usize, found: &[(usize, f64)]) {
        let Problem { config, cameras, .. } = self.problem;
        let square = |(image, sd): &(usize, f64)| {
            let offset = self.offsets[camera][*image];
            (offset * offset + sd * sd) * cameras[camera].images[*image].count as f64
        };
        let variance = found.iter().map(square).sum::<f64>() / found.len().max(1) as f64;
        self.spreads[camera].common_per_m = variance.sqrt().max(LEAST_DEPTH_SD * config.inverse_depth_sd_per_m);
    }

    /// The spread and the residuals of a camera become those of the errors that its measurements have.
    fn note(&mut self, camera: usize, errors: Errors, pass: Pass) {
        let Problem { config, cameras, .. } = self.problem;
        let spread = self.spreads[camera];
        let Errors { mut of_depths, mut of_silhouettes, outliers, correlation } = errors;
        let count = of_depths.len() + of_silhouettes.len();
        self.residuals[camera] = Residuals {
            images: cameras[camera].images.len(),
            depths: of_depths.len(),
            inverse_depth_sd_per_m: robust_sd(&mut of_depths),
            silhouette_sd_px: robust_sd(&mut of_silhouettes),
            outlier_fraction: f64::from(outliers) / count.max(1) as f64,
        };
        if count > 0 {
            let Residuals { inverse_depth_sd_per_m, silhouette_sd_px, .. } = self.residuals[camera];
            let is_last = pass == Pass::Correlating;
            self.spreads[camera] = Spread {
                depth_per_m: inverse_depth_sd_per_m.max(LEAST_DEPTH_SD * config.inverse_depth_sd_per_m),
                common_per_m: spread.common_per_m,
                shown_px: silhouette_sd_px.max(LEAST_SHOWN_SD_PX),
                depth_correlation: if is_last { correlation.of_depths() } else { spread.depth_correlation },
                shown_correlation: if is_last { correlation.of_silhouettes() } else { spread.shown_correlation },
            };
        }
    }
}

/// Residuals of the measurements of a camera, in multiples of their expected standard deviations.
#[derive(Default)]
struct Errors {
    of_depths: Vec<f64>,
    of_silhouettes: Vec<f64>,
    outliers: u32,
    correlation: Correlation,
}

/// Standard deviation by the median of the sizes, which is 0.6745 of it for normal ones.
fn robust_sd(sizes: &mut [f64]) -> f64 {
    median_in_place(sizes) / 0.6745
}
