//! The tracker: what was sensed lately, the cameras as far as they are aligned, and the poses so far of all
//! that could be the object.

pub(crate) mod tracks;

use std::{borrow::Cow, collections::VecDeque};

use catch_body::{JointVector, Twist};
use catch_cell::{CameraModel, DepthFrame, Observation, PixelWindow};

use crate::{
    perception::{
        GATE_M, ObjectPose, PoseEstimator, Surroundings, View, camera_alignment::CameraAlignment,
        camera_health::CameraHealth, camera_offsets::CameraOffset,
    },
    preparation::Preparation,
    trajectory_prediction::FlightTrajectory,
};
use tracks::{POSES, Tracks};

/// Observations whose joint angles are remembered: longer than images can take to arrive.
const SENSED: usize = 64;
/// Images that were taken within this time are registered together, once it is known how the object moves.
const TOGETHER_S: f64 = 0.01;
/// An object that has not been seen for this long is looked for everywhere, in seconds.
const LOST_AFTER_S: f64 = 0.05;

/// Readings of the encoders at one time.
#[derive(Debug, Clone, Copy)]
struct Sensed {
    time_s: f64,
    q: JointVector,
    /// Aperture of the gripper.
    width_m: f64,
}

/// Observations of the arm and of the object.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    /// The cameras, as far as images of the arm have told where they look.
    alignment: CameraAlignment,
    /// Faults of the cameras.
    pub health: CameraHealth,
    /// Readings of the encoders, oldest first.
    sensed: VecDeque<Sensed>,
    /// Times of the newest observation with images and of the one before.
    imaged_s: [Option<f64>; 2],
    /// The object, and what else moves.
    pub tracks: Tracks,
    /// True if single images are also registered by themselves: for operation over many throws, which reveal
    /// displaced cameras.
    pub compares_cameras: bool,
    /// Number of single images that were registered by themselves.
    compared: usize,
    /// Poses from single images, each with its camera.
    image_poses: Vec<(usize, ObjectPose)>,
}

impl Tracker {
    pub fn new(known: &Preparation, compares_cameras: bool) -> Self {
        Self {
            alignment: known.alignment.clone(),
            health: known.camera_health.clone(),
            sensed: VecDeque::with_capacity(SENSED),
            imaged_s: [None; 2],
            tracks: Tracks::new(),
            compares_cameras,
            compared: 0,
            image_poses: Vec::with_capacity(POSES),
        }
    }

    /// The object's flight as predicted last.
    pub fn flight(&self) -> Option<&FlightTrajectory> {
        self.tracks.object.flight.as_ref()
    }

    /// Offset of each camera from a flight, by its own images.
    pub fn camera_offsets(&self, flight: &FlightTrajectory) -> Vec<CameraOffset> {
        let images = self.image_poses.iter().map(|(camera, pose)| {
            let shift_m = pose.X_WO.translation.vector - flight.pose_at(pose.capture_s).translation.vector;
            (*camera, pose, flight.time_s - pose.capture_s, shift_m)
        });
        CameraOffset::of_throw(images, self.alignment.cameras.len())
    }

    /// A throw has begun: what single images showed before tells nothing of it.
    pub fn begin_throw(&mut self) {
        self.image_poses.clear();
    }

    /// Forgets the throw, and remembers what is wrong with the cameras, also by how far they were off in it.
    pub fn end_throw(&mut self, offsets: &[CameraOffset], known: &Preparation) {
        self.health.end_throw(offsets, &known.config.perception);
        let (health, compared) = (self.health.clone(), self.compared);
        *self = Self { health, compared, ..Self::new(known, self.compares_cameras) };
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

    /// Takes in new images, capture time by capture time, in whatever order they come. Returns the newest
    /// pose of the object that they show, if any. Where they show that it was taken for turned over, earlier
    /// poses are turned, and there is no flight any more.
    pub fn track(
        &mut self,
        frames: &[DepthFrame],
        known: &Preparation,
        estimator: &mut dyn PoseEstimator,
    ) -> Option<ObjectPose> {
        // Whether the object is lost is told by the images before these.
        let before_s = self.tracks.unlabelled_s.unwrap_or(f64::NEG_INFINITY);
        let unlabelled_s = frames.iter().filter(|frame| frame.mask.is_none()).map(|frame| frame.capture_s);
        self.tracks.unlabelled_s = self.tracks.unlabelled_s.into_iter().chain(unlabelled_s).reduce(f64::max);
        let frames = oldest_first(frames);
        let (mut newest, mut left, mut surroundings) = (None, &frames[..], Vec::with_capacity(frames.len()));
        while !left.is_empty() {
            let (frames, later) = left.split_at(together(left, self.tracks.followed(before_s).is_some()));
            left = later;
            surroundings.clear();
            for frames in frames.chunk_by(|a, b| a.capture_s == b.capture_s) {
                let of_arm = self.surroundings(known, frames[0].capture_s);
                let (cameras, config) = (&known.cameras, &known.config.perception);
                self.health.observe(frames, cameras, of_arm.as_ref(), config);
                self.alignment.observe(frames, cameras, of_arm.as_ref(), config);
                surroundings.extend(frames.iter().filter_map(|_| of_arm));
            }
            let (cameras, left_out) = (&self.alignment.cameras, &self.health.left_out);
            let mut view = View { frames, cameras, left_out, surroundings: &surroundings, V_WO: Twist::default() };
            let followed = self.tracks.followed(before_s);
            view.V_WO = followed.map_or(view.V_WO, |flight| flight.twist_at(view.capture_s()));
            if let Some(flight) = followed.filter(|_| self.compares_cameras && self.image_poses.len() < POSES) {
                // One image of these by itself, in turn.
                let i = self.compared % frames.len();
                self.compared = self.compared.wrapping_add(1);
                let one = View { frames: &frames[i..=i], surroundings: surroundings.get(i..=i).unwrap_or(&[]), ..view };
                let pose = estimator.estimate_aside(&one, &flight.pose_at(one.capture_s()));
                self.image_poses.extend(pose.map(|pose| (frames[i].camera, pose)));
            }
            let are_labelled = frames.iter().all(|frame| frame.mask.is_some());
            let pose = match followed.is_some() || are_labelled {
                true => self.tracks.follow(&view, &known.reference, estimator),
                false => self.tracks.search(&view, &known.reference, estimator),
            };
            newest = pose.or(newest);
        }
        newest
    }

    /// The part of each camera's next images that may show the object, once it is followed in images without
    /// masks (sensors that tell objects apart read out the right pixels by themselves). Full images if it has
    /// been lost.
    pub fn windows(&self, observation: &Observation, known: &Preparation) -> Option<Vec<PixelWindow>> {
        let flight = self.tracks.followed(self.tracks.unlabelled_s?)?;
        let mut sensed_s = self.sensed.iter().rev().map(|sensed| sensed.time_s);
        let period_s = sensed_s.next().zip(sensed_s.next()).map_or(0.0, |(now_s, before_s)| now_s - before_s);
        let next_s = observation.time_s + period_s;
        let (p_WO, v_WO) = (flight.pose_at(next_s).translation.vector, flight.twist_at(next_s).linear);
        let radius_m = known.reference.radius_m + GATE_M + 3.0 * flight.position_sd_at(next_s) + v_WO.norm() * period_s;
        let window = |(camera, left_out): (&CameraModel, &bool)| match left_out {
            true => PixelWindow::default(),
            false => camera.window_around(&camera.X_WC.inverse_transform_point(&p_WO.into()), radius_m),
        };
        Some(self.alignment.cameras.iter().zip(&self.health.left_out).map(window).collect())
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
        Some(Surroundings { arm: &known.arm_surface, X_WL: known.search.motion.robot.link_poses(&q), width_m })
    }
}

/// Images by capture time, those of one time by camera. Copies them only where they come in another order.
fn oldest_first(frames: &[DepthFrame]) -> Cow<'_, [DepthFrame]> {
    let order = |a: &DepthFrame, b: &DepthFrame| a.capture_s.total_cmp(&b.capture_s).then(a.camera.cmp(&b.camera));
    let mut sorted = Cow::Borrowed(frames);
    if !frames.is_sorted_by(|a, b| order(a, b).is_le()) {
        sorted.to_mut().sort_by(order);
    }
    sorted
}

/// Number of these images, oldest first, that are registered together: those of one capture time, or all
/// within some milliseconds where the object's motion is known.
fn together(frames: &[DepthFrame], moves_as_known: bool) -> usize {
    let span_s = if moves_as_known { TOGETHER_S } else { 0.0 };
    frames.iter().take_while(|it| it.capture_s - frames[0].capture_s <= span_s).count().max(1)
}

#[cfg(test)]
pub(crate) mod tests {
    use catch_body::{Gripper, Pose, Robot, robot_file::RobotFiles};
    use catch_cell::{ArmState, GraspState, GripperState, Setpoint};
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::{
        Config,
        perception::{PerceptionStatus, Prior, synthetic},
    };

    /// Shows nothing; remembers which camera's image it was asked for by itself.
    struct Blind(Vec<usize>);

    impl PoseEstimator for Blind {
        fn estimate(&mut self, _: &View<'_>, _: Prior) -> Result<ObjectPose, PerceptionStatus> {
            Err(PerceptionStatus::NoPoints)
        }

        fn estimate_aside(&mut self, view: &View<'_>, _: &Pose) -> Option<ObjectPose> {
            self.0.extend(view.frames.iter().map(|it| it.camera));
            None
        }
    }

    pub fn preparation() -> Preparation {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
        };
        let gripper = Gripper::from_toml("gripper.toml", include_str!("../../../assets/grippers/wsg50.toml")).unwrap();
        let scan = synthetic::scan(&synthetic::Shape::ball(), 40);
        let robot = Robot::from_files(&files).unwrap();
        Preparation::new(Config::default(), (robot, None), gripper, synthetic::flight_rig(), &scan).unwrap()
    }

    pub fn observation(time_s: f64, known: &Preparation, frames: Vec<DepthFrame>) -> Observation {
        let q = known.search.motion.robot.ready_q;
        let (dq, commanded) = (JointVector::zeros(), Setpoint::at_rest(q));
        let arm = ArmState { time_s, q, dq, commanded, executing: None, rejected: Vec::new() };
        let gripper = GripperState { width_m: 0.1, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle };
        Observation { time_s, arm, gripper, frames }
    }

    /// As long as it is not known what flies to the arm, all pixels are needed.
    #[test]
    fn windows_are_around_a_flight_that_leads_to_the_arm() {
        let known = preparation();
        let mut tracker = Tracker::new(&known, false);
        let v_WOcm = Vector3::new(-2.9, -4.0, 3.6);
        let flight = FlightTrajectory { p_WOcm: Point3::new(2.6, 2.6, 0.5), v_WOcm, ..FlightTrajectory::default() };
        tracker.tracks.object.flight = Some(flight.clone());
        let windows = |tracker: &Tracker| tracker.windows(&observation(0.06, &known, Vec::new()), &known);
        tracker.tracks.unlabelled_s = Some(0.0);
        assert_eq!(windows(&tracker), None, "it is not followed");
        tracker.tracks.is_followed = true;
        let place = Point3::from(flight.pose_at(0.06).translation.vector);
        for (camera, window) in known.cameras.iter().zip(windows(&tracker).unwrap()) {
            let uv = camera.project(&camera.X_WC.inverse_transform_point(&place)).unwrap();
            let in_image = camera.full_window().contains(&uv);
            assert!(window.contains(&uv) || !in_image, "{uv} is not in {window:?}");
            assert!(10 * window.area() < camera.full_window().area(), "{window:?}");
        }
        tracker.tracks.unlabelled_s = Some(2.0 * LOST_AFTER_S);
        assert_eq!(windows(&tracker), None, "the object has been lost");
    }

    /// Finds the object at its mask alone.
    struct AtMask;

    impl PoseEstimator for AtMask {
        fn estimate(&mut self, view: &View<'_>, _: Prior) -> Result<ObjectPose, PerceptionStatus> {
            Ok(tracks::tests::pose(view.capture_s(), Point3::origin()))
        }

        fn estimate_all(&mut self, _: &View<'_>, _: &[Pose], _: &mut Vec<ObjectPose>) {}
    }

    #[test]
    fn a_mask_is_believed_after_an_image_without() {
        let known = preparation();
        let mut tracker = Tracker::new(&known, false);
        let found = [(0.0, None), (0.01, Some(Vec::new())), (0.02, None)].map(|(capture_s, mask)| {
            let window = PixelWindow::default();
            let frames = vec![DepthFrame { camera: 0, capture_s, window, depth_m: Vec::new(), mask }];
            tracker.sense(&observation(capture_s, &known, frames.clone()));
            tracker.track(&frames, &known, &mut AtMask).is_some()
        });
        assert_eq!(found, [false, true, false]);
    }

    /// Each camera is compared in turn, even where no pose is found; a turn by the number of poses would end
    /// there.
    #[test]
    fn each_camera_gets_its_turn_to_be_compared() {
        let known = preparation();
        let cameras = known.cameras.len();
        let (mut tracker, mut blind) = (Tracker::new(&known, true), Blind(Vec::new()));
        tracker.tracks.object.flight = Some(FlightTrajectory { v_WOcm: Vector3::x(), ..FlightTrajectory::default() });
        tracker.tracks.is_followed = true;
        for i in 0..2 * cameras {
            let time_s = 0.02 * i as f64;
            let frame = |camera: usize| DepthFrame {
                camera,
                capture_s: time_s,
                window: PixelWindow::default(),
                depth_m: Vec::new(),
                mask: Some(Vec::new()),
            };
            let observation = observation(time_s, &known, (0..cameras).map(frame).collect());
            tracker.sense(&observation);
            let found = tracker.track(&observation.frames, &known, &mut blind);
            assert_eq!(found, None);
        }
        let turns: Vec<usize> = (0..cameras).chain(0..cameras).collect();
        assert_eq!(blind.0, turns);
    }
}
