//! What an arm can reach in time: of the throws that were missed, of all throws, and from which waiting pose.

pub mod oracle;
pub mod ready;
