//! Ray-cast depth images of object, arm, gripper and floor.

use catch_body::{
    Gripper, Pose, Robot, TriangleMesh,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, RayCaster},
    workcell::FLOOR_Z_M,
};
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, Vector3};

/// Scene in front of the cameras at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// Time at which the shutters close, in seconds on the cell's clock.
    pub capture_s: f64,
    /// Poses of the arm's links.
    pub X_WL: &'a LinkPoses,
    /// Opening of the gripper.
    pub width_m: f64,
    /// Pose of the object.
    pub X_WO: &'a Pose,
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
    arm: ArmSurface,
    object: RayCaster,
    floor_visible: bool,
}

impl Renderer {
    /// Prepares the surfaces. The object's mesh is in O; the floor, if it can be seen, hides what lies
    /// behind it from either side.
    pub fn new(robot: &Robot, gripper: &Gripper, object: &TriangleMesh, floor_visible: bool) -> Self {
        Self { arm: ArmSurface::new(robot, gripper), object: RayCaster::new(object), floor_visible }
    }

    /// Renders one frame per camera, without any error: depth in metres along the optical axis, NaN where
    /// there is no surface; with `labelled` also which pixels show the object. The cameras stand where their
    /// models say.
    pub fn render(&self, cameras: &[CameraModel], scene: &Scene, readout: Readout, labelled: bool) -> Vec<DepthFrame> {
        let view = self.view(scene);
        let frame_of = |(index, camera): (usize, &CameraModel)| {
            let window = view.window(index, camera, readout, 0);
            let channels = Channels { shows_object: labelled, facing: false };
            view.image(camera, window, channels).frame(index, scene.capture_s)
        };
        cameras.iter().enumerate().map(frame_of).collect()
    }

    /// The surfaces where they are in `scene`.
    pub(super) fn view(&self, scene: &Scene) -> View<'_> {
        View {
            others: self.arm.parts(scene.X_WL, scene.width_m).collect(),
            object: (*scene.X_WO, &self.object),
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
    /// Adds more bodies.
    pub fn with(mut self, bodies: impl IntoIterator<Item = (Pose, &'a RayCaster)>) -> Self {
        self.others.extend(bodies);
        self
    }

    /// The pixels of camera number `index` that are read out; a window around the object is widened by
    /// `margin_px`.
    pub fn window(&self, index: usize, camera: &CameraModel, readout: Readout, margin_px: u32) -> PixelWindow {
        match readout {
            Readout::Full => camera.full_window(),
            Readout::Windows(windows) => {
                windows.get(index).map_or(camera.full_window(), |window| window.intersection(&camera.full_window()))
            }
            // One pixel all around that shows something else tells where the outline is.
            Readout::Object => widened(camera, &Sight::new(camera, &self.object).window, 1 + margin_px),
        }
    }

    /// Renders a camera's image in a window.
    pub fn image<'c>(&self, camera: &'c CameraModel, window: PixelWindow, channels: Channels) -> Image<'c> {
        let mut image = Image::empty(camera, window, channels);
        image.add_body(&Sight::new(camera, &self.object), true);
        // From near to far, because what is known to be hidden costs little. The order is the same for all
        // windows.
        let mut others: Vec<_> = self.others.iter().map(|body| Sight::new(camera, body)).collect();
        others.retain(|body| body.window.intersection(&window).area() > 0);
        others.sort_by(|one, two| one.nearest_m.total_cmp(&two.nearest_m));
        for body in &others {
            image.add_body(body, false);
        }
        if self.floor_visible {
            image.add_floor();
        }
        image
    }
}

/// A body in a camera's frame.
pub(super) struct Sight<'a> {
    X_BC: Pose,
    caster: &'a RayCaster,
    /// The smallest depth that it may have.
    nearest_m: f64,
    /// The pixels that it may cover.
    pub window: PixelWindow,
}

impl<'a> Sight<'a> {
    /// A body with its pose X_WB.
    pub fn new(camera: &CameraModel, (X_WB, caster): &(Pose, &'a RayCaster)) -> Self {
        let X_BC = X_WB.inv_mul(&camera.X_WC);
        let centre_C = X_BC.inverse_transform_point(&caster.centre());
        let (z, radius) = (centre_C.z, caster.radius());
        let window = if z + radius <= 0.0 {
            PixelWindow::default()
        } else if z - radius <= 1e-3 {
            // The camera's plane cuts the ball around the body, whose image is then unbounded.
            camera.full_window()
        } else {
            // Image coordinates of the ball's tangents, x/z = (x·z ± r·√(x² + z² − r²))/(z² − r²), and of the
            // box's corners.
            let R_CB = X_BC.rotation.to_rotation_matrix().transpose();
            let [a, b, c] = [0, 1, 2].map(|axis| R_CB * Vector3::ith(axis, caster.half_size()[axis]));
            let corners = [a + b + c, a + b - c, a - b + c, a - b - c].map(|corner| [corner, -corner]);
            let span = |axis: usize| {
                let x = centre_C[axis];
                let reach = radius * (x * x + z * z - radius * radius).sqrt();
                let ball = [x * z - reach, x * z + reach].map(|slope| slope / (z * z - radius * radius));
                let slopes = corners.iter().flatten().map(|corner| (x + corner[axis]) / (z + corner.z));
                let (low, high) =
                    slopes.fold((f64::MAX, f64::MIN), |(low, high), slope| (low.min(slope), high.max(slope)));
                [ball[0].max(low), ball[1].min(high)].map(|slope| slope * camera.focal_px + camera.principal_px[axis])
            };
            // A box whose corner reaches behind the camera bounds nothing.
            let is_bounded = corners.iter().flatten().all(|corner| z + corner.z > 1e-3);
            if is_bounded { pixels_within(camera, span(0), span(1)) } else { camera.full_window() }
        };
        Self { X_BC, caster, nearest_m: z - radius, window }
    }
}

/// The pixels whose centres lie within a box in image coordinates, and a little around it.
fn pixels_within(camera: &CameraModel, u: [f64; 2], v: [f64; 2]) -> PixelWindow {
    const SLACK: f64 = 1e-6;
    let span = |[from, to]: [f64; 2], most: u32| {
        let cut = |edge: f64| edge.clamp(0.0, f64::from(most)) as u32;
        let (first, end) = (cut((from - 0.5 - SLACK).ceil()), cut((to - 0.5 + SLACK).floor() + 1.0));
        (first, end.saturating_sub(first))
    };
    let ((left, width), (top, height)) = (span(u, camera.width_px), span(v, camera.height_px));
    if width == 0 || height == 0 { PixelWindow::default() } else { PixelWindow { left, top, width, height } }
}

/// The nearest depth seen so far in each pixel of a window.
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

impl<'a> Image<'a> {
    /// An image of nothing.
    pub fn empty(camera: &'a CameraModel, window: PixelWindow, channels: Channels) -> Self {
        let pixels = window.area();
        let shows_object = channels.shows_object.then(|| vec![false; pixels]);
        let facing = channels.facing.then(|| vec![0.0; pixels]);
        Self { camera, window, depth_m: vec![f32::NAN; pixels], shows_object, facing }
    }

    /// Adds a body wherever it is nearer than all before it.
    pub fn add_body(&mut self, body: &Sight, is_object: bool) {
        let part = body.window.intersection(&self.window);
        // Rays are cast in the body's frame: origin C, direction R_BC·((u − cx)/f, (v − cy)/f, 1), whose
        // third component of one makes the ray's parameter the depth.
        let Sight { X_BC, caster, .. } = body;
        let R_BC = X_BC.rotation.to_rotation_matrix();
        let origin = Point3::from(X_BC.translation.vector);
        for row in part.top..part.top + part.height {
            for column in part.left..part.left + part.width {
                let pixel = self.index(column, row);
                let direction = R_BC * self.direction(column, row);
                let before = self.depth_m[pixel];
                let limit = if before.is_nan() { f64::INFINITY } else { f64::from(before) };
                let depth = match &mut self.facing {
                    Some(facing) => caster.cast_to_face(&origin, &direction, limit).map(|(depth, normal)| {
                        facing[pixel] = (normal.dot(&direction).abs() / direction.norm()) as f32;
                        depth
                    }),
                    None => caster.cast_within(&origin, &direction, limit),
                };
                if let Some(depth) = depth {
                    self.depth_m[pixel] = depth as f32;
                    if let Some(shows_object) = &mut self.shows_object {
                        shows_object[pixel] = is_object;
                    }
                }
            }
        }
    }

    /// Adds the floor.
    fn add_floor(&mut self) {
        let X_WC = &self.camera.X_WC;
        let z_C = X_WC.rotation.inverse() * Vector3::z();
        for row in self.window.top..self.window.top + self.window.height {
            for column in self.window.left..self.window.left + self.window.width {
                let direction = self.direction(column, row);
                let descent = z_C.dot(&direction);
                let depth = ((FLOOR_Z_M - X_WC.translation.z) / descent) as f32;
                let pixel = self.index(column, row);
                let before = self.depth_m[pixel];
                if depth > 0.0 && depth < f32::INFINITY && (before.is_nan() || depth < before) {
                    self.depth_m[pixel] = depth;
                    if let Some(shows_object) = &mut self.shows_object {
                        shows_object[pixel] = false;
                    }
                    if let Some(facing) = &mut self.facing {
                        facing[pixel] = (descent.abs() / direction.norm()) as f32;
                    }
                }
            }
        }
    }

    /// The image as the cell hands it out.
    pub fn frame(self, camera: usize, capture_s: f64) -> DepthFrame {
        DepthFrame { camera, capture_s, window: self.window, depth_m: self.depth_m, mask: self.shows_object }
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

/// A window with so many pixels more on each side, cut to the image; one that is empty stays so.
pub(super) fn widened(camera: &CameraModel, window: &PixelWindow, margin_px: u32) -> PixelWindow {
    if window.area() == 0 {
        return *window;
    }
    let (left, top) = (window.left.saturating_sub(margin_px), window.top.saturating_sub(margin_px));
    let right = (window.left + window.width + margin_px).min(camera.width_px);
    let bottom = (window.top + window.height + margin_px).min(camera.height_px);
    PixelWindow { left, top, width: right - left, height: bottom - top }
}
