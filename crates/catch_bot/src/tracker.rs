//! The tracker: what was sensed lately, the cameras as far as they are aligned, and the object's poses so far.

use std::{borrow::Cow, collections::VecDeque};

use catch_body::{JointVector, Pose, Twist};
use catch_cell::{CameraModel, DepthFrame, Observation, PixelWindow};

use crate::{
    perception::{
        CameraStatus, ObjectPose, PoseEstimator, Surroundings, View, camera_alignment::CameraAlignment,
        camera_health::CameraHealth, camera_offsets::CameraOffset,
    },
    preparation::Preparation,
    trajectory_prediction::FlightTrajectory,
};

/// Observations whose joint angles are remembered: longer than images can take to arrive.
const SENSED: usize = 64;
/// Images that were taken within this time are registered together, once it is known how the object moves.
const TOGETHER_S: f64 = 0.01;
/// Poses that are remembered, more than any prediction looks back at.
const POSES: usize = 1024;

/// What the encoders said at one time.
#[derive(Debug, Clone, Copy)]
struct Sensed {
    time_s: f64,
    q: JointVector,
    /// Aperture of the gripper.
    width_m: f64,
}

/// What the brain has seen of the arm and of the object.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    /// The cameras, as far as images of the arm have told where they look.
    alignment: CameraAlignment,
    /// What is wrong with them.
    health: CameraHealth,
    /// Oldest first.
    sensed: VecDeque<Sensed>,
    /// Times of the newest observation with images and of the one before.
    imaged_s: [Option<f64>; 2],
    /// Oldest first.
    poses: Vec<ObjectPose>,
    /// Whether single images are registered by themselves, too: work for lives of many throws, which tell of displaced cameras.
    pub compares_cameras: bool,
    /// How often a single image was registered by itself.
    compared: usize,
    /// Poses from single images, each with its camera.
    image_poses: Vec<(usize, ObjectPose)>,
    /// Capture time of the newest image without a mask.
    unlabelled_s: Option<f64>,
}

impl Tracker {
    pub fn new(known: &Preparation, compares_cameras: bool) -> Self {
        Self {
            alignment: known.alignment().clone(),
            health: known.camera_health().clone(),
            sensed: VecDeque::with_capacity(SENSED),
            imaged_s: [None; 2],
            poses: Vec::with_capacity(POSES),
            compares_cameras,
            compared: 0,
            image_poses: Vec::with_capacity(POSES),
            unlabelled_s: None,
        }
    }

    /// How far each camera is off from a flight, by its own images.
    pub fn camera_offsets(&self, flight: &FlightTrajectory) -> Vec<CameraOffset> {
        let images = self.image_poses.iter().map(|(camera, pose)| {
            let shift_m = pose.X_WO.translation.vector - flight.pose_at(pose.capture_s).translation.vector;
            (*camera, pose, flight.time_s - pose.capture_s, shift_m)
        });
        CameraOffset::of_throw(images, self.alignment.cameras().len())
    }

    /// Forgets the throw, and remembers what is wrong with the cameras, also by how far they were off in it.
    pub fn end_throw(&mut self, offsets: &[CameraOffset], known: &Preparation) {
        self.alignment.clone_from(known.alignment());
        self.health.end_throw(offsets, &known.config().perception);
        self.sensed.clear();
        self.imaged_s = [None; 2];
        self.poses.clear();
        self.image_poses.clear();
        self.unlabelled_s = None;
    }

    /// The status of each camera.
    pub fn camera_statuses(&self) -> &[CameraStatus] {
        self.health.statuses()
    }

    /// Forgets the object's poses but for the newest `count`.
    pub fn keep_newest(&mut self, count: usize) {
        self.poses.drain(..self.poses.len().saturating_sub(count));
    }

    /// The object's poses so far, oldest first.
    pub fn poses(&self) -> &[ObjectPose] {
        &self.poses
    }

    /// Times of the newest observation with images and of the one before.
    pub fn observed_s(&self) -> (f64, Option<f64>) {
        (self.imaged_s[0].unwrap_or(f64::NAN), self.imaged_s[1])
    }

    /// Takes in the state of the arm.
    pub fn sense(&mut self, observation: &Observation) {
        if self.sensed.len() == SENSED {
            self.sensed.pop_front();
        }
        if !observation.frames.is_empty() {
            self.imaged_s = [Some(observation.arm.time_s), self.imaged_s[0]];
        }
        let (q, width_m) = (observation.arm.q, observation.gripper.width_m);
        self.sensed.push_back(Sensed { time_s: observation.arm.time_s, q, width_m });
    }

    /// Takes in new images, capture time by capture time, in whatever order they come. Returns the newest pose that they show, if
    /// any. Where they show that the object was taken for turned over, earlier poses are turned, and there is no flight any more.
    pub fn track(
        &mut self,
        frames: &[DepthFrame],
        flight: &mut Option<FlightTrajectory>,
        known: &Preparation,
        estimator: &mut impl PoseEstimator,
    ) -> Option<ObjectPose> {
        let unlabelled_s = frames.iter().filter(|frame| frame.mask.is_none()).map(|frame| frame.capture_s);
        self.unlabelled_s = self.unlabelled_s.into_iter().chain(unlabelled_s).reduce(f64::max);
        let frames = oldest_first(frames);
        let (mut newest, mut left, mut surroundings) = (None, &frames[..], Vec::with_capacity(frames.len()));
        while !left.is_empty() {
            let (frames, later) = left.split_at(together(left, flight.is_some()));
            left = later;
            surroundings.clear();
            for frames in frames.chunk_by(|a, b| a.capture_s == b.capture_s) {
                let of_arm = self.surroundings(known, frames[0].capture_s);
                let (cameras, config) = (known.cameras(), &known.config().perception);
                self.health.observe(frames, cameras, of_arm.as_ref(), config);
                self.alignment.observe(frames, cameras, of_arm.as_ref(), config);
                surroundings.extend(frames.iter().filter_map(|_| of_arm));
            }
            let (cameras, left_out) = (self.alignment.cameras(), self.health.left_out());
            let mut view = View { frames, cameras, left_out, surroundings: &surroundings, V_WO: Twist::default() };
            view.V_WO = flight.as_ref().map_or(view.V_WO, |flight| flight.twist_at(view.capture_s()));
            if let Some(flight) = flight.as_ref().filter(|_| self.compares_cameras && self.image_poses.len() < POSES) {
                // One image of these by itself, in turn.
                let i = self.compared % frames.len();
                self.compared = self.compared.wrapping_add(1);
                let one = View { frames: &frames[i..=i], surroundings: surroundings.get(i..=i).unwrap_or(&[]), ..view };
                let pose = estimator.estimate_aside(&one, &flight.pose_at(one.capture_s()));
                self.image_poses.extend(pose.map(|pose| (frames[i].camera, pose)));
            }
            let expected = self.expected_pose(flight.as_ref(), view.capture_s());
            let Ok(mut pose) = estimator.estimate(&view, expected.into()) else { continue };
            if let Some(T) = estimator.turned_over() {
                self.poses.iter_mut().for_each(|it| it.X_WO *= T);
                *flight = None;
            } else if let Some(X_WO) = &expected {
                pose.X_WO.rotation = known.reference().symmetry.nearest_alike(&X_WO.rotation, &pose.X_WO.rotation);
            }
            remember(&mut self.poses, pose);
            newest = Some(pose);
        }
        newest
    }

    /// The part of each camera's next images that may show the object, once it is tracked in images without masks (sensors that
    /// tell objects apart read out the right pixels by themselves). Full images if it has been lost.
    pub fn windows(
        &self,
        observation: &Observation,
        flight: &FlightTrajectory,
        known: &Preparation,
    ) -> Option<Vec<PixelWindow>> {
        let lost_after_s = known.config().perception.lost_after_s;
        self.unlabelled_s.filter(|newest_s| *newest_s <= flight.time_s + lost_after_s)?;
        let mut sensed_s = self.sensed.iter().rev().map(|sensed| sensed.time_s);
        let period_s = sensed_s.next().zip(sensed_s.next()).map_or(0.0, |(now_s, before_s)| now_s - before_s);
        let next_s = observation.time_s + period_s;
        let (p_WO, v_WO) = (flight.pose_at(next_s).translation.vector, flight.twist_at(next_s).linear);
        let uncertainty_m = 3.0 * flight.position_sd_at(next_s) + v_WO.norm() * period_s;
        let radius_m = known.reference().radius_m + known.config().perception.gate_m + uncertainty_m;
        let window = |(camera, left_out): (&CameraModel, &bool)| match left_out {
            true => PixelWindow::default(),
            false => camera.window_around(&camera.X_WC.inverse_transform_point(&p_WO.into()), radius_m),
        };
        Some(self.alignment.cameras().iter().zip(self.health.left_out()).map(window).collect())
    }

    /// Where the object should be: on the last flight, or, before there is one, where it was seen last. The latter keeps an
    /// object that looks the same from two sides from turning over between the first images.
    fn expected_pose(&self, flight: Option<&FlightTrajectory>, time_s: f64) -> Option<Pose> {
        flight.map(|flight| flight.pose_at(time_s)).or_else(|| self.poses.last().map(|pose| pose.X_WO))
    }

    /// The arm as it was at a time, between what was sensed before and after.
    fn surroundings<'a>(&self, known: &'a Preparation, time_s: f64) -> Option<Surroundings<'a>> {
        let sensed = &self.sensed;
        let after = sensed.iter().position(|it| it.time_s >= time_s).unwrap_or(sensed.len().saturating_sub(1));
        let (before, after) = (sensed.get(after.saturating_sub(1))?, sensed.get(after)?);
        let span_s = after.time_s - before.time_s;
        let fraction = if span_s > 0.0 { ((time_s - before.time_s) / span_s).clamp(0.0, 1.0) } else { 1.0 };
        let q = before.q + (after.q - before.q) * fraction;
        let width_m = before.width_m + (after.width_m - before.width_m) * fraction;
        Some(Surroundings { arm: known.arm_surface(), X_WL: known.search().motion().robot().link_poses(&q), width_m })
    }
}

/// Images by capture time, those of one time by camera. Copies them only where they come in another order.
fn oldest_first(frames: &[DepthFrame]) -> Cow<'_, [DepthFrame]> {
    let order = |a: &DepthFrame, b: &DepthFrame| a.capture_s.total_cmp(&b.capture_s).then(a.camera.cmp(&b.camera));
    if frames.is_sorted_by(|a, b| order(a, b).is_le()) {
        return Cow::Borrowed(frames);
    }
    let mut sorted = frames.to_vec();
    sorted.sort_by(order);
    Cow::Owned(sorted)
}

/// Adds a pose to those so far, oldest first: images may arrive later than others that were taken after them. Where there are
/// as many as are remembered, the oldest one is forgotten.
fn remember(poses: &mut Vec<ObjectPose>, pose: ObjectPose) {
    if poses.len() == POSES {
        poses.remove(0);
    }
    let at = poses.partition_point(|it| it.capture_s <= pose.capture_s);
    poses.insert(at, pose);
}

/// How many of these images, oldest first, are registered together: those of one capture time, or all within some milliseconds where it is
/// known how the object moves.
fn together(frames: &[DepthFrame], moves_as_known: bool) -> usize {
    let span_s = if moves_as_known { TOGETHER_S } else { 0.0 };
    frames.iter().take_while(|it| it.capture_s - frames[0].capture_s <= span_s).count().max(1)
}
