//! Calibrations as ROS keeps them: `camera_info` YAML of a camera's intrinsics, and results of
//! `easy_handeye2`.
//!
//! Whatever changes what a pixel means, or in which frames a pose is, is read or refused.

use std::path::Path;

use crate::yaml;
use catch_body::{
    InputError, Pose,
    document::{Document, Harmless, Node},
    quantity,
    quantity::Quantity,
};
use catch_cell::CameraModel;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use catch_recording::bounded_file::FileKind;

/// Focal lengths along both axes that differ by more than this are not those of square pixels.
const SQUARE: f64 = 0.005;
/// Distortion coefficients above this are not those of rectified images.
const RECTIFIED: f64 = 1e-6;

/// Frames of images end so, as REP 103 has it: z forward, x to the right.
const OPTICAL: &str = "optical_frame";
/// Names that do not concern a camera's geometry.
const HARMLESS: Harmless = &[
    ("", "camera_name distortion_model"),
    ("roi", "do_rectify"),
    ("header", "seq stamp"),
    (
        "parameters",
        "name namespace freehand_robot_movement move_group move_group_namespace robot_effector_frame \
         tracking_marker_frame",
    ),
    ("*", "rows cols"),
];
/// Numbers of matrices.
const NUMBER: Quantity = Quantity { least: -1e9, most: 1e9, unit: "" };

/// The value that a path of keys leads to.
fn value<'d>(document: &'d Document, path: &[&'static str]) -> Result<Option<Node<'d>>, InputError> {
    let mut node = document.root();
    for key in path {
        let Some(child) = yaml::table(node)?.child(key) else { return Ok(None) };
        node = child;
    }
    Ok(Some(node).filter(|it| !it.is_null()))
}

fn needed<'d>(document: &'d Document, path: &[&'static str], what: &str) -> Result<Node<'d>, InputError> {
    value(document, path)?.ok_or_else(|| InputError::new(document.file(), path.join("."), "nothing", what))
}

fn number(document: &Document, path: &[&'static str], range: Quantity) -> Result<f64, InputError> {
    needed(document, path, "a number")?.number(range)
}

/// A frame's name has to be that of images.
fn optical(frame: Option<Node>) -> Result<(), InputError> {
    let frame = frame.filter(|it| !it.text().trim_matches('/').is_empty());
    let Some(other) = frame.filter(|it| !it.text().ends_with(OPTICAL)) else { return Ok(()) };
    let expected = format!("the frame of the images, …_{OPTICAL}: z forward, x to the right (REP 103)");
    Err(other.fault(other.text(), expected))
}

/// Reads a file of one of both kinds.
///
/// # Errors
/// A file that cannot be read.
fn read(path: &Path, what: &'static str) -> Result<(String, String), InputError> {
    Ok((path.display().to_string(), FileKind::text(what).read_text(path)?))
}

/// The intrinsics in a `camera_info` YAML file, of a camera at the world's origin.
///
/// # Errors
/// A file that cannot be read, a field that is missing, pixels that are not square, or images that are not
/// rectified.
pub fn read_camera_info(path: &Path) -> Result<CameraModel, InputError> {
    let (file, text) = read(path, "a readable camera_info YAML file")?;
    camera_info(&file, &text)
}

/// Reads the intrinsics of a camera from the text of a `camera_info` file; `file` names it in errors.
///
/// # Errors
/// As [`read_camera_info`].
pub fn camera_info(file: &str, text: &str) -> Result<CameraModel, InputError> {
    let document = yaml::document(file, text)?;
    let size = |key| {
        let node = needed(&document, &[key], "a number of pixels")?;
        let whole = Some(node.number(quantity::IMAGE_PX)?).filter(|it| it.fract() == 0.0);
        whole.map(|it| it as u32).ok_or_else(|| node.fault(node.text(), "a whole number of pixels"))
    };
    let (width_px, height_px) = (size("image_width")?, size("image_height")?);
    let data = needed(&document, &["camera_matrix", "data"], "9 numbers")?;
    let [fx, skew, cx, zero, fy, cy, below @ ..] = data.numbers::<9>(NUMBER)?;
    if (fx / fy - 1.0).abs().is_nan() || (fx / fy - 1.0).abs() > SQUARE {
        let expected = "focal lengths along both axes that are alike: square pixels";
        return Err(data.fault(format!("{fx} and {fy}"), expected));
    }
    if zero != 0.0 || below != [0.0, 0.0, 1.0] {
        let found = format!("{zero} below the first number and {below:?} as the third row");
        return Err(data.fault(found, "0 there and [0, 0, 1] as the third row: numbers row by row"));
    }
    if skew != 0.0 {
        return Err(data.fault(format!("a skew of {skew}"), "no skew: 0 as the second number"));
    }
    let place = |value: f64, size_px: u32| {
        let in_image = Quantity { least: 0.0, most: f64::from(size_px), unit: "pixels, a place in the image" };
        in_image.check(file, "camera_matrix.data", value)
    };
    let principal_px = [place(cx, width_px)?, place(cy, height_px)?];
    undistorted(&document)?;
    as_taken(&document, [f64::from(width_px), f64::from(height_px)])?;
    rectified(&document, [fx, fy, cx, cy])?;
    optical(value(&document, &["header", "frame_id"])?)?;
    document.finish(&[HARMLESS])?;
    let focal_px = quantity::FOCAL_PX.check(file, "camera_matrix.data", f64::midpoint(fx, fy))?;
    Ok(CameraModel { X_WC: Pose::identity(), width_px, height_px, focal_px, principal_px, rate_hz: None, sheet: None })
}

/// Checks that the images come without distortion.
fn undistorted(document: &Document) -> Result<(), InputError> {
    let Some(data) = value(document, &["distortion_coefficients", "data"])? else { return Ok(()) };
    if !data.is_list() {
        return Err(data.fault(format!("`{}`", data.text()), "a list of numbers"));
    }
    for coefficient in data.items() {
        if coefficient.number(NUMBER)?.abs() > RECTIFIED {
            return Err(coefficient.fault(coefficient.text(), "zeros: depth images come rectified"));
        }
    }
    Ok(())
}

/// Checks that the images have all pixels of which the file speaks.
fn as_taken(document: &Document, [width_px, height_px]: [f64; 2]) -> Result<(), InputError> {
    let count = |path: &[&'static str]| {
        let node = value(document, path)?;
        node.map(|it| it.number(NUMBER).map(|number| (it, number))).transpose()
    };
    for key in ["binning_x", "binning_y"] {
        if let Some((node, other)) = count(&[key])?.filter(|it| ![0.0, 1.0].contains(&it.1)) {
            let expected = "0 or 1: the size and the matrices of the images as they are sent";
            return Err(node.fault(other, expected));
        }
    }
    for (key, whole) in [("x_offset", 0.0), ("y_offset", 0.0), ("width", width_px), ("height", height_px)] {
        if let Some((node, other)) = count(&["roi", key])?.filter(|it| it.1 != 0.0 && it.1 != whole) {
            let expected = "no region of interest: the size and the matrices of the images as they are sent";
            return Err(node.fault(other, expected));
        }
    }
    Ok(())
}

/// Checks that the matrices for rectified images are those of the camera, whose images are rectified.
fn rectified(document: &Document, [fx, fy, cx, cy]: [f64; 4]) -> Result<(), InputError> {
    let rotation = value(document, &["rectification_matrix", "data"])?;
    if let Some(node) = rotation {
        let is_identity = node.numbers::<9>(NUMBER)?.iter().enumerate().all(|(i, it)| {
            let right = if i % 4 == 0 { 1.0 } else { 0.0 };
            (it - right).abs() <= 1e-6
        });
        if !is_identity {
            return Err(node.fault("a rotation", "the identity: depth images come rectified"));
        }
    }
    let Some(node) = value(document, &["projection_matrix", "data"])? else { return Ok(()) };
    let found = node.numbers::<12>(NUMBER)?;
    let right = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    if found.iter().all(|it| *it == 0.0) || found.iter().zip(right).all(|(it, right)| (it - right).abs() <= 1e-3) {
        return Ok(());
    }
    let expected = "the numbers of camera_matrix, as depth images come rectified: one of both is of other images";
    Err(node.fault(format!("{found:?}"), expected))
}

/// The `camera_info` YAML of a camera.
pub fn camera_info_yaml(name: &str, camera: &CameraModel) -> String {
    let CameraModel { width_px, height_px, focal_px: f, principal_px: [cx, cy], .. } = camera;
    format!(
        "image_width: {width_px}\nimage_height: {height_px}\ncamera_name: {name}\n\
         camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{f:?}, 0.0, {cx:?}, 0.0, {f:?}, {cy:?}, 0.0, 0.0, 1.0]\n\
         distortion_model: plumb_bob\n\
         distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.0, 0.0, 0.0, 0.0, 0.0]\n\
         rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n\
         projection_matrix:\n  rows: 3\n  cols: 4\n  data: [{f:?}, 0.0, {cx:?}, 0.0, 0.0, {f:?}, {cy:?}, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
    )
}

/// The pose X_BC of a camera in the robot's base that `easy_handeye2` found, or `easy_handeye`; `base_link`
/// is the name of the base.
///
/// # Errors
/// A file that cannot be read, a camera on the robot's hand, frames that are others, a field that is missing,
/// or a quaternion that is none.
pub fn read_hand_eye(path: &Path, base_link: &str) -> Result<Pose, InputError> {
    let (file, text) = read(path, "a readable result of easy_handeye2")?;
    hand_eye(&file, &text, base_link)
}

/// Reads the pose X_BC of a camera in the robot's base from the text of a hand-eye calibration; `file` names
/// it in errors.
///
/// # Errors
/// As [`read_hand_eye`].
pub fn hand_eye(file: &str, text: &str, base_link: &str) -> Result<Pose, InputError> {
    let document = yaml::document(file, text)?;
    let parameter = |key| value(&document, &["parameters", key]);
    let beside = "eye_on_base: a camera beside the robot";
    if let Some(kind) = parameter("calibration_type")?.filter(|it| it.text() != "eye_on_base") {
        return Err(kind.fault(kind.text(), beside));
    }
    if let Some(on_hand) = parameter("eye_on_hand")?
        && yaml::boolean(on_hand)?
    {
        return Err(on_hand.fault(on_hand.text(), beside));
    }
    if let Some(other) = parameter("robot_base_frame")?.filter(|it| !matches!(it.text().trim_matches('/'), "" | "''"))
        && other.text().trim_start_matches('/') != base_link
    {
        let expected = format!("{base_link}, the arm's base, in which the camera's pose has to be");
        return Err(other.fault(other.text(), expected));
    }
    optical(parameter("tracking_base_frame")?)?;
    // `easy_handeye` writes all seven numbers in one mapping.
    let (place, rotated, turn) = match value(&document, &["transformation"])? {
        Some(_) => (&["transformation"][..], &["transformation"][..], ["qx", "qy", "qz", "qw"]),
        None => (&["transform", "translation"][..], &["transform", "rotation"][..], ["x", "y", "z", "w"]),
    };
    let of = |path: &[&'static str], key, range| number(&document, &[path, &[key]].concat(), range);
    let [px, py, pz] = ["x", "y", "z"].map(|key| of(place, key, quantity::PLACE_M));
    let [x, y, z, w] = turn.map(|key| of(rotated, key, quantity::QUATERNION));
    let p = Translation3::new(px?, py?, pz?);
    let rotation = Quaternion::new(w?, x?, y?, z?);
    document.finish(&[HARMLESS])?;
    if (rotation.norm() - 1.0).abs() > 1e-3 {
        let found = format!("a quaternion of length {}", rotation.norm());
        return Err(InputError::new(file, rotated.join("."), found, "a unit quaternion"));
    }
    Ok(Pose::from_parts(p, UnitQuaternion::from_quaternion(rotation)))
}

/// The pose `X_BC` of a camera in the robot's base as a result of `easy_handeye2`.
pub fn hand_eye_yaml(name: &str, base_frame: &str, X_BC: &Pose) -> String {
    let (p, r) = (X_BC.translation.vector, X_BC.rotation.coords);
    format!(
        "parameters:\n  name: {name}\n  calibration_type: eye_on_base\n  robot_base_frame: {base_frame}\n  \
         robot_effector_frame: ''\n  tracking_base_frame: {name}_depth_optical_frame\n  tracking_marker_frame: ''\n  \
         freehand_robot_movement: false\n  move_group_namespace: /\n  move_group: manipulator\n\
         transform:\n  translation:\n    x: {:?}\n    y: {:?}\n    z: {:?}\n  rotation:\n    x: {:?}\n    y: {:?}\n    z: {:?}\n    w: {:?}\n",
        p.x, p.y, p.z, r.x, r.y, r.z, r.w
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::pose::look_at;
    use nalgebra::Point3;

    fn camera() -> CameraModel {
        let X_WC = look_at(&Point3::new(2.0, -1.0, 1.4), &Point3::new(1.0, 0.3, 0.7));
        CameraModel { principal_px: [423.1, 241.7], ..CameraModel::with_field_of_view(X_WC, 848, 480, 1.0) }
    }

    #[test]
    fn what_is_written_is_read_again() {
        let camera = camera();
        let again = camera_info("info.yaml", &camera_info_yaml("left", &camera)).unwrap();
        assert_eq!(CameraModel { X_WC: camera.X_WC, ..again }, camera);
        let X_BC = hand_eye("left.calib", &hand_eye_yaml("left", "base", &camera.X_WC), "base").unwrap();
        assert!((X_BC.translation.vector - camera.X_WC.translation.vector).norm() < 1e-12);
        assert!(X_BC.rotation.angle_to(&camera.X_WC.rotation) < 1e-7);
    }

    /// Lists as other writers of YAML break them.
    #[test]
    fn lists_are_read_in_either_notation() {
        let flow = "image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [ 600.0, 0., 320.5,\n    0., 600.0,\n    \
                    240.5, 0., 0., 1. ]\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n";
        let block = "image_width: 640 # pixels\nimage_height: 480\ncamera_matrix:\n  data:\n  - 600.0\n  - 0.0\n  - 320.5\n  - 0.0\n  - 600.0\n  \
                     - 240.5\n  - 0.0\n  - 0.0\n  - 1.0\n";
        for text in [flow, block] {
            let camera = camera_info("info.yaml", text).unwrap();
            assert_eq!((camera.width_px, camera.focal_px, camera.principal_px), (640, 600.0, [320.5, 240.5]));
        }
    }

    #[test]
    fn faults_name_file_and_field() {
        let info = camera_info_yaml("left", &camera());
        let result = hand_eye_yaml("left", "base", &camera().X_WC);
        for (text, from, to, expected) in [
            (&info, "image_width: 848", "image_width: wide", "info.yaml: line 1: image_width: found `wide`"),
            (&info, "data: [0.0, 0.0, 0.0, 0.0, 0.0]", "data: [0.1, 0.0, 0.0, 0.0, 0.0]", "rectified"),
            (&info, "data: [0.0, 0.0, 0.0, 0.0, 0.0]", "data: 0.1", "distortion_coefficients.data: found `0.1`"),
            (&info, "camera_name: left", "roi: 5", "roi: found `5`, expected a table"),
            (&info, "image_width: 848", "image_width: 848.6", "image_width: found 848.6, expected a whole number"),
            (&info, ", 0.0, 423.1,", ", 0.0, 4240.0,", "camera_matrix.data: found 4240, expected 0 to 848 pixels"),
            (&info, ", 0.0, 423.1,", ", 3.0, 423.1,", "camera_matrix.data: found a skew of 3"),
            (
                &info,
                "241.7, 0.0, 0.0, 1.0]",
                "0.0, 423.1, 241.7, 1.0]",
                "found 0 below the first number and [423.1, 241.7, 1.0]",
            ),
            (&info, "camera_name: left", "binning_x: -2", "binning_x: found -2"),
            (&info, "camera_name: left", "binning_y: 0.5", "binning_y: found 0.5"),
            (&info, "camera_matrix", "camera_metrics", "camera_matrix.data: found nothing"),
            (&result, "eye_on_base", "eye_in_hand", "parameters.calibration_type"),
            (&result, "    w: ", "    w: 9", "transform.rotation.w"),
            (&result, "translation", "position", "transform.translation.x"),
            (&info, "camera_name: left", "camera_name: left\nbinning_x: 2", "binning_x: found 2"),
            (&info, "camera_name: left", "roi: {x_offset: 100, y_offset: 0}", "roi.x_offset: found 100"),
            (&info, "camera_name: left", "roi: {width: 400, height: 300}", "roi.width: found 400"),
            (&info, "camera_name: left", "header: {frame_id: camera_link}", "header.frame_id: found camera_link"),
            (&info, "camera_name: left", "gain: 2", "gain: found `gain`, which is not read"),
            (
                &info,
                "data: [1.0, 0.0, 0.0, 0.0, 1.0",
                "data: [0.0, 1.0, 0.0, -1.0, 0.0",
                "rectification_matrix.data: found a rotation",
            ),
            (&info, "cols: 4\n  data: [", "cols: 4\n  data: [1", "projection_matrix.data: found"),
            (
                &result,
                "robot_base_frame: base",
                "robot_base_frame: pedestal",
                "robot_base_frame: found pedestal, expected base",
            ),
            (&result, "left_depth_optical_frame", "camera_link", "tracking_base_frame: found camera_link"),
            (&result, "transform:", "scale: 2\ntransform:", "scale: found `scale`"),
        ] {
            let text = text.replacen(from, to, 1);
            let fault = if text.starts_with("image") {
                camera_info("info.yaml", &text).unwrap_err()
            } else {
                hand_eye("info.yaml", &text, "base").unwrap_err()
            };
            assert!(fault.to_string().contains(expected), "{fault}");
        }
    }

    /// Files are read as both generations of the program write them, in either notation; null regions and
    /// binning are none.
    #[test]
    fn other_writers_are_understood() {
        let first = "parameters: {eye_on_hand: false, robot_base_frame: base, tracking_base_frame: cam_optical_frame}\n\
            transformation: {x: 1, y: 2, z: 0.5, qx: 0, qy: 0, qz: 1, qw: 0}\n";
        let X_BC = hand_eye("a.yaml", first, "base").unwrap();
        assert_eq!(X_BC.translation.vector.as_slice(), [1.0, 2.0, 0.5]);
        assert!((X_BC.rotation.angle() - std::f64::consts::PI).abs() < 1e-12);
        let second = "transform: {translation: {x: 1, y: 2, z: 0.5}, rotation: {x: 0, y: 0, z: 1, w: 0}}\n";
        assert_eq!(hand_eye("a.yaml", second, "base").unwrap(), X_BC);
        assert_eq!(hand_eye("a.yaml", &first.replace("false", "False"), "base").unwrap(), X_BC);
        assert!(hand_eye("a.yaml", &first.replace("false", "true"), "base").is_err());
        let info = camera_info_yaml("left", &camera())
            + "binning_x: 0\nbinning_y: 1\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 480\n  width: 848\n  do_rectify: false\n";
        assert!(camera_info("a.yaml", &info).is_ok());
    }
}
