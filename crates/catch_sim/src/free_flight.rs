//! The flight of an object that nothing touches, step by step.

use std::sync::Arc;

use catch_body::{Pose, Twist, dynamics};
use nalgebra::Vector3;

use crate::{
    conditions::Conditions,
    object::ThrownObject,
    physics::{FreeBody, carried},
    throw::{RecordedFlight, Release},
};

/// Pose and spatial velocity of O in W from the release on, in even steps.
#[derive(Debug, Clone)]
pub struct FreeFlight {
    body: FreeBody,
    com_O: Vector3<f64>,
    conditions: Conditions,
    step_s: f64,
    steps: u32,
    path: Option<Arc<RecordedFlight>>,
    /// The frame C stands at the centre of mass, with the axes of O.
    X_WC: Pose,
    V_WC: Twist,
}

impl FreeFlight {
    /// The flight of an object under the conditions of its throw.
    pub fn new(object: &ThrownObject, release: &Release, conditions: &Conditions, step_s: f64) -> Self {
        let X_WO = Pose::from_parts(release.p_WO.coords.into(), release.q_WO);
        let V_WO = Twist { angular: release.omega_WO, linear: release.v_WO };
        let (X_WC, V_WC) = carried((&X_WO, &V_WO), &object.com_O.coords);
        Self {
            body: FreeBody::of(object),
            com_O: object.com_O.coords,
            conditions: conditions.clone(),
            step_s,
            steps: 0,
            path: release.path.clone(),
            X_WC,
            V_WC,
        }
    }
}

impl Iterator for FreeFlight {
    type Item = (Pose, Twist);

    /// The state, which then goes on by the midpoint rule.
    fn next(&mut self) -> Option<Self::Item> {
        let (X_WC, V_WC, step_s) = (self.X_WC, self.V_WC, self.step_s);
        let air = Air::in_step(&self.body, &self.conditions, (&X_WC, &V_WC), step_s);
        let p_WC = X_WC.translation.vector + air.v_WC * step_s;
        let linear = V_WC.linear + (dynamics::gravity() + air.acceleration_mps2) * step_s;
        let (R_WC, angular) = self.body.rotated((&X_WC.rotation, &V_WC.angular), &air.torque_nm, step_s);
        (self.X_WC, self.V_WC) = (Pose::from_parts(p_WC.into(), R_WC), Twist { angular, linear });
        self.steps += 1;
        if let Some(recorded) = self.path.as_ref().and_then(|it| it.at(f64::from(self.steps) * step_s)) {
            recorded.put((&mut self.X_WC, &mut self.V_WC));
        }
        Some(carried((&X_WC, &V_WC), &-self.com_O))
    }
}

/// Pose and spatial velocity of O after `duration_s` without contact and air: the centre of mass follows its
/// parabola, and the body rotates about it by Euler's equations.
pub fn coasted(object: &ThrownObject, (X_WO, V_WO): (&Pose, &Twist), duration_s: f64) -> (Pose, Twist) {
    let (com_O, nothing) = (object.com_O.coords, Vector3::zeros());
    let (X_WC, V_WC) = carried((X_WO, V_WO), &com_O);
    let gravity = dynamics::gravity();
    let (X_WC, V_WC) = FreeBody::of(object).advanced((&X_WC, &V_WC), &gravity, (&nothing, &nothing), duration_s);
    carried((&X_WC, &V_WC), &-com_O)
}

/// Aerodynamic acceleration and torque on an object during one time step, by its state in the middle of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Air {
    /// Velocity of the centre of mass in the middle of the step.
    v_WC: Vector3<f64>,
    /// Acceleration of the centre of mass.
    pub acceleration_mps2: Vector3<f64>,
    /// Torque in W.
    pub torque_nm: Vector3<f64>,
}

impl Air {
    /// Aerodynamic effects in the step after a state of the centre of mass.
    pub fn in_step(body: &FreeBody, conditions: &Conditions, (X_WC, V_WC): (&Pose, &Twist), step_s: f64) -> Self {
        let half_s = step_s / 2.0;
        let acceleration = dynamics::gravity() + conditions.air_mps2(&X_WC.rotation, V_WC);
        let linear = V_WC.linear + acceleration * half_s;
        // L̇ = −c·L: the constant torque that has the same effect in the step.
        let decay = libm::expm1(-conditions.aerodynamics.spin_decay_per_s * step_s) / step_s;
        let torque_nm = body.momentum(&X_WC.rotation, &V_WC.angular) * decay;
        let (R_WC, angular) = body.rotated((&X_WC.rotation, &V_WC.angular), &torque_nm, half_s);
        let acceleration_mps2 = conditions.air_mps2(&R_WC, &Twist { angular, linear });
        Self { v_WC: linear, acceleration_mps2, torque_nm }
    }
}
