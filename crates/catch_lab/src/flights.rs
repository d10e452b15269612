//! Flights through recorded tracks: predicted, learned from, and thrown again.

pub mod aerodynamics;
pub mod flight_learning;
pub mod flight_misses;
pub mod flight_prediction;
pub mod recorded_throws;
pub mod track;
pub mod track_file;
