//! Faults of a camera, found from its full images while the arm waits in a known pose.
//!
//! Along the silhouette of the arm pixels show the arm on one side and not on the other. A camera without
//! depths is blinded; one whose depths repeat bit for bit, although they are noisy, is frozen; one that shows
//! the silhouette elsewhere is displaced, or another camera's images come in its place. Cameras that do not
//! see the arm are not judged by it. The cameras' images of flights show a displacement, too.

use std::fmt::{self, Display};

use catch_body::kinematics::LinkPoses;
use catch_cell::{CameraModel, DepthFrame};
use serde::{Deserialize, Serialize};

use super::{
    Config,
    arm_edges::{ArmEdges, Sight},
    camera_offsets::{self, CameraOffset},
    segmentation::{Surroundings, is_full},
    silhouette_shift::{DISPLACED_M, MeanShift, SIGNIFICANT, ShiftHistory},
};

/// Status of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraStatus {
    /// No fault of the camera is known.
    #[default]
    Good,
    /// The camera's images have no depths, or the same one everywhere.
    Blinded,
    /// The camera gives the same image again and again.
    Frozen,
    /// The camera gives no images while others do.
    Silent,
    /// The camera does not stand or look as configured, or not as it did before.
    Displaced,
    /// The camera's images are those of another camera.
    Swapped,
    /// No calibration has found the camera's pose.
    Uncalibrated,
}

impl Display for CameraStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Good => "good",
            Self::Blinded => "blinded",
            Self::Frozen => "frozen",
            Self::Silent => "silent",
            Self::Displaced => "displaced",
            Self::Swapped => "swapped with another",
            Self::Uncalibrated => "uncalibrated",
        })
    }
}

/// The health of all cameras.
#[derive(Debug, Clone)]
pub struct CameraHealth {
    /// The waiting arm, and the aperture of its gripper.
    waiting: (LinkPoses, f64),
    edges: Vec<ArmEdges>,
    records: Vec<Record>,
    /// Offset of each camera as estimated from flights.
    offsets: Vec<CameraOffset>,
    /// The status of each camera.
    pub statuses: Vec<CameraStatus>,
    /// Cameras that are left out of perception: true for each of these.
    pub left_out: Vec<bool>,
    uncalibrated: Vec<bool>,
}

/// Memory of one camera.
#[derive(Debug, Clone, Default)]
struct Record {
    /// Capture time of its newest image.
    newest_s: Option<f64>,
    /// Sets of full images since then that it had no part in.
    missed: usize,
    /// Depths of its newest full image, at the same pixels in each.
    depths_m: Vec<f32>,
    frozen: Verdict,
    blinded: Verdict,
    swapped: Verdict,
    /// Set if too little of the silhouette is where it should be.
    misplaced: Verdict,
    shift: ShiftHistory,
    /// True if flights have shown an offset of the camera.
    is_off: bool,
}

/// A verdict that changes when so many images in a row speak against it.
#[derive(Debug, Clone, Copy, Default)]
struct Verdict {
    holds: bool,
    against: u8,
}

/// Depths of an image that are remembered.
const SAMPLES: usize = 64;
/// Depths that are looked at all over an image.
const SPREAD: usize = 1024;
/// Least number of the remembered pixels that must have depths for a judgement.
const MIN_SAMPLES: usize = 12;
/// Images in a row that make a verdict; so many more unmake it.
const MAKES: u8 = 2;
const UNMAKES: u8 = 4;
/// An arm whose links are nearer to where they wait than this waits, in metres and radians.
const WAITING: f64 = 2e-3;
/// Largest fraction of the pixels showing the arm that a blinded camera measures.
const BLINDED_FRACTION: f64 = 0.05;
/// Least fraction of those pixels measured by a camera that sees the same depth everywhere.
const COVERED_FRACTION: f64 = 0.9;
/// Least fraction of the pixels along the silhouette that are right, but for a camera that is misplaced.
const EXPLAINED: f64 = 0.7;
/// An image of which less is explained may be another camera's.
const UNCLEAR: f64 = 0.85;
/// Least gain in the explained fraction by which another camera's silhouette must be better for the image to
/// be that camera's.
const BETTER: f64 = 0.08;
/// A camera is silent when it has not given an image for so long, in seconds, and in so many sets of images.
const SILENT_S: f64 = 0.25;
const SILENT_SETS: usize = 10;

impl CameraHealth {
    /// Prepares the check for an arm that will be waiting where `surroundings` say.
    pub fn before_flight(cameras: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let uncalibrated: Vec<bool> =
            (0..cameras.len()).map(|camera| config.uncalibrated_cameras.contains(&camera)).collect();
        let mut health = Self {
            waiting: (surroundings.X_WL, surroundings.width_m),
            edges: cameras.iter().map(|camera| ArmEdges::new(camera, surroundings, config)).collect(),
            records: vec![Record { depths_m: vec![f32::NAN; SAMPLES], ..Record::default() }; cameras.len()],
            offsets: vec![CameraOffset::default(); cameras.len()],
            statuses: vec![CameraStatus::Good; cameras.len()],
            left_out: uncalibrated.clone(),
            uncalibrated,
        };
        health.conclude();
        health
    }

    /// A throw is over; where the cameras were seen to look during it is how they looked before. Flights may
    /// tell that one is off.
    pub fn end_throw(&mut self, offsets: &[CameraOffset], config: &Config) {
        self.records.iter_mut().for_each(|it| it.shift.close());
        self.offsets.iter_mut().zip(offsets).for_each(|(it, offset)| it.add(offset));
        // Errors of the calibration of any camera make one seem to be off.
        let bound_m = |it: &ArmEdges| DISPLACED_M + SIGNIFICANT * config.camera_sd_rad * it.mean_depth_m;
        let most_m = self.edges.iter().map(bound_m).fold(0.0, f64::max);
        if let Some(camera) = camera_offsets::displaced(&mut self.offsets, most_m) {
            self.records[camera].is_off = true;
        }
    }

    /// Takes in the images of one capture time. Only full images without masks tell anything.
    pub fn observe(
        &mut self,
        frames: &[DepthFrame],
        cameras: &[CameraModel],
        surroundings: Option<&Surroundings<'_>>,
        config: &Config,
    ) {
        let tells = |frame: &&DepthFrame| {
            frame.mask.is_none() && cameras.get(frame.camera).is_some_and(|it| is_full(frame, it))
        };
        self.note_arrivals(frames, frames.iter().any(|frame| tells(&frame)));
        let waits = surroundings.is_some_and(|known| known.stands_as(&self.waiting, WAITING));
        for frame in frames.iter().filter(tells) {
            self.judge_repetition(frame, config);
            if waits {
                self.judge_sight(frame, &cameras[frame.camera], config);
            }
        }
        self.conclude();
    }

    /// Notes which cameras give images, while any gives full ones.
    fn note_arrivals(&mut self, frames: &[DepthFrame], any_is_full: bool) {
        let Some(now_s) = frames.first().map(|frame| frame.capture_s) else { return };
        for record in &mut self.records {
            record.missed = (record.missed + usize::from(any_is_full)).min(SILENT_SETS);
            record.newest_s.get_or_insert(now_s);
        }
        for frame in frames {
            if let Some(record) = self.records.get_mut(frame.camera) {
                (record.newest_s, record.missed) = (Some(frame.capture_s), 0);
            }
        }
        for (record, status) in self.records.iter().zip(&mut self.statuses) {
            let silent = record.missed == SILENT_SETS && record.newest_s.is_some_and(|it| now_s - it > SILENT_S);
            *status = if silent { CameraStatus::Silent } else { CameraStatus::Good };
        }
    }

    /// Judges whether the camera is frozen: its depths are noisy and still repeat.
    fn judge_repetition(&mut self, frame: &DepthFrame, config: &Config) {
        let (edges, record) = (&self.edges[frame.camera], &mut self.records[frame.camera]);
        let (mut measured, mut repeated) = (0, true);
        for (pixel, before_m) in edges.samples(SAMPLES).zip(&mut record.depths_m) {
            let depth_m = frame.depth_m[pixel];
            repeated &= depth_m.to_bits() == before_m.to_bits() || depth_m.is_nan() && before_m.is_nan();
            measured += usize::from(depth_m.is_finite());
            *before_m = depth_m;
        }
        if measured >= MIN_SAMPLES && config.depth_sd_m(edges.mean_depth_m) > 0.0 {
            record.frozen.update(repeated);
        }
    }

    /// Judges whether the arm is seen, and where.
    fn judge_sight(&mut self, frame: &DepthFrame, camera: &CameraModel, config: &Config) {
        let edges = &self.edges[frame.camera];
        if !edges.are_enough() {
            return;
        }
        let sight = edges.look(frame);
        let blinded = match sight.measured_fraction {
            fraction if fraction < BLINDED_FRACTION => is_empty(frame),
            fraction => fraction > COVERED_FRACTION && is_uniform(frame),
        };
        let misplaced = sight.explained.is_some_and(|it| it < EXPLAINED);
        let is_unclear = !blinded && sight.explained.is_none_or(|it| it < UNCLEAR);
        let swapped = is_unclear && self.is_of_another(frame, &sight);
        let record = &mut self.records[frame.camera];
        record.blinded.update(blinded);
        record.swapped.update(swapped);
        if !blinded && sight.explained.is_some() {
            record.misplaced.update(misplaced);
        }
        if let Some(shift) = MeanShift::of(&sight).filter(|_| !blinded && !misplaced && !record.frozen.holds) {
            record.shift.add(&shift, camera, edges.mean_depth_m, config);
        }
    }

    /// Returns whether an image shows the arm as another camera would.
    fn is_of_another(&self, frame: &DepthFrame, own: &Sight) -> bool {
        let least = own.explained.unwrap_or(0.0).max(EXPLAINED) + BETTER;
        self.edges.iter().enumerate().any(|(i, edges)| {
            i != frame.camera
                && edges.are_enough()
                && edges.window == frame.window
                && edges.look(frame).explained.is_some_and(|explained| explained > least)
        })
    }

    /// The statuses, and which cameras are left out. Where most cameras seem to be displaced, the arm is:
    /// then they all stay.
    fn conclude(&mut self) {
        let mut displaced = 0;
        let all = self.records.iter().zip(&self.uncalibrated).zip(&mut self.statuses);
        for ((record, uncalibrated), status) in all {
            *status = match record {
                _ if *uncalibrated => CameraStatus::Uncalibrated,
                _ if *status == CameraStatus::Silent => CameraStatus::Silent,
                Record { frozen: Verdict { holds: true, .. }, .. } => CameraStatus::Frozen,
                Record { blinded: Verdict { holds: true, .. }, .. } => CameraStatus::Blinded,
                Record { swapped: Verdict { holds: true, .. }, .. } => CameraStatus::Swapped,
                _ if record.is_off || record.misplaced.holds || record.shift.is_displaced => CameraStatus::Displaced,
                _ => CameraStatus::Good,
            };
            displaced += usize::from(*status == CameraStatus::Displaced);
        }
        let most_are_displaced = 2 * displaced > self.statuses.len();
        for (left_out, status) in self.left_out.iter_mut().zip(&self.statuses) {
            *left_out = match status {
                CameraStatus::Good => false,
                CameraStatus::Displaced => !most_are_displaced,
                _ => true,
            };
        }
    }
}

impl Verdict {
    fn update(&mut self, holds: bool) {
        self.against = if holds == self.holds { 0 } else { self.against + 1 };
        if self.against >= if self.holds { UNMAKES } else { MAKES } {
            *self = Self { holds, against: 0 };
        }
    }
}

/// Depths of an image that are evenly spread.
fn spread(frame: &DepthFrame) -> impl Iterator<Item = f32> {
    let count = frame.window.area();
    // Not a multiple of the width, so that all columns have their turn.
    let step = (count / SPREAD).max(1) | 1;
    frame.depth_m[..count].iter().step_by(step).copied()
}

/// Returns whether hardly any pixel has a depth.
fn is_empty(frame: &DepthFrame) -> bool {
    spread(frame).filter(|depth_m| depth_m.is_finite() && *depth_m > 0.0).count() <= 2
}

/// Returns whether nearly all pixels have the same depth.
fn is_uniform(frame: &DepthFrame) -> bool {
    let Some(first) = spread(frame).find(|depth_m| depth_m.is_finite() && *depth_m > 0.0) else { return false };
    let alike = spread(frame).filter(|depth_m| *depth_m == first).count();
    10 * alike > 9 * spread(frame).count()
}
