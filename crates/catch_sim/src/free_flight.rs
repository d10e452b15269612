//! The flight of an object that nothing touches, step by step.

use std::sync::Arc;

use catch_body::{Pose, Twist, dynamics::gravity};
use nalgebra::Vector3;

use crate::{
    conditions::Conditions,
    object::ThrownObject,
    physics::FlyingObject,
    throw::{RecordedFlight, Release},
};

/// Pose and spatial velocity of O in W from the release on, in even steps.
#[derive(Debug, Clone)]
pub struct FreeFlight {
    object: FlyingObject,
    conditions: Conditions,
    step_s: f64,
    steps: u32,
    path: Option<Arc<RecordedFlight>>,
}

impl FreeFlight {
    /// The flight of an object under the conditions of its throw.
    pub fn new(object: &ThrownObject, release: &Release, conditions: &Conditions, step_s: f64) -> Self {
        let (object, conditions) = (FlyingObject::released(object, release), conditions.clone());
        Self { object, conditions, step_s, steps: 0, path: release.path.clone() }
    }
}

impl Iterator for FreeFlight {
    type Item = (Pose, Twist);

    /// The state, which then goes on as in the arena.
    fn next(&mut self) -> Option<Self::Item> {
        let state = self.object.state();
        let (force_n, torque_nm) = air(&self.object, &self.conditions, self.step_s);
        self.object.fly(&gravity(), (&force_n, &torque_nm), self.step_s);
        self.steps += 1;
        if let Some(recorded) = self.path.as_ref().and_then(|it| it.at(f64::from(self.steps) * self.step_s)) {
            self.object.follow(&recorded);
        }
        Some(state)
    }
}

/// Pose and spatial velocity of O after `duration_s` without contact and air: the centre of mass follows its
/// parabola, and the body rotates about it by Euler's equations.
pub fn coasted(object: &ThrownObject, of_O: (&Pose, &Twist), duration_s: f64) -> (Pose, Twist) {
    let mut object = FlyingObject::new(object, of_O);
    object.fly(&gravity(), (&Vector3::zeros(), &Vector3::zeros()), duration_s);
    object.state()
}

/// Aerodynamic force on the object's centre of mass and torque on it in W, constant for a step, by the state
/// in the middle of it.
pub(crate) fn air(object: &FlyingObject, conditions: &Conditions, step_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let FlyingObject { body, X_WC, V_WC, .. } = object;
    let half_s = step_s / 2.0;
    let linear = V_WC.linear + (gravity() + conditions.air_mps2(&X_WC.rotation, V_WC)) * half_s;
    // L̇ = −c·L: the constant torque that has the same effect in the step.
    let decay = libm::expm1(-conditions.aerodynamics.spin_decay_per_s * step_s) / step_s;
    let torque_nm = body.momentum(&X_WC.rotation, &V_WC.angular) * decay;
    let (R_WC, angular) = body.rotated((&X_WC.rotation, &V_WC.angular), &torque_nm, half_s);
    (conditions.air_mps2(&R_WC, &Twist { angular, linear }) * body.mass_kg, torque_nm)
}
