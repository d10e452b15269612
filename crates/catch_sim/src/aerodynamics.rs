//! Aerodynamic forces that depend on how an object is oriented and spins.
//!
//! With the velocity u relative to the air, the drag constant k of the throw and R = R_WO:
//!
//! a = −k·|u|·(u + R·E·Rᵀ·u) + c_M·ω×u, ω̇ = J⁻¹·(J·ω×ω) − c·ω
//!
//! E is symmetric and fixed to the object: the drag matrix is k·(1 + E), which also makes lift. c_M is the
//! Magnus coefficient and c the decay of the spin. No other torque of the air is modelled.

use std::f64::consts::TAU;

use catch_body::quantity;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use serde::{Deserialize, Serialize};

use crate::random_streams::Draws;

/// Moments of inertia that differ by less than this fraction are those of an object that the air brakes alike
/// along both axes.
const ALIKE: f64 = 0.01;

/// A matrix without trace along the principal axes of inertia, with size·cos φ, size·cos(φ + 120°) and
/// size·cos(φ + 240°) on its diagonal; of those along axes of equal moments, the mean.
fn deviation(inertia_kgm2: &Matrix3<f64>, size: f64, phase: f64) -> Matrix3<f64> {
    let SymmetricEigen { eigenvalues, eigenvectors } = inertia_kgm2.symmetric_eigen();
    let each = Vector3::from_fn(|i, _| size * libm::cos(phase + TAU / 3.0 * i as f64));
    let alike = |i: usize, j: usize| (eigenvalues[i] - eigenvalues[j]).abs() <= ALIKE * eigenvalues.max();
    let shared = Vector3::from_fn(|i, _| {
        let with: Vec<usize> = (0..3).filter(|&j| alike(i, j)).collect();
        with.iter().map(|&j| each[j]).sum::<f64>() / with.len() as f64
    });
    eigenvectors * Matrix3::from_diagonal(&shared) * eigenvectors.transpose()
}

/// Ranges of the aerodynamic forces of a throw. All zero by default: the air brakes an object alike from all
/// sides, if at all.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct AerodynamicsConfig {
    /// Largest relative deviation of an object's drag along one of its principal axes of inertia from the
    /// mean of the three. Every throw draws the largest deviation uniformly up to this, and how it is
    /// divided; axes of equal moments of inertia have equal drag, so none deviates in a ball. It takes effect
    /// only with drag.
    pub drag_anisotropy: quantity::spread,
    /// Every throw draws its Magnus coefficient c_M of a = c_M·ω×v uniformly up to this.
    pub max_magnus: quantity::magnus,
    /// Every throw draws the decay c of its spin, ω̇ = −c·ω, uniformly up to this, in 1/s.
    pub max_spin_decay_per_s: quantity::decay_per_s,
}

/// The aerodynamic coefficients of one throw.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Aerodynamics {
    /// Deviation E of the drag matrix k·(1 + E), in O.
    pub drag_deviation_O: Matrix3<f64>,
    /// Magnus coefficient c_M.
    pub magnus: f64,
    /// Decay of the spin in 1/s.
    pub spin_decay_per_s: f64,
}

impl Aerodynamics {
    /// Draws the aerodynamics of a throw of an object with this inertia about its centre of mass, in O.
    pub(crate) fn draw(config: &AerodynamicsConfig, inertia_kgm2: &Matrix3<f64>, draws: &mut Draws) -> Self {
        let size = config.drag_anisotropy * draws.unit();
        let phase = TAU * draws.unit();
        Self {
            drag_deviation_O: deviation(inertia_kgm2, size, phase),
            magnus: config.max_magnus * draws.unit(),
            spin_decay_per_s: config.max_spin_decay_per_s * draws.unit(),
        }
    }
}
