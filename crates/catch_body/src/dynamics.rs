//! Inverse dynamics of a serial arm by the recursive Newton–Euler algorithm.

use nalgebra::Vector3;

use crate::robot::{JointVector, MAX_JOINTS, MassMatrix, Robot};

/// Acceleration of gravity in W, in m/s²: (0, 0, −9.81), as in the paper's simulator.
pub fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

impl Robot {
    /// Joint torques τ = M(q)·q̈ + C(q, q̇)·q̇ + g(q) + Iᵣ·q̈ + d·q̇ in N·m, rotors and damping included.
    ///
    /// Recursive Newton–Euler in world axes (Featherstone, Rigid Body Dynamics Algorithms, table 5.1; gravity
    /// enters as an upward acceleration of the base).
    pub fn inverse_dynamics(&self, q: &JointVector, dq: &JointVector, ddq: &JointVector) -> JointVector {
        let X_WL = self.link_poses(q);
        let mut omega = Vector3::zeros();
        let mut alpha = Vector3::zeros();
        let mut acceleration = -gravity();
        let mut origin = X_WL[0].translation.vector;
        let mut forces = [Vector3::zeros(); MAX_JOINTS];
        let mut moments = [Vector3::zeros(); MAX_JOINTS];
        let mut arms = [Vector3::zeros(); MAX_JOINTS];

        // Outward: velocities and accelerations of the links, and what it takes to accelerate each.
        for (i, joint) in self.joints.iter().enumerate() {
            let X_WLi = &X_WL[i + 1];
            let axis = X_WLi.rotation * joint.axis.into_inner();
            let offset = X_WLi.translation.vector - origin;
            acceleration += alpha.cross(&offset) + omega.cross(&omega.cross(&offset));
            origin = X_WLi.translation.vector;
            alpha += axis * ddq[i] + omega.cross(&axis) * dq[i];
            omega += axis * dq[i];

            let com = X_WLi.rotation * joint.inertia.com.coords;
            let R_WL = X_WLi.rotation.to_rotation_matrix();
            let about_com = R_WL.matrix() * joint.inertia.about_com * R_WL.matrix().transpose();
            let com_acceleration = acceleration + alpha.cross(&com) + omega.cross(&omega.cross(&com));
            forces[i] = com_acceleration * joint.inertia.mass;
            moments[i] = about_com * alpha + omega.cross(&(about_com * omega)) + com.cross(&forces[i]);
            arms[i] = offset;
        }

        // Inward: each joint carries its own link and everything beyond.
        let mut torque = JointVector::zeros();
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for (i, joint) in self.joints.iter().enumerate().rev() {
            let arm = arms.get(i + 1).copied().unwrap_or_default();
            moment += moments[i] + arm.cross(&force);
            force += forces[i];
            let axis = X_WL[i + 1].rotation * joint.axis.into_inner();
            torque[i] = axis.dot(&moment) + joint.rotor_inertia * ddq[i] + joint.damping * dq[i];
        }
        torque
    }

    /// Mass matrix M(q) in kg·m², rotors included, with ones for the joints that the arm has not: column i is
    /// the torque that accelerates joint i alone by 1 rad/s², without gravity.
    pub fn mass_matrix(&self, q: &JointVector) -> MassMatrix {
        let still = JointVector::zeros();
        let gravity = self.inverse_dynamics(q, &still, &still);
        let mut matrix = MassMatrix::identity();
        for i in 0..self.dof() {
            let torque = self.inverse_dynamics(q, &still, &JointVector::ith(i, 1.0));
            matrix.set_column(i, &(torque - gravity));
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::tests::iiwa;
    use proptest::prelude::*;

    proptest! {
        /// Against torques of any acceleration; a mass matrix is symmetric and positive definite.
        #[test]
        fn the_mass_matrix_is_that_of_inverse_dynamics(
            q in prop::array::uniform7(-2.5f64..2.5),
            ddq in prop::array::uniform7(-9.0f64..9.0),
        ) {
            let robot = iiwa();
            let [q, ddq] = [q, ddq].map(|it| robot.joint_vector(&it).unwrap());
            let matrix = robot.mass_matrix(&q);
            let still = JointVector::zeros();
            let needed = robot.inverse_dynamics(&q, &still, &ddq) - robot.inverse_dynamics(&q, &still, &still);
            prop_assert!((matrix * ddq - needed).amax() < 1e-9);
            prop_assert!((matrix - matrix.transpose()).amax() < 1e-9 && matrix.cholesky().is_some());
        }
    }
}
