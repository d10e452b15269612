//! Newton's law of restitution where several parts of the machine meet the object at once.
//!
//! The engine applies restitution in one sweep over the contacts after a step. That is exact for one contact; of two fingers that
//! meet a ball together the second one undoes what the first was given, and both rebound too slowly. Here the sweeps go on
//! until all of them agree (Gauss–Seidel on the velocity at each point, impulses that only push).
//!
//! Only contacts that begin in the same step count. With one restitution for all of them no energy is gained; to ask a ball that
//! bounces off one finger to stay at the other, which it touches already, would make that finger recoil with energy from nowhere.

use catch_body::MAX_JOINTS;
use nalgebra::{DVector, Vector3, Vector6};
use rapier3d_f64::prelude as engine;

use super::{
    PARTS, Part, World,
    convert::{from_vector, to_vector},
    solved_points,
};
use crate::truth::Contact;

/// Most sweeps; a ball between two fingers needs some twenty.
const MOST_SWEEPS: usize = 200;
/// Velocities that differ by less are the same, in m/s.
const SAME_MPS: f64 = 1e-9;

/// Angular and linear velocities before a step: of the object, and of the links by joint, fingers last.
pub(super) struct VelocitiesBefore {
    object: [Vector3<f64>; 2],
    links: [[Vector3<f64>; 2]; MAX_JOINTS + 2],
}

/// One point at which the machine pushes the object.
struct Point {
    /// From the machine to the object.
    normal: Vector3<f64>,
    /// Normal × lever arm about the object's centre of mass, and what a unit impulse changes its angular velocity by.
    turning: Vector3<f64>,
    spin_per_ns: Vector3<f64>,
    /// The same in the machine's generalized coordinates: what a unit of their velocity does to the point's along the normal,
    /// and what a unit impulse does to them.
    jacobian: DVector<f64>,
    velocity_per_ns: DVector<f64>,
    /// Change of the normal velocity by a unit impulse.
    mobility: f64,
    /// Normal velocity at which the object should leave.
    wanted_mps: f64,
    /// Impulse so far.
    impulse_ns: f64,
    /// The part of the machine.
    part: Part,
}

fn velocities(body: &engine::RigidBody) -> [Vector3<f64>; 2] {
    [from_vector(body.angvel()), from_vector(body.linvel())]
}

impl World {
    /// To be called before a step.
    pub(super) fn velocities_before(&self) -> VelocitiesBefore {
        let mut links = [[Vector3::zeros(); 2]; MAX_JOINTS + 2];
        for (link, axis) in links.iter_mut().zip(self.joints.iter().chain(&self.fingers)) {
            *link = velocities(&self.bodies[axis.child]);
        }
        VelocitiesBefore { object: velocities(&self.bodies[self.object]), links }
    }

    /// Makes the velocities after a step those of Newton's law, if several parts have begun to touch the object in it; `touched` is
    /// what did before.
    pub(super) fn let_rebound(&mut self, before: &VelocitiesBefore, touched: &Contact) {
        let touches = &self.contact_forces.contact;
        let has_begun = |part: &Part| touches.has(*part) && !touched.has(*part);
        if PARTS.iter().filter(|part| has_begun(part)).count() < 2 {
            return;
        }
        let mut points = self.new_points(before, touched);
        let object = &self.bodies[self.object];
        let inverse_mass = 1.0 / object.mass();
        let [mut angular, mut linear] = velocities(object);
        let link = self.multibodies.rigid_body_link(self.fingers[0].child).expect("fingers are part of the tree");
        let multibody = self.multibodies.get_multibody_mut(link.multibody).expect("the tree exists");
        let mut generalized = multibody.generalized_velocity().into_owned();
        for _ in 0..MOST_SWEEPS {
            let mut largest = 0.0f64;
            for point in &mut points {
                let velocity =
                    point.normal.dot(&linear) + point.turning.dot(&angular) - point.jacobian.dot(&generalized);
                let lacking = point.wanted_mps - velocity;
                let impulse_ns = (point.impulse_ns + lacking / point.mobility).max(0.0);
                let change = impulse_ns - point.impulse_ns;
                point.impulse_ns = impulse_ns;
                linear += point.normal * (change * inverse_mass);
                angular += point.spin_per_ns * change;
                generalized.axpy(-change, &point.velocity_per_ns, 1.0);
                largest = largest.max((change * point.mobility).abs());
            }
            if largest < SAME_MPS {
                break;
            }
        }
        multibody.generalized_velocity_mut().copy_from(&generalized);
        for part in PARTS {
            let of_part = points.iter().filter(|point| point.part == part).map(|point| point.impulse_ns);
            let peak = &mut self.contact_forces.contact.peak_impulse_ns;
            *peak = peak.max(of_part.sum());
        }
        let object = &mut self.bodies[self.object];
        object.set_linvel(to_vector(&linear), true);
        object.set_angvel(to_vector(&angular), true);
    }

    /// The points of parts that have begun to touch the object in the last step and pushed it.
    fn new_points(&self, before: &VelocitiesBefore, touched: &Contact) -> Vec<Point> {
        let mut points = Vec::new();
        for &collider in self.bodies[self.object].colliders() {
            for pair in self.narrow_phase.contact_pairs_with(collider) {
                let is_first = pair.collider1 == collider;
                let other = &self.colliders[if is_first { pair.collider2 } else { pair.collider1 }];
                let part = PARTS[other.user_data as usize];
                if touched.has(part) {
                    continue;
                }
                for (manifold, point) in solved_points(pair).filter(|(_, point)| point.data.impulse > 0.0) {
                    let (normal, arms) = (manifold.data.normal, [point.data.solver_dp1, point.data.solver_dp2]);
                    let ([object_arm, link_arm], normal) =
                        if is_first { (arms, -normal) } else { ([arms[1], arms[0]], normal) };
                    let arms = [object_arm, link_arm].map(from_vector);
                    let by_engine = (part, point.data.impulse);
                    points.extend(self.point(before, other.parent(), from_vector(normal), arms, by_engine));
                }
            }
        }
        points
    }

    /// A point where `link` pushes the object along `normal`, at these lever arms from the object's and the link's centres of mass;
    /// `None` if they were not approaching each other there.
    fn point(
        &self,
        before: &VelocitiesBefore,
        link: Option<engine::RigidBodyHandle>,
        normal: Vector3<f64>,
        [object_arm, link_arm]: [Vector3<f64>; 2],
        (part, impulse_ns): (Part, f64),
    ) -> Option<Point> {
        let object = &self.bodies[self.object];
        let turning = object_arm.cross(&normal);
        let inverse_inertia = object.mass_properties().effective_world_inv_inertia;
        let spin_per_ns = from_vector(inverse_inertia * to_vector(&turning));
        let in_tree = link.and_then(|link| self.multibodies.rigid_body_link(link));
        let dofs = self.joints.len() + self.fingers.len();
        let (mut jacobian, mut velocity_per_ns) = (DVector::zeros(dofs), DVector::zeros(dofs));
        if let Some(id) = in_tree {
            let multibody = self.multibodies.get_multibody(id.multibody)?;
            let moment = link_arm.cross(&normal);
            let wrench = Vector6::from_iterator(normal.iter().chain(moment.iter()).copied());
            multibody.body_jacobian(id.id).tr_mul_to(&wrench, &mut jacobian);
            velocity_per_ns.copy_from(&jacobian);
            if !multibody.inv_augmented_mass().solve_mut(&mut velocity_per_ns) {
                return None;
            }
        }
        let mobility = 1.0 / object.mass() + turning.dot(&spin_per_ns) + jacobian.dot(&velocity_per_ns);
        let at = |[angular, linear]: &[Vector3<f64>; 2], arm: &Vector3<f64>| linear + angular.cross(arm);
        let joint = self.joints.iter().chain(&self.fingers).position(|axis| Some(axis.child) == link);
        let link_mps = joint.map_or(Vector3::zeros(), |joint| at(&before.links[joint], &link_arm));
        let approach_mps = normal.dot(&(at(&before.object, &object_arm) - link_mps));
        let wanted_mps = -self.settings.restitution * approach_mps;
        (wanted_mps > 0.0).then_some(Point {
            normal,
            turning,
            spin_per_ns,
            jacobian,
            velocity_per_ns,
            mobility,
            wanted_mps,
            impulse_ns,
            part,
        })
    }
}
