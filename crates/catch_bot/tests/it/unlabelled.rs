//! Tests of segmentation without labels: recall and precision against what the images truly show, with an arm in them.

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use std::sync::Arc;

use catch_body::{Gripper, JointVector, Pose, Robot, ray_cast::ArmSurface, robot_file::RobotFiles};
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, UnitQuaternion};

use catch_bot::perception::{
    Config, DepthNoise, PoseEstimator, Prior, SdfEstimator, Surroundings, View, Workspace,
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
    (Robot::from_files(&files).unwrap(), gripper)
}

/// Images of an object with what the brain knows behind and before it, noise on all of it, and the true masks.
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

    /// How many images without mask show the arm, or would if the object were not there.
    pub fn windows_before_arm(&self, frames: &[DepthFrame]) -> usize {
        let shows_arm = |frame: &&DepthFrame| {
            let background =
                Background::new(&self.cameras[frame.camera], Some(&self.surroundings), &frame.window, self.config);
            let pixels = 0..frame.window.area();
            frame.mask.is_none()
                && pixels.into_iter().any(|i| background.depth_m(&frame.window.pixel_centre(i)).is_finite())
        };
        frames.iter().filter(shows_arm).count()
    }
}

/// Errors, recall and precision over several throws: far from the arm or at its gripper, found anew or tracked.
fn segment(noise: Noise, floor_visible: bool, at_gripper: bool, tracked: bool, trials: u64) -> [f64; 5] {
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
    let (mut hits, mut wanted, mut taken, mut found, mut errors_mm, mut degrees) = (0, 0, 0, 0, Vec::new(), Vec::new());
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
                    camera.window_around(
                        &camera.X_WC.inverse_transform_point(&centre),
                        reference.radius_m + config.gate_m,
                    )
                } else {
                    camera.full_window()
                }
            })
            .collect();
        let (frames, truth) = scene.frames(&shape, &(X_WO * reference.X_RO.inverse()), &windows, &mut normal);
        let view = View { frames: &frames, cameras: &cameras, surroundings: Some(&surroundings) };
        let pose = estimator.estimate(&view, Prior::from(tracked.then_some(prior)));
        for (i, (frame, truth)) in frames.iter().zip(&truth).enumerate() {
            wanted += truth.iter().filter(|shows| **shows).count();
            let Some((part, labels)) = estimator.scene().labels_of(i) else { continue };
            for (at, label) in labels.iter().enumerate().filter(|(_, label)| **label == Label::Object) {
                let uv = part.pixel_centre(at);
                let column = uv.x as usize - frame.window.left as usize;
                let row = uv.y as usize - frame.window.top as usize;
                taken += 1;
                hits += usize::from(truth[row * frame.window.width as usize + column]);
                let _ = label;
            }
        }
        match pose {
            Ok(pose) => {
                found += 1;
                errors_mm.push((pose.X_WO.translation.vector - X_WO.translation.vector).norm() * 1e3);
                degrees.push(pose.X_WO.rotation.angle_to(&X_WO.rotation).to_degrees());
            }
            Err(status) => println!("{seed}: {status:?}"),
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let (recall, precision) = (hits as f64 / wanted as f64, hits as f64 / f64::from(taken.max(1) as u32));
    let result = [recall, precision, f64::from(found) / trials as f64, median(&mut errors_mm), median(&mut degrees)];
    println!(
        "{noise:?} floor {floor_visible} gripper {at_gripper} tracked {tracked}: recall {:.1} %, precision {:.1} %, found {:.0} %, \
         {:.2} mm {:.2}°",
        result[0] * 100.0,
        result[1] * 100.0,
        result[2] * 100.0,
        result[3],
        result[4]
    );
    result
}

#[test]
fn objects_in_front_of_the_arm_are_told_from_it() {
    for noise in [Noise::Clean, Noise::Constant(0.002)] {
        let [recall, precision, found, off_mm, _] = segment(noise, false, true, true, 5);
        assert!(recall > 0.97 && precision > 0.995 && found == 1.0 && off_mm < 0.6, "{noise:?}");
    }
}

#[test]
fn an_object_is_found_in_full_images() {
    for noise in [Noise::Clean, Noise::Constant(0.002)] {
        let [recall, precision, found, ..] = segment(noise, true, false, false, 3);
        assert!(recall > 0.97 && precision > 0.995 && found == 1.0, "{noise:?}");
    }
}

#[test]
#[ignore = "takes minutes"]
fn measured_segmentation_without_labels() {
    for noise in [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7] {
        for (floor, at_gripper) in [(false, false), (false, true), (true, false), (true, true)] {
            for tracked in [true, false] {
                segment(noise, floor, at_gripper, tracked, 20);
            }
        }
    }
}
