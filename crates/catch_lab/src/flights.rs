//! Flights through recorded tracks: predicted, learned from, and thrown again.

pub mod flight;
mod flight_fit;
pub mod flight_learning;
pub mod flight_misses;
pub mod flight_prediction;
pub mod flight_prior;
mod flight_problem;
pub mod recorded_throws;
pub mod stretches;
pub mod track_file;
