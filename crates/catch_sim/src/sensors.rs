//! The cell's cameras in time: when they look, which pixels they read out, and when their images arrive.

use catch_cell::{CameraModel, DepthFrame, PixelWindow};

use crate::{
    cameras::{DepthCameras, Readout, Renderer, Scene},
    config::ArenaConfig,
};

/// Cameras that look at every tick and whose images arrive after a while.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    cameras: DepthCameras,
    /// How often they have looked.
    exposures: u64,
    labels: bool,
    latency_s: f64,
    windows: Option<Vec<PixelWindow>>,
    /// Images that have not arrived, with their times of arrival, soonest first.
    under_way: Vec<(f64, Vec<DepthFrame>)>,
}

impl Sensors {
    /// The sensors of the scene (`seed`, `index`), whose cameras the brain believes to stand as `calibrated`.
    pub fn new(config: &ArenaConfig, calibrated: &[CameraModel], seed: u64, index: u64) -> Self {
        Self {
            cameras: DepthCameras::new(calibrated, &config.depth, seed, index),
            exposures: 0,
            labels: config.labels,
            latency_s: config.latency_s,
            windows: None,
            under_way: Vec::new(),
        }
    }

    /// The windows that the brain wants from now on; `None` means all that the cameras give by themselves.
    pub fn set_windows(&mut self, windows: Option<Vec<PixelWindow>>) {
        self.windows = windows;
    }

    /// All cameras look at `scene`.
    pub fn expose(&mut self, renderer: &Renderer, scene: &Scene) {
        let readout = match &self.windows {
            Some(windows) => Readout::Windows(windows),
            None if self.labels => Readout::Object,
            None => Readout::Full,
        };
        let frames = self.cameras.capture(renderer, scene, self.exposures, readout, self.labels);
        self.exposures += 1;
        self.under_way.push((scene.capture_s + self.latency_s, frames));
    }

    /// The images that have arrived by `now_s`, oldest first.
    pub fn arrived(&mut self, now_s: f64) -> Vec<DepthFrame> {
        let count = self.under_way.partition_point(|(at_s, _)| *at_s <= now_s + 1e-9);
        self.under_way.drain(..count).flat_map(|(_, frames)| frames).collect()
    }
}
