//! Depth cameras: where they stand, what they see of a scene, what they make of it, and the reference scan of an object.
//!
//! Cameras see by ray casting, one ray through the centre of each pixel ([`Renderer`]), which is exact. What real sensors do to
//! such images is added to them ([`DepthCameras`], [`depth_noise`]).

mod chance;
pub mod depth_noise;
mod measurement;
mod reference_scan;
mod render;
mod rig;

pub use measurement::DepthCameras;
pub use reference_scan::reference_scan;
pub use render::{Readout, Renderer, Scene};
pub use rig::rig_from_toml;

#[cfg(test)]
mod measured;
#[cfg(test)]
mod near_rigs;
#[cfg(test)]
mod tests;
