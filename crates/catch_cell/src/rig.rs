//! Rig files: the cameras of a cell.

use catch_body::{InputError, Pose, pose::look_at, quantity};
use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

use crate::{CameraModel, rig_calibration::RigCalibration};

/// Pixels of all images of a rig together, at most.
const MAX_PIXELS: u64 = 32_000_000;
/// Cameras of a rig at most.
const MAX_CAMERAS: usize = 256;

/// A rig: a sphere of cameras, single cameras, or both, in this order.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RigFile {
    /// A sphere of cameras.
    uv_sphere: Option<UvSphereFields>,
    /// Single cameras.
    #[serde(default)]
    pub cameras: Vec<CameraFields>,
}

/// Cameras on a sphere, one for each pair of an azimuth and an elevation, all looking at the same point.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct UvSphereFields {
    /// Radius of the sphere.
    radius_m: quantity::distance_m,
    /// Azimuths, counterclockwise from x.
    azimuths_deg: quantity::angle_deg<Vec<f64>>,
    /// Elevations above the horizontal.
    elevations_deg: quantity::elevation_deg<Vec<f64>>,
    /// Centre of the sphere, which all cameras look at.
    look_at_m: quantity::place_m<[f64; 3]>,
    /// Width of the images.
    width_px: quantity::image_px<u32>,
    /// Height of the images.
    height_px: quantity::image_px<u32>,
    /// Field of view from top to bottom.
    vertical_fov_deg: quantity::field_of_view_deg,
}

/// A camera of its own: it looks at a point or has a rotation, and has a field of view or a calibrated focal
/// length.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
pub(crate) struct CameraFields {
    /// Position of the camera.
    position_m: quantity::place_m<[f64; 3]>,
    /// Point that the camera looks at, level; or:
    look_at_m: quantity::place_m<Option<[f64; 3]>>,
    /// Rotation of the camera as a unit quaternion x, y, z, w; the camera looks along its z, and its y points
    /// down.
    rotation_xyzw: quantity::quaternion<Option<[f64; 4]>>,
    /// Width of the camera's images.
    width_px: quantity::image_px<u32>,
    /// Height of the camera's images.
    height_px: quantity::image_px<u32>,
    /// Field of view from top to bottom; or:
    vertical_fov_deg: quantity::field_of_view_deg<Option<f64>>,
    /// Focal length.
    focal_px: quantity::focal_px<Option<f64>>,
    /// Principal point; the middle of the image if left out.
    principal_px: quantity::image_coordinate_px<Option<[f64; 2]>>,
    /// Images per second.
    rate_hz: quantity::rate_hz<Option<f64>>,
    /// Uncertainty of the camera's parameters, where it was calibrated.
    pub calibration: Option<RigCalibration>,
}

/// Reads the cameras of a rig file; `file` names it in errors.
///
/// The file has a table `[uv_sphere]`, or tables `[[cameras]]`, or both. The poses are in the frame that the
/// rig stands in: the world, or the reference frame R around an object that is scanned.
///
/// # Errors
/// The first field that is missing, misspelt or out of range, or that there is no camera at all.
pub fn rig_from_toml(file: &str, text: &str) -> Result<Vec<CameraModel>, InputError> {
    let rig: RigFile = InputError::parse_toml(file, text)?;
    let of_sphere =
        rig.uv_sphere.as_ref().map_or(0, |it| it.azimuths_deg.len().saturating_mul(it.elevations_deg.len()));
    let count = of_sphere.saturating_add(rig.cameras.len());
    if !(1..=MAX_CAMERAS).contains(&count) {
        let expected = format!("1 to {MAX_CAMERAS} cameras: a table [uv_sphere] or [[cameras]]");
        return Err(InputError::new(file, "uv_sphere", format!("{count} cameras"), expected));
    }
    let mut cameras = rig.uv_sphere.as_ref().map(uv_sphere).unwrap_or_default();
    for (i, camera) in rig.cameras.iter().enumerate() {
        let table = format!("cameras[{i}]");
        cameras.push(single_camera(file, &table, camera)?);
        if let Some(calibration) = &camera.calibration {
            calibration.check(file, &format!("{table}.calibration"))?;
        }
    }
    let pixels: u64 = cameras.iter().map(|it| u64::from(it.width_px) * u64::from(it.height_px)).sum();
    if pixels > MAX_PIXELS {
        let expected = format!("at most {} megapixels in all images together", MAX_PIXELS / 1_000_000);
        return Err(InputError::new(file, "width_px × height_px", format!("{pixels} pixels"), expected));
    }
    Ok(cameras)
}

fn uv_sphere(sphere: &UvSphereFields) -> Vec<CameraModel> {
    let UvSphereFields { radius_m, width_px, height_px, .. } = *sphere;
    let (target, vertical_rad) = (Point3::from(sphere.look_at_m), sphere.vertical_fov_deg.to_radians());
    let mut cameras = Vec::with_capacity(sphere.azimuths_deg.len() * sphere.elevations_deg.len());
    for azimuth in &sphere.azimuths_deg {
        for elevation in &sphere.elevations_deg {
            let (sin_a, cos_a) = libm::sincos(azimuth.to_radians());
            let (sin_e, cos_e) = libm::sincos(elevation.to_radians());
            let eye = target + nalgebra::Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e) * radius_m;
            let X_WC = look_at(&eye, &target);
            cameras.push(CameraModel::with_field_of_view(X_WC, width_px, height_px, vertical_rad));
        }
    }
    cameras
}

fn single_camera(file: &str, table: &str, camera: &CameraFields) -> Result<CameraModel, InputError> {
    let field = |name: &str| format!("{table}.{name}");
    let position = Point3::from(camera.position_m);
    let X_WC = match (camera.look_at_m, camera.rotation_xyzw) {
        (Some(target), None) => {
            let target = Point3::from(target);
            let distance_m = (target - position).norm();
            let at = format!("{table}: distance from position_m to look_at_m");
            quantity::DISTANCE_M.check(file, at, distance_m)?;
            look_at(&position, &target)
        }
        (None, Some(xyzw)) => {
            let [x, y, z, w] = xyzw;
            let rotation = Quaternion::new(w, x, y, z);
            if (rotation.norm() - 1.0).abs() > 1e-3 {
                let expected = "a unit quaternion in the order x, y, z, w";
                return Err(InputError::new(file, field("rotation_xyzw"), format!("{xyzw:?}"), expected));
            }
            Pose::from_parts(Translation3::from(position), UnitQuaternion::from_quaternion(rotation))
        }
        (both, _) => {
            let found = if both.is_some() { "both" } else { "neither" };
            return Err(InputError::new(file, table, found, "either look_at_m or rotation_xyzw"));
        }
    };
    let mut model = CameraModel::with_field_of_view(X_WC, camera.width_px, camera.height_px, 1.0);
    model.focal_px = match (camera.vertical_fov_deg, camera.focal_px) {
        (Some(degrees), None) => f64::from(camera.height_px) / 2.0 / libm::tan(degrees.to_radians() / 2.0),
        (None, Some(focal_px)) => focal_px,
        (both, _) => {
            let found = if both.is_some() { "both" } else { "neither" };
            return Err(InputError::new(file, table, found, "either vertical_fov_deg or focal_px"));
        }
    };
    if let Some(principal_px) = camera.principal_px {
        model.principal_px = principal_px;
    }
    model.rate_hz = camera.rate_hz;
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const PAPER_FLIGHT: &str = include_str!("../../../assets/rigs/paper_flight.toml");
    const PAPER_REFERENCE: &str = include_str!("../../../assets/rigs/paper_reference.toml");
    const REFERENCE: &str = include_str!("../../../assets/rigs/reference.toml");

    #[test]
    fn flight_rig_looks_at_the_origin_from_seven_metres() {
        let cameras = rig_from_toml("paper_flight.toml", PAPER_FLIGHT).unwrap();
        assert_eq!(cameras.len(), 20);
        for camera in &cameras {
            assert!((camera.focal_px - 362.13).abs() < 0.01);
            let origin_C = camera.X_WC.inverse() * Point3::origin();
            assert!((origin_C - Point3::new(0.0, 0.0, 7.0)).norm() < 1e-12);
            // The image stands upright: what lies higher in the world lies higher in the image, which is −y.
            assert!((camera.X_WC * Vector3::y()).z < 0.0);
        }
    }

    #[test]
    fn reference_rigs_differ_in_resolution_only() {
        let paper = rig_from_toml("paper_reference.toml", PAPER_REFERENCE).unwrap();
        let ours = rig_from_toml("reference.toml", REFERENCE).unwrap();
        assert_eq!((paper.len(), ours.len()), (32, 32));
        assert!((paper[0].focal_px - 90.53).abs() < 0.01);
        for (one, two) in paper.iter().zip(&ours) {
            assert_eq!(one.X_WC, two.X_WC);
            assert_eq!((one.width_px * 2, one.height_px * 2), (two.width_px, two.height_px));
        }
    }

    #[test]
    fn a_pixel_projects_back_onto_itself() {
        for camera in rig_from_toml("paper_flight.toml", PAPER_FLIGHT).unwrap() {
            for index in (0..camera.full_window().area()).step_by(7919) {
                let uv = camera.full_window().pixel_centre(index);
                let p_W = camera.X_WC * camera.back_project(&uv, 6.3);
                let again = camera.project(&(camera.X_WC.inverse() * p_W)).unwrap();
                assert!((again - uv).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn single_cameras_may_be_calibrated_ones() {
        let text = "
            [[cameras]]
            position_m = [1.0, 2.0, 3.0]
            rotation_xyzw = [0.0, 0.0, 1.0, 0.0]
            width_px = 848
            height_px = 480
            focal_px = 425.0
            principal_px = [423.1, 241.7]
            rate_hz = 90
            [[cameras]]
            position_m = [1.0, 0.0, 0.0]
            look_at_m = [0.0, 0.0, 0.0]
            width_px = 400
            height_px = 300
            vertical_fov_deg = 45.0";
        let cameras = rig_from_toml("rig.toml", text).unwrap();
        assert_eq!((cameras[0].focal_px, cameras[0].principal_px), (425.0, [423.1, 241.7]));
        assert_eq!([cameras[0].rate_hz, cameras[1].rate_hz], [Some(90.0), None]);
        assert!((cameras[0].X_WC * Vector3::x() + Vector3::x()).norm() < 1e-12);
        assert!((cameras[1].focal_px - 362.13).abs() < 0.01);
        assert_eq!(cameras[1].principal_px, [200.0, 150.0]);
    }

    #[test]
    fn every_fault_names_its_file_and_field() {
        for (from, to, expected) in [
            ("radius_m = 7.0", "radius_m = 0.0", "rig.toml: uv_sphere.radius_m: found 0"),
            ("radius_m = 7.0", "radius_m = nan", "uv_sphere.radius_m"),
            ("radius_m", "radios_m", "radios_m"),
            ("width_px = 400", "width_px = 0", "uv_sphere.width_px"),
            ("vertical_fov_deg = 45.0", "vertical_fov_deg = 180.0", "uv_sphere.vertical_fov_deg"),
            ("[60.0, ", "[160.0, ", "uv_sphere.elevations_deg"),
        ] {
            let text = PAPER_FLIGHT.replace(from, to);
            assert_ne!(text, PAPER_FLIGHT, "{from}");
            let fault = rig_from_toml("rig.toml", &text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
        assert!(rig_from_toml("rig.toml", "").unwrap_err().to_string().contains("[[cameras]]"));
        let both = "[[cameras]]\nposition_m = [1, 0, 0]\nlook_at_m = [0, 0, 0]\nrotation_xyzw = [0, 0, 0, 1]\nwidth_px = 4\n\
            height_px = 3\nfocal_px = 4.0\n";
        assert!(rig_from_toml("rig.toml", both).unwrap_err().to_string().contains("cameras[0]: found both"));
    }
}
