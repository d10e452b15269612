//! Cameras as objects see them.

use catch_body::Pose;
use nalgebra::{Point3, Rotation3, Vector3};

/// A camera's place as the object sees it.
#[derive(Debug)]
pub(super) struct Viewpoint {
    pub R_OW: Rotation3<f64>,
    p_WO: Vector3<f64>,
    p_WC: Point3<f64>,
    pub p_OC: Point3<f64>,
}

impl Viewpoint {
    /// Viewpoint without a camera yet, for an object at `X_WO`.
    pub fn new(X_WO: &Pose) -> Self {
        let R_OW = X_WO.rotation.to_rotation_matrix().transpose();
        let p_WC = Point3::new(f64::NAN, f64::NAN, f64::NAN);
        Self { R_OW, p_WO: X_WO.translation.vector, p_WC, p_OC: p_WC }
    }

    /// Takes the place of a camera. Returns whether that stands elsewhere than the last one.
    pub fn look_from(&mut self, p_WC: &Point3<f64>) -> bool {
        let is_elsewhere = self.p_WC != *p_WC;
        if is_elsewhere {
            self.p_WC = *p_WC;
            self.p_OC = Point3::from(self.R_OW * (p_WC.coords - self.p_WO));
        }
        is_elsewhere
    }
}
