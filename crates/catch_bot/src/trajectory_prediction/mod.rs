//! Trajectory prediction (paper, III-B): the flight that the poses agree on.
//!
//! Sampling ([`ransac`]) finds a flight that most poses lie on, and which they are; a robust fit to all of
//! them (`fit.rs`) makes it as good as the poses' information allows and says how good that is.

mod aerodynamic_forces;
mod aerodynamics;
mod agreement;
mod correlated_error;
mod fit;
mod flight;
pub(crate) mod free_fall;
mod local_flight;
mod process_noise;
pub mod ransac;
mod rotation_consensus;

use catch_body::{quantity, symmetry::Symmetry};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

pub use aerodynamic_forces::AerodynamicForces;
pub use aerodynamics::AerodynamicPrior;
pub use flight::{FlightPropagator, FlightTrajectory};
pub use local_flight::LocalFlight;
pub use process_noise::ProcessNoise;
use ransac::Sampling;

use crate::perception::ObjectPose;

/// Inertia tensor that rules an object's tumbling; none where ω, or what can be seen of it, is constant.
pub fn inertia_per_kg(symmetry: &Symmetry) -> Option<Matrix3<f64>> {
    match symmetry {
        Symmetry::Finite { inertia_per_kg, .. } => Some(*inertia_per_kg),
        Symmetry::Axis { .. } | Symmetry::Sphere => None,
    }
}

/// Settings of trajectory prediction.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Drag constant k that is expected, in 1/m; zero if it is not set.
    pub drag_prior_per_m: quantity::drag_per_m<Option<f64>>,
    /// Standard deviation of the expected drag constant, in 1/m; zero if it is not set. Zero, as in the
    /// paper's simulator, means that the drag is exactly as expected.
    pub drag_prior_sd_per_m: quantity::drag_per_m<Option<f64>>,
    /// Standard deviation of each component of the angular velocity around zero before anything is seen,
    /// rad/s.
    pub spin_prior_sd_radps: quantity::speed_radps,
    /// Error in metres that all poses have in common, at the arm and away from it (calibration of the
    /// cameras).
    pub systematic_sd_m: quantity::error_m,
    /// Standard deviation of an error that successive poses have in common, in metres for each metre between
    /// the pose and the origin of W, where the arm stands. It follows from `perception.camera_sd_rad`: no
    /// setting of a file.
    #[serde(skip)]
    pub correlated_sd_per_m: Option<f64>,
    /// Standard deviation in metres of each coordinate by which the centre of mass may be beside that of the
    /// reference model, whose density is uniform; as the object's file says if it is not set.
    pub com_sd_m: quantity::error_m<Option<f64>>,
    /// Forces that depend on orientation and spin. None are expected by default.
    pub aerodynamics: AerodynamicPrior,
    /// Disturbances that no model of the flight covers. None by default, as in the paper's simulator.
    pub process_noise: ProcessNoise,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            drag_prior_per_m: None,
            drag_prior_sd_per_m: None,
            spin_prior_sd_radps: 8.3,
            systematic_sd_m: 0.0002,
            correlated_sd_per_m: None,
            com_sd_m: None,
            aerodynamics: AerodynamicPrior::default(),
            process_noise: ProcessNoise::default(),
        }
    }
}

/// Poses before there is a first flight, and the fewest that agree on one: two agree with the flight through
/// them whatever they are.
pub const FIRST_AFTER: usize = 3;
/// Newest poses at most that sampling looks at (paper, III-B).
pub(crate) const WINDOW: usize = 30;
/// Newest poses at most that the fit looks at: a second of them, since each adds information.
const FIT_WINDOW: usize = 100;

impl Config {
    /// Drag constant that is expected, in 1/m.
    fn drag_per_m(&self) -> f64 {
        self.drag_prior_per_m.unwrap_or_default()
    }

    /// Standard deviation of the expected drag constant, in 1/m.
    fn drag_sd_per_m(&self) -> f64 {
        self.drag_prior_sd_per_m.unwrap_or_default()
    }

    /// Largest drag constant that a flight may be found to have, in 1/m: what is expected is always possible.
    fn most_drag_per_m(&self) -> f64 {
        MOST_DRAG_PER_M.max(self.drag_per_m())
    }

    /// Standard deviation of the centre of mass.
    fn com_sd_m(&self) -> f64 {
        self.com_sd_m.unwrap_or_default()
    }
}

/// The newest poses, at which sampling looks, oldest first.
///
/// # Errors
/// Fewer than `first_after` poses.
pub fn sampled(poses: &[ObjectPose], first_after: usize) -> Result<&[ObjectPose], PredictionStatus> {
    if poses.len() < first_after { Err(PredictionStatus::TooFewPoses) } else { Ok(newest(poses, WINDOW)) }
}

/// The newest poses, so many at most.
pub(crate) fn newest(poses: &[ObjectPose], most: usize) -> &[ObjectPose] {
    &poses[poses.len().saturating_sub(most)..]
}

/// Reason for which there is no flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PredictionStatus {
    /// Fewer poses than a first flight needs.
    TooFewPoses,
    /// No flight that enough poses agree with.
    NoAgreement,
    /// The fit came to nothing.
    NotConverged,
}

/// Predicts the object's flight from its poses (paper, III-B).
pub trait FlightPredictor: Send {
    /// The flight that the poses seen so far agree on.
    ///
    /// `poses` are all poses of one thing in this throw in W, oldest first, outliers included; `previous` is
    /// its flight as predicted last, `None` before the first. The result holds at the time of the newest
    /// pose. Until it is known what flies to the arm, one tick asks about several things.
    ///
    /// # Errors
    /// Why there is no flight.
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        previous: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus>;

    /// Number of numerical failures in this throw; zero where the method does not count.
    fn numerical_failures(&self) -> u32 {
        0
    }

    /// Forgets all that it knows of the throw; the next one is another.
    fn reset(&mut self) {}
}

/// Sampling to start and to restart, then a robust fit to all poses that agree, weighted by their
/// information.
///
/// The previous flight is where the fit starts as long as the newest poses agree with it. Its forces and its
/// centre of mass correct what the fit expects; both are then found anew.
#[derive(Debug, Clone)]
pub struct InformationFit {
    config: Config,
    symmetry: Symmetry,
    seed: u64,
    /// Refinements that failed numerically in this throw.
    failures: u32,
    // Buffers. They carry nothing from one call to the next.
    fit: fit::Scratch,
    ransac: ransac::Scratch,
    about_com: Vec<ObjectPose>,
    rows: Vec<aerodynamics::Row>,
}

impl InformationFit {
    /// Creates the predictor for an object of some symmetry; poses are sampled at random by `seed`.
    pub fn new(config: Config, symmetry: Symmetry, seed: u64) -> Self {
        let (fit, ransac) = (fit::Scratch::default(), ransac::Scratch::default());
        Self { config, symmetry, seed, failures: 0, fit, ransac, about_com: Vec::new(), rows: Vec::new() }
    }

    /// The flight that fits poses which are seen from the centre of mass as the previous flight has it.
    fn fit_about_com(
        &mut self,
        poses: &[ObjectPose],
        previous: &FlightTrajectory,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let com_O = previous.com_O;
        let mut about_com = std::mem::take(&mut self.about_com);
        about_com.clear();
        about_com.reserve(FIT_WINDOW);
        about_com.extend(newest(poses, FIT_WINDOW).iter().map(|pose| {
            let mut X_WO = pose.X_WO;
            let to_com_W = X_WO.rotation * com_O;
            X_WO.translation.vector += to_com_W;
            // A turn about the centre of mass shifts O.
            let mut by_com = Matrix6::identity();
            by_com.fixed_view_mut::<3, 3>(3, 0).copy_from(&to_com_W.cross_matrix());
            ObjectPose { X_WO, information: by_com.transpose() * pose.information * by_com, ..*pose }
        }));
        let mut com_covariance = SMatrix::<f64, 9, 3>::zeros();
        com_covariance.fixed_rows_mut::<3>(6).fill_diagonal(self.config.com_sd_m().powi(2));
        let previous = FlightTrajectory { com_O: Vector3::zeros(), ..previous.clone() };
        let found = self.fit_flight(&about_com, Some(&previous));
        self.about_com = about_com;
        found.map(|flight| FlightTrajectory { com_O, com_covariance, ..flight })
    }

    /// The flight that fits without forces by which orientation and spin matter.
    fn fit_flight(
        &mut self,
        poses: &[ObjectPose],
        previous: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let Self { config, symmetry, seed, fit: fitting, ransac: sampling, .. } = self;
        let window = sampled(poses, FIRST_AFTER)?;
        let fitted = newest(poses, FIT_WINDOW);
        let enough =
            |inliers: usize| inliers >= FIRST_AFTER && inliers as f64 >= MIN_INLIER_FRACTION * window.len() as f64;
        let known = previous.and_then(|it| fit::fit(fitted, it, symmetry, config, fitting).ok());
        let known = known.filter(|(_, agreeing)| enough(*agreeing)).map(|(flight, _)| flight);
        // Sampling looks at the newest poses alone: it does not know better than a fit to all of them.
        let rests_on_all = fitted.len() >= WINDOW;
        if let Some(known) = &known
            && known.error_scale <= MAX_ERROR_SCALE
            && (rests_on_all || known.inliers as f64 >= GOOD_INLIER_FRACTION * known.considered as f64)
        {
            return Ok(known.clone());
        }
        // A fit that has gone astray stays so, however good the poses are by now.
        let anew = ransac::best_flight(window, symmetry, Sampling { seed: *seed, ..Sampling::OURS }, config, sampling)
            .and_then(|start| match enough(start.inliers) {
                true => fit::fit(fitted, &start, symmetry, config, fitting).map(|(flight, _)| flight),
                false => Err(PredictionStatus::NoAgreement),
            });
        let Some(known) = known else { return anew };
        let is_no_better = |anew: &FlightTrajectory| {
            anew.inliers <= known.inliers && anew.error_scale > MUCH_BETTER * known.error_scale
        };
        Ok(anew.ok().filter(|anew| !is_no_better(anew)).unwrap_or(known))
    }
}

impl FlightPredictor for InformationFit {
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        previous: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let mut flight = match previous.filter(|it| it.com_O != Vector3::zeros()) {
            None => self.fit_flight(poses, previous)?,
            Some(previous) => self.fit_about_com(poses, previous)?,
        };
        if self.config.aerodynamics.any() || self.config.com_sd_m() > 0.0 {
            let fitted = newest(poses, FIT_WINDOW);
            let refined = aerodynamics::refine(fitted, &mut flight, &self.symmetry, &self.config, &mut self.rows);
            self.failures += u32::from(refined.is_none());
        }
        Ok(flight)
    }

    fn numerical_failures(&self) -> u32 {
        self.failures
    }

    fn reset(&mut self) {
        self.failures = 0;
    }
}

/// Least drag constant that a fit may find, in 1/m. Air brakes: values below zero are noise.
const LEAST_DRAG_PER_M: f64 = -0.02;
const MOST_DRAG_PER_M: f64 = 1.0;
/// A fit is much better than another if its errors are less than this fraction.
const MUCH_BETTER: f64 = 0.8;
/// A flight that fewer than this fraction of the newest poses agree with is given up, and searched for anew.
pub const MIN_INLIER_FRACTION: f64 = 0.25;
/// A fit whose poses err by more than so many times what they say, or an early one that fewer than this
/// fraction of them agree with, is searched for anew as well, and the better one is taken.
const MAX_ERROR_SCALE: f64 = 2.0;
const GOOD_INLIER_FRACTION: f64 = 0.7;
