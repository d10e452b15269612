//! Trajectory prediction (paper, III-B): the flight that the poses agree on.

use catch_body::{Pose, Twist};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Settings of trajectory prediction.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {}

/// A flight: the state at one instant and the law by which it goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightTrajectory {
    /// The instant of the state below.
    pub time_s: f64,
    /// Position of the centre of mass in W.
    pub p_WO: Point3<f64>,
    /// Its velocity.
    pub v_WO: Vector3<f64>,
    /// Attitude in W.
    pub R_WO: UnitQuaternion<f64>,
    /// Angular velocity in W, rad/s.
    pub w_WO: Vector3<f64>,
    /// Drag constant k in a = −k·|v|·v, in 1/m.
    pub drag_per_m: f64,
    /// Poses that agree with it.
    pub inliers: usize,
}

impl FlightTrajectory {
    /// Pose at `time_s`.
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let _ = time_s;
        Pose::identity()
    }

    /// Spatial velocity at `time_s`.
    pub fn twist_at(&self, time_s: f64) -> Twist {
        let _ = time_s;
        Twist::default()
    }

    /// Standard deviation of the position at `time_s`, the largest over all directions, in metres.
    pub fn position_sd_at(&self, time_s: f64) -> f64 {
        let _ = time_s;
        0.0
    }
}
