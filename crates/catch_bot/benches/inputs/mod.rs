//! Inputs of the benches: synthetic images, the poses and flights that follow from them, and an arm.

#![allow(dead_code, reason = "shared by benches, of which each uses a part")]

pub mod arm;

use std::sync::Arc;

use catch_body::Pose;
use catch_bot::{
    perception::{Config, DepthNoise, ObjectPose, PoseEstimator, Prior, ReferenceModel, SdfEstimator, View, Workspace},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::synthetic::{self, Noise, Normal, Shape};

/// Joint angles in which the arm waits in the scenario of the paper.
pub const READY: [f64; 7] = [-1.308, 1.236, 1.116, -1.523, 1.648, 1.472, 0.272];

/// Images of an object by all cameras, in windows around it.
pub struct Images {
    pub cameras: Vec<CameraModel>,
    pub frames: Vec<DepthFrame>,
    /// A predicted X_WO, 2 mm and 1° off.
    pub prior: Pose,
}

impl Images {
    pub fn new(shape: &Shape, reference: &ReferenceModel, noise: Noise) -> Self {
        let cameras = synthetic::flight_rig();
        let mut normal = Normal::new(1);
        let X_WO = synthetic::pose_in_flight(&mut normal);
        let frames = synthetic::depth_frames(&cameras, shape, &(X_WO * reference.X_RO.inverse()), noise, &mut normal);
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, -0.01, 0.01));
        let p_WO = X_WO.translation.vector + Vector3::new(0.001, -0.001, 0.001);
        Self { cameras, frames, prior: Pose::from_parts(p_WO.into(), rotation * X_WO.rotation) }
    }
}

/// Noise of their depths, in metres.
const NOISE_M: f64 = 0.002;

/// Thirty poses of an object in flight, 10 ms apart.
pub fn poses(shape: &Shape, reference: &Arc<ReferenceModel>) -> Vec<ObjectPose> {
    let cameras = synthetic::flight_rig();
    let mut normal = Normal::new(1);
    let depth_noise = Some(DepthNoise { constant_m: NOISE_M, quadratic_per_m: 0.0 });
    let config = Config { depth_noise, ..Config::default() };
    let mut estimator = SdfEstimator::new(config, reference.clone(), Workspace::default());
    let mut poses = Vec::new();
    for i in 0..30 {
        let time_s = 0.01 * f64::from(i);
        let p_WO = Vector3::new(2.6 - 2.9 * time_s, 2.6 - 4.0 * time_s, 0.5 + 3.6 * time_s - 4.905 * time_s * time_s);
        let X_WO = Pose::new(p_WO, Vector3::new(0.3, 2.0 * time_s, 0.1));
        let X_WR = X_WO * reference.X_RO.inverse();
        let mut frames = synthetic::depth_frames(&cameras, shape, &X_WR, Noise::Constant(NOISE_M), &mut normal);
        frames.iter_mut().for_each(|frame| frame.capture_s = time_s);
        let view = View { frames: &frames, cameras: &cameras, ..View::default() };
        poses.extend(estimator.estimate(&view, Prior::Pose(X_WO)));
    }
    poses
}

/// The paper's near throw.
pub fn near_throw() -> FlightTrajectory {
    FlightTrajectory {
        p_WOcm: Point3::new(1.66613, 1.63277, 0.3),
        v_WOcm: Vector3::new(-1.58705, -2.68301, 3.75643),
        ..FlightTrajectory::default()
    }
}
