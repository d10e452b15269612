//! Depth cameras: where they stand, what they see of a scene, and the reference scan of an object.
//!
//! Cameras see by ray casting, one ray through the centre of each pixel. Images are exact; what real sensors do to them is
//! added later.

mod reference_scan;
mod render;
mod rig;

pub use reference_scan::reference_scan;
pub use render::{Readout, Renderer, Scene};
pub use rig::rig_from_toml;

#[cfg(test)]
mod tests;
