//! Ray-cast depth images of object, arm, gripper and floor.

use std::sync::Arc;

use catch_body::{
    Gripper, Pose, Robot, TriangleMesh,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, RayCaster},
    workcell::FLOOR_Z_M,
};
use catch_cell::{
    CameraModel, DepthFrame, PixelWindow,
    sight::{DepthBuffer, Sight},
};
use nalgebra::Vector3;

/// Scene in front of the cameras at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Scene {
    /// Time at which the shutters close, in seconds on the cell's clock.
    pub capture_s: f64,
    /// Poses of the arm's links.
    pub X_WL: LinkPoses,
    /// Opening of the gripper.
    pub width_m: f64,
    /// Pose of the object.
    pub X_WO: Pose,
}

/// Pixels that are read out.
#[derive(Debug, Clone, Copy)]
pub enum Readout<'a> {
    /// All of them.
    Full,
    /// One window per camera, cut to the image; cameras beyond the end of the list read out all.
    Windows(&'a [PixelWindow]),
    /// The box around the object's image, which a sensor that tells objects apart tracks by itself; empty
    /// where the object is out of sight.
    Object,
}

/// The surfaces that cameras may see, prepared once; each scene only brings poses.
///
/// A pixel's depth is that of the nearest surface on the ray through the pixel's centre, exact for the
/// meshes. It does not depend on which other pixels are read out, so a window equals the same part of the
/// full image bit for bit.
#[derive(Debug, Clone)]
pub struct Renderer {
    arm: Arc<ArmSurface>,
    object: Arc<RayCaster>,
    floor_visible: bool,
}

impl Renderer {
    /// Prepares the surfaces. The object's mesh is in O; the floor, if it can be seen, hides what lies
    /// behind it from either side.
    pub fn new(robot: &Robot, gripper: &Gripper, object: &TriangleMesh, floor_visible: bool) -> Self {
        let arm = Arc::new(ArmSurface::new(robot, gripper));
        Self { arm, object: Arc::new(RayCaster::new(object)), floor_visible }
    }

    /// The same with another arm.
    pub(crate) fn with_arm(self, robot: &Robot, gripper: &Gripper) -> Self {
        Self { arm: Arc::new(ArmSurface::new(robot, gripper)), ..self }
    }

    /// The same with the object of another one.
    pub(crate) fn with_object_of(self, other: &Self) -> Self {
        Self { object: other.object.clone(), ..self }
    }

    /// The surfaces where they are in `scene`, and further ones with their poses.
    pub(super) fn view<'a>(&'a self, scene: &Scene, more: impl Iterator<Item = (Pose, &'a RayCaster)>) -> View<'a> {
        View {
            others: self.arm.parts(&scene.X_WL, scene.width_m).chain(more).collect(),
            object: (scene.X_WO, &self.object),
            floor_visible: self.floor_visible,
        }
    }
}

/// Surfaces with their poses X_WB.
pub(super) struct View<'a> {
    /// All but the object.
    others: Vec<(Pose, &'a RayCaster)>,
    object: (Pose, &'a RayCaster),
    floor_visible: bool,
}

impl<'a> View<'a> {
    /// The pixels of camera number `index` that are read out; a window around the object is widened by
    /// `margin_px`.
    pub fn window(&self, index: usize, camera: &CameraModel, readout: Readout, margin_px: u32) -> PixelWindow {
        match readout {
            Readout::Full => camera.full_window(),
            Readout::Windows(windows) => {
                windows.get(index).map_or(camera.full_window(), |window| window.intersection(&camera.full_window()))
            }
            // One pixel all around that shows something else tells where the outline is.
            Readout::Object => {
                let window = Sight::new(camera, &self.object.0, self.object.1).window();
                window.widened(1 + margin_px, &camera.full_window())
            }
        }
    }

    /// All bodies before a camera: the object, then the others from near to far. The order is the same for
    /// all windows.
    pub fn bodies<'c>(&self, camera: &'c CameraModel) -> Vec<Sight<'c>>
    where
        'a: 'c,
    {
        let all = std::iter::once(&self.object).chain(&self.others);
        let mut bodies: Vec<Sight> = all.map(|(X_WB, surface)| Sight::new(camera, X_WB, surface)).collect();
        bodies[1..].sort_by(|one, two| one.nearest_m().total_cmp(&two.nearest_m()));
        bodies
    }

    /// The pixels that may show any surface.
    pub fn covered(&self, camera: &CameraModel, bodies: &[Sight]) -> PixelWindow {
        let all = bodies.iter().map(Sight::window).fold(PixelWindow::default(), |a, b| a.hull(&b));
        if self.floor_visible { camera.full_window() } else { all }
    }

    /// Renders a camera's image of bodies in a window.
    pub fn image<'c>(
        &self,
        camera: &'c CameraModel,
        bodies: &[Sight],
        window: PixelWindow,
        channels: Channels,
    ) -> Image<'c> {
        let seen = DepthBuffer::new(window, bodies.iter().copied());

        let up_C = camera.X_WC.rotation.inverse() * Vector3::z();
        let floor = self.floor_visible.then_some((FLOOR_Z_M - camera.X_WC.translation.z, up_C));
        let pixels = window.area();
        let mut image = Image {
            camera,
            window,
            depth_m: vec![f32::NAN; pixels],
            shows_object: channels.shows_object.then(|| vec![false; pixels]),
            facing: channels.facing.then(|| vec![0.0; pixels]),
        };
        for (pixel, seen) in seen.pixels().enumerate().filter(|(_, seen)| seen.is_some() || floor.is_some()) {
            let ray_C = camera.back_project(&window.pixel_centre(pixel), 1.0).coords;
            let floor_m = floor.map(|(below_m, up_C)| below_m / up_C.dot(&ray_C));
            let floor_m = floor_m.filter(|it| *it > 0.0 && it.is_finite());
            let nearest = seen.filter(|(_, hit)| floor_m.is_none_or(|floor_m| hit.t <= floor_m));
            let Some(depth_m) = nearest.map(|(_, hit)| hit.t).or(floor_m) else { continue };
            image.depth_m[pixel] = depth_m as f32;
            if let Some(shows_object) = &mut image.shows_object {
                shows_object[pixel] = nearest.is_some_and(|(body, _)| body == 0);
            }
            if let Some(facing) = &mut image.facing {
                let normal_C = nearest.map(|(body, hit)| bodies[body].normal_C(hit.triangle));
                let normal_C = normal_C.or(floor.map(|(_, up_C)| up_C)).unwrap_or_default();
                facing[pixel] = (normal_C.dot(&ray_C).abs() / ray_C.norm()) as f32;
            }
        }
        image
    }
}

/// The nearest surface in each pixel of a window.
pub(super) struct Image<'a> {
    pub camera: &'a CameraModel,
    pub window: PixelWindow,
    /// Depth along the optical axis in metres, row by row; NaN where nothing was met.
    pub depth_m: Vec<f32>,
    /// True for each pixel where that surface is the object's.
    pub shows_object: Option<Vec<bool>>,
    /// Cosine of the angle of incidence there.
    pub facing: Option<Vec<f32>>,
}

/// Channels of an image beside the depths.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Channels {
    pub shows_object: bool,
    pub facing: bool,
}

impl Image<'_> {
    /// The image as the cell hands it out.
    pub fn frame(self, camera: usize, capture_s: f64) -> DepthFrame {
        DepthFrame { camera, capture_s, window: self.window, depth_m: self.depth_m, mask: self.shows_object }
    }
}
