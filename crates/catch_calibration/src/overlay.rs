//! Images beside what the model of the arm predicts of them, for people to look at.

use catch_body::{Gripper, Robot, ray_cast::ArmSurface};
use catch_cell::CameraModel;

use super::{AveragedImage, Session, rendering::Rendering};

/// An image in which the arm stands still, and the arm as predicted.
#[derive(Debug, Clone)]
pub struct Overlay {
    /// Width of the image.
    pub width_px: usize,
    /// True for each pixel that shows something, row by row.
    pub shown: Vec<bool>,
    /// True for each pixel that should show the arm, row by row.
    pub predicted: Vec<bool>,
}

/// The first images of camera number `index` in which the arm stands still, `most` of them, for a camera that
/// stands as `camera`.
pub fn overlays(
    robot: &Robot,
    gripper: &Gripper,
    (index, camera): (usize, &CameraModel),
    session: &Session,
    most: usize,
) -> Vec<Overlay> {
    let surface = ArmSurface::new(robot, gripper);
    let images = session.images.iter().filter(|it| it.camera == index && it.is_still(&session.arm));
    let full = camera.full_window();
    let wide = full.width as usize;
    let overlay = |image: &AveragedImage| {
        let arm = image.arm(&session.arm, 0.0)?;
        let rendering = Rendering::new(camera, &surface, &robot.link_poses(&arm.q), arm.width_m);
        let mut predicted = vec![false; full.area()];
        let window = rendering.window;
        for (i, _) in rendering.hits.iter().enumerate().filter(|(_, hit)| hit.is_some()) {
            let (column, row) = (i % window.width as usize, i / window.width as usize);
            predicted[(row + window.top as usize) * wide + column + window.left as usize] = true;
        }
        let shown = (0..full.area()).map(|i| image.at(i % wide, i / wide).1 > 0).collect();
        Some(Overlay { width_px: wide, shown, predicted })
    };
    images.take(most).filter_map(overlay).collect()
}
