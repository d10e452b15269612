//! Calibrations in rig files: the table that one adds, and rig files as a calibration writes them.

use std::fmt::Write;

use catch_body::{InputError, quantity};
use nalgebra::Matrix6;
use serde::Deserialize;

use crate::CameraModel;

/// Uncertainty of a camera's parameters after a calibration.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct RigCalibration {
    /// Covariance of the pose X_WC·exp(ω, v), row by row: three rotations about the camera's axes, then three
    /// translations along them.
    pub covariance: quantity::pose_covariance<Vec<f64>>,
    /// Relative error of depths: measured depths are true ones times 1 + this.
    pub depth_scale: quantity::scale_error,
    /// Offset to be added to the time stamps of the camera's images.
    pub time_offset_s: quantity::time_offset_s,
    /// Standard deviation of the time offset; none where no motion was seen.
    pub time_offset_sd_s: quantity::time_sd_s<Option<f64>>,
    /// Standard deviation of 1/z of a pixel around the model of the arm.
    pub inverse_depth_sd_per_m: quantity::inverse_depth_per_m,
    /// Standard deviation of a silhouette around the model of the arm.
    pub silhouette_sd_px: quantity::error_px,
    /// Poses of the arm that the camera saw.
    pub images: usize,
}

impl RigCalibration {
    /// Checks that the covariance is symmetric and positive definite; `file` and `table` name the place in
    /// errors.
    ///
    /// # Errors
    /// If it is not.
    pub(crate) fn check(&self, file: &str, table: &str) -> Result<(), InputError> {
        let field = format!("{table}.covariance");
        let count = self.covariance.len();
        if count != 36 {
            return Err(InputError::new(file, field, format!("{count} numbers"), "36 numbers: six rows of six"));
        }
        let matrix = Matrix6::from_row_slice(&self.covariance);
        let is_symmetric = (matrix - matrix.transpose()).amax() <= 1e-9 * matrix.amax();
        if !is_symmetric || matrix.cholesky().is_none() {
            let expected = "a symmetric matrix all of whose eigenvalues are above zero";
            return Err(InputError::new(file, field, "another matrix", expected));
        }
        Ok(())
    }
}

/// The rig file of these cameras, which [`rig_from_toml`](crate::rig_from_toml) reads; every line of `about`
/// stands above it as a comment.
pub fn rig_to_toml(about: &str, cameras: &[(CameraModel, Option<RigCalibration>)]) -> String {
    let mut text = String::new();
    about.lines().for_each(|line| text += &format!("# {line}\n"));
    for (camera, calibration) in cameras {
        let CameraModel { X_WC, width_px, height_px, focal_px, principal_px, rate_hz, sheet: _ } = camera;
        let p: [f64; 3] = X_WC.translation.vector.into();
        let xyzw: [f64; 4] = X_WC.rotation.coords.into();
        let _ = write!(
            text,
            "\n[[cameras]]\nposition_m = {p:?}\nrotation_xyzw = {xyzw:?}\nwidth_px = {width_px}\nheight_px = {height_px}\n\
             focal_px = {focal_px:?}\nprincipal_px = {principal_px:?}\n"
        );
        if let Some(rate_hz) = rate_hz {
            let _ = writeln!(text, "rate_hz = {rate_hz:?}");
        }
        let Some(it) = calibration else { continue };
        let _ = writeln!(text, "\n[cameras.calibration]\ncovariance = [");
        for row in it.covariance.chunks(6) {
            let row: Vec<String> = row.iter().map(|value| format!("{value:e}")).collect();
            let _ = writeln!(text, "    {},", row.join(", "));
        }
        let _ = writeln!(text, "]\ndepth_scale = {:?}\ntime_offset_s = {:?}", it.depth_scale, it.time_offset_s);
        if let Some(sd_s) = it.time_offset_sd_s {
            let _ = writeln!(text, "time_offset_sd_s = {sd_s:?}");
        }
        let _ = writeln!(
            text,
            "inverse_depth_sd_per_m = {:?}\nsilhouette_sd_px = {:?}\nimages = {}",
            it.inverse_depth_sd_per_m, it.silhouette_sd_px, it.images
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{RigFile, rig_from_toml};
    use catch_body::pose::look_at;
    use nalgebra::Point3;

    fn calibrated() -> (CameraModel, Option<RigCalibration>) {
        let X_WC = look_at(&Point3::new(2.0, -1.0, 1.4), &Point3::new(1.05, 0.35, 0.75));
        let camera = CameraModel {
            principal_px: [423.1, 241.7],
            rate_hz: Some(60.0),
            ..CameraModel::with_field_of_view(X_WC, 848, 480, 1.0)
        };
        let covariance = Matrix6::<f64>::identity() * 1e-7;
        let calibration = RigCalibration {
            covariance: covariance.iter().copied().collect(),
            depth_scale: -1.5e-4,
            time_offset_s: 0.0021,
            time_offset_sd_s: Some(1e-4),
            inverse_depth_sd_per_m: 0.0026,
            silhouette_sd_px: 0.9,
            images: 24,
        };
        (camera, Some(calibration))
    }

    #[test]
    fn what_is_written_is_read_again() {
        let mut cameras = vec![calibrated(), calibrated()];
        cameras[1].1 = None;
        let text = rig_to_toml("A rig.\nOf two cameras.", &cameras);
        assert!(text.starts_with("# A rig.\n# Of two cameras.\n"));
        let again = rig_from_toml("rig.toml", &text).unwrap();
        let fields: RigFile = InputError::parse_toml("rig.toml", &text).unwrap();
        assert_eq!(again.len(), 2);
        for (((camera, calibration), read), fields) in cameras.iter().zip(&again).zip(&fields.cameras) {
            assert!((camera.X_WC.translation.vector - read.X_WC.translation.vector).norm() < 1e-12);
            assert!(camera.X_WC.rotation.angle_to(&read.X_WC.rotation) < 1e-7);
            assert_eq!((camera.focal_px, camera.principal_px), (read.focal_px, read.principal_px));
            assert_eq!(camera.rate_hz, read.rate_hz);
            assert_eq!(*calibration, fields.calibration);
        }
    }

    #[test]
    fn a_covariance_that_is_none_is_named() {
        let mut cameras = [calibrated()];
        let fault = |cameras: &[(CameraModel, Option<RigCalibration>)]| {
            rig_from_toml("rig.toml", &rig_to_toml("", cameras)).unwrap_err().to_string()
        };
        cameras[0].1.as_mut().unwrap().covariance[0] = -1e-7;
        assert!(fault(&cameras).contains("cameras[0].calibration.covariance: found another matrix"));
        cameras[0].1.as_mut().unwrap().covariance.pop();
        assert!(fault(&cameras).contains("35 numbers"));
        cameras[0].1.as_mut().unwrap().time_offset_s = 2.0;
        assert!(fault(&cameras).contains("cameras[0].calibration.time_offset_s"));
    }
}
