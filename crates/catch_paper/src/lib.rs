//! The paper's own method, for comparison: its perception (ICP, III-B, [`registration`]), its prediction
//! (RANSAC alone, III-B, [`prediction`]), its grasp selection (III-C, [`grasp`]) and its trajectory
//! optimization (III-D, [`motion`]), as stages of a [`CatchingBot`](catch_bot::CatchingBot).
//!
//! Figures that the paper does not give are those of the authors' code. Where code and text differ the
//! modules say so, and which one is followed by default. What a real arm could not do is not done by default
//! either: motions start where the arm is, none breaks a limit of the arm (they are part of the program; the
//! paper has position and velocity limits only), none is carried out that is not safe, and the gripper closes
//! when the prediction says so, not when the simulator's truth does. Each of these is a setting. The scenario
//! `as-published` has them all as the authors' code has them.
//!
//! Begin with [`IcpEstimator`], [`RansacPredictor`] and [`PaperPlanner`], each a stage that a brain may have
//! in place of its own:
//!
//! ```
//! use std::sync::Arc;
//! use catch_bot::{CatchingBot, Preparation};
//! use catch_paper::{Config, RansacPredictor};
//!
//! /// A brain that predicts flights as the paper does, and does all else its own way.
//! fn brain(known: Arc<Preparation>, seed: u64) -> CatchingBot {
//!     let settings = known.config.trajectory_prediction.clone();
//!     let predictor = RansacPredictor::new(settings, Config::default().prediction, known.reference.symmetry, seed);
//!     let (estimator, planner) = (Box::new(known.pose_estimator()), Box::new(known.catch_planner()));
//!     CatchingBot::with_stages(known, estimator, Box::new(predictor), planner)
//! }
//! ```
//!
//! [`sqp`] is the general nonlinear form of the trajectory optimization over all joints at once, for any arm.
//! Catches whose time and pose are given, as the paper's are, [`posed`] plans with our own motions, or proves
//! them out of reach.

pub mod grasp;
pub mod motion;
pub mod planner;
pub mod posed;
pub mod prediction;
pub mod registration;
pub mod sqp;
pub mod unreachable;

use serde::{Deserialize, Serialize};

pub use planner::PaperPlanner;
pub use prediction::RansacPredictor;
pub use registration::IcpEstimator;

/// Settings of the paper's method.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
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
}
