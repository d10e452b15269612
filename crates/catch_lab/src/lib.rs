//! CatchingBot's lab: trials, their referee, their recordings, evaluations of many.
//!
//! # Where to begin
//!
//! With [`Setup`](scenario::setup::Setup) (a scenario and all that it names), [`trial::run`] (one throw) and
//! [`Evaluation`](evaluation::Evaluation) (many):
//!
//! ```
//! use catch_lab::{referee, scenario::setup::{Choice, Setup}, trial};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() })?;
//! let (seed, index) = (1, 0);
//! let throw = trial::run(&setup, seed, index, &mut |_, _| Ok(()))?;
//! let verdict = referee::judge(&setup, &throw);
//! assert!(verdict.caught, "{:?}", verdict.reason);
//! # Ok(())
//! # }
//! ```
//!
//! The tutorial `docs/tutorial/your-first-throw.md` starts with the
//! program; the numbered examples in `crates/catch_cli/examples` do the same as a library:
//!
//! | example | shows | uses |
//! |---|---|---|
//! | `01_first_throw` | a throw, its story, its page | [`scenario::setup`], [`recording::recorded_throw`], `catch_view` |
//! | `02_own_object` | an object from an OBJ file | [`scenario::setup::Choice`] |
//! | `03_own_scenario` | a changed scenario, and how often it still catches | [`scenario`], [`evaluation`] |
//! | `04_own_brain` | another brain in the same arena | [`catch_cell::Brain`], [`catch_cell::Cell`] |
//! | `05_predict_a_track` | a flight fitted to measured poses | [`catch_bot::trajectory_prediction`] |
//! | `06_own_cell` | a brain, and the driver of another cell than the arena | [`catch_bot::CatchingBot`], [`catch_cell::Cell`] |
//! | `07_own_predictor` | another flight predictor in the brain, evaluated beside ours | [`catch_bot::trajectory_prediction::FlightPredictor`], [`evaluation`] |
//!
//! Each is run with `cargo run --release --example 01_first_throw`.
//!
//! # What is where
//!
//! Here, and only here, the brain and the arena meet. A module uses only those above it in this table, and
//! those of its own row:
//!
//! | module | holds |
//! |---|---|
//! | [`flights`] | recorded tracks and the flights through them, their aerodynamics, learned from throws; recorded tracks as throws |
//! | [`assets`], [`parallel`] | what is built in or named by a file; work on several threads |
//! | [`scenario`] | everything that trials share: [`scenario::setup`] reads what a scenario names |
//! | [`trial`] | one throw: arena and brain tick by tick |
//! | [`reachability`] | what the arm could have reached: oracle, proofs, waiting poses |
//! | [`referee`] | the only place where truth meets score |
//! | [`recording`] | a throw on disk with its truth: story, replay, what is measured with it |
//! | [`evaluation`] | many trials: rows on disk, statistics, tables |
//! | [`play`] | many throws in one life |
//! | [`scenario::setup::calibration`] | where cameras stand, from what they see of the arm |
//! | [`camera_placement`] | where cameras tell most about throws |
//! | [`planner_cases`] | catches to plan, from a file |

/// The blocks of Rust in the pages for people, as doctests.
#[cfg(doctest)]
mod pages_for_people {
    #[doc = include_str!("../../../README.md")]
    struct Readme;
    #[doc = include_str!("../../../docs/how-to/benchmark-your-method.md")]
    struct BenchmarkYourMethod;
    #[doc = include_str!("../../../docs/how-to/drive-a-real-cell.md")]
    struct DriveARealCell;
}

pub mod assets;
pub mod camera_placement;
pub mod evaluation;
pub mod flights;
pub mod parallel;
pub mod planner_cases;
pub mod play;
pub mod png;
pub mod reachability;
pub mod recording;
pub mod referee;
pub mod scenario;

pub mod trial;

/// Version of this program, as every result carries it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
