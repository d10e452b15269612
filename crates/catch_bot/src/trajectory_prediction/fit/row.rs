//! Residuals of a flight at each of the poses.

use nalgebra::{Matrix3, Matrix3x4, SMatrix, Vector3};

use super::{
    super::{ProcessNoise, process_noise::lost_square},
    state::{ROTATION, TURN},
};

/// Residual of the flight at one pose: the error, and the dependence of the flight's pose there on its
/// parameters.
#[derive(Debug, Clone, Copy, Default)]
pub struct Row {
    /// Age of this pose before the newest one, in seconds.
    pub age_s: f64,
    /// Position of the pose.
    pub p_W: Vector3<f64>,
    /// Turn and shift from the flight to the pose.
    pub turn: Vector3<f64>,
    pub shift: Vector3<f64>,
    /// ∂turn/∂(θ, ω, c), and ∂shift/∂(v, k); ∂shift/∂p is the identity.
    pub by_rotation: SMatrix<f64, 3, ROTATION>,
    pub by_motion: Matrix3x4<f64>,
    /// The pose's information by turns, turns and shifts, and shifts.
    pub turns: Matrix3<f64>,
    pub mixed: Matrix3<f64>,
    pub shifts: Matrix3<f64>,
    /// eᵀ·W·e, W less the noise of the process since then.
    pub square: f64,
}

impl Row {
    /// Notes eᵀ·W·e.
    pub fn weigh(&mut self, turns: bool, noise: &ProcessNoise) {
        self.square = self.shift.dot(&(self.shifts * self.shift));
        if turns {
            self.square += self.turn.dot(&(self.turns * self.turn + self.mixed * (self.shift * 2.0)));
        }
        if noise.any() && self.age_s > 0.0 {
            self.square -= lost_square(&self.shifts, &self.shift, noise.acceleration, self.age_s);
            if turns {
                self.square -= lost_square(&self.turns, &self.turn, noise.angular_acceleration, self.age_s);
            }
        }
        self.square = self.square.max(0.0);
    }

    /// The error in standard deviations scaled by `scale`, per degree of freedom.
    pub fn in_sd(&self, freedom: f64, scale: f64) -> f64 {
        (self.square / freedom).sqrt() / scale
    }

    /// The first rows of Jᵀ·W for an error of the pose's position: all, or those of position, velocity and
    /// drag.
    pub fn by_position<const M: usize>(&self) -> SMatrix<f64, M, 3> {
        let mut by = SMatrix::<f64, M, 3>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.shifts);
        for (i, shifts) in self.shifts.column_iter().enumerate() {
            (0..4).for_each(|j| by[(3 + j, i)] = self.by_motion.column(j).dot(&shifts));
        }
        for (i, mixed) in self.mixed.column_iter().enumerate().filter(|_| M > TURN) {
            (0..ROTATION).for_each(|j| by[(TURN + j, i)] = self.by_rotation.column(j).dot(&mixed));
        }
        by
    }
}
