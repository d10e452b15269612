//! Flights for other people's tracks: positions or poses with times, from whatever tracker, in whatever axes.

use catch_body::Pose;
use catch_bot::{
    perception::{ObjectPose, Symmetry},
    trajectory_prediction::{Config, FlightPredictor, FlightTrajectory, InformationFit, PredictionStatus},
};
use nalgebra::{Matrix3, Matrix6, Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// One sample of a track, in the track's own axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackSample {
    /// When, in seconds.
    pub time_s: f64,
    /// Where, in metres.
    pub position: Point3<f64>,
    /// Orientation, where the track has one.
    pub orientation: Option<UnitQuaternion<f64>>,
    /// Standard deviation of each coordinate of the position, in metres.
    pub position_sd_m: f64,
    /// Standard deviation of the orientation about each axis, in radians.
    pub orientation_sd_rad: f64,
}

/// The flight that fits a track, in the track's own axes.
///
/// ```
/// use catch_bot::trajectory_prediction::Config;
/// use catch_lab::flights::track::{Track, TrackSample};
/// use nalgebra::{Point3, Vector3};
///
/// // A ball thrown at 3 m/s along x and 4 m/s upwards, where up is y.
/// let samples = (0..20).map(|i| {
///     let t = 0.01 * f64::from(i);
///     let position = Point3::new(3.0 * t, 4.0 * t - 0.5 * 9.81 * t * t, 0.0);
///     TrackSample { time_s: t, position, orientation: None, position_sd_m: 0.001, orientation_sd_rad: 1.0 }
/// });
/// let samples: Vec<_> = samples.collect();
/// let track = Track::fit(&samples, &Vector3::y_axis(), &Config::default(), 0).unwrap();
/// assert!((track.position_at(0.5) - Point3::new(1.5, 2.0 - 0.5 * 9.81 * 0.25, 0.0)).norm() < 1e-3);
/// assert!(track.covariance_at(0.5).diagonal().min() > 0.0);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The flight in axes whose z points up.
    pub flight: FlightTrajectory,
    /// Orientation of the track's axes T in those.
    R_WT: UnitQuaternion<f64>,
}

impl Track {
    /// Fits a flight to samples in the order of time. Samples with numbers that are none are passed over.
    ///
    /// `up` is the direction in the track's axes against which gravity pulls.
    ///
    /// # Errors
    /// Too few samples, or none that agree on a flight.
    pub fn fit(
        samples: &[TrackSample],
        up: &Unit<Vector3<f64>>,
        config: &Config,
        seed: u64,
    ) -> Result<Self, PredictionStatus> {
        let across = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let R_WT = UnitQuaternion::rotation_between_axis(up, &Vector3::z_axis()).unwrap_or(across);
        let poses: Vec<ObjectPose> = samples.iter().map(|sample| sample.pose(&R_WT)).filter(is_finite).collect();
        let has_orientation = samples.iter().any(|sample| sample.orientation.is_some());
        // Nothing is known of how the object's mass lies: it is taken to turn at a constant rate, like a ball's.
        let symmetry = if has_orientation { Symmetry::default() } else { Symmetry::Sphere };
        let flight = InformationFit::new(config.clone(), symmetry, seed).predict(&poses, None)?;
        Ok(Self { flight, R_WT })
    }

    /// Position at a time, in metres.
    pub fn position_at(&self, time_s: f64) -> Point3<f64> {
        self.R_WT.inverse() * Point3::from(self.flight.pose_at(time_s).translation.vector)
    }

    /// Velocity at a time, in m/s.
    pub fn velocity_at(&self, time_s: f64) -> Vector3<f64> {
        self.R_WT.inverse() * self.flight.twist_at(time_s).linear
    }

    /// Covariance of (position, velocity) at a time, in m² and m²/s².
    pub fn covariance_at(&self, time_s: f64) -> Matrix6<f64> {
        let R_TW: Matrix3<f64> = *self.R_WT.inverse().to_rotation_matrix().matrix();
        let mut both = Matrix6::zeros();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(&R_TW);
        both.fixed_view_mut::<3, 3>(3, 3).copy_from(&R_TW);
        both * self.flight.covariance_at(time_s) * both.transpose()
    }

    /// Drag constant k in a = −k·|v|·v that was found, in 1/m.
    pub fn drag_per_m(&self) -> f64 {
        self.flight.drag_per_m
    }
}

impl TrackSample {
    fn pose(&self, R_WT: &UnitQuaternion<f64>) -> ObjectPose {
        let shift = self.position_sd_m.max(1e-9).powi(-2);
        let turn = if self.orientation.is_some() { self.orientation_sd_rad.max(1e-9).powi(-2) } else { 0.0 };
        let rotation = R_WT * self.orientation.unwrap_or_default();
        ObjectPose {
            capture_s: self.time_s,
            X_WO: Pose::from_parts((R_WT * self.position).coords.into(), rotation),
            information: Matrix6::from_diagonal(&nalgebra::Vector6::new(turn, turn, turn, shift, shift, shift)),
            points: 0,
            residual_m: 0.0,
            points_mismatch: None,
            silhouette_mismatch: None,
            iterations: 0,
            registered_globally: false,
        }
    }
}

fn is_finite(pose: &ObjectPose) -> bool {
    let values = pose.X_WO.to_homogeneous();
    pose.capture_s.is_finite() && values.iter().chain(pose.information.iter()).all(|value| value.is_finite())
}
