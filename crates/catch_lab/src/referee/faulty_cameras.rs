//! Cameras that the brain says are at fault.

use catch_bot::perception::CameraStatus;
use serde::{Deserialize, Serialize};

use super::Measures;
use crate::trial::StateSnapshot;

/// A camera that the brain says is at fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultyCamera {
    /// Index of the camera in the rig, from 0 on.
    pub camera: usize,
    /// Fault of the camera.
    pub status: CameraStatus,
}

/// The cameras that were said to be at fault in a throw, each with the last status that is none of a good
/// one.
pub fn faulty_cameras(snapshots: &[StateSnapshot]) -> Vec<FaultyCamera> {
    let mut statuses: Vec<CameraStatus> = Vec::new();
    for report in snapshots.iter().filter_map(|it| it.report.as_ref()) {
        statuses.resize(statuses.len().max(report.cameras.len()), CameraStatus::Good);
        let said = statuses.iter_mut().zip(&report.cameras);
        said.filter(|(_, now)| **now != CameraStatus::Good).for_each(|(last, now)| *last = *now);
    }
    let faulty = statuses.into_iter().enumerate().filter(|(_, status)| *status != CameraStatus::Good);
    faulty.map(|(camera, status)| FaultyCamera { camera, status }).collect()
}

/// Counts the cameras that the brain reported as faulty, as measures without any other.
pub(super) fn counted(snapshots: &[StateSnapshot]) -> Measures {
    let faulty = faulty_cameras(snapshots);
    let said = |status: CameraStatus| faulty.iter().filter(|it| it.status == status).count() as u32;
    Measures {
        blinded_cameras: said(CameraStatus::Blinded),
        frozen_cameras: said(CameraStatus::Frozen),
        silent_cameras: said(CameraStatus::Silent),
        displaced_cameras: said(CameraStatus::Displaced),
        swapped_cameras: said(CameraStatus::Swapped),
        uncalibrated_cameras: said(CameraStatus::Uncalibrated),
        ..Measures::default()
    }
}
