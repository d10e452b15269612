//! A single catch, planned for a flight that is known.

use catch_bot::{
    control::{Decision, Progress, Situation, Status},
    trajectory_optimization::Start,
    trajectory_prediction::FlightTrajectory,
};

use super::setup::Setup;

/// Search passes before the answer is that there is no catch: each tries times between those of the one
/// before.
const PASSES: usize = 8;

/// The scenario's planner, asked once for an arm in the state `start` that nothing is planned for yet.
///
/// # Panics
/// If settings were changed in code to values out of their ranges.
pub fn plan(setup: &Setup, start: Start, flight: &FlightTrajectory) -> Decision {
    let settings = setup.uncalibrated_config();
    let mut planner = settings.catch_planner(setup.known(), setup.brain_seed(0, 0));
    let mut progress = Progress::default();
    let mut ask = || {
        let decision = planner.plan(&Situation {
            observed_s: (start.time_s, None),
            first_seen_s: start.time_s,
            start,
            sensed: (start.state.q, start.state.dq),
            flight,
            running: None,
            closing: None,
            progress,
        });
        progress = decision.progress;
        decision
    };
    let mut decision = ask();
    for _ in 1..PASSES {
        if decision.status == Status::Planned {
            break;
        }
        decision = ask();
    }
    decision
}
