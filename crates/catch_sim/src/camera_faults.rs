//! Cameras that fail: what a test of a brain does to them, and from when on.

use catch_body::{InputError, quantity};
use catch_cell::CameraModel;
use serde::{Deserialize, Serialize};

/// A camera that fails.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraFault {
    /// Number of the camera in its rig, from 0 on.
    pub camera: quantity::camera_number<usize>,
    /// Kind of the fault.
    pub kind: CameraFaultKind,
    /// Start of the fault, in seconds on the cell's clock.
    #[serde(default)]
    pub from_s: quantity::clock_s,
}

/// Kind of a camera's fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraFaultKind {
    /// The camera's images have no depths.
    Blinded,
    /// The camera gives the same image again and again, each with a new capture time.
    Frozen,
    /// The camera gives no images.
    Silent,
    /// The camera and another one have exchanged their images.
    Swapped(SwappedCamera),
    /// The camera has been pushed.
    Pushed(Push),
}

/// Camera whose images are exchanged with those of this one.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SwappedCamera {
    /// Number of the other camera, whose images are as large.
    pub with: quantity::camera_number<usize>,
}

/// Displacement of a camera that was pushed.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Push {
    /// Displacement in W, in metres.
    pub by_m: quantity::offset_m<[f64; 3]>,
}

impl CameraFault {
    /// Checks that a rig has the cameras of the fault.
    ///
    /// # Errors
    /// If a camera does not exist; `file` and `field` name the place.
    pub fn check(&self, cameras: &[CameraModel], file: &str, field: &str) -> Result<(), InputError> {
        let find = |number: usize, name: &str| {
            let expected = format!("the number of a camera of the rig, 0 to {}", cameras.len().saturating_sub(1));
            cameras.get(number).ok_or_else(|| InputError::new(file, format!("{field}.{name}"), number, expected))
        };
        let camera = find(self.camera, "camera")?;
        if let CameraFaultKind::Swapped(SwappedCamera { with }) = self.kind {
            let name = "kind.swapped.with";
            let other = find(with, name)?;
            if (camera.width_px, camera.height_px) != (other.width_px, other.height_px) {
                let expected = "a camera with images of the same size";
                return Err(InputError::new(file, format!("{field}.{name}"), with, expected));
            }
        }
        Ok(())
    }
}
