//! While an object is tracked neither perception nor prediction allocates.

use catch_bot::{
    perception::{Config, DepthNoise, PoseEstimator, ReferenceModel, SdfEstimator, View, Workspace},
    trajectory_prediction::{self, AerodynamicPrior, FlightPredictor, InformationFit},
};
use nalgebra::Vector3;
use std::sync::Arc;

use crate::synthetic::{self, Noise, Normal, Shape};

#[test]
fn tracking_and_predicting_allocate_nothing() {
    let cameras = synthetic::flight_rig();
    let simple = trajectory_prediction::Config { drag_prior_sd_per_m: Some(0.02), ..Default::default() };
    let prediction = trajectory_prediction::Config {
        com_sd_m: Some(0.005),
        aerodynamics: AerodynamicPrior { drag_deviation_sd_per_m: 0.01, magnus_sd: 0.002, ..Default::default() },
        ..simple.clone()
    };
    for ((name, shape), noise) in Shape::all().into_iter().zip([Noise::Clean, Noise::Constant(0.002), Noise::Stereo7]) {
        let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
        // The third shape with all that can be expected of images and flights.
        let (prediction, depth_edge_px, depth_common_fraction) =
            if noise == Noise::Stereo7 { (&prediction, Some(2), Some(0.5)) } else { (&simple, None, None) };
        let depth_noise = Some(DepthNoise { constant_m, quadratic_per_m });
        let config = Config { depth_noise, depth_edge_px, depth_common_fraction, ..Config::default() };
        let reference = Arc::new(ReferenceModel::from_scan(&synthetic::scan(&shape, 100)));
        for labelled in [true, false] {
            let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
            let mut fit = InformationFit::new(prediction.clone(), reference.symmetry, 1);
            let (mut poses, mut flight) = (Vec::with_capacity(100), None);
            let mut normal = Normal::new(1);
            let orientation = normal.rotation();
            for i in 0..30 {
                let t = 0.01 * f64::from(i);
                let p_WO = Vector3::new(2.6 - 2.9 * t, 2.6 - 4.0 * t, 0.5 + 3.6 * t - 4.905 * t * t);
                let X_WO = catch_body::Pose::from_parts(p_WO.into(), orientation);
                let X_WR = X_WO * reference.X_RO.inverse();
                let mut frames = synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal);
                for frame in &mut frames {
                    frame.capture_s = t;
                    frame.mask = frame.mask.take().filter(|_| labelled);
                }
                let expected =
                    flight.as_ref().map(|flight: &trajectory_prediction::FlightTrajectory| flight.pose_at(t));
                let mut found = None;
                let allocated = allocation_counter::measure(|| {
                    let view = View { frames: &frames, cameras: &cameras, ..View::default() };
                    let pose = estimator.estimate(&view, expected.into());
                    poses.push(pose.unwrap());
                    found = fit.predict(&poses, flight.as_ref()).ok();
                });
                flight = found;
                // The first images make the buffers as large as they need to be.
                assert!(i < 15 || allocated.count_total == 0, "{name} {labelled} frame {i}: {allocated:?}");
            }
        }
    }
}
