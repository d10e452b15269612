//! The points at which something touches the object, and how easily each gives way.

use nalgebra::{DVector, Vector3, Vector6};
use rapier3d_f64::prelude as engine;

use super::{
    PARTS, Part, World,
    convert::{from_vector, to_vector},
};

/// The engine marks contacts that bore no load in the step before in this bit of their index.
const NEW_CONTACT: u64 = 1 << 31;

/// A point at which the object was pushed in the last step.
pub(super) struct ContactPoint {
    /// What pushed.
    pub part: Part,
    /// The body it belongs to.
    pub link: Option<engine::RigidBodyHandle>,
    /// From there to the object, in W.
    pub normal: Vector3<f64>,
    /// From the object's centre of mass to the point, and from that of the link, in W.
    pub object_arm: Vector3<f64>,
    pub link_arm: Vector3<f64>,
    /// The engine's normal impulse.
    pub impulse_ns: f64,
    /// Whether it pushed for the first time.
    pub is_new: bool,
}

/// The effect of an impulse along the normal of a contact point.
pub(super) struct Response {
    /// Normal × lever arm about the object's centre of mass, and the change of the object's angular velocity
    /// by a unit impulse.
    pub turning: Vector3<f64>,
    pub spin_per_ns: Vector3<f64>,
    /// The same in the machine's generalized coordinates: velocity of the point along the normal per
    /// generalized velocity, and the change of that by a unit impulse.
    pub jacobian: DVector<f64>,
    pub velocity_per_ns: DVector<f64>,
    /// Change of the normal velocity by a unit impulse: one over the effective mass.
    pub mobility_per_kg: f64,
}

impl World {
    /// All points at which the object was pushed in the last step. A manifold may list a point twice, and the
    /// duplicate keeps an impulse that nothing felt; so they are found by what was solved.
    pub(super) fn contact_points(&self) -> Vec<ContactPoint> {
        let mut points = Vec::new();
        for &collider in self.bodies[self.object].colliders() {
            for pair in self.narrow_phase.contact_pairs_with(collider) {
                let is_first = pair.collider1 == collider;
                let other = &self.colliders[if is_first { pair.collider2 } else { pair.collider1 }];
                for manifold in pair.solver_manifolds() {
                    for contact in &manifold.data.solver_contacts {
                        let id = contact.contact_id[0];
                        let Some(point) = manifold.points.get((id & !NEW_CONTACT) as usize) else { continue };
                        if point.data.impulse <= 0.0 {
                            continue;
                        }
                        let (normal, [arm1, arm2]) =
                            (from_vector(manifold.data.normal), [point.data.solver_dp1, point.data.solver_dp2]);
                        let (normal, object_arm, link_arm) =
                            if is_first { (-normal, arm1, arm2) } else { (normal, arm2, arm1) };
                        points.push(ContactPoint {
                            part: PARTS[other.user_data as usize],
                            link: other.parent(),
                            normal,
                            object_arm: from_vector(object_arm),
                            link_arm: from_vector(link_arm),
                            impulse_ns: point.data.impulse,
                            is_new: id & NEW_CONTACT != 0,
                        });
                    }
                }
            }
        }
        points
    }

    /// How object and machine answer to an impulse at a point; `None` if the machine's inertia is singular.
    pub(super) fn response(&self, point: &ContactPoint) -> Option<Response> {
        let object = &self.bodies[self.object];
        let turning = point.object_arm.cross(&point.normal);
        let inverse_inertia = object.mass_properties().effective_world_inv_inertia;
        let spin_per_ns = from_vector(inverse_inertia * to_vector(&turning));
        let in_tree = point.link.and_then(|link| self.multibodies.rigid_body_link(link));
        let dofs = self.joints.len() + self.fingers.len();
        let (mut jacobian, mut velocity_per_ns) = (DVector::zeros(dofs), DVector::zeros(dofs));
        if let Some(id) = in_tree {
            let multibody = self.multibodies.get_multibody(id.multibody)?;
            let moment = point.link_arm.cross(&point.normal);
            let wrench = Vector6::from_iterator(point.normal.iter().chain(moment.iter()).copied());
            multibody.body_jacobian(id.id).tr_mul_to(&wrench, &mut jacobian);
            velocity_per_ns.copy_from(&jacobian);
            if !multibody.inv_augmented_mass().solve_mut(&mut velocity_per_ns) {
                return None;
            }
        }
        let mobility_per_kg = 1.0 / object.mass() + turning.dot(&spin_per_ns) + jacobian.dot(&velocity_per_ns);
        Some(Response { turning, spin_per_ns, jacobian, velocity_per_ns, mobility_per_kg })
    }
}
