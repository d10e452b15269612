//! Calibrations as ROS keeps them: `camera_info` YAML of a camera's intrinsics, and results of `easy_handeye2`.
//!
//! Of YAML only what these files have is read: nested mappings, numbers, words, and lists of numbers in either notation.

use std::{collections::BTreeMap, path::Path};

use catch_body::{InputError, Pose, quantity};
use catch_cell::CameraModel;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use crate::bounded_file::FileKind;

/// Focal lengths along both axes that differ by more than this are not those of square pixels.
const SQUARE: f64 = 0.005;
/// Distortion coefficients above this are not those of rectified images.
const RECTIFIED: f64 = 1e-6;

/// Values of a YAML file by the path of their keys, such as `transform.rotation.x`.
struct Values<'a> {
    file: &'a str,
    values: BTreeMap<String, Vec<String>>,
}

impl<'a> Values<'a> {
    fn parse(file: &'a str, text: &str) -> Self {
        let mut values: BTreeMap<String, Vec<String>> = BTreeMap::new();
        // Keys above the present line, with their indentation.
        let mut above: Vec<(usize, String)> = Vec::new();
        let mut open_list: Option<String> = None;
        for line in text.lines() {
            let line = line.split(" #").next().unwrap_or_default();
            let content = line.trim();
            if content.is_empty() || content.starts_with('#') || content.starts_with("---") {
                continue;
            }
            let path = |above: &[(usize, String)]| above.iter().map(|it| it.1.as_str()).collect::<Vec<_>>().join(".");
            if let Some(key) = open_list.take() {
                push_numbers(values.entry(key.clone()).or_default(), content);
                open_list = (!content.contains(']')).then_some(key);
                continue;
            }
            let indentation = line.len() - line.trim_start().len();
            if let Some(item) = content.strip_prefix("- ") {
                values.entry(path(&above)).or_default().push(item.trim().to_owned());
                continue;
            }
            let Some((key, value)) = content.split_once(':') else { continue };
            above.retain(|(column, _)| *column < indentation);
            above.push((indentation, key.trim().to_owned()));
            let (key, value) = (path(&above), value.trim());
            if value.starts_with('[') {
                push_numbers(values.entry(key.clone()).or_default(), value);
                open_list = (!value.contains(']')).then_some(key);
            } else if !value.is_empty() {
                values.entry(key).or_default().push(value.trim_matches(['"', '\'']).to_owned());
            }
        }
        Self { file, values }
    }

    fn numbers(&self, path: &str, count: usize) -> Result<Vec<f64>, InputError> {
        let found = self.values.get(path).map(Vec::as_slice).unwrap_or_default();
        let numbers: Option<Vec<f64>> =
            found.iter().map(|it| it.parse().ok().filter(|it: &f64| it.is_finite())).collect();
        let right = numbers.filter(|it| it.len() == count);
        let wrong = || {
            let text = if found.is_empty() { "nothing".to_owned() } else { format!("`{}`", found.join(", ")) };
            let expected = if count == 1 { "a number".to_owned() } else { format!("{count} numbers") };
            InputError::new(self.file, path, text, expected)
        };
        right.ok_or_else(wrong)
    }

    fn number(&self, path: &str, range: quantity::Quantity) -> Result<f64, InputError> {
        range.check(self.file, path, self.numbers(path, 1)?[0])
    }

    fn word(&self, path: &str) -> Option<&str> {
        self.values.get(path)?.first().map(String::as_str)
    }
}

fn push_numbers(values: &mut Vec<String>, text: &str) {
    let parts = text.trim_matches(['[', ']']).split(',').map(|it| it.trim().trim_matches(['[', ']']).trim());
    values.extend(parts.filter(|it| !it.is_empty()).map(str::to_owned));
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
/// A file that cannot be read, a field that is missing, pixels that are not square, or images that are not rectified.
pub fn read_camera_info(path: &Path) -> Result<CameraModel, InputError> {
    let (file, text) = read(path, "a readable camera_info YAML file")?;
    camera_info(&file, &text)
}

/// The same of a text; `file` names it in errors.
///
/// # Errors
/// As [`read_camera_info`].
pub fn camera_info(file: &str, text: &str) -> Result<CameraModel, InputError> {
    let values = Values::parse(file, text);
    let size = |path: &str| values.number(path, quantity::IMAGE_PX).map(|it| it as u32);
    let (width_px, height_px) = (size("image_width")?, size("image_height")?);
    let camera_matrix = values.numbers("camera_matrix.data", 9)?;
    let (fx, cx, fy, cy) = (camera_matrix[0], camera_matrix[2], camera_matrix[4], camera_matrix[5]);
    if (fx / fy - 1.0).abs().is_nan() || (fx / fy - 1.0).abs() > SQUARE {
        let expected = "focal lengths along both axes that are alike: square pixels";
        return Err(InputError::new(file, "camera_matrix.data", format!("{fx} and {fy}"), expected));
    }
    let distortion = values.values.get("distortion_coefficients.data").map(Vec::as_slice).unwrap_or_default();
    for coefficient in distortion {
        if coefficient.parse::<f64>().is_ok_and(|it| it.abs() <= RECTIFIED) {
            continue;
        }
        let expected = "zeros: depth images come rectified";
        return Err(InputError::new(file, "distortion_coefficients.data", coefficient, expected));
    }
    let focal_px = quantity::FOCAL_PX.check(file, "camera_matrix.data", f64::midpoint(fx, fy))?;
    let place = |value: f64| quantity::IMAGE_COORDINATE_PX.check(file, "camera_matrix.data", value);
    Ok(CameraModel {
        X_WC: Pose::identity(),
        width_px,
        height_px,
        focal_px,
        principal_px: [place(cx)?, place(cy)?],
        rate_hz: None,
        sheet: None,
    })
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

/// The pose X_BC of a camera in the robot's base that `easy_handeye2` found.
///
/// # Errors
/// A file that cannot be read, a camera on the robot's hand, a field that is missing, or a quaternion that is none.
pub fn read_hand_eye(path: &Path) -> Result<Pose, InputError> {
    let (file, text) = read(path, "a readable result of easy_handeye2")?;
    hand_eye(&file, &text)
}

/// The same of a text; `file` names it in errors.
///
/// # Errors
/// As [`read_hand_eye`].
pub fn hand_eye(file: &str, text: &str) -> Result<Pose, InputError> {
    let values = Values::parse(file, text);
    if let Some(kind) = values.word("parameters.calibration_type").filter(|it| *it != "eye_on_base") {
        return Err(InputError::new(
            file,
            "parameters.calibration_type",
            kind,
            "eye_on_base: a camera beside the robot",
        ));
    }
    let place = |axis: &str| values.number(&format!("transform.translation.{axis}"), quantity::PLACE_M);
    let part = |axis: &str| values.number(&format!("transform.rotation.{axis}"), quantity::QUATERNION);
    let p = Translation3::new(place("x")?, place("y")?, place("z")?);
    let rotation = Quaternion::new(part("w")?, part("x")?, part("y")?, part("z")?);
    if (rotation.norm() - 1.0).abs() > 1e-3 {
        let found = format!("a quaternion of length {}", rotation.norm());
        return Err(InputError::new(file, "transform.rotation", found, "a unit quaternion"));
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
        let X_BC = hand_eye("left.calib", &hand_eye_yaml("left", "base", &camera.X_WC)).unwrap();
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
            (&info, "image_width: 848", "image_width: wide", "info.yaml: image_width: found `wide`"),
            (&info, "data: [0.0, 0.0, 0.0, 0.0, 0.0]", "data: [0.1, 0.0, 0.0, 0.0, 0.0]", "rectified"),
            (&info, "camera_matrix", "camera_metrics", "camera_matrix.data: found nothing"),
            (&result, "eye_on_base", "eye_in_hand", "parameters.calibration_type"),
            (&result, "    w: ", "    w: 9", "transform.rotation.w"),
            (&result, "translation", "position", "transform.translation.x"),
        ] {
            let text = text.replacen(from, to, 1);
            let fault = if text.starts_with("image") {
                camera_info("info.yaml", &text).unwrap_err()
            } else {
                hand_eye("info.yaml", &text).unwrap_err()
            };
            assert!(fault.to_string().contains(expected), "{fault}");
        }
    }
}
