//! Trajectory prediction as in the paper (III-B): the best of the sampled flights through two poses, as it is.

use catch_bot::{
    perception::{ObjectPose, Symmetry},
    trajectory_prediction::{
        Config, FlightPredictor, FlightTrajectory, PredictionStatus,
        ransac::{self, Rotation},
    },
};

/// RANSAC alone.
#[derive(Debug, Clone)]
pub struct RansacPredictor {
    config: Config,
    symmetry: Symmetry,
    seed: u64,
    scratch: ransac::Scratch,
}

impl RansacPredictor {
    /// For an object of some symmetry; poses are sampled at random by `seed`, always as many as [`Config::samples`] says.
    pub fn new(mut config: Config, symmetry: Symmetry, seed: u64) -> Self {
        config.max_samples = config.samples;
        Self { config, symmetry, seed, scratch: ransac::Scratch::default() }
    }
}

impl FlightPredictor for RansacPredictor {
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        _: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let window = self.config.sampled(poses).ok_or(PredictionStatus::TooFewPoses)?;
        ransac::best_flight(window, &self.symmetry, Rotation::Constant, &self.config, self.seed, &mut self.scratch)
    }
}
