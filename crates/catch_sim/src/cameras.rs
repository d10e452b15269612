//! Depth cameras: what they see of a scene, and what they make of it.
//!
//! Cameras see by ray casting, one ray through the centre of each pixel ([`Renderer`]), which is exact. What
//! real sensors do to such images is added to them ([`DepthCameras`], [`depth_noise`](crate::depth_noise)).

mod counter_generator;
mod measurement;
mod render;

pub use measurement::DepthCameras;
pub use render::{Readout, Renderer, Scene};

#[cfg(test)]
mod tests;
