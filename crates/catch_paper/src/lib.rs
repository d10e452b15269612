//! The paper's own method, for comparison: its perception (ICP, III-B, [`registration`]), its prediction (RANSAC alone, III-B,
//! [`prediction`]), its grasp selection (III-C, [`grasp`]) and its trajectory optimization (III-D, [`motion`]), as stages of a
//! [`CatchingBot`](catch_bot::CatchingBot).
//!
//! Figures that the paper does not give are those of the authors' code. Where code and text differ the modules say so, and which
//! one is followed by default. What a real arm could not do is not done by default either: motions start where the arm is, none
//! breaks a limit of the arm (they are part of the program; the paper has position and velocity limits only), none is carried out
//! that is not safe, and the gripper closes when the prediction says so, not when the simulator's truth does. Each of these is a
//! setting. The scenario `as-published` has them all as the authors' code has them.
//!
//! Begin with [`IcpEstimator`], [`RansacPredictor`] and [`PaperPlanner`], each a stage that a brain may have in place of its own:
//!
//! ```
//! use std::sync::Arc;
//! use catch_bot::{CatchingBot, Preparation, control::TimeGridSearch, perception::SdfEstimator};
//! use catch_paper::{Config, RansacPredictor};
//!
//! /// A brain that predicts flights as the paper does, and does all else its own way.
//! fn brain(known: Arc<Preparation>, seed: u64) -> CatchingBot<SdfEstimator, RansacPredictor, TimeGridSearch> {
//!     let settings = known.config().trajectory_prediction.clone();
//!     let predictor = RansacPredictor::new(settings, &Config::default().prediction, known.reference().symmetry, seed);
//!     let (estimator, planner) = (known.pose_estimator(), known.catch_planner());
//!     CatchingBot::with_stages(known, estimator, predictor, planner)
//! }
//! ```
//!
//! [`sqp`] is the general nonlinear form of the trajectory optimization over all joints at once, for any arm. Catches whose time and
//! pose are given, as the paper's are, [`general`] plans with it and [`posed`] with our own motions, or proves them out of reach.

pub mod general;
pub mod grasp;
pub mod motion;
pub mod planner;
pub mod posed;
pub mod prediction;
pub mod registration;
pub mod sqp;
pub mod unreachable;

use catch_bot::settings::{DURATION_S, Faults, LIMIT_SCALE, NOT_NEGATIVE, PERIOD_S, SettingError, Settings};
use serde::{Deserialize, Serialize};

pub use planner::PaperPlanner;
pub use prediction::RansacPredictor;
pub use registration::IcpEstimator;

/// Settings of the paper's method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Settings of the registration, III-B.
    pub registration: registration::Config,
    /// Settings of the prediction, III-B.
    pub prediction: prediction::SamplingConfig,
    /// Settings of III-C.
    pub grasp: grasp::Config,
    /// Settings of III-D.
    pub motion: motion::Config,
    /// The object is within reach between these distances from the axis of the base, in metres (code).
    pub reach_m: [f64; 2],
    /// Times after the first sighting among which it is sought when it comes within reach and leaves it, in seconds (code).
    pub sought_s: [f64; 2],
    /// How many such times (code).
    pub sought: usize,
    /// The catch is at this fraction of the sum of both times (code: just before the middle).
    pub catch_time_fraction: f64,
    /// Time between plans, in seconds (code).
    pub period_s: f64,
    /// Plans are not changed any more in the last seconds before the catch (code).
    pub freeze_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            registration: registration::Config::default(),
            prediction: prediction::SamplingConfig::default(),
            grasp: grasp::Config::default(),
            motion: motion::Config::default(),
            reach_m: [0.42, 0.75],
            sought_s: [0.5, 1.0],
            sought: 20,
            catch_time_fraction: 0.475,
            period_s: 0.025,
            freeze_s: 0.2,
        }
    }
}

impl Settings for Config {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .lists(&NOT_NEGATIVE, [("reach_m", &self.reach_m[..])])
            .lists(&DURATION_S, [("sought_s", &self.sought_s[..])])
            .counts([("sought", self.sought)])
            .values(&LIMIT_SCALE, [("catch_time_fraction", self.catch_time_fraction)])
            .values(&PERIOD_S, [("period_s", self.period_s)])
            .values(&DURATION_S, [("freeze_s", self.freeze_s)])
            .table("registration", &self.registration)
            .table("grasp", &self.grasp)
            .table("motion", &self.motion)
            .all()
    }
}
