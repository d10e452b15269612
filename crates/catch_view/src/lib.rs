//! Throws, evaluations to look at: pages for the browser, and files for other tools.
//!
//! A [`Playback`](playback::Playback) is a recording read whole, from which [pages], MCAP files and moving
//! pictures are made. Each format of other tools is behind a feature: `mcap`, `gif`, and `parquet` for
//! data sets.

pub mod export;
pub mod pages;
pub mod playback;
pub mod points;
pub mod shading;
pub mod surfaces;
pub mod viewpoint;
