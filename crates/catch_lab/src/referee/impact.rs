//! The impact of the object on the gripper, from the change of the object's momentum.

use catch_body::{JointVector, Robot, dynamics::gravity};
use catch_sim::{ThrownObject, Truth, TruthSample};
use nalgebra::{Vector3, Vector6};

/// From the first contact on: how long the object is taken to come to rest in the hand. An impact itself is over in one step.
const IMPACT_S: f64 = 0.02;

/// What the gripper and the arm felt of the object in the first 20 ms after the first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Impact {
    /// Magnitude of the impulse, in N·s. Fingers that squeeze cancel out.
    pub impulse_ns: f64,
    /// What it is at the joints, Jᵀ·(impulse and its moment), the largest of any joint, in N·m·s.
    pub joint_impulse_nms: f64,
}

/// Of the object that first touched the gripper at `contact_s`. The air is left out.
pub(super) fn impact(truth: &Truth, contact_s: f64, object: &ThrownObject, robot: &Robot) -> Impact {
    let (mut impulse, mut joint_impulse) = (Vector3::zeros(), JointVector::zeros());
    let momenta = |sample: &TruthSample| {
        let R_WO = sample.X_WO.rotation;
        let angular = R_WO * (object.inertia_kgm2 * (R_WO.inverse() * sample.V_WO.angular));
        (sample.V_WO.linear * object.mass_kg, angular)
    };
    let first = truth.samples.partition_point(|sample| sample.time_s < contact_s).max(1);
    let after = truth.samples.partition_point(|sample| sample.time_s < contact_s + IMPACT_S);
    for pair in truth.samples[first - 1..after].windows(2) {
        let (before, after) = (momenta(&pair[0]), momenta(&pair[1]));
        let weight = gravity() * (object.mass_kg * (pair[1].time_s - pair[0].time_s));
        // On the object; on the gripper the opposite.
        let (linear, angular) = (after.0 - before.0 - weight, after.1 - before.1);
        impulse += linear;
        let X_WL = robot.link_poses(&pair[1].q);
        let jacobian = robot.jacobian(&X_WL, &pair[1].X_WO.translation.vector.into());
        let wrench = Vector6::from_iterator(angular.iter().chain(linear.iter()).copied());
        joint_impulse -= jacobian.transpose() * wrench;
    }
    Impact { impulse_ns: impulse.norm(), joint_impulse_nms: joint_impulse.amax() }
}
