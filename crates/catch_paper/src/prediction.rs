//! Trajectory prediction as in the paper (III-B): the best of the sampled flights through two poses, as it
//! is.

use catch_bot::{
    perception::{ObjectPose, Symmetry},
    trajectory_prediction::{
        Config, FlightPredictor, FlightTrajectory, PredictionStatus,
        ransac::{self, Rotation, SAMPLES, Sampling, TieBreak},
        sampled,
    },
};
use serde::{Deserialize, Serialize};

/// Poses before there is a first flight (original).
const FIRST_AFTER: usize = 6;

/// Settings of the paper's prediction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingConfig {
    /// True if among flights with equally many inliers the one with the least sum of distances and angles is
    /// taken (code), not the least mean squared distance (text).
    pub ties_by_sum: bool,
    /// True if rotations about an axis of symmetry are left out, as nobody can see them. The code takes the
    /// rotations that the registration finds for spin.
    pub knows_symmetry: bool,
}

impl Default for SamplingConfig {
    fn default() -> Self {
        Self { ties_by_sum: false, knows_symmetry: true }
    }
}

/// RANSAC alone.
#[derive(Debug, Clone)]
pub struct RansacPredictor {
    config: Config,
    symmetry: Symmetry,
    sampling: Sampling,
    scratch: ransac::Scratch,
}

impl RansacPredictor {
    /// Creates the predictor for an object of some symmetry; poses are sampled at random by `seed`, always
    /// [`SAMPLES`] pairs of them.
    pub fn new(config: Config, settings: SamplingConfig, symmetry: Symmetry, seed: u64) -> Self {
        let symmetry = if settings.knows_symmetry { symmetry } else { Symmetry::default() };
        let ties = if settings.ties_by_sum { TieBreak::Sum } else { TieBreak::MeanSquare };
        let sampling = Sampling { rotation: Rotation::Constant, ties, most: SAMPLES, seed };
        Self { config, symmetry, sampling, scratch: ransac::Scratch::default() }
    }
}

impl FlightPredictor for RansacPredictor {
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        _: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let window = sampled(poses, FIRST_AFTER)?;
        ransac::best_flight(window, &self.symmetry, self.sampling, &self.config, &mut self.scratch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix6, UnitQuaternion, Vector3};

    /// A flight on which the registration turns the object by 2 rad/s about its axis.
    #[test]
    fn turns_about_an_axis_of_symmetry_are_spin_to_who_does_not_know_it() {
        let axis = Vector3::y_axis();
        let flight = FlightTrajectory { v_WOcm: Vector3::new(-3.0, -4.0, 3.6), ..FlightTrajectory::default() };
        let poses: Vec<ObjectPose> = (0..12)
            .map(|i| {
                let time_s = 0.01 * f64::from(i);
                let mut X_WO = flight.pose_at(time_s);
                X_WO.rotation = UnitQuaternion::from_axis_angle(&axis, 2.0 * time_s);
                ObjectPose {
                    capture_s: time_s,
                    X_WO,
                    information: Matrix6::identity(),
                    points: 100,
                    residual_m: 0.001,
                    points_mismatch: None,
                    silhouette_mismatch: None,
                    iterations: 1,
                    registered_globally: false,
                }
            })
            .collect();
        let spin = |knows_symmetry: bool| {
            let symmetry = Symmetry::Axis { axis, reversible: false, axial_inertia: 1.0 };
            let sampling = SamplingConfig { knows_symmetry, ..SamplingConfig::default() };
            let mut predictor = RansacPredictor::new(Config::default(), sampling, symmetry, 1);
            assert_eq!(predictor.predict(&poses[..5], None), Err(PredictionStatus::TooFewPoses));
            assert!(predictor.predict(&poses[..6], None).is_ok());
            predictor.predict(&poses, None).unwrap().w_WO
        };
        assert!(spin(true).norm() < 1e-6 && (spin(false) - axis.scale(2.0)).norm() < 1e-6);
    }
}
