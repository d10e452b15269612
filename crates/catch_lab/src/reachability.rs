//! Reachability of throws in time: oracle of missed throws, and choice of the ready pose.

pub mod oracle;
pub mod ready;
