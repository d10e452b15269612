//! Sightings of one throw by the cameras: positions of the object in single images.

use std::sync::Arc;

use catch_body::{Twist, kinematics::LinkPoses};
use catch_bot::{
    Preparation,
    perception::{ObjectPose, PoseEstimator, Prior, SdfEstimator, Surroundings, View},
    trajectory_prediction::{FlightPredictor, FlightTrajectory, InformationFit},
};
use catch_cell::{Brain, CameraModel, Command, DepthFrame, Observation, PixelWindow, Probe};
use nalgebra::{Matrix3, Point3};

use super::{
    ArmSample, Calibration, CalibrationStatus, arm_at,
    flights::{Flight, Sighting},
};

/// Images that were taken within this time are registered together, once it is known how the object moves.
const TOGETHER_S: f64 = 0.005;
/// Distance beyond which a position is not on the predicted flight, in metres and in standard deviations
/// beside that.
const GATE_M: f64 = 0.05;
const GATE_SD: f64 = 3.0;
/// Images by themselves are registered from so many poses on, when it is known where the object is.
const LEAST_POSES: usize = 4;
/// Number of poses in a row beside the flight that end it: the object has hit something. A flight of few
/// poses was none, and another begins.
const ENDING_POSES: usize = 3;
const FEW_POSES: usize = 8;
/// An object that has not been seen for so long, in seconds, is gone.
const GONE_S: f64 = 0.3;

/// Collects the sightings of one throw of a known object while the arm rests: a brain like any other, for any
/// cell.
///
/// All images together tell the flight. Near it each image is registered by itself.
#[derive(Debug)]
pub struct FlightRun {
    known: Arc<Preparation>,
    time_offsets_s: Vec<f64>,
    /// Cameras whose calibration did not converge.
    left_out: Vec<bool>,
    duration_s: f64,
    estimator: SdfEstimator,
    predictor: InformationFit,
    from_s: Option<f64>,
    is_done: bool,
    arm: Vec<ArmSample>,
    poses: Vec<ObjectPose>,
    flight: Option<FlightTrajectory>,
    beside: usize,
    sightings: Vec<Sighting>,
}

impl FlightRun {
    /// `known` has the object, and the cameras as they are calibrated; `calibration` what is to be added to
    /// their time stamps. It ends after `duration_s`, or when the object has hit something or is gone.
    pub fn new(known: Arc<Preparation>, calibration: &Calibration, duration_s: f64) -> Self {
        Self {
            time_offsets_s: calibration.cameras.iter().map(|it| it.time_offset_s).collect(),
            left_out: calibration.cameras.iter().map(|it| it.status != CalibrationStatus::Converged).collect(),
            duration_s,
            estimator: known.pose_estimator(),
            predictor: known.flight_predictor(0),
            known,
            from_s: None,
            is_done: false,
            arm: Vec::new(),
            poses: Vec::new(),
            flight: None,
            beside: 0,
            sightings: Vec::new(),
        }
    }

    /// Returns whether the flight is over.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Flight that was seen.
    pub fn into_flight(self) -> Flight {
        Flight { sightings: self.sightings }
    }

    /// Takes in images of about one time.
    fn see(&mut self, frames: &[DepthFrame]) {
        let known = self.known.clone();
        let robot = &known.search.motion.robot;
        let arm_at = |frame: &DepthFrame| {
            let sample = arm_at(&self.arm, frame.capture_s)?;
            Some((robot.link_poses(&sample.q), sample.width_m))
        };
        let Some(arm) = frames.iter().map(arm_at).collect::<Option<Vec<(LinkPoses, f64)>>>() else { return };
        let surroundings: Vec<_> =
            arm.into_iter().map(|(X_WL, width_m)| Surroundings { arm: &known.arm_surface, X_WL, width_m }).collect();
        let mut view = View {
            frames,
            cameras: &known.cameras,
            left_out: &self.left_out,
            surroundings: &surroundings,
            V_WO: Twist::default(),
        };
        let time_s = view.capture_s();
        view.V_WO = self.flight.as_ref().map_or(view.V_WO, |it| it.twist_at(time_s));
        let prior = self.flight.as_ref().map_or(Prior::Anywhere, |it| Prior::Pose(it.pose_at(time_s)));
        let Ok(pose) = self.estimator.estimate(&view, prior) else { return };
        if self.flight.as_ref().is_some_and(|it| !is_on(it, &pose)) {
            self.beside += 1;
            if self.beside >= ENDING_POSES && self.poses.len() < FEW_POSES {
                self.forget();
            }
            return;
        }
        self.beside = 0;
        if let Some(flight) = self.flight.as_ref().filter(|_| self.poses.len() >= LEAST_POSES) {
            for (i, frame) in frames.iter().enumerate() {
                let one = View { frames: &frames[i..=i], surroundings: &surroundings[i..=i], ..view };
                let pose = self.estimator.estimate_aside(&one, &flight.pose_at(frame.capture_s));
                let pose = pose.filter(|it| is_on(flight, it));
                let camera = known.cameras.get(frame.camera);
                let sighting = camera.zip(pose).and_then(|(camera, pose)| {
                    let p_WOcm = pose.X_WO * Point3::from(flight.com_O);
                    self.sighting(frame, camera, &p_WOcm, &position_covariance(&pose)?)
                });
                self.sightings.extend(sighting);
            }
        }
        if let Some(T) = self.estimator.turned_over() {
            self.poses.iter_mut().for_each(|it| it.X_WO *= T);
            self.flight = None;
        }
        self.poses.push(pose);
        if let Ok(flight) = self.predictor.predict(&self.poses, self.flight.as_ref()) {
            self.flight = Some(flight);
        }
    }

    /// Begins anew.
    fn forget(&mut self) {
        self.estimator.reset();
        self.predictor.reset();
        (self.flight, self.beside) = (None, 0);
        self.poses.clear();
        self.sightings.clear();
    }

    fn sighting(
        &self,
        frame: &DepthFrame,
        camera: &CameraModel,
        p_W: &Point3<f64>,
        covariance_W: &Matrix3<f64>,
    ) -> Option<Sighting> {
        let R_CW = camera.X_WC.rotation.inverse().to_rotation_matrix();
        Some(Sighting {
            camera: frame.camera,
            capture_s: frame.capture_s - self.time_offsets_s.get(frame.camera)?,
            p_C: camera.X_WC.inverse_transform_point(p_W).coords,
            covariance_C: R_CW * covariance_W * R_CW.inverse(),
        })
    }
}

impl Brain for FlightRun {
    fn tick(&mut self, observation: &Observation, _: &mut dyn Probe) -> Command {
        let (now_s, arm) = (observation.time_s, &observation.arm);
        self.arm.push(ArmSample { time_s: arm.time_s, q: arm.q, dq: arm.dq, width_m: observation.gripper.width_m });
        let mut frames: Vec<DepthFrame> =
            observation.frames.iter().filter(|it| it.window.area() > 0).cloned().collect();
        frames.iter_mut().for_each(|it| it.capture_s += self.time_offsets_s.get(it.camera).unwrap_or(&0.0));
        frames.sort_by(|a, b| a.capture_s.total_cmp(&b.capture_s));
        let mut left = &frames[..];
        while let Some(first) = left.first() {
            let span_s = if self.flight.is_some() { TOGETHER_S } else { 0.0 };
            let count = left.iter().take_while(|it| it.capture_s - first.capture_s <= span_s).count().max(1);
            if self.beside < ENDING_POSES {
                self.see(&left[..count]);
            }
            left = &left[count..];
        }
        let is_over = now_s > *self.from_s.get_or_insert(now_s) + self.duration_s;
        let is_gone =
            self.poses.len() >= FEW_POSES && self.poses.last().is_some_and(|it| now_s > it.capture_s + GONE_S);
        self.is_done = is_over || is_gone || self.beside >= ENDING_POSES;
        let windows = self.known.cameras.iter().map(CameraModel::full_window).collect::<Vec<PixelWindow>>();
        Command { windows: Some(windows), ..Command::default() }
    }

    fn reset(&mut self) {
        (self.from_s, self.is_done) = (None, false);
        self.arm.clear();
        self.forget();
    }
}

/// Returns whether a pose may be one of a flight.
fn is_on(flight: &FlightTrajectory, pose: &ObjectPose) -> bool {
    let off_m = (pose.X_WO.translation.vector - flight.pose_at(pose.capture_s).translation.vector).norm();
    let pose_sd_m = position_covariance(pose).map_or(0.0, |it| it.trace().sqrt());
    off_m < GATE_M + GATE_SD * libm::hypot(pose_sd_m, flight.position_sd_at(pose.capture_s))
}

/// Covariance of the position in W, whatever the orientation is; along directions that the image does not
/// tell it is 1 m.
fn position_covariance(pose: &ObjectPose) -> Option<Matrix3<f64>> {
    let block = |i, j| pose.information.fixed_view::<3, 3>(i, j).into_owned();
    let rotation = (block(0, 0) + Matrix3::identity()).try_inverse()?;
    (block(3, 3) - block(3, 0) * rotation * block(0, 3) + Matrix3::identity()).try_inverse()
}
