//! Joint encoders, and the observer behind them by which a robot controller knows positions and velocities.
//!
//! An encoder tells positions only, in whole steps and with noise, and what it tells is one control cycle old
//! when the controller has it. A Luenberger observer of a double integrator per joint (in its form as
//! prediction estimator: Franklin, Powell & Workman, Digital Control of Dynamic Systems, section 8.2)
//! estimates position and velocity of now from it and from the acceleration u that the controller asked for:
//!
//! x̂ₖ₊₁ = A·x̂ₖ + B·uₖ + L·(yₖ − C·x̂ₖ),  A = (1 h; 0 1),  B = (h²/2; h),  C = (1 0)

use catch_body::{JointVector, quantity};

use crate::{config::RobotErrors, random_streams::Draws};

/// Bandwidth of the observer in rad/s: both poles at e^(−ωh). Six times that of the default loop, within the
/// five to ten times of the textbooks.
const OBSERVER_RADPS: f64 = 300.0;

/// Joint states as a robot controller measures them.
#[derive(Debug, Clone)]
pub struct Encoders {
    sd_rad: f64,
    step_rad: f64,
    joints: usize,
    draws: Draws,
    q: JointVector,
    dq: JointVector,
}

impl Encoders {
    /// Encoders of an arm that waits at `q`; noise comes from `draws`.
    pub fn new(errors: &RobotErrors, joints: usize, q: &JointVector, draws: Draws) -> Self {
        let RobotErrors { encoder_sd_rad: sd_rad, encoder_step_rad: step_rad, .. } = *errors;
        Self { sd_rad, step_rad, joints, draws, q: *q, dq: JointVector::zeros() }
    }

    /// Positions and velocities of now as the controller knows them.
    pub fn sensed(&self) -> (JointVector, JointVector) {
        (self.q, self.dq)
    }

    /// A cycle passes: the joints were truly at `began` when it began and have position and velocity `ended`
    /// at its end, and the controller asked for the acceleration `asked_radps2` during it. What is sensed
    /// from now on is of its end; ideal encoders know it.
    pub fn pass_cycle(
        &mut self,
        began: &JointVector,
        ended: (&JointVector, &JointVector),
        asked_radps2: &JointVector,
        cycle_s: f64,
    ) {
        if self.sd_rad == 0.0 && self.step_rad == 0.0 {
            (self.q, self.dq) = (*ended.0, *ended.1);
            return;
        }
        let pole = libm::exp(-OBSERVER_RADPS * cycle_s);
        // det(λ − A + L·C) = (λ − pole)².
        let (of_position, of_velocity) = (2.0 * (1.0 - pole), (1.0 - pole).powi(2) / cycle_s);
        for i in 0..self.joints {
            let noisy = began[i] + self.sd_rad * self.draws.normal();
            let read = if self.step_rad > 0.0 { (noisy / self.step_rad).round() * self.step_rad } else { noisy };
            let innovation = read - self.q[i];
            self.q[i] += self.dq[i] * cycle_s + asked_radps2[i] * (cycle_s * cycle_s / 2.0) + of_position * innovation;
            self.dq[i] += asked_radps2[i] * cycle_s + of_velocity * innovation;
            // The range of what an encoder tells.
            self.q[i] = self.q[i].clamp(quantity::JOINT_RAD.least, quantity::JOINT_RAD.most);
            self.dq[i] = self.dq[i].clamp(quantity::JOINT_RADPS.least, quantity::JOINT_RADPS.most);
        }
    }
}
