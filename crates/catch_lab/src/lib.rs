//! CatchingBot's lab: trials, their referee, their recordings, what they look like, and the program `catchingbot`.
//!
//! # Where to begin
//!
//! The tutorial `docs/your-first-throw.md` starts with the
//! program; the numbered examples in `crates/catch_lab/examples` do the same as a library:
//!
//! | example | shows | uses |
//! |---|---|---|
//! | `01_first_throw` | a throw, its story, its page | [`setup`], [`recorded_throw`], [`catch_page`] |
//! | `02_own_object` | an object from an OBJ file | [`setup::Choice`] |
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
//! Here, and only here, the brain and the arena meet: [`setup`] reads what a scenario names ([`assets`], [`scenario`]),
//! [`brain`] makes the brain, [`trial`] lets it play one throw, [`referee`] judges it by the truth, [`timeline`] tells its story, [`recording`]
//! keeps it, also of a real cell ([`cell_recorder`]), [`gripper_latency`] measures with it, and [`replay`] checks that the brain would do it again. An [`evaluation`] is many trials, [`results`] keeps their
//! rows, [`statistics`] sums them up; [`trial_table`] and [`summary_table`] are what others read.
//!
//! A recording is looked at through a [`playback`]: as a page ([`catch_page`]), a small moving picture ([`gif_picture`]) or in
//! other tools ([`mcap_file`]); an evaluation as a page ([`report_page`]) and as [`plots`].

pub mod assets;
pub mod brain;
pub mod catch_page;
pub mod cell_recorder;
pub mod check;
pub mod cloud_file;
pub mod evaluation;
pub mod flight_learning;
pub mod gif_picture;
pub mod gripper_latency;
pub mod ladder;
pub mod mcap_file;
pub mod oracle;
pub mod packed;
pub mod planner_cases;
pub mod play;
pub mod playback;
pub mod plots;
pub mod ready;
pub mod recorded_surface;
pub mod recorded_throw;
pub mod recording;
pub mod referee;
pub mod replay;
pub mod report_page;
pub mod results;
pub mod scenario;
pub mod setup;
pub mod statistics;
pub mod stopwatch;
pub mod summary_table;
pub mod sweep;
pub mod templates;
pub mod throw_proof;
pub mod throw_times;
pub mod timeline;
pub mod track_file;
pub mod trial;
pub mod trial_table;

/// Version of this program, as every result carries it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
