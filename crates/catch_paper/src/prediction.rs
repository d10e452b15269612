//! Trajectory prediction as in the paper (III-B): the best of the sampled flights through two poses, as it is.

use catch_bot::{
    perception::{ObjectPose, Symmetry},
    trajectory_prediction::{
        Config, FlightPredictor, FlightTrajectory, PredictionStatus,
        ransac::{self, Rotation, TieBreak},
    },
};
use serde::{Deserialize, Serialize};

/// Settings of the paper's prediction.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingConfig {
    /// Whether of flights with as many inliers that is taken from which the sum of distances and angles is the least (code), not
    /// the mean squared distance (text).
    pub ties_by_sum: bool,
}

/// RANSAC alone.
#[derive(Debug, Clone)]
pub struct RansacPredictor {
    config: Config,
    symmetry: Symmetry,
    ties: TieBreak,
    seed: u64,
    scratch: ransac::Scratch,
}

impl RansacPredictor {
    /// For an object of some symmetry; poses are sampled at random by `seed`, always as many as [`Config::samples`] says.
    pub fn new(mut config: Config, sampling: &SamplingConfig, symmetry: Symmetry, seed: u64) -> Self {
        config.max_samples = config.samples;
        let ties = if sampling.ties_by_sum { TieBreak::Sum } else { TieBreak::MeanSquare };
        Self { config, symmetry, ties, seed, scratch: ransac::Scratch::default() }
    }
}

impl FlightPredictor for RansacPredictor {
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        _: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let window = self.config.sampled(poses).ok_or(PredictionStatus::TooFewPoses)?;
        let method = (Rotation::Constant, self.ties);
        ransac::best_flight(window, &self.symmetry, method, &self.config, self.seed, &mut self.scratch)
    }
}
