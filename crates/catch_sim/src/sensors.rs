//! The cell's cameras in time: when they look, which pixels they read out, and when their images arrive.

use catch_cell::{DepthFrame, PixelWindow};

use crate::{
    cameras::{Readout, Renderer, Scene},
    config::ArenaConfig,
};

/// Cameras that look at every tick and whose images arrive after a while.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    labels: bool,
    latency_s: f64,
    windows: Option<Vec<PixelWindow>>,
    /// Images that have not arrived, with their times of arrival, soonest first.
    under_way: Vec<(f64, Vec<DepthFrame>)>,
}

impl Sensors {
    pub fn new(config: &ArenaConfig) -> Self {
        Self { labels: config.labels, latency_s: config.latency_s, windows: None, under_way: Vec::new() }
    }

    /// The windows that the brain wants from now on; `None` means all that the cameras give by themselves.
    pub fn set_windows(&mut self, windows: Option<Vec<PixelWindow>>) {
        self.windows = windows;
    }

    /// All cameras look at `scene`.
    pub fn expose(&mut self, renderer: &Renderer, scene: &Scene) {
        if renderer.cameras().is_empty() {
            return;
        }
        let readout = match &self.windows {
            Some(windows) => Readout::Windows(windows),
            None if self.labels => Readout::Object,
            None => Readout::Full,
        };
        let frames = renderer.render(scene, readout, self.labels);
        self.under_way.push((scene.capture_s + self.latency_s, frames));
    }

    /// The images that have arrived by `now_s`, oldest first.
    pub fn arrived(&mut self, now_s: f64) -> Vec<DepthFrame> {
        let count = self.under_way.partition_point(|(at_s, _)| *at_s <= now_s + 1e-9);
        self.under_way.drain(..count).flat_map(|(_, frames)| frames).collect()
    }
}
