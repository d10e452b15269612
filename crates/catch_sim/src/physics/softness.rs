//! How far contacts give way.
//!
//! The engine's contacts are springs whose stiffness follows the effective mass m of each point, k =
//! m·(2πf)², with one natural frequency f for all. A gripper's motor would thus decide how soft the object
//! is. So f is set anew before each step from the object's own stiffness and the effective masses of the
//! points that pushed it in the step before.

use std::f64::consts::TAU;

use rapier3d_f64::prelude as engine;

use super::{Part, World};
use crate::object::ThrownObject;

/// Natural frequency of contacts with an object whose file names no stiffness, and the highest of any, in Hz:
/// a finger sinks 0.2 mm into a bottle at most. Chosen.
const HARD_HZ: f64 = 400.0;
/// Of the solver's rate, which a contact's frequency may not exceed: as Box2D 3 bounds its contacts.
const OF_SOLVER_RATE: f64 = 0.25;
/// Critically damped: restitution is not the spring's business.
const DAMPING_RATIO: f64 = 1.0;

/// Stiffness of the object under a finger.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stiffness {
    /// None: it is hard.
    surface_npm: Option<f64>,
    /// Effective mass where one finger meets the object's centre, for the first contact.
    first_mass_kg: f64,
}

impl Stiffness {
    /// Of an object under fingers of this mass, drive included.
    pub fn of(object: &ThrownObject, finger_kg: f64) -> Self {
        let first_mass_kg = 1.0 / (object.mass_kg.recip() + finger_kg.recip());
        Self { surface_npm: object.stiffness_npm, first_mass_kg }
    }
}

impl World {
    /// Makes contacts in the step to come as stiff as the object is.
    pub(super) fn set_softness(&mut self) {
        let solver_rate_hz = self.parameters.num_solver_iterations as f64 / self.settings.step_s;
        let hardest_hz = HARD_HZ.min(OF_SOLVER_RATE * solver_rate_hz);
        let frequency_hz = self.stiffness.surface_npm.map_or(hardest_hz, |stiffness_npm| {
            let mass_kg = self.mass_in_contact_kg().unwrap_or(self.stiffness.first_mass_kg);
            ((stiffness_npm / mass_kg).sqrt() / TAU).min(hardest_hz)
        });
        let softness = engine::SpringCoefficients::new(frequency_hz, DAMPING_RATIO);
        (self.parameters.contact_softness, self.parameters.static_contact_softness) = (softness, softness);
    }

    /// Effective mass against which a part pushes, all its points together; the mean of the fingers if they
    /// touch the object, else of all parts that do.
    fn mass_in_contact_kg(&self) -> Option<f64> {
        let points = self.contact_points();
        let is_finger = |part: Part| matches!(part, Part::LeftFinger | Part::RightFinger);
        let by_fingers = points.iter().any(|point| is_finger(point.part));
        let counted = points.iter().filter(|point| is_finger(point.part) || !by_fingers);
        let (mut parts, mut sum_kg) = (Vec::new(), 0.0);
        for point in counted {
            sum_kg += self.response(point)?.mobility_per_kg.recip();
            if !parts.contains(&point.part) {
                parts.push(point.part);
            }
        }
        (!parts.is_empty()).then(|| sum_kg / parts.len() as f64)
    }
}
