use std::sync::Arc;

use catch_body::Pose;
use catch_bot::{
    perception::{self, DepthNoise, ObjectPose, PoseEstimator, Prior, ReferenceModel, SdfEstimator, View, Workspace},
    trajectory_prediction::{Config, FlightPredictor, FlightTrajectory, InformationFit},
};
use catch_paper::{IcpEstimator, RansacPredictor, registration};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::synthetic::{self, Noise, Normal, Shape};

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn icp(perception: perception::Config, reference: &Arc<ReferenceModel>) -> IcpEstimator {
    IcpEstimator::new(registration::Config::default(), perception, reference.clone(), Workspace::default()).unwrap()
}

/// From a start that is off by 2 cm and 10°.
#[test]
fn icp_gives_the_pose_less_well() {
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        let mut estimator = icp(perception::Config::default(), &reference);
        let (mut position_mm, mut rotation_deg) = (Vec::new(), Vec::new());
        for seed in 0..30 {
            let mut normal = Normal::new(seed);
            let X_WO = synthetic::pose_in_flight(&mut normal);
            let X_WR = X_WO * reference.X_RO.inverse();
            let frames = synthetic::depth_frames(&cameras, &shape, &X_WR, Noise::Clean, &mut normal);
            let turn = UnitQuaternion::from_scaled_axis(normal.vector() * 0.1);
            let prior =
                Pose::from_parts((X_WO.translation.vector + normal.vector() * 0.012).into(), turn * X_WO.rotation);
            let view = View { frames: &frames, cameras: &cameras, surroundings: None };
            let found = estimator.estimate(&view, Prior::Pose(prior)).ok();
            let off = |of: &dyn Fn(&ObjectPose) -> f64| found.as_ref().map_or(f64::INFINITY, of);
            position_mm.push(off(&|it| (it.X_WO.translation.vector - X_WO.translation.vector).norm() * 1e3));
            let turned = |it: &ObjectPose| reference.symmetry.turn_between(&it.X_WO.rotation, &X_WO.rotation).norm();
            rotation_deg.push(off(&turned).to_degrees());
        }
        let (position_mm, rotation_deg) = (median(&mut position_mm), median(&mut rotation_deg));
        println!("{name}: {position_mm:.4} mm {rotation_deg:.4}°");
        assert!(position_mm < 5.0 && rotation_deg < 8.0, "{name}: {position_mm} mm, {rotation_deg}°");
    }
}

/// Pose estimation and flight prediction of one method, and what they have found.
struct Method {
    estimator: Box<dyn PoseEstimator>,
    predictor: Box<dyn FlightPredictor>,
    poses: Vec<ObjectPose>,
    flight: Option<FlightTrajectory>,
}

impl Method {
    fn see(&mut self, view: &View<'_>) {
        let expected = self.flight.as_ref().map(|flight| flight.pose_at(view.frames[0].capture_s));
        let Ok(pose) = self.estimator.estimate(view, expected.into()) else { return };
        self.poses.push(pose);
        self.flight = self.predictor.predict(&self.poses, self.flight.as_ref()).ok().or(self.flight.take());
    }
}

/// Ours and the paper's, told how noisy the cameras are.
fn both(noise: Noise, reference: &Arc<ReferenceModel>, seed: u64) -> [Method; 2] {
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let depth_noise = Some(DepthNoise { constant_m, quadratic_per_m });
    let perception = perception::Config { depth_noise, ..Default::default() };
    let prediction = Config { spin_prior_sd_radps: 0.1, ..Config::default() };
    let symmetry = reference.symmetry;
    let ours = SdfEstimator::new(perception.clone(), reference.clone(), Workspace::default());
    let stages: [(Box<dyn PoseEstimator>, Box<dyn FlightPredictor>); 2] = [
        (Box::new(ours), Box::new(InformationFit::new(prediction.clone(), symmetry, seed))),
        (Box::new(icp(perception, reference)), Box::new(RansacPredictor::new(prediction, symmetry, seed))),
    ];
    stages.map(|(estimator, predictor)| Method { estimator, predictor, poses: Vec::new(), flight: None })
}

/// The table in `docs/perception.md`: twenty images of each throw, one in ten an outlier, and the error at the catch.
#[test]
#[ignore = "takes minutes"]
fn measured_against_the_papers_method() {
    const CATCH_S: f64 = 0.7;
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        for noise in [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7] {
            let mut errors_mm = [Vec::new(), Vec::new()];
            for seed in 0..24 {
                let mut normal = Normal::new(seed);
                let throw = FlightTrajectory {
                    p_WO: Point3::new(2.66613, 2.6152, 0.5) + normal.vector() * 0.05,
                    v_WO: Vector3::new(-2.95994, -4.06236, 3.5882) + normal.vector() * 0.1,
                    R_WO: normal.rotation(),
                    ..FlightTrajectory::default()
                };
                let mut methods = both(noise, &reference, seed);
                for i in 0..20 {
                    let capture_s = 0.01 * f64::from(i);
                    let mut shown = throw.pose_at(capture_s);
                    let away = normal.vector().normalize() * normal.uniform(0.05, 0.2);
                    if normal.uniform(0.0, 1.0) < 0.1 {
                        shown.translation.vector += away;
                    }
                    let X_WR = shown * reference.X_RO.inverse();
                    let mut frames = synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal);
                    frames.iter_mut().for_each(|frame| frame.capture_s = capture_s);
                    let view = View { frames: &frames, cameras: &cameras, surroundings: None };
                    methods.iter_mut().for_each(|method| method.see(&view));
                }
                let truth = throw.pose_at(CATCH_S).translation.vector;
                for (method, errors_mm) in methods.iter().zip(&mut errors_mm) {
                    let off_m = |it: &FlightTrajectory| (it.pose_at(CATCH_S).translation.vector - truth).norm();
                    errors_mm.push(method.flight.as_ref().map_or(f64::INFINITY, off_m) * 1e3);
                }
            }
            let [ours_mm, papers_mm] = errors_mm.map(|mut errors_mm| median(&mut errors_mm));
            println!("{name} {noise:?}: ours {ours_mm:.2} mm, the paper's {papers_mm:.2} mm");
        }
    }
}
