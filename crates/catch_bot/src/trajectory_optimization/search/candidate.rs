//! Candidates of a search: catch times, and grasps at each.

use catch_body::MAX_JOINTS;

use crate::{
    grasp_selection::{Grasp, RankedGrasp},
    trajectory_optimization::reachability::ReachableSet,
    trajectory_prediction::LocalFlight,
};

/// State of flight and joints at one catch time.
pub struct CatchTimeSample {
    pub local_flight: LocalFlight,
    pub joints: [ReachableSet; MAX_JOINTS],
    pub ranges: [[f64; 2]; MAX_JOINTS],
}

/// A catch time with a grasp.
pub struct Candidate {
    pub sample: usize,
    pub ranked: RankedGrasp,
    /// Estimated cost of the reachability margin, by the reach map.
    pub margin_cost: f64,
    /// Postures whose velocities at the catch were looked for, and those that were tried in vain.
    pub velocity_trials: usize,
    pub failed: usize,
    /// The grasp, where the hand holds a ball turned as the arm can turn it.
    pub turned: Option<Grasp>,
}

impl Candidate {
    /// Candidate with which nothing was tried yet.
    pub fn new(sample: usize, ranked: RankedGrasp, margin_cost: f64) -> Self {
        Self { sample, ranked, margin_cost, velocity_trials: 0, failed: 0, turned: None }
    }
}
