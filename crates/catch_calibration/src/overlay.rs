//! Images beside what the model of the arm predicts of them, for people to look at.

use catch_body::{Gripper, Robot, ray_cast::ArmSurface};
use catch_cell::CameraModel;

use super::{Session, averaged_image::averaged, rendering::Rendering};

/// An image in which the arm stands still, and the arm as predicted.
#[derive(Debug, Clone)]
pub struct Overlay {
    /// Width of the image.
    pub width_px: usize,
    /// Whether each pixel shows something, row by row.
    pub shown: Vec<bool>,
    /// Whether it should show the arm.
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
    let images = averaged(index, camera, session).into_iter().filter(|it| it.is_still);
    let overlay = |image: super::AveragedImage| {
        let arm = image.arm(&session.arm, 0.0)?;
        let rendering = Rendering::new(camera, &surface, &robot.link_poses(&arm.q), arm.width_m);
        let mut predicted = vec![false; image.shown.len()];
        let window = rendering.window;
        for (i, _) in rendering.hits.iter().enumerate().filter(|(_, hit)| hit.is_some()) {
            let (column, row) = (i % window.width as usize, i / window.width as usize);
            predicted[(row + window.top as usize) * image.width_px + column + window.left as usize] = true;
        }
        let shown = image.shown.iter().map(|shown| *shown > 0).collect();
        Some(Overlay { width_px: image.width_px, shown, predicted })
    };
    images.take(most).filter_map(overlay).collect()
}
