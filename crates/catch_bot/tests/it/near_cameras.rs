//! Tests of images from a few near stereo cameras without masks: edges that bleed, and objects that one
//! camera alone sees.

use std::{f64::consts::PI, sync::Arc};

use catch_body::{Pose, Twist, pose::look_at, ray_cast::ArmSurface};
use catch_bot::perception::{
    Config, DepthNoise, PerceptionStatus, PoseEstimator, Prior, SdfEstimator, Surroundings, Symmetry, View, Workspace,
    segmentation::Background,
};
use catch_cell::{CameraModel, DepthFrame, PixelWindow, sight::DepthBuffer};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use crate::{
    synthetic::{self, Normal, Shape},
    unlabelled::arm,
};

const EDGE_PX: u32 = 2;

fn cameras() -> Vec<CameraModel> {
    let eyes = [[2.0, -1.0, 1.4], [-0.6, 1.6, 1.4], [2.2, 1.8, 1.4]];
    let camera = |eye: [f64; 3]| {
        let X_WC = look_at(&Point3::from(eye), &Point3::new(1.0, 0.4, 0.75));
        CameraModel::with_field_of_view(X_WC, 848, 480, 58.0_f64.to_radians())
    };
    eyes.map(camera).to_vec()
}

fn config() -> Config {
    Config {
        depth_noise: Some(DepthNoise { constant_m: 0.0, quadratic_per_m: 0.08 / (433.0 * 0.05) }),
        depth_common_fraction: Some(0.5),
        depth_dropout: Some(true),
        depth_edge_px: Some(EDGE_PX),
        ..Config::default()
    }
}

/// An image of nothing.
fn empty(index: usize, camera: &CameraModel) -> DepthFrame {
    let window = camera.full_window();
    DepthFrame { camera: index, capture_s: 0.0, window, depth_m: vec![f32::NAN; window.area()], mask: None }
}

/// Lets a quarter of the pixels beside what is there show it too, and adds noise.
fn measured(clean: &DepthFrame, normal: &mut Normal) -> DepthFrame {
    let (wide, reach) = (clean.window.width as usize, EDGE_PX as usize);
    let mut frame = clean.clone();
    for (i, depth_m) in frame.depth_m.iter_mut().enumerate() {
        let (column, row) = (i % wide, i / wide);
        if depth_m.is_nan() && normal.uniform(0.0, 1.0) < 0.25 {
            let columns = column.saturating_sub(reach)..(column + reach + 1).min(wide);
            let rows = row.saturating_sub(reach)..(row + reach + 1).min(clean.window.height as usize);
            let around = rows.flat_map(|row| columns.clone().map(move |column| clean.depth_m[row * wide + column]));
            *depth_m = around.fold(f32::NAN, f32::min);
        }
        let z = f64::from(*depth_m);
        *depth_m += (z * z * 0.08 / (433.0 * 0.05) * normal.draw()) as f32;
    }
    frame
}

/// The arm alone is no object, although pixels beside it seem to be something before nothing.
#[test]
fn edges_of_the_arm_that_bleed_are_no_object() {
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.11 };
    let (cameras, config) = (cameras(), config());
    let clean: Vec<DepthFrame> = (0..)
        .zip(&cameras)
        .map(|(index, camera)| {
            let mut frame = empty(index, camera);
            let background = Background::new(camera, Some(&surroundings), &camera.full_window(), &config);
            frame.depth_m = background.cast_all();
            frame.depth_m.iter_mut().filter(|depth_m| depth_m.is_infinite()).for_each(|depth_m| *depth_m = f32::NAN);
            frame
        })
        .collect();
    let reference = Arc::new(synthetic::reference(&Shape::ball(), 100));
    let found = |config: &Config| {
        let workspace = Workspace::before_flight(&cameras, &surroundings, config);
        let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), workspace);
        let mut normal = Normal::new(1);
        let mut is_found = || {
            let frames: Vec<DepthFrame> = clean.iter().map(|frame| measured(frame, &mut normal)).collect();
            let view = View {
                frames: &frames,
                cameras: &cameras,
                surroundings: &vec![surroundings; cameras.len()],
                ..View::default()
            };
            estimator
                .estimate(&view, Prior::Anywhere)
                .map_or_else(|status| status != PerceptionStatus::NoPoints, |_| true)
        };
        (0..5).filter(|_| is_found()).count()
    };
    assert_eq!(found(&config), 0);
    assert!(found(&Config { depth_edge_px: None, ..config.clone() }) > 0, "edges that nobody expects are objects");
}

/// Whether bodies are drawn or asked ray by ray makes no difference, within the image and at its borders; and
/// what their bounds say of a depth, rays say too.
#[test]
fn drawn_bodies_are_where_their_rays_meet_them() {
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.11 };
    let (cameras, config) = (cameras(), config());
    // In one memory, of which each picture needs another part.
    let mut buffer = DepthBuffer::default();
    let (mut shown, mut before, mut all) = (0, 0, 0);
    for camera in &cameras {
        let PixelWindow { width, height, .. } = camera.full_window();
        for (left, top) in [(0, 0), (width / 3, height / 4), (width / 2, height / 2)] {
            let part = PixelWindow { left, top, width: width - left, height: height / 3 };
            let asked = Background::new(camera, Some(&surroundings), &part, &config);
            let mut drawn = Background::new(camera, Some(&surroundings), &part, &config);
            drawn.draw(&part, || usize::MAX, &mut buffer);
            for uv in (0..part.area()).step_by(37).map(|i| part.pixel_centre(i)) {
                assert_eq!(drawn.depth_m(&uv), asked.depth_m(&uv), "{uv}");
                assert_eq!(drawn.nearest_m(&uv), asked.nearest_m(&uv), "{uv}");
                let nearest_m = asked.nearest_m(&uv);
                let threshold_m = 0.0099 + 4.0 * config.depth_sd_m(nearest_m);
                assert!(!asked.is_before_all(nearest_m - threshold_m, &uv, &config), "{uv}");
                before += usize::from(nearest_m.is_finite() && asked.is_before_all(0.5 * nearest_m, &uv, &config));
                (shown, all) = (shown + usize::from(nearest_m.is_finite()), all + 1);
            }
        }
    }
    assert!(2 * before > shown, "{before} of {shown} depths are before all by the bounds");
    assert!(shown > 100 && all > 2 * shown, "{shown} of {all} pixels show the arm");
}

/// An object that one camera alone shows counts only where no other camera would have seen it.
#[test]
fn one_camera_is_enough_where_no_other_sees() {
    let place = Point3::new(1.0, 0.4, 0.75);
    let reference = Arc::new(synthetic::reference(&Shape::ball(), 100));
    let X_WO = Pose::from_parts(place.coords.into(), UnitQuaternion::identity());
    let mut estimator = SdfEstimator::new(config(), reference.clone(), Workspace::default());
    let mut found = |cameras: &[CameraModel]| {
        let mut seen = synthetic::depth_frame(0, &cameras[0], &Shape::ball(), &(X_WO * reference.X_RO.inverse()), 0.03);
        seen.mask = None;
        let frames = [seen, empty(1, &cameras[1]), empty(2, &cameras[2])];
        let view = View { frames: &frames, cameras, ..View::default() };
        estimator.estimate(&view, Prior::Anywhere).map(|pose| (pose.X_WO.translation.vector - place.coords).norm())
    };
    let mut cameras = cameras();
    assert_eq!(found(&cameras), Err(PerceptionStatus::NoPoints));
    for camera in &mut cameras[1..] {
        let eye = Point3::from(camera.X_WC.translation.vector);
        camera.X_WC = look_at(&eye, &(eye + (eye - place)));
    }
    let off_m = found(&cameras).unwrap();
    assert!(off_m < 0.02, "{off_m}");
}

/// One far camera tells how far away an object is as well as its mean depth does, and says so.
#[test]
fn a_far_object_is_as_far_away_as_its_mean_depth() {
    let camera = CameraModel::with_field_of_view(
        look_at(&Point3::new(3.5, 0.0, 1.0), &Point3::new(0.0, 0.0, 1.0)),
        848,
        480,
        58.0_f64.to_radians(),
    );
    let reference = Arc::new(synthetic::reference(&Shape::ball(), 100));
    let X_WO = Pose::translation(0.0, 0.0, 1.0);
    let mut estimator = SdfEstimator::new(config(), reference.clone(), Workspace::default());
    let mut normal = Normal::new(2);
    for _ in 0..10 {
        let clean = synthetic::depth_frame(0, &camera, &Shape::ball(), &(X_WO * reference.X_RO.inverse()), 0.05);
        let frames = [DepthFrame { mask: None, ..measured(&clean, &mut normal) }];
        let view = View { frames: &frames, cameras: std::slice::from_ref(&camera), ..View::default() };
        let pose = estimator.estimate(&view, Prior::Pose(Pose::translation(0.01, 0.01, 1.0))).unwrap();
        let error = pose.X_WO.translation.vector - X_WO.translation.vector;
        // 45 mm, half of whose variance is common.
        let claimed_m = pose.information[(3, 3)].sqrt().recip();
        assert!((0.02..0.06).contains(&claimed_m), "{claimed_m}");
        assert!(error.x.abs() < 3.0 * claimed_m && error.yz().norm() < 0.01, "{error:?} {claimed_m}");
    }
}

/// A bottle that was taken for upside down is turned over by what all images say, and one that stands right
/// is not.
#[test]
fn which_end_is_which_is_decided_by_all_images() {
    let shape = Shape::Bottle;
    let reference = Arc::new(synthetic::reference(&shape, 200));
    let Symmetry::Axis { axis, .. } = reference.symmetry else { panic!("{:?}", reference.symmetry) };
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    assert!((half_turn * axis).dot(&axis) < -0.99, "{axis:?}");
    let cameras = cameras();
    let mut normal = Normal::new(3);
    for trial in 0..6 {
        let X_WO = Pose::from_parts(Translation3::new(1.0, 0.4, 0.75), normal.rotation());
        let mut estimator = SdfEstimator::new(config(), reference.clone(), Workspace::default());
        let is_wrong = trial % 2 == 0;
        let begun = if is_wrong { X_WO * half_turn } else { X_WO };
        let (mut believed, mut turns) = (begun, 0);
        for _ in 0..15 {
            let X_WR = X_WO * reference.X_RO.inverse();
            let image = |(i, camera): (usize, &CameraModel)| {
                let clean = synthetic::depth_frame(i, camera, &shape, &X_WR, 0.05);
                DepthFrame { mask: None, ..measured(&clean, &mut normal) }
            };
            let frames: Vec<DepthFrame> = cameras.iter().enumerate().map(image).collect();
            let view = View { frames: &frames, cameras: &cameras, ..View::default() };
            believed = estimator.estimate(&view, Prior::Pose(believed)).unwrap().X_WO;
            if let Some(T) = estimator.turned_over() {
                turns += 1;
                let earlier = begun * T;
                assert!((earlier.rotation * axis).dot(&(X_WO.rotation * axis)) > 0.9, "{trial}");
            }
        }
        assert_eq!(turns, usize::from(is_wrong), "{trial}");
        assert!((believed.rotation * axis).dot(&(X_WO.rotation * axis)) > 0.98, "{trial}");
    }
}

/// Images of a few milliseconds, each camera's at its own time, tell the pose in the middle as well as
/// simultaneous ones.
#[test]
fn a_moving_object_is_seen_at_different_times() {
    let shape = Shape::banana();
    let reference = Arc::new(synthetic::reference(&shape, 200));
    let cameras = cameras();
    let mut normal = Normal::new(4);
    let mut error_m = |moves: f64, known: f64| {
        let mut errors_m: Vec<f64> = (0..10)
            .map(|_| {
                let X_WO = Pose::from_parts(Translation3::new(1.0, 0.4, 0.75), normal.rotation());
                let V_WO = Twist { linear: normal.vector() * 3.0, angular: normal.vector() * 8.0 };
                let image = |(i, camera): (usize, &CameraModel)| {
                    let elapsed_s = 0.004 * (i as f64 - 1.0);
                    let turn = UnitQuaternion::from_scaled_axis(V_WO.angular * (moves * elapsed_s));
                    let p_WO = X_WO.translation.vector + V_WO.linear * (moves * elapsed_s);
                    let X_WR = Pose::from_parts(p_WO.into(), turn * X_WO.rotation) * reference.X_RO.inverse();
                    let clean = synthetic::depth_frame(i, camera, &shape, &X_WR, 0.05);
                    DepthFrame { mask: None, capture_s: 0.5 + elapsed_s, ..measured(&clean, &mut normal) }
                };
                let frames: Vec<DepthFrame> = cameras.iter().enumerate().map(image).collect();
                let V_WO = Twist { linear: V_WO.linear * known, angular: V_WO.angular * known };
                let view = View { frames: &frames, cameras: &cameras, V_WO, ..View::default() };
                let mut estimator = SdfEstimator::new(config(), reference.clone(), Workspace::default());
                let pose = estimator.estimate(&view, Prior::Pose(X_WO)).unwrap();
                assert_eq!(pose.capture_s, 0.5);
                let turn = (pose.X_WO.rotation * X_WO.rotation.inverse()).angle();
                (pose.X_WO.translation.vector - X_WO.translation.vector).norm() + turn * reference.radius_m
            })
            .collect();
        errors_m.sort_by(f64::total_cmp);
        errors_m[5]
    };
    let (still, moving, unknown) = (error_m(0.0, 0.0), error_m(1.0, 1.0), error_m(1.0, 0.0));
    assert!(moving < 1.5 * still && unknown > 2.0 * still, "{still} {moving} {unknown}");
}
