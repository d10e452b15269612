//! Tests of segmentation without labels: recall and precision against what the images truly show, with an arm
//! in them.

use std::sync::Arc;

use catch_body::{Gripper, JointVector, Pose, Robot, ray_cast::ArmSurface, robot_file::RobotFiles};
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use catch_bot::perception::{
    Config, DepthNoise, GATE_M, PoseEstimator, Prior, SdfEstimator, Surroundings, View, Workspace,
    segmentation::{Background, Label},
};

use crate::synthetic::{self, Noise, Normal, Shape};

pub fn arm() -> (Robot, Gripper) {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    };
    let gripper = Gripper::from_toml("wsg50.toml", include_str!("../../../../assets/grippers/wsg50.toml")).unwrap();
    (Robot::from_files(&files).unwrap().with_mount_of(&gripper), gripper)
}

/// Images of an object with what the brain knows behind and before it, noise on all of it, and the true
/// masks.
pub struct Scene<'a> {
    pub cameras: &'a [CameraModel],
    pub surroundings: Surroundings<'a>,
    pub config: &'a Config,
    pub noise: Noise,
}

impl Scene<'_> {
    pub fn frames(
        &self,
        shape: &Shape,
        X_WS: &Pose,
        windows: &[PixelWindow],
        normal: &mut Normal,
    ) -> (Vec<DepthFrame>, Vec<Vec<bool>>) {
        let both = self.cameras.iter().zip(windows).enumerate().map(|(i, (camera, window))| {
            let object = synthetic::depth_frame(i, camera, shape, X_WS, 0.03);
            let background = Background::new(camera, Some(&self.surroundings), window, self.config);
            let mut frame = DepthFrame { camera: i, capture_s: 0.0, window: *window, depth_m: Vec::new(), mask: None };
            let mut truth = Vec::new();
            for pixel in 0..window.area() {
                let uv = window.pixel_centre(pixel);
                let (column, row) = (uv.x as u32, uv.y as u32);
                let inside = column >= object.window.left
                    && row >= object.window.top
                    && column < object.window.left + object.window.width
                    && row < object.window.top + object.window.height;
                let seen = if inside {
                    let at = (row - object.window.top) * object.window.width + column - object.window.left;
                    object.depth_m[at as usize]
                } else {
                    f32::NAN
                };
                let behind = background.depth_m(&uv) as f32;
                let shows = seen.is_finite() && seen < behind;
                truth.push(shows);
                let depth = if shows { seen } else { behind };
                let z = f64::from(depth);
                frame.depth_m.push(if z.is_finite() {
                    (z + self.noise.sd(z) * normal.draw()) as f32
                } else {
                    f32::NAN
                });
            }
            (frame, truth)
        });
        both.unzip()
    }
}

/// Position of the object and the conditions under which it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Case {
    noise: Noise,
    floor_visible: bool,
    /// 0.2 m before the gripper instead of on its way.
    at_gripper: bool,
    /// True for windows where the object is expected, false for full images.
    tracked: bool,
}

/// Pixels over several throws, and how far off the poses were.
#[derive(Debug, Default)]
struct Segmented {
    /// Fraction of the object's pixels that were taken for it.
    recall: f64,
    /// Fraction of the pixels taken for the object that show it.
    precision: f64,
    off_m: Vec<f64>,
}

/// Segments images of several throws, in each of which the object must be found.
fn segment(case: Case, trials: u64) -> Segmented {
    let Case { noise, floor_visible, at_gripper, tracked } = case;
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let q: JointVector = robot.ready_q;
    let X_WL = robot.link_poses(&q);
    let X_WG = robot.gripper_in(&X_WL);
    let surroundings = Surroundings { arm: &surface, X_WL, width_m: 0.1 };
    let shape = Shape::banana();
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let config = Config {
        depth_noise: Some(DepthNoise { constant_m, quadratic_per_m }),
        floor_visible: Some(floor_visible),
        ..Config::default()
    };
    let reference = Arc::new(synthetic::reference(&shape, 200));
    let cameras = synthetic::flight_rig();
    let scene = Scene { cameras: &cameras, surroundings, config: &config, noise };
    let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
    let (mut hits, mut wanted, mut taken, mut off_m) = (0, 0, 0, Vec::new());
    for seed in 0..trials {
        let mut normal = Normal::new(seed);
        let mut X_WO = synthetic::pose_in_flight(&mut normal);
        if at_gripper {
            let place = X_WG * Point3::new(0.0, 0.2, 0.0);
            X_WO.translation.vector = place.coords + normal.vector() * 0.03;
        }
        let turn = UnitQuaternion::from_scaled_axis(normal.vector() * 0.02);
        let prior = Pose::from_parts((X_WO.translation.vector + normal.vector() * 0.003).into(), turn * X_WO.rotation);
        let centre = Point3::from(prior.translation.vector);
        let windows: Vec<PixelWindow> = cameras
            .iter()
            .map(|camera| {
                if tracked {
                    camera.window_around(&camera.X_WC.inverse_transform_point(&centre), reference.radius_m + GATE_M)
                } else {
                    camera.full_window()
                }
            })
            .collect();
        let (frames, truth) = scene.frames(&shape, &(X_WO * reference.X_RO.inverse()), &windows, &mut normal);
        let view = View {
            frames: &frames,
            cameras: &cameras,
            surroundings: &vec![surroundings; cameras.len()],
            ..View::default()
        };
        let pose = estimator.estimate(&view, Prior::from(tracked.then_some(prior)));
        for (i, (frame, truth)) in frames.iter().zip(&truth).enumerate() {
            wanted += truth.iter().filter(|shows| **shows).count();
            let Some((part, labels)) = estimator.scene().labels_of(i) else { continue };
            for (at, _) in labels.iter().enumerate().filter(|(_, label)| **label == Label::Object) {
                let uv = part.pixel_centre(at);
                let column = uv.x as usize - frame.window.left as usize;
                let row = uv.y as usize - frame.window.top as usize;
                taken += 1;
                hits += usize::from(truth[row * frame.window.width as usize + column]);
            }
        }
        let pose = pose.unwrap_or_else(|status| panic!("{case:?} {seed}: {status:?}"));
        off_m.push((pose.X_WO.translation.vector - X_WO.translation.vector).norm());
    }
    let fraction = |part: usize, all: usize| part as f64 / all as f64;
    Segmented { recall: fraction(hits, wanted), precision: fraction(hits, taken), off_m }
}

/// Noises, with the least recall and the largest error of a pose in metres.
const NOISES: [(Noise, f64, f64); 3] =
    [(Noise::Clean, 0.97, 0.0006), (Noise::Constant(0.002), 0.97, 0.002), (Noise::Stereo7, 0.88, 0.008)];

fn assert_segmented(floor_visible: bool, at_gripper: bool, tracked: bool, trials: u64) {
    for (noise, least_recall, within_m) in NOISES {
        let case = Case { noise, floor_visible, at_gripper, tracked };
        let found = segment(case, trials);
        assert!(found.recall > least_recall && found.precision > 0.995, "{case:?}: {found:?}");
        assert!(found.off_m.iter().all(|off_m| *off_m < within_m), "{case:?}: {found:?}");
    }
}

#[test]
fn objects_in_front_of_the_arm_are_told_from_it() {
    for floor_visible in [false, true] {
        assert_segmented(floor_visible, true, true, 5);
    }
}

#[test]
fn an_object_is_found_in_full_images() {
    for floor_visible in [false, true] {
        assert_segmented(floor_visible, false, false, 3);
    }
}

/// A thing that stands in the room is an object like the one that flies. Who has seen it before knows better.
#[test]
fn what_the_first_images_show_is_background() {
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.1 };
    let (shape, cameras) = (Shape::banana(), synthetic::flight_rig());
    let reference = Arc::new(synthetic::reference(&shape, 200));
    let noise = Noise::Constant(0.002);
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let depth_noise = Some(DepthNoise { constant_m, quadratic_per_m });
    let windows: Vec<PixelWindow> = cameras.iter().map(CameraModel::full_window).collect();
    let mut normal = Normal::new(3);
    let mut X_WO = [0; 2].map(|_| synthetic::pose_in_flight(&mut normal));
    X_WO[0].translation.vector.x -= 0.3;
    for background_images in [0, 3] {
        let config = Config { depth_noise, background_images, ..Config::default() };
        let scene = Scene { cameras: &cameras, surroundings, config: &config, noise };
        let workspace = Workspace::before_flight(&cameras, &surroundings, &config);
        let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), workspace);
        let mut found = |poses: &[Pose]| {
            let images = poses
                .iter()
                .map(|X_WO| scene.frames(&shape, &(X_WO * reference.X_RO.inverse()), &windows, &mut normal).0);
            let nearest = |mut one: Vec<DepthFrame>, other: Vec<DepthFrame>| {
                for (one, other) in one.iter_mut().zip(other) {
                    one.depth_m.iter_mut().zip(other.depth_m).for_each(|(a, b)| *a = a.min(b));
                }
                one
            };
            let frames = images.reduce(nearest).unwrap();
            let surroundings = vec![surroundings; cameras.len()];
            let view = View { frames: &frames, cameras: &cameras, surroundings: &surroundings, ..View::default() };
            estimator.estimate(&view, Prior::Anywhere).ok()
        };
        for _ in 0..3 {
            assert_eq!(found(&X_WO[..1]).is_some(), background_images == 0, "it stands there");
        }
        if background_images > 0 {
            assert!(found(&X_WO[..1]).is_none(), "it still does");
            let pose = found(&X_WO).expect("one that flies");
            let off_m = (pose.X_WO.translation.vector - X_WO[1].translation.vector).norm();
            assert!(off_m < 0.005, "{off_m}");
        }
    }
}

/// Cables and covers rise from links, and some pose of the object fits to the few pixels of them that show.
#[test]
fn what_rises_from_the_arm_is_not_the_object() {
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.1 };
    let cameras = synthetic::flight_rig();
    let reference = Arc::new(synthetic::reference(&Shape::banana(), 200));
    let noise = Noise::Constant(0.005);
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let depth_noise = Some(DepthNoise { constant_m, quadratic_per_m });
    let config = Config { depth_noise, ..Config::default() };
    let windows: Vec<PixelWindow> = cameras.iter().map(CameraModel::full_window).collect();
    let scene = Scene { cameras: &cameras, surroundings, config: &config, noise };
    let mut shown = 0;
    for (link, X_WL) in surroundings.X_WL.iter().enumerate() {
        for beside in [-0.05, 0.05] {
            let mut normal = Normal::new(link as u64);
            let X_WS = X_WL * Pose::translation(0.0, beside, 0.0);
            let (frames, truth) = scene.frames(&Shape::Sphere { radius: 0.06 }, &X_WS, &windows, &mut normal);
            shown += usize::from(truth.iter().flatten().filter(|shows| **shows).count() > 10);
            let all = vec![surroundings; cameras.len()];
            let view = View { frames: &frames, cameras: &cameras, surroundings: &all, ..View::default() };
            let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
            let found = estimator.estimate(&view, Prior::Anywhere);
            assert!(found.is_err(), "link {link}, {beside} m: {found:?}");
        }
    }
    assert!(shown > 4, "{shown}");
}

/// A camera's image of several objects of one shape, with nothing else.
fn image_of_all(number: usize, camera: &CameraModel, shape: &Shape, all_X_WS: &[Pose]) -> DepthFrame {
    let window = camera.full_window();
    let mut depth_m = vec![f32::NAN; window.area()];
    for X_WS in all_X_WS {
        let object = synthetic::depth_frame(number, camera, shape, X_WS, 0.03);
        for (pixel, seen_m) in object.depth_m.iter().enumerate().filter(|(_, seen_m)| seen_m.is_finite()) {
            let uv = object.window.pixel_centre(pixel);
            let there_m = &mut depth_m[uv.y as usize * camera.width_px as usize + uv.x as usize];
            *there_m = there_m.min(*seen_m);
        }
    }
    DepthFrame { camera: number, capture_s: 0.0, window, depth_m, mask: None }
}

#[test]
fn all_that_could_be_the_object_is_found_once() {
    let (shape, cameras) = (Shape::banana(), synthetic::flight_rig());
    let reference = Arc::new(synthetic::reference(&shape, 200));
    let mut normal = Normal::new(1);
    let [one, mut other] = [(); 2].map(|()| synthetic::pose_in_flight(&mut normal));
    other.translation.vector = one.translation.vector + Vector3::new(0.3, 0.2, 0.1);
    let all = [one, other].map(|X_WO| X_WO * reference.X_RO.inverse());
    let images = (0..).zip(&cameras).map(|(number, camera)| image_of_all(number, camera, &shape, &all));
    let frames: Vec<DepthFrame> = images.collect();
    let view = View { frames: &frames, cameras: &cameras, ..View::default() };
    let mut estimator = SdfEstimator::new(Config::default(), reference, Workspace::default());
    for expected in [&[][..], &[other], &[other, one, one]] {
        let mut found = Vec::new();
        estimator.estimate_all(&view, expected, &mut found);
        assert_eq!(found.len(), 2, "{expected:?}");
        let off_m = |X_WO: &Pose| {
            let offs_m = found.iter().map(|it| (it.X_WO.translation.vector - X_WO.translation.vector).norm());
            offs_m.fold(f64::INFINITY, f64::min)
        };
        assert!(off_m(&one) < 1e-3 && off_m(&other) < 1e-3, "{found:?}");
    }
}
