//! Rendering of the arm as a camera would see it: inverse depth, surface normal and part of each pixel.

use catch_body::{
    Pose,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, RayCaster, SurfacePart},
};
use catch_cell::{CameraModel, PixelWindow};
use nalgebra::{Point3, Vector3};

/// Pixels around the arm that are looked at, too.
const MARGIN_PX: u32 = 16;

/// Corners of boxes nearer than this to the camera's plane, in metres, may be anywhere in the image.
const NEAR_M: f64 = 1e-3;

/// A part of the arm's surface in a camera's frame.
#[derive(Debug, Clone, Copy)]
struct Body<'a> {
    part: SurfacePart,
    X_BC: Pose,
    caster: &'a RayCaster,
    nearest_m: f64,
    window: PixelWindow,
}

/// Intersection of one pixel's ray with the arm.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// 1/z in 1/m.
    pub inverse_m: f64,
    /// Outward normal in C, of length one.
    pub normal_C: Vector3<f64>,
    /// Cosine of the angle of incidence.
    pub cosine: f64,
    /// Part of the surface that was met.
    pub part: SurfacePart,
}

/// The arm as a camera sees it.
#[derive(Debug, Clone)]
pub struct Rendering<'a> {
    camera: &'a CameraModel,
    bodies: Vec<Body<'a>>,
    /// The pixels that follow: all that may show the arm, and some around them.
    pub window: PixelWindow,
    /// Intersection of each pixel's ray in the window, row by row.
    pub hits: Vec<Option<Hit>>,
}

impl<'a> Rendering<'a> {
    /// Casts a ray through the centre of each pixel that may show the arm.
    pub fn new(camera: &'a CameraModel, surface: &'a ArmSurface, X_WL: &LinkPoses, width_m: f64) -> Self {
        let full = camera.full_window();
        let mut bodies: Vec<Body<'a>> = Vec::new();
        for (part, X_WB, caster) in surface.named_parts(X_WL, width_m) {
            let X_BC = X_WB.inv_mul(&camera.X_WC);
            let centre_C = X_BC.inverse_transform_point(&caster.centre());
            let window = window_of(camera, &X_BC, caster);
            if window.area() > 0 {
                bodies.push(Body { part, X_BC, caster, nearest_m: centre_C.z - caster.radius(), window });
            }
        }
        // Surfaces that are known to be hidden cost little.
        bodies.sort_by(|one, two| one.nearest_m.total_cmp(&two.nearest_m));
        let arm = bodies.iter().filter(|it| it.part != SurfacePart::Obstacle);
        let window = arm.map(|it| it.window).reduce(hull).map(|it| widened(&it, &full)).unwrap_or_default();
        let mut rendering = Self { camera, bodies, window, hits: vec![None; window.area()] };
        rendering.cast();
        rendering
    }

    fn cast(&mut self) {
        let Self { camera, bodies, window, hits } = self;
        for body in bodies.iter() {
            let part = window.intersection(&body.window);
            for row in part.top..part.top + part.height {
                for column in part.left..part.left + part.width {
                    let ray_C = ray(camera, f64::from(column) + 0.5, f64::from(row) + 0.5);
                    let hit = &mut hits[((row - window.top) * window.width + column - window.left) as usize];
                    let limit_m = hit.map_or(f64::INFINITY, |it| 1.0 / it.inverse_m);
                    if let Some(nearer) = body.cast(&ray_C, limit_m) {
                        *hit = Some(nearer);
                    }
                }
            }
        }
    }

    /// Nearest intersection of the ray through image coordinates.
    pub fn hit_at(&self, u_px: f64, v_px: f64) -> Option<Hit> {
        let ray_C = ray(self.camera, u_px, v_px);
        let pixel = PixelWindow { left: u_px as u32, top: v_px as u32, width: 1, height: 1 };
        let may_show = |it: &&Body<'_>| it.window.intersection(&pixel).area() > 0;
        self.bodies.iter().filter(may_show).fold(None, |nearest: Option<Hit>, body| {
            body.cast(&ray_C, nearest.map_or(f64::INFINITY, |it| 1.0 / it.inverse_m)).or(nearest)
        })
    }

    /// Intersection of the pixel in a column and row of the window; none outside of it.
    pub fn at(&self, column: i64, row: i64) -> Option<&Hit> {
        let inside =
            column >= 0 && row >= 0 && column < i64::from(self.window.width) && row < i64::from(self.window.height);
        if inside { self.hits[(row * i64::from(self.window.width) + column) as usize].as_ref() } else { None }
    }
}

impl Body<'_> {
    fn cast(&self, ray_C: &Vector3<f64>, limit_m: f64) -> Option<Hit> {
        let origin = Point3::from(self.X_BC.translation.vector);
        let direction = self.X_BC.rotation * ray_C;
        // The ray's third component is one: its parameter is the depth.
        let (depth_m, normal_B) = self.caster.cast_to_face(&origin, &direction, limit_m)?;
        let normal_C = self.X_BC.rotation.inverse() * normal_B;
        let cosine = -normal_C.dot(ray_C) / ray_C.norm();
        Some(Hit { inverse_m: 1.0 / depth_m, normal_C, cosine, part: self.part })
    }
}

/// Direction in C through image coordinates, its third component one.
pub fn ray(camera: &CameraModel, u_px: f64, v_px: f64) -> Vector3<f64> {
    let [cx, cy] = camera.principal_px;
    Vector3::new((u_px - cx) / camera.focal_px, (v_px - cy) / camera.focal_px, 1.0)
}

/// The pixels that the box around a mesh may cover.
fn window_of(camera: &CameraModel, X_BC: &Pose, caster: &RayCaster) -> PixelWindow {
    let corner = |i: usize| {
        let sign = Vector3::from_fn(|axis, _| if i >> axis & 1 == 0 { 1.0 } else { -1.0 });
        X_BC.inverse_transform_point(&(caster.centre() + caster.half_size().component_mul(&sign)))
    };
    let corners: [Point3<f64>; 8] = std::array::from_fn(corner);
    if corners.iter().all(|it| it.z < 0.0) {
        return PixelWindow::default();
    }
    if corners.iter().any(|it| it.z < NEAR_M) {
        return camera.full_window();
    }
    let uv = corners.map(|it| camera.project(&it).unwrap_or_default());
    let (least, greatest) = uv.iter().fold((uv[0], uv[0]), |(least, greatest), it| (least.inf(it), greatest.sup(it)));
    // A pixel to each side, for rounding.
    let cut = |at: f64, most: u32| at.clamp(0.0, f64::from(most)) as u32;
    let (left, right) = (cut(least.x - 1.0, camera.width_px), cut(greatest.x + 2.0, camera.width_px));
    let (top, bottom) = (cut(least.y - 1.0, camera.height_px), cut(greatest.y + 2.0, camera.height_px));
    PixelWindow { left, top, width: right - left, height: bottom - top }
}

fn hull(one: PixelWindow, two: PixelWindow) -> PixelWindow {
    let (left, top) = (one.left.min(two.left), one.top.min(two.top));
    let right = (one.left + one.width).max(two.left + two.width);
    let bottom = (one.top + one.height).max(two.top + two.height);
    PixelWindow { left, top, width: right - left, height: bottom - top }
}

fn widened(window: &PixelWindow, full: &PixelWindow) -> PixelWindow {
    let (left, top) = (window.left.saturating_sub(MARGIN_PX), window.top.saturating_sub(MARGIN_PX));
    let wide = PixelWindow {
        left,
        top,
        width: window.left + window.width + MARGIN_PX - left,
        height: window.top + window.height + MARGIN_PX - top,
    };
    wide.intersection(full)
}
