//! Aerodynamic forces that depend on how an object is oriented and spins.
//!
//! With the velocity u relative to the air, the drag constant k of the throw and R = R_WO:
//!
//! a = −k·|u|·(u + R·E·Rᵀ·u) + c_M·ω×u, ω̇ = J⁻¹·(J·ω×ω) − c·ω
//!
//! E is symmetric and fixed to the object: the drag matrix is k·(1 + E), which also makes lift. c_M is the Magnus coefficient and c the
//! decay of the spin. No other torque of the air is modelled.

use catch_body::quantity;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::random_streams::Draws;

/// Ranges of the aerodynamic forces of a throw. All zero by default: the air brakes an object alike from all sides, if at all.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AerodynamicsConfig {
    /// Every throw draws the drag along each of three axes of the object uniformly within this fraction around the throw's drag
    /// constant; the axes are orthogonal and in any orientation. It counts where there is drag.
    #[serde(deserialize_with = "quantity::spread")]
    pub drag_anisotropy: f64,
    /// Every throw draws its Magnus coefficient c_M of a = c_M·ω×v uniformly up to this.
    #[serde(deserialize_with = "quantity::magnus")]
    pub max_magnus: f64,
    /// Every throw draws the decay c of its spin, ω̇ = −c·ω, uniformly up to this, in 1/s.
    #[serde(deserialize_with = "quantity::decay_per_s")]
    pub max_spin_decay_per_s: f64,
}

/// The aerodynamic coefficients of one throw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aerodynamics {
    /// Deviation E of the drag matrix k·(1 + E), in O.
    pub drag_deviation_O: Matrix3<f64>,
    /// Magnus coefficient c_M.
    pub magnus: f64,
    /// Decay of the spin in 1/s.
    pub spin_decay_per_s: f64,
}

impl Aerodynamics {
    /// Drag that is the same from all sides, and nothing else.
    pub const NONE: Self = Self {
        drag_deviation_O: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        magnus: 0.0,
        spin_decay_per_s: 0.0,
    };

    /// Those of a throw.
    pub(crate) fn draw(config: &AerodynamicsConfig, draws: &mut Draws) -> Self {
        let principal = Vector3::from_fn(|_, _| draws.between([-1.0, 1.0])) * config.drag_anisotropy;
        let axes = draws.orientation().to_rotation_matrix().into_inner();
        Self {
            drag_deviation_O: axes * Matrix3::from_diagonal(&principal) * axes.transpose(),
            magnus: config.max_magnus * draws.unit(),
            spin_decay_per_s: config.max_spin_decay_per_s * draws.unit(),
        }
    }

    /// What the acceleration is besides a = −k·|u|·u, in m/s². `u_W` is the velocity relative to the air.
    pub(crate) fn deviation_mps2(
        &self,
        drag_per_m: f64,
        R_WO: &UnitQuaternion<f64>,
        w_WO: &Vector3<f64>,
        u_W: &Vector3<f64>,
    ) -> Vector3<f64> {
        let across = R_WO * (self.drag_deviation_O * R_WO.inverse_transform_vector(u_W));
        w_WO.cross(u_W) * self.magnus - across * (drag_per_m * u_W.norm())
    }
}
