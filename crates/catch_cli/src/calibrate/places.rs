//! Files of a calibration: a rig, a page, and for each camera the files of ROS.

use std::path::{Path, PathBuf};

use catch_calibration::{Calibration, CalibrationStatus, CameraCalibration, Residuals};
use catch_cell::{CameraModel, RigCalibration, rig_to_toml};
use catch_import::ros_calibration::{camera_info_yaml, hand_eye_yaml};
use catch_lab::scenario::setup::Setup;
use catch_recording::name_of;

use super::CalibrateArguments;

/// Paths of the results.
pub struct Places {
    /// The rig.
    pub rig: PathBuf,
    /// The page.
    pub page: PathBuf,
    /// Paths of each camera's intrinsics and pose, in the formats of ROS.
    cameras: Vec<[PathBuf; 2]>,
}

impl Places {
    /// Paths within a folder, for so many cameras.
    pub fn of(out: &Path, cameras: usize) -> Self {
        let of_camera = |i| ["yaml", "calib"].map(|kind| out.join(format!("camera_{i}.{kind}")));
        Self {
            rig: out.join("rig.toml"),
            page: out.join("calibration.html"),
            cameras: (0..cameras).map(of_camera).collect(),
        }
    }

    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.rig, &self.page].into_iter().chain(self.cameras.iter().flatten())
    }

    /// The rig and the files of ROS.
    pub fn files(
        &self,
        arguments: &CalibrateArguments,
        setup: &Setup,
        found: &Calibration,
        calibrated: &[CameraModel],
    ) -> Vec<(PathBuf, Vec<u8>)> {
        let with_covariance: Vec<_> =
            calibrated.iter().cloned().zip(found.cameras.iter().map(rig_calibration)).collect();
        let statuses: Vec<String> = found.cameras.iter().map(|it| name_of(it.status)).collect();
        let source = match arguments.camera_info.is_empty() {
            true => format!("the rig {}", setup.scenario.flight_rig),
            false => "files of ROS".to_owned(),
        };
        let about = format!(
            "Cameras calibrated on the arm of the scenario {}, from {source}.\nStatus of each: {}. One that has not converged stays \
             where it was believed to stand.",
            setup.scenario.name,
            statuses.join(", ")
        );
        let mut files = vec![(self.rig.clone(), rig_to_toml(&about, &with_covariance).into_bytes())];
        let X_BW = setup.robot.X_WB.inverse();
        for (i, ([info, hand_eye], camera)) in self.cameras.iter().zip(calibrated).enumerate() {
            let name = format!("camera_{i}");
            let stands = hand_eye_yaml(&name, &setup.robot.base_link, &(X_BW * camera.X_WC));
            files.push((info.clone(), camera_info_yaml(&name, camera).into_bytes()));
            files.push((hand_eye.clone(), stands.into_bytes()));
        }
        files
    }
}

/// Returns the calibration for the rig; `None` if it did not converge.
fn rig_calibration(found: &CameraCalibration) -> Option<RigCalibration> {
    let Residuals { images, inverse_depth_sd_per_m, silhouette_sd_px, .. } = found.residuals;
    (found.status == CalibrationStatus::Converged).then(|| RigCalibration {
        covariance: found.covariance.transpose().iter().copied().collect(),
        depth_scale: found.depth_scale,
        time_offset_s: found.time_offset_s,
        time_offset_sd_s: found.time_offset_sd_s,
        inverse_depth_sd_per_m,
        silhouette_sd_px,
        images,
    })
}
