//! Ray-cast depth images of object, arm, gripper and floor.

use catch_body::{
    Gripper, Pose, Robot, TriangleMesh,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, RayCaster},
};
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, Vector3};

/// What the cameras look at, at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// When the shutters close, on the cell's clock.
    pub capture_s: f64,
    /// Poses of the arm's links.
    pub X_WL: &'a LinkPoses,
    /// Opening of the gripper.
    pub width_m: f64,
    /// Pose of the object.
    pub X_WO: &'a Pose,
}

/// Which pixels are read out.
#[derive(Debug, Clone, Copy)]
pub enum Readout<'a> {
    /// All of them.
    Full,
    /// One window per camera, cut to the image; cameras beyond the end of the list read out all.
    Windows(&'a [PixelWindow]),
    /// The box around the object's image, which a sensor that tells objects apart tracks by itself; empty where the object is
    /// out of sight.
    Object,
}

/// Cameras and the surfaces that they may see, prepared once; each scene only brings poses.
///
/// A pixel's depth is that of the nearest surface on the ray through the pixel's centre, exact for the meshes. It does not
/// depend on which other pixels are read out, so a window equals the same part of the full image bit for bit.
#[derive(Debug, Clone)]
pub struct Renderer {
    cameras: Vec<CameraModel>,
    arm: ArmSurface,
    object: RayCaster,
    floor_visible: bool,
}

impl Renderer {
    /// Prepares the surfaces. The object's mesh is in O; the cameras stand where they truly are; the floor, if it can be seen,
    /// is the plane z = 0 and hides what lies behind it from either side.
    pub fn new(
        robot: &Robot,
        gripper: &Gripper,
        object: &TriangleMesh,
        cameras: Vec<CameraModel>,
        floor_visible: bool,
    ) -> Self {
        Self { cameras, arm: ArmSurface::new(robot, gripper), object: RayCaster::new(object), floor_visible }
    }

    /// The cameras, in the order of the frames.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.cameras
    }

    /// One frame per camera: depth in metres along the optical axis, NaN where there is no surface; with `labelled` also which
    /// pixels show the object.
    pub fn render(&self, scene: &Scene, readout: Readout, labelled: bool) -> Vec<DepthFrame> {
        let arm: Vec<(Pose, &RayCaster)> = self.arm.parts(scene.X_WL, scene.width_m).collect();
        let object = (*scene.X_WO, &self.object);
        let image_of = |(index, camera): (usize, &CameraModel)| {
            let window = match readout {
                Readout::Full => camera.full_window(),
                Readout::Windows(windows) => {
                    windows.get(index).map_or(camera.full_window(), |window| overlap(window, &camera.full_window()))
                }
                Readout::Object => covered(camera, &object),
            };
            let mut image = Image::empty(camera, window);
            image.add_body(&object, true);
            // From near to far, because what is known to be hidden costs little. The order is the same for all windows.
            let in_sight = arm.iter().filter(|body| overlap(&covered(camera, body), &window).area() > 0);
            let mut in_sight: Vec<_> = in_sight.map(|body| (nearest_depth(camera, body), body)).collect();
            in_sight.sort_by(|(one, _), (two, _)| one.total_cmp(two));
            for (_, body) in in_sight {
                image.add_body(body, false);
            }
            if self.floor_visible {
                image.add_floor();
            }
            image.frame(index, scene.capture_s, labelled)
        };
        self.cameras.iter().enumerate().map(image_of).collect()
    }
}

/// The nearest depth seen so far in each pixel of a window.
pub(super) struct Image<'a> {
    camera: &'a CameraModel,
    window: PixelWindow,
    /// Along the optical axis, row by row; infinite where nothing was met.
    nearest: Vec<f64>,
    /// Where that surface is the object's.
    shows_object: Vec<bool>,
}

impl<'a> Image<'a> {
    /// An image of nothing.
    pub fn empty(camera: &'a CameraModel, window: PixelWindow) -> Self {
        Self { camera, window, nearest: vec![f64::INFINITY; window.area()], shows_object: vec![false; window.area()] }
    }

    /// Adds a body with its pose X_WB wherever it is nearer than all before it.
    pub fn add_body(&mut self, body: &(Pose, &RayCaster), is_object: bool) {
        let part = overlap(&covered(self.camera, body), &self.window);
        let (X_WB, caster) = body;
        // Rays are cast in the body's frame: origin C, direction R_BC·((u − cx)/f, (v − cy)/f, 1), whose third component of one
        // makes the ray's parameter the depth.
        let X_BC = X_WB.inv_mul(&self.camera.X_WC);
        let R_BC = X_BC.rotation.to_rotation_matrix();
        let origin = Point3::from(X_BC.translation.vector);
        for row in part.top..part.top + part.height {
            for column in part.left..part.left + part.width {
                let pixel = self.index(column, row);
                if let Some(depth) =
                    caster.cast_within(&origin, &(R_BC * self.direction(column, row)), self.nearest[pixel])
                {
                    self.nearest[pixel] = depth;
                    self.shows_object[pixel] = is_object;
                }
            }
        }
    }

    /// Adds the plane z = 0.
    fn add_floor(&mut self) {
        let X_WC = &self.camera.X_WC;
        let z_C = X_WC.rotation.inverse() * Vector3::z();
        for row in self.window.top..self.window.top + self.window.height {
            for column in self.window.left..self.window.left + self.window.width {
                let depth = -X_WC.translation.z / z_C.dot(&self.direction(column, row));
                let pixel = self.index(column, row);
                if depth > 0.0 && depth < self.nearest[pixel] {
                    self.nearest[pixel] = depth;
                    self.shows_object[pixel] = false;
                }
            }
        }
    }

    /// The image as the cell hands it out.
    pub fn frame(self, camera: usize, capture_s: f64, labelled: bool) -> DepthFrame {
        let depth_m = self.nearest.iter().map(|&depth| if depth < f64::INFINITY { depth as f32 } else { f32::NAN });
        let mask = labelled.then_some(self.shows_object);
        DepthFrame { camera, capture_s, window: self.window, depth_m: depth_m.collect(), mask }
    }

    /// Direction in C through a pixel's centre, its third component one.
    fn direction(&self, column: u32, row: u32) -> Vector3<f64> {
        let [cx, cy] = self.camera.principal_px;
        let focal = self.camera.focal_px;
        Vector3::new((f64::from(column) + 0.5 - cx) / focal, (f64::from(row) + 0.5 - cy) / focal, 1.0)
    }

    fn index(&self, column: u32, row: u32) -> usize {
        (row - self.window.top) as usize * self.window.width as usize + (column - self.window.left) as usize
    }
}

/// The pixels that a body at X_WB may cover.
pub(super) fn covered(camera: &CameraModel, (X_WB, caster): &(Pose, &RayCaster)) -> PixelWindow {
    let centre_C = camera.X_WC.inverse_transform_point(&(X_WB * caster.centre()));
    if centre_C.z + caster.radius() <= 0.0 {
        PixelWindow::default()
    } else if centre_C.z - caster.radius() <= 1e-3 {
        // The camera's plane cuts the ball around the body, whose image is then unbounded.
        camera.full_window()
    } else {
        camera.window_around(&centre_C, caster.radius())
    }
}

/// The smallest depth that a body at X_WB may have.
fn nearest_depth(camera: &CameraModel, (X_WB, caster): &(Pose, &RayCaster)) -> f64 {
    camera.X_WC.inverse_transform_point(&(X_WB * caster.centre())).z - caster.radius()
}

/// The pixels that two windows share.
fn overlap(one: &PixelWindow, two: &PixelWindow) -> PixelWindow {
    // Windows come from outside and may be anything.
    let span = |from: u32, length: u32| (from, from.saturating_add(length));
    let shared = |(a, b): (u32, u32), (c, d): (u32, u32)| (a.max(c), b.min(d).saturating_sub(a.max(c)));
    let (left, width) = shared(span(one.left, one.width), span(two.left, two.width));
    let (top, height) = shared(span(one.top, one.height), span(two.top, two.height));
    if width == 0 || height == 0 { PixelWindow::default() } else { PixelWindow { left, top, width, height } }
}
