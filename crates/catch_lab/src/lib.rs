//! The lab: trials, their referee, their recordings, and the program `catchingbot`.
//!
//! Here, and only here, the brain and the arena meet: [`setup`] reads what a scenario names ([`assets`], [`scenario`]),
//! [`trial`] lets the brain play one throw, [`referee`] judges it by the truth, [`timeline`] tells its story, [`recording`]
//! keeps it and [`replay`] checks that the brain would do it again. An [`evaluation`] is many trials, [`results`] keeps their
//! rows and [`statistics`] sums them up.

pub mod assets;
pub mod catch_page;
pub mod check;
pub mod evaluation;
pub mod gif_picture;
pub mod mcap_file;
pub mod packed;
pub mod planner_cases;
pub mod playback;
pub mod plots;
pub mod ready;
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
pub mod throw_times;
pub mod timeline;
pub mod trial;

/// Version of this program, as every result carries it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
