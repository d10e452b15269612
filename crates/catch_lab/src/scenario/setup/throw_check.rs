//! Conditions drawn for a throw, and checks of it.

use std::fmt::Display;

use catch_body::InputError;
use catch_sim::{Arena, FlightConditions, FreeFlight};

use super::Setup;
use crate::flights::flight_prediction::LONGEST_FLIGHT_S;

/// Step with which a flight is followed to the floor, in seconds.
const STEP_S: f64 = 5e-3;

impl Setup {
    /// Returns the conditions drawn for the object and the flight of throw number `index`.
    pub fn flight_conditions(&self, seed: u64, index: u64) -> FlightConditions {
        FlightConditions::of(&self.object, &self.release(seed, index), &self.conditions(seed, index))
    }

    /// Checks throw number `index`: it begins clear of everything, and it ends within a trial.
    ///
    /// # Errors
    /// If it is none, with the throw, the object and what would be right.
    pub fn check_throw(&self, seed: u64, index: u64) -> Result<(), InputError> {
        self.check_flight(seed, index)?;
        // Most throws begin far from everything, and that is told without an arena.
        if self.equipment().has_in_the_open(&self.release(seed, index), &self.robot.ready_q) {
            return Ok(());
        }
        self.check_release(&self.arena(seed, index), seed, index)
    }

    /// Checks that the object that has just been released in an arena, as throw number `index`, is clear of
    /// everything.
    ///
    /// # Errors
    /// If it is not.
    pub(crate) fn check_release(&self, arena: &Arena, seed: u64, index: u64) -> Result<(), InputError> {
        let Some(part) = arena.released_in_contact_with() else { return Ok(()) };
        let [x, y, z]: [f64; 3] = self.release(seed, index).p_WO.coords.into();
        let found =
            format!("the release of {} at [{x:.3}, {y:.3}, {z:.3}] m in contact with {part}", self.named(index));
        Err(self.fault(found, "a release that touches nothing: 1 mm or more from hand, arm, floor and obstacles"))
    }

    /// Checks that the flight begins above the floor and meets it within a trial, if nothing is in its way.
    ///
    /// # Errors
    /// If it does not.
    pub fn check_flight(&self, seed: u64, index: u64) -> Result<(), InputError> {
        let (release, conditions) = (self.release(seed, index), self.conditions(seed, index));
        if release.p_WO.z <= 0.0 {
            let found = format!("the release of {} at a height of {:.3} m", self.named(index), release.p_WO.z);
            return Err(self.fault(found, "one above the floor"));
        }
        let flight = FreeFlight::new(&self.object, &release, &conditions, STEP_S);
        let mut states = flight.take((LONGEST_FLIGHT_S / STEP_S) as usize);
        if states.any(|(X_WO, _)| X_WO.translation.z <= 0.0) {
            return Ok(());
        }
        let found = format!("a flight of {} that takes longer", self.named(index));
        Err(self
            .fault(found, format!("a flight that meets the floor within {LONGEST_FLIGHT_S} s, the longest of a trial")))
    }

    fn named(&self, index: u64) -> String {
        format!("{} in throw {index}", self.scenario.object)
    }

    fn fault(&self, found: String, expected: impl Display) -> InputError {
        InputError::new(&self.scenario.throw, "motion", found, expected)
    }
}
