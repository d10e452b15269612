//! Edge cases of images: no panic, no number that is none, and a status that says what happened, whatever the
//! images show.

use std::sync::Arc;

use catch_body::Pose;
use catch_bot::{
    perception::{Config, ObjectPose, PerceptionStatus, PoseEstimator, ReferenceModel, SdfEstimator, View, Workspace},
    trajectory_prediction::{self, FlightPredictor, InformationFit, PredictionStatus},
};
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Point3, Vector3};

use crate::synthetic::{self, Noise, Normal, Shape};

struct Bench {
    cameras: Vec<CameraModel>,
    shape: Shape,
    reference: Arc<ReferenceModel>,
    config: Config,
    X_WO: Pose,
}

impl Bench {
    fn new() -> Self {
        let (shape, config) = (Shape::banana(), Config::default());
        let reference = Arc::new(ReferenceModel::from_scan(&synthetic::scan(&shape, 100)));
        let X_WO = synthetic::pose_in_flight(&mut Normal::new(2));
        Self { cameras: synthetic::flight_rig(), shape, reference, config, X_WO }
    }

    fn frames_at(&self, X_WO: &Pose) -> Vec<DepthFrame> {
        let X_WR = X_WO * self.reference.X_RO.inverse();
        synthetic::depth_frames(&self.cameras, &self.shape, &X_WR, Noise::Constant(0.001), &mut Normal::new(3))
    }

    fn find_with(
        &self,
        reference: &Arc<ReferenceModel>,
        frames: &[DepthFrame],
        prior: Option<&Pose>,
    ) -> Result<ObjectPose, PerceptionStatus> {
        let mut estimator = SdfEstimator::new(self.config.clone(), reference.clone(), Workspace::default());
        estimator.estimate(&View { frames, cameras: &self.cameras, ..View::default() }, prior.copied().into())
    }

    fn find(&self, frames: &[DepthFrame], prior: Option<&Pose>) -> Result<ObjectPose, PerceptionStatus> {
        let found = self.find_with(&self.reference, frames, prior);
        if let Ok(pose) = &found {
            let numbers = pose.X_WO.to_homogeneous();
            assert!(numbers.iter().chain(pose.information.iter()).all(|value| value.is_finite()));
            assert!(pose.residual_m.is_finite());
        }
        found
    }

    fn off_m(&self, pose: &ObjectPose) -> f64 {
        (pose.X_WO.translation.vector - self.X_WO.translation.vector).norm()
    }

    /// Turns the images into full ones without masks.
    fn full(&self, frames: &[DepthFrame]) -> Vec<DepthFrame> {
        let full = frames.iter().map(|frame| {
            let window = self.cameras[frame.camera].full_window();
            let mut depth_m = vec![f32::NAN; window.area()];
            for (i, depth) in frame.depth_m.iter().enumerate() {
                let uv = frame.window.pixel_centre(i);
                depth_m[uv.y as usize * window.width as usize + uv.x as usize] = *depth;
            }
            DepthFrame { window, depth_m, mask: None, ..frame.clone() }
        });
        full.collect()
    }
}

#[test]
fn empty_frames_and_frames_of_nothing_show_nothing() {
    let bench = Bench::new();
    let mut frames = bench.frames_at(&bench.X_WO);
    assert_eq!(bench.find(&[], None), Err(PerceptionStatus::NoPoints));
    for masks in [true, false] {
        for frame in &mut frames {
            frame.depth_m.fill(f32::NAN);
            frame.mask = frame.mask.take().filter(|_| masks);
        }
        assert_eq!(bench.find(&frames, None), Err(PerceptionStatus::NoPoints));
        assert_eq!(bench.find(&frames, Some(&bench.X_WO)), Err(PerceptionStatus::NoPoints));
    }
    for frame in &mut frames {
        frame.window = Default::default();
        frame.depth_m.clear();
    }
    assert_eq!(bench.find(&frames, Some(&bench.X_WO)), Err(PerceptionStatus::NoPoints));
}

#[test]
fn one_camera_alone_gives_a_pose_that_knows_what_it_cannot_tell() {
    let bench = Bench::new();
    let frames = bench.frames_at(&bench.X_WO);
    let many = bench.find(&frames, Some(&bench.X_WO)).unwrap();
    let frame = frames.iter().find(|frame| frame.mask.iter().flatten().filter(|mask| **mask).count() > 12).unwrap();
    let one = bench.find(std::slice::from_ref(frame), Some(&bench.X_WO)).unwrap();
    assert!(bench.off_m(&one) < 0.02, "{}", bench.off_m(&one));
    let least = |pose: &ObjectPose| pose.information.symmetric_eigenvalues().min();
    assert!(least(&one) < 0.3 * least(&many));
    // Without a prior one view leaves the orientation open, but not where the object is.
    let cold = bench.find(std::slice::from_ref(frame), None).unwrap();
    assert!(bench.off_m(&cold) < 0.02, "{}", bench.off_m(&cold));
}

/// An object that flies straight out of all views is found while images show enough of it; when none shows it
/// any more, the status says so.
#[test]
fn an_object_that_leaves_the_view_is_found_as_long_as_it_is_shown() {
    /// Pixels, over all images, that are always enough to follow it.
    const ENOUGH_PIXELS: usize = 12;
    let bench = Bench::new();
    let mut last = bench.X_WO;
    let (mut found, mut whole) = (0, 0);
    let mut status = None;
    for i in 0..300 {
        let way = Vector3::new(0.045, 0.045, 0.0) * f64::from(i);
        let X_WO = Pose::from_parts((bench.X_WO.translation.vector + way).into(), bench.X_WO.rotation);
        let frames = bench.frames_at(&X_WO);
        let shown = frames.iter().flat_map(|frame| &frame.depth_m).filter(|depth| depth.is_finite()).count();
        match bench.find(&frames, Some(&last)) {
            Ok(pose) => {
                // The rest of an object that most images' edges cut off shows little more than its position.
                let off_m = (pose.X_WO.translation.vector - X_WO.translation.vector).norm();
                whole = whole.max(pose.points);
                let limit_m = if 3 * pose.points < whole { bench.reference.radius_m } else { 0.01 };
                assert!(off_m < limit_m, "{i}: {off_m} m off, {pose:?}");
                last = pose.X_WO;
                found += 1;
            }
            Err(fault) => {
                assert!(shown < ENOUGH_PIXELS, "{i}: {fault:?} though {shown} pixels show it");
                let expected = if shown == 0 { PerceptionStatus::NoPoints } else { PerceptionStatus::TooFewPoints };
                assert_eq!(fault, expected, "{i}: {shown} pixels");
                status = Some(fault);
            }
        }
    }
    assert!(found > 100, "found in {found} image sets only");
    assert_eq!(status, Some(PerceptionStatus::NoPoints), "no camera sees that far");
}

#[test]
fn of_two_objects_the_expected_one_is_followed_and_without_expectation_one_is_found() {
    let bench = Bench::new();
    let mut other = bench.X_WO;
    other.translation.vector += Vector3::new(0.4, -0.3, 0.2);
    let (one, two) = (bench.full(&bench.frames_at(&bench.X_WO)), bench.full(&bench.frames_at(&other)));
    let mut both = one;
    for (frame, two) in both.iter_mut().zip(&two) {
        for (depth, other) in frame.depth_m.iter_mut().zip(&two.depth_m) {
            *depth = depth.min(*other);
        }
    }
    let followed = bench.find(&both, Some(&bench.X_WO)).unwrap();
    assert!(bench.off_m(&followed) < 0.002, "{}", bench.off_m(&followed));
    let found = bench.find(&both, None).unwrap();
    let off_m = bench.off_m(&found).min((found.X_WO.translation.vector - other.translation.vector).norm());
    assert!(off_m < 0.005, "{off_m}");
}

#[test]
fn a_cloud_of_one_point_is_too_few() {
    let bench = Bench::new();
    let mut frames = bench.frames_at(&bench.X_WO);
    frames.truncate(1);
    let first = frames[0].mask.as_ref().unwrap().iter().position(|mask| *mask).unwrap();
    frames[0].mask.iter_mut().flatten().enumerate().for_each(|(i, mask)| *mask = i == first);
    assert_eq!(bench.find(&frames, Some(&bench.X_WO)), Err(PerceptionStatus::TooFewPoints));
    assert_eq!(bench.find(&frames, None), Err(PerceptionStatus::TooFewPoints));
    assert_eq!(ReferenceModel::from_points(&[Point3::origin()], &[Vector3::z()]), ReferenceModel::default());
    let nothing = Arc::new(ReferenceModel::default());
    let found = bench.find_with(&nothing, &frames, None);
    assert_eq!(found, Err(PerceptionStatus::NoReference));
}

#[test]
fn poses_that_make_no_flight_give_a_status() {
    let bench = Bench::new();
    let mut pose = bench.find(&bench.frames_at(&bench.X_WO), None).unwrap();
    let config = trajectory_prediction::Config::default();
    let mut fit = InformationFit::new(config, bench.reference.symmetry, 0);
    let mut flight_of = |poses: &[ObjectPose]| fit.predict(poses, None);
    assert_eq!(flight_of(&[]), Err(PredictionStatus::TooFewPoses));
    assert!(flight_of(&vec![pose; 20]).is_err());
    pose.capture_s = f64::NAN;
    assert!(flight_of(&vec![pose; 20]).is_err());
}

/// A setting made in code is refused as one of a file is, wherever it stands.
#[test]
fn settings_out_of_range_are_named() {
    let fault = |change: fn(&mut catch_bot::Config)| {
        let mut config = catch_bot::Config::default();
        change(&mut config);
        config.check().unwrap_err().to_string()
    };
    for (found, expected) in [
        (
            fault(|it| it.control.closing_force_n = -1.0),
            "settings of the brain: control.closing_force_n: found -1, expected 0.01 to 100000 N",
        ),
        (
            fault(|it| it.perception.camera_sd_rad = f64::NAN),
            "settings of the brain: perception.camera_sd_rad: found nan, expected a finite number",
        ),
        (
            fault(|it| it.perception.background_images = 101),
            "settings of the brain: perception.background_images: found 101, expected 0 to 100",
        ),
        (
            fault(|it| it.grasp_selection.restitution = Some(1.5)),
            "settings of the brain: grasp_selection.restitution: found 1.5, expected 0 to 1",
        ),
    ] {
        assert_eq!(found, expected);
    }
}
