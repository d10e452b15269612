//! Recordings and evaluations in the formats of other tools, each behind a feature of its own.

#[cfg(feature = "gif")]
pub mod gif_picture;
#[cfg(feature = "mcap")]
pub mod mcap_file;
pub mod mjcf;
