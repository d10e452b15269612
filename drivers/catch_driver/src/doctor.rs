//! What the links to arm and cameras are like: measured while the arm is held.

use std::{collections::BTreeMap, fs, path::Path};

use anyhow::Context;
use catch_recording::drive_job::DriveJob;
use serde::Serialize;

use crate::{
    camera_socket::{self, Arrived, FrameStatus, ImageFaults},
    clock::Clock,
    control::Sample,
    depth_noise::{DepthNoise, NoiseFigures},
    drive::{self, Driver},
    enabling_key::EnablingKey,
};

/// Duration of the measurement in seconds.
const MEASURED_S: f64 = 10.0;
/// Name of the file with the findings.
const FILE: &str = "doctor.json";

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// States that arrived.
    pub states: usize,
    /// Times between states in ms: median, 99th percentile, most.
    pub interval_ms: [f64; 3],
    /// Times from a state to its answer in ms: median, 99th percentile, most.
    pub answer_ms: [f64; 3],
    /// States that did not arrive.
    pub states_lost: u64,
    /// Longest run of them.
    pub longest_run: u64,
    /// The least fraction of a hundred answers that arrived, as the robot counts them.
    pub least_success_rate: f64,
    /// The host's clock less the robot's at the end, in seconds, and its drift.
    pub clock_offset_s: f64,
    /// Drift of the offset in seconds per second.
    pub clock_drift: f64,
    /// Fraction of the acceleration limit that plans may use; null: nothing may move over this link.
    pub acceleration_ratio: Option<f64>,
    /// Images of each camera by what they are.
    pub images: BTreeMap<usize, Images>,
}

/// Images of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Images {
    /// Images that arrived.
    pub frames: usize,
    /// Images per second.
    pub rate_hz: f64,
    /// Time from capture to arrival in seconds, the mean.
    pub latency_s: f64,
    /// Noise of the depth, as long as nothing moves; null if there were no depths.
    pub noise: Option<NoiseFigures>,
    /// What was wrong with them.
    #[serde(flatten)]
    pub faults: ImageFaults,
}

/// Median, 99th percentile and most, in ms.
fn told_ms(mut values_s: Vec<f64>) -> [f64; 3] {
    values_s.sort_by(f64::total_cmp);
    let at = |fraction: f64| values_s.get(((values_s.len() as f64 - 1.0) * fraction) as usize).copied();
    [0.5, 0.99, 1.0].map(|fraction| at(fraction).unwrap_or(f64::NAN) * 1e3)
}

/// Findings of some samples, in order.
pub fn findings(samples: &[Sample], margin: fn(u64) -> Option<f64>) -> Findings {
    let interval_s = samples.windows(2).map(|it| it[1].heard_s - it[0].heard_s).collect();
    let least = |part: &[Sample]| part.iter().map(|it| it.heard_s - it.time_s).fold(f64::INFINITY, f64::min);
    let (first, last) = samples.split_at(samples.len() / 2);
    let half_s = samples.last().map_or(f64::NAN, |it| it.time_s) / 2.0;
    let longest_run = samples.iter().map(|it| it.missed).max().unwrap_or(0);
    // The first hundred answers do not fill the robot's count.
    let rates = samples.iter().skip(100).map(|it| it.success_rate);
    Findings {
        states: samples.len(),
        interval_ms: told_ms(interval_s),
        answer_ms: told_ms(samples.iter().map(|it| it.answer_s).collect()),
        states_lost: samples.iter().map(|it| it.missed).sum(),
        longest_run,
        least_success_rate: rates.fold(1.0, f64::min),
        clock_offset_s: least(last),
        clock_drift: (least(last) - least(first)) / half_s,
        acceleration_ratio: margin(longest_run),
        images: BTreeMap::new(),
    }
}

/// Images of a camera as they arrive.
#[derive(Debug, Default)]
struct Watched {
    count: usize,
    latency_s: f64,
    faults: ImageFaults,
    noise: DepthNoise,
}

impl Watched {
    fn add(&mut self, image: &Arrived) {
        self.count += 1;
        self.latency_s += image.latency_s;
        self.faults.count(image.status);
        // A repeated image has the noise of the one before.
        if image.status != FrameStatus::Frozen {
            self.noise.add(&image.frame.depth_m);
        }
    }

    fn found(&self, measured_s: f64) -> Images {
        let count = self.count as f64;
        let (rate_hz, latency_s) = (count / measured_s, self.latency_s / count);
        Images { frames: self.count, rate_hz, latency_s, noise: self.noise.figures(), faults: self.faults }
    }
}

/// Measures, prints the findings as JSON, and writes them to `doctor.json` in the folder for results.
///
/// # Errors
/// A device that does not answer.
pub fn run<D: Driver>(job: &DriveJob) -> anyhow::Result<()> {
    let bounds = drive::bounds::<D>(job)?;
    // It is not moved, but a name that is wrong is told now.
    drive::hand::<D>(job)?;
    let images = camera_socket::listen(Path::new(&job.links.cameras.socket), &job.cell.cameras, &Clock::Host)?;
    let key = EnablingKey::default();
    // The arm is held: there is no motion to enable.
    key.set(true);
    let mut control = D::hold(job, &bounds.arm, &key)?;
    let (mut samples, mut watched) = (Vec::new(), BTreeMap::<usize, Watched>::new());
    while samples.last().is_none_or(|it: &Sample| it.time_s < MEASURED_S) {
        match control.samples.recv() {
            Ok(sample) => samples.push(sample),
            Err(_) => anyhow::bail!("the arm: {}", control.cause()),
        }
        for image in images.try_iter() {
            watched.entry(image.frame.camera).or_default().add(&image);
        }
    }
    control.stop();
    // The images' clock is the host's.
    let measured_s = samples.last().map_or(f64::NAN, |it| it.heard_s - samples[0].heard_s);
    let cameras = watched.iter().map(|(camera, it)| (*camera, it.found(measured_s))).collect();
    let found = serde_json::to_string_pretty(&Findings { images: cameras, ..findings(&samples, D::margin) })?;
    println!("{found}");
    let file = job.out.join(FILE);
    fs::write(&file, found).with_context(|| file.display().to_string())
}
