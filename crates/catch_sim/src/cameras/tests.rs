//! Tests of the cameras' images, against closed forms and against themselves.

mod measured;
mod near_rigs;

use catch_body::{
    Gripper, JointVector, Pose, Robot, TriangleMesh,
    ray_cast::ArmSurface,
    robot_file::RobotFiles,
    shape::{Capsule, Cuboid},
};
use catch_cell::{CameraModel, DepthFrame, PixelWindow, reference_scan, rig_from_toml};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{DepthCameras, Readout, Renderer, Scene};
use crate::depth_noise::DepthConfig;

const PAPER_FLIGHT: &str = include_str!("../../../../assets/rigs/paper_flight.toml");
const REFERENCE: &str = include_str!("../../../../assets/rigs/reference.toml");

pub(super) fn iiwa() -> Robot {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    };
    Robot::from_files(&files).unwrap().with_mount_of(&wsg50())
}

fn wsg50() -> Gripper {
    Gripper::from_toml("wsg50.toml", include_str!("../../../../assets/grippers/wsg50.toml")).unwrap()
}

pub(super) fn flight_rig() -> Vec<CameraModel> {
    rig_from_toml("paper_flight.toml", PAPER_FLIGHT).unwrap()
}

/// A tennis ball, 67.2 mm wide.
pub(super) fn ball() -> TriangleMesh {
    TriangleMesh::sphere(0.0336, 4)
}

pub(super) fn long_object() -> TriangleMesh {
    TriangleMesh::capsule(
        &Capsule { from: Point3::new(0.0, 0.0, -0.07), to: Point3::new(0.0, 0.02, 0.07), radius: 0.018 },
        24,
    )
}

pub(super) fn renderer(object: &TriangleMesh, floor_visible: bool) -> Renderer {
    Renderer::new(&iiwa(), &wsg50(), object, floor_visible)
}

/// The images of one exposure of all cameras.
pub(super) fn captured(
    cameras: &DepthCameras,
    renderer: &Renderer,
    scene: &Scene,
    exposure: u64,
    readout: Readout,
    labelled: bool,
) -> Vec<DepthFrame> {
    let exposures = (0..cameras.cameras().len()).map(|camera| (camera, exposure));
    cameras.capture(renderer, scene, exposures, readout, labelled)
}

/// Images without any error.
pub(super) fn exact_images(
    renderer: &Renderer,
    rig: &[CameraModel],
    scene: &Scene,
    readout: Readout,
    labelled: bool,
) -> Vec<DepthFrame> {
    captured(&DepthCameras::new(rig, &DepthConfig::default(), 0, 0), renderer, scene, 0, readout, labelled)
}

fn labelled_pixels(frames: &[DepthFrame]) -> usize {
    frames.iter().flat_map(|frame| frame.mask.iter().flatten()).filter(|shown| **shown).count()
}

/// The part of a full image that a window covers.
pub(super) fn cut(full: &DepthFrame, window: PixelWindow) -> DepthFrame {
    let indices = (0..window.height).flat_map(|row| {
        let start = (window.top + row) * full.window.width + window.left;
        start..start + window.width
    });
    let indices: Vec<usize> = indices.map(|index| index as usize).collect();
    DepthFrame {
        window,
        depth_m: indices.iter().map(|&index| full.depth_m[index]).collect(),
        mask: full.mask.as_ref().map(|mask| indices.iter().map(|&index| mask[index]).collect()),
        ..*full
    }
}

pub(super) fn bits(frame: &DepthFrame) -> Vec<u32> {
    frame.depth_m.iter().map(|depth| depth.to_bits()).collect()
}

/// Poses of arm and object with the object free, close to the gripper, and between its fingers.
pub(super) fn scenes() -> Vec<(JointVector, f64, Pose)> {
    let robot = iiwa();
    let mut scenes = vec![(robot.ready_q, 0.11, Pose::translation(1.2, 1.0, 0.8))];
    for (turn, q) in [robot.ready_q, robot.comfortable_q, JointVector::repeat(0.4)].into_iter().enumerate() {
        let q = JointVector::from_fn(|i, _| if i < robot.dof() { q[i] } else { 0.0 });
        let X_WG = robot.gripper_pose(&q);
        for (width_m, p_GO) in [(0.0672, Vector3::new(0.0, 0.0833, 0.0)), (0.11, Vector3::new(0.02, 0.1, 0.3))] {
            let X_GO = Pose::from_parts(p_GO.into(), UnitQuaternion::from_scaled_axis(Vector3::repeat(turn as f64)));
            scenes.push((q, width_m, X_WG * X_GO));
        }
    }
    scenes
}

#[test]
fn a_window_equals_that_part_of_the_full_image_bit_for_bit() {
    let robot = iiwa();
    let mut occluded = 0;
    for floor_visible in [false, true] {
        let renderer = renderer(&long_object(), floor_visible);
        for (q, width_m, X_WO) in scenes() {
            let scene = Scene { capture_s: 0.3, X_WL: robot.link_poses(&q), width_m, X_WO };
            let full = exact_images(&renderer, &flight_rig(), &scene, Readout::Full, true);
            let tracked = exact_images(&renderer, &flight_rig(), &scene, Readout::Object, true);
            let windows: Vec<PixelWindow> =
                (0..20).map(|i| PixelWindow { left: 150 + i, top: 90, width: 60 + i, height: 80 }).collect();
            let asked = exact_images(&renderer, &flight_rig(), &scene, Readout::Windows(&windows), true);
            for frames in [&tracked, &asked] {
                for (frame, full) in frames.iter().zip(&full) {
                    let expected = cut(full, frame.window);
                    assert_eq!(bits(frame), bits(&expected));
                    assert_eq!((&frame.mask, frame.camera), (&expected.mask, expected.camera));
                }
            }
            // The window around the object holds all of it.
            assert_eq!(labelled_pixels(&tracked), labelled_pixels(&full));
            let hidden =
                |frame: &DepthFrame| frame.window.area() > 0 && !frame.mask.iter().flatten().any(|shown| *shown);
            occluded += tracked.iter().filter(|frame| hidden(frame)).count();
        }
    }
    assert!(occluded > 5, "the arm hides the object from some cameras: {occluded}");
}

#[test]
fn a_ball_covers_the_pixels_of_its_outline() {
    let robot = iiwa();
    let renderer = renderer(&ball(), false);
    // The catching pose of the near throw, the arm turned out of the way.
    let X_WO = Pose::translation(0.555, -0.245, 0.526);
    let q = robot.joint_vector(&[2.5, 0.6, 0.0, -1.75, 0.0, 1.0, 0.0]).unwrap();
    let scene = Scene { capture_s: 0.7, X_WL: robot.link_poses(&q), width_m: 0.11, X_WO };
    let frames = exact_images(&renderer, &flight_rig(), &scene, Readout::Object, true);
    let pixels = labelled_pixels(&frames);
    // The outline is an ellipse with the area π·f²·r²·√(d² − r²)/(z² − r²)^(3/2) at the distance d and depth
    // z: 193 pixels in all twenty cameras.
    let outline = |camera: &CameraModel| {
        let p_C = camera.X_WC.inverse() * Point3::from(X_WO.translation.vector);
        let square = 0.0336_f64.powi(2);
        let stretch = (p_C.coords.norm_squared() - square).sqrt() / libm::pow(p_C.z * p_C.z - square, 1.5);
        std::f64::consts::PI * camera.focal_px.powi(2) * square * stretch
    };
    let expected: f64 = flight_rig().iter().map(outline).sum();
    assert!((pixels as f64 / expected - 1.0).abs() < 0.03, "{pixels} pixels for an area of {expected}");
    for frame in &frames {
        let camera = &flight_rig()[frame.camera];
        assert_eq!(frame.capture_s, 0.7);
        for (pixel, depth) in frame.depth_m.iter().enumerate().filter(|(pixel, _)| frame.mask.as_ref().unwrap()[*pixel])
        {
            // Every labelled point lies on the ball, up to its facets and single precision at 7 m.
            let p_C = camera.back_project(&frame.window.pixel_centre(pixel), f64::from(*depth));
            let p_O = X_WO.inverse() * (camera.X_WC * p_C);
            assert!((p_O.coords.norm() - 0.0336).abs() < 60e-6, "{}", p_O.coords.norm());
        }
    }
}

#[test]
fn the_arm_is_seen_where_it_is_and_the_floor_only_if_wanted() {
    let robot = iiwa();
    let X_WL = robot.link_poses(&JointVector::zeros());
    let X_WO = Pose::translation(0.0, 0.0, 50.0);
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO };
    let depths = |floor_visible: bool, camera: usize| {
        let renderer = renderer(&ball(), floor_visible);
        exact_images(&renderer, &flight_rig(), &scene, Readout::Full, false).swap_remove(camera)
    };
    // Camera 2 looks from +x along the floor: the upper arm stands in its middle, 0.5 m up.
    let level = depths(false, 2);
    assert!(level.mask.is_none());
    let row = 150 - (0.5 / 7.0 * 362.13) as usize;
    let seen = level.depth_m[row * 400 + 200];
    let camera = &flight_rig()[2];
    let ray_W = camera.X_WC.rotation * camera.back_project(&level.window.pixel_centre(row * 400 + 200), 1.0).coords;
    let surface = ArmSurface::new(&robot, &wsg50());
    let hits = surface.parts(&X_WL, 0.11).filter_map(|(X_WB, part)| {
        let X_BW = X_WB.inverse();
        part.cast(&(X_BW * Point3::from(camera.X_WC.translation.vector)), &(X_BW * ray_W))
    });
    let expected = hits.fold(f64::INFINITY, f64::min);
    assert!((6.9..6.98).contains(&seen) && (f64::from(seen) - expected).abs() < 1e-3, "{seen}, {expected}");
    assert!(level.depth_m[10].is_nan());

    // Camera 1 looks down at 30°: beside the arm there is the floor, or nothing.
    assert!(depths(false, 1).depth_m[200 * 400 + 20].is_nan());
    let floor = depths(true, 1);
    let camera = &flight_rig()[1];
    let p_C = camera.back_project(&floor.window.pixel_centre(200 * 400 + 20), f64::from(floor.depth_m[200 * 400 + 20]));
    assert!((camera.X_WC * p_C).z.abs() < 1e-5);
}

#[test]
fn windows_from_outside_are_cut_to_the_image() {
    let renderer = renderer(&ball(), false);
    let X_WL = iiwa().link_poses(&JointVector::zeros());
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::identity() };
    let windows = [
        PixelWindow { left: 390, top: 290, width: 100, height: u32::MAX },
        PixelWindow { left: u32::MAX, top: 0, width: 7, height: 7 },
        PixelWindow::default(),
    ];
    let frames = exact_images(&renderer, &flight_rig(), &scene, Readout::Windows(&windows), true);
    assert_eq!(frames[0].window, PixelWindow { left: 390, top: 290, width: 10, height: 10 });
    assert_eq!((frames[1].window.area(), frames[2].window.area()), (0, 0));
    assert_eq!(frames[3].window, flight_rig()[3].full_window());
    for frame in frames {
        assert_eq!(frame.depth_m.len(), frame.window.area());
        assert_eq!(frame.mask.unwrap().len(), frame.window.area());
    }
}

/// The culling must not lose a body that a camera nearly touches.
#[test]
fn a_camera_beside_a_body_sees_it() {
    let cuboid = Cuboid { centre: Point3::new(0.3, 0.0, 0.2), size: Vector3::new(1.0, 1.0, 0.1) };
    let camera = CameraModel::with_field_of_view(Pose::identity(), 40, 30, 1.0);
    let scan = reference_scan(&TriangleMesh::cuboid(&cuboid), &[camera]);
    assert_eq!(scan.frames[0].window.area(), 1200);
    assert!(scan.frames[0].depth_m.iter().all(|depth| (depth - 0.15).abs() < 1e-6));
}

#[test]
fn a_reference_scan_lies_on_the_surface_all_around() {
    let rig = rig_from_toml("reference.toml", REFERENCE).unwrap();
    let scan = reference_scan(&ball(), &rig);
    assert_eq!((scan.cameras.len(), scan.frames.len()), (32, 32));
    let (mut sum, mut count) = (Vector3::zeros(), 0);
    for frame in &scan.frames {
        let camera = &scan.cameras[frame.camera];
        assert!(frame.window.area() < 40 * 40);
        for (pixel, shown) in frame.mask.as_ref().unwrap().iter().enumerate() {
            assert_eq!(*shown, !frame.depth_m[pixel].is_nan());
            if *shown {
                let p_C = camera.back_project(&frame.window.pixel_centre(pixel), f64::from(frame.depth_m[pixel]));
                let p_R = camera.X_WC * p_C;
                assert!((p_R.coords.norm() - 0.0336).abs() < 40e-6);
                sum += p_R.coords;
                count += 1;
            }
        }
    }
    // A disc of radius r·f/√(d² − r²) = 6.09 px has an area of 116 pixels; in the middle of the grid it
    // covers 120 centres.
    assert_eq!(count, 32 * 120);
    assert!((sum / count as f64).norm() < 1e-4, "seen evenly from all sides");
}
