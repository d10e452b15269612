//! A flight close to one instant.

use catch_body::{Pose, Twist, dynamics::gravity};
use nalgebra::{Point3, UnitQuaternion, Vector3};

/// The flight within about 0.1 s of an instant, as cheap to evaluate as a pose: constant acceleration and
/// constant angular velocity. Over 0.1 s, drag's change and tumbling displace the object by less than 0.3 mm
/// and turn it by less than 1° more.
#[derive(Debug, Clone, Copy)]
pub struct LocalFlight {
    /// The instant.
    pub time_s: f64,
    /// Pose then.
    pub X_WO: Pose,
    /// Spatial velocity then.
    pub V_WO: Twist,
    /// Centre of mass in O, as in [`FlightTrajectory`](super::FlightTrajectory).
    pub com_O: Vector3<f64>,
    /// Drag constant, as in [`FlightTrajectory`](super::FlightTrajectory).
    pub drag_per_m: f64,
    /// Acceleration then by other aerodynamic forces.
    pub forces_mps2: Vector3<f64>,
}

impl LocalFlight {
    /// Pose at `time_s`.
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let elapsed_s = time_s - self.time_s;
        let mut X_WO = self.X_WO;
        let to_com_W = X_WO.rotation * self.com_O;
        let v = self.V_WO.linear + self.V_WO.angular.cross(&to_com_W);
        let acceleration = gravity() - v * (self.drag_per_m * v.norm()) + self.forces_mps2;
        X_WO.translation.vector += v * elapsed_s + acceleration * (0.5 * elapsed_s * elapsed_s);
        X_WO.rotation = UnitQuaternion::from_scaled_axis(self.V_WO.angular * elapsed_s) * X_WO.rotation;
        X_WO.translation.vector += to_com_W - X_WO.rotation * self.com_O;
        X_WO
    }

    /// Velocity in G with which a point of the object passes a gripper that moves through `X_WG`.
    pub fn velocity_in(&self, X_WG: impl Fn(f64) -> Pose, p_O: &Point3<f64>) -> Vector3<f64> {
        const STEP_S: f64 = 1e-3;
        let place = |time_s: f64| X_WG(time_s).inverse() * (self.pose_at(time_s) * p_O);
        (place(self.time_s) - place(self.time_s - STEP_S)) / STEP_S
    }
}
