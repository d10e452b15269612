//! The flight of an object that nothing touches, step by step.

use std::sync::Arc;

use catch_body::{Pose, Twist, dynamics};
use nalgebra::Vector3;

use crate::{
    conditions::Conditions,
    object::ThrownObject,
    physics::FreeBody,
    throw::{RecordedFlight, Release},
};

/// Pose and spatial velocity in W from the release on, in even steps.
#[derive(Debug, Clone)]
pub struct FreeFlight {
    body: FreeBody,
    conditions: Conditions,
    step_s: f64,
    steps: u32,
    path: Option<Arc<RecordedFlight>>,
    X_WO: Pose,
    V_WO: Twist,
}

impl FreeFlight {
    /// The flight of an object under the conditions of its throw.
    pub fn new(object: &ThrownObject, release: &Release, conditions: &Conditions, step_s: f64) -> Self {
        Self {
            body: FreeBody::of(object),
            conditions: conditions.clone(),
            step_s,
            steps: 0,
            path: release.path.clone(),
            X_WO: Pose::from_parts(release.p_WO.coords.into(), release.q_WO),
            V_WO: Twist { angular: release.omega_WO, linear: release.v_WO },
        }
    }
}

impl Iterator for FreeFlight {
    type Item = (Pose, Twist);

    /// The state, which then goes on by the midpoint rule.
    fn next(&mut self) -> Option<Self::Item> {
        let (X_WO, V_WO, step_s) = (self.X_WO, self.V_WO, self.step_s);
        let air = Air::in_step(&self.body, &self.conditions, (&X_WO, &V_WO), step_s);
        let p_WO = X_WO.translation.vector + air.v_WO * step_s;
        let linear = V_WO.linear + (dynamics::gravity() + air.acceleration_mps2) * step_s;
        let (R_WO, angular) = self.body.rotated((&X_WO.rotation, &V_WO.angular), &air.torque_nm, step_s);
        (self.X_WO, self.V_WO) = (Pose::from_parts(p_WO.into(), R_WO), Twist { angular, linear });
        self.steps += 1;
        if let Some(recorded) = self.path.as_ref().and_then(|it| it.at(f64::from(self.steps) * step_s)) {
            recorded.put((&mut self.X_WO, &mut self.V_WO));
        }
        Some((X_WO, V_WO))
    }
}

/// What the air does to an object during a step, by its state in the middle of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Air {
    /// Velocity in the middle of the step.
    v_WO: Vector3<f64>,
    /// Acceleration of the centre of mass.
    pub acceleration_mps2: Vector3<f64>,
    /// Torque in W.
    pub torque_nm: Vector3<f64>,
}

impl Air {
    /// In the step after a state.
    pub fn in_step(body: &FreeBody, conditions: &Conditions, (X_WO, V_WO): (&Pose, &Twist), step_s: f64) -> Self {
        let half_s = step_s / 2.0;
        let acceleration = dynamics::gravity() + conditions.air_mps2(&X_WO.rotation, V_WO);
        let linear = V_WO.linear + acceleration * half_s;
        // L̇ = −c·L: the constant torque that has the same effect in the step.
        let decay = (-conditions.aerodynamics.spin_decay_per_s * step_s).exp_m1() / step_s;
        let torque_nm = body.momentum(&X_WO.rotation, &V_WO.angular) * decay;
        let (R_WO, angular) = body.rotated((&X_WO.rotation, &V_WO.angular), &torque_nm, half_s);
        let acceleration_mps2 = conditions.air_mps2(&R_WO, &Twist { angular, linear });
        Self { v_WO: linear, acceleration_mps2, torque_nm }
    }
}
