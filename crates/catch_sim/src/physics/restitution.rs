//! Newton's law of restitution.
//!
//! The engine lets contacts end without rebound. It can make them rebound, but by one sweep over the contacts
//! after a step: of two points that meet in the same step the second one undoes part of what the first was
//! given, or adds to it. Two fingers that meet a ball then rebound too slowly, and a bottle thrown at
//! the hand gains up to 15 % of energy. Here the sweeps go on until all points agree (Gauss–Seidel on
//! the normal velocities, impulses that only push).
//!
//! Only points that begin to push in the same step count. With one restitution for all of them no energy is
//! gained; to ask a ball that bounces off one finger to stay at the other, which it touches already, would
//! make that finger recoil with energy from nowhere.

use catch_body::MAX_JOINTS;
use nalgebra::Vector3;

use super::{
    PARTS, World,
    contact_points::{ContactPoint, Response},
    convert::to_vector,
    velocities,
};

/// Most sweeps; a ball between two fingers needs some twenty.
const MOST_SWEEPS: usize = 200;
/// Velocities that differ by less are the same, in m/s.
const SAME_MPS: f64 = 1e-9;

/// Angular and linear velocities before a step: of the object, and of the links by joint, fingers last.
pub(super) struct VelocitiesBefore {
    object: [Vector3<f64>; 2],
    links: [[Vector3<f64>; 2]; MAX_JOINTS + 2],
}

/// A point at which the object rebounds.
struct Rebound {
    point: ContactPoint,
    response: Response,
    /// Normal velocity at which the object should leave.
    wanted_mps: f64,
    /// Impulse so far.
    impulse_ns: f64,
}

impl World {
    /// To be called before a step.
    pub(super) fn velocities_before(&self) -> VelocitiesBefore {
        let links = self.link_velocities();
        VelocitiesBefore { object: velocities(&self.bodies[self.object]), links }
    }

    /// Makes the velocities after a step those of Newton's law at all points that have begun to push in it.
    /// Returns the impulse that this adds for each part.
    pub(super) fn let_rebound(&mut self, before: &VelocitiesBefore) -> [f64; PARTS.len()] {
        let new = self.contact_points().into_iter().filter(|point| point.is_new);
        let mut rebounds: Vec<Rebound> = new.filter_map(|point| self.rebound(before, point)).collect();
        let mut added_ns = [0.0; PARTS.len()];
        if rebounds.is_empty() {
            return added_ns;
        }
        let object = &self.bodies[self.object];
        let inverse_mass = 1.0 / object.mass();
        let [mut angular, mut linear] = velocities(object);
        let link = self.multibodies.rigid_body_link(self.fingers[0].child).expect("fingers are part of the tree");
        let multibody = self.multibodies.get_multibody_mut(link.multibody).expect("the tree exists");
        let mut generalized = multibody.generalized_velocity().into_owned();
        for _ in 0..MOST_SWEEPS {
            let mut largest = 0.0f64;
            for Rebound { point, response, wanted_mps, impulse_ns } in &mut rebounds {
                let velocity =
                    point.normal.dot(&linear) + response.turning.dot(&angular) - response.jacobian.dot(&generalized);
                let wanted_ns = *impulse_ns + (*wanted_mps - velocity) / response.mobility_per_kg;
                let change = wanted_ns.max(0.0) - *impulse_ns;
                *impulse_ns += change;
                linear += point.normal * (change * inverse_mass);
                angular += response.spin_per_ns * change;
                generalized.axpy(-change, &response.velocity_per_ns, 1.0);
                largest = largest.max((change * response.mobility_per_kg).abs());
            }
            if largest < SAME_MPS {
                break;
            }
        }
        multibody.generalized_velocity_mut().copy_from(&generalized);
        let object = &mut self.bodies[self.object];
        object.set_linvel(to_vector(&linear), true);
        object.set_angvel(to_vector(&angular), true);
        for Rebound { point, impulse_ns, .. } in &rebounds {
            added_ns[point.part as usize] += impulse_ns - point.impulse_ns;
        }
        added_ns
    }

    /// A point where the object rebounds; `None` if nothing approached there.
    fn rebound(&self, before: &VelocitiesBefore, point: ContactPoint) -> Option<Rebound> {
        let at = |[angular, linear]: &[Vector3<f64>; 2], arm: &Vector3<f64>| linear + angular.cross(arm);
        let joint = self.joints.iter().chain(&self.fingers).position(|axis| Some(axis.child) == point.link);
        let link_mps = joint.map_or(Vector3::zeros(), |joint| at(&before.links[joint], &point.link_arm));
        let approach_mps = point.normal.dot(&(at(&before.object, &point.object_arm) - link_mps));
        let wanted_mps = -self.settings.restitution * approach_mps;
        if wanted_mps <= 0.0 {
            return None;
        }
        Some(Rebound { response: self.response(&point)?, wanted_mps, impulse_ns: point.impulse_ns, point })
    }
}
