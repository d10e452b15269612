//! Aerodynamic forces on a flying object besides a drag that is the same from all sides.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Forces on an object per mass: f = −|v|·R·E·Rᵀ·v + (c_M·ω + s + R·s_O)×v, s and s_O being the Magnus
/// coefficient times the part of the spin that cannot be seen.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct AerodynamicForces {
    /// E in O, in 1/m.
    pub drag_deviation_O: Matrix3<f64>,
    /// Magnus coefficient c_M.
    #[serde(default)]
    pub magnus: f64,
    /// s in W, in rad/s.
    pub lift_W: Vector3<f64>,
    /// s_O in O, in rad/s.
    #[serde(default)]
    pub lift_O: Vector3<f64>,
}

impl AerodynamicForces {
    /// The acceleration f of an object with this orientation, velocity and angular velocity; of the spin that
    /// cannot be seen, `left` is the fraction that has not decayed.
    pub fn acceleration_mps2(
        &self,
        R_WO: &UnitQuaternion<f64>,
        v_WO: &Vector3<f64>,
        w_WO: &Vector3<f64>,
        left: f64,
    ) -> Vector3<f64> {
        let across = R_WO * (self.drag_deviation_O * R_WO.inverse_transform_vector(v_WO));
        let lift_W = w_WO * self.magnus + (self.lift_W + R_WO * self.lift_O) * left;
        lift_W.cross(v_WO) - across * v_WO.norm()
    }

    /// Returns whether there are any such forces.
    pub fn any(&self) -> bool {
        *self != Self::default()
    }
}
