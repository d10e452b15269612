//! What a camera sees of surfaces: the pixels that they may cover, and the nearest one behind each pixel.
//!
//! Arena, brain and calibration ask this of the arm many thousand times a throw, so it is answered in one
//! place. A small part of an image is found by ray casting, a large one by rasterization into a z-buffer: a
//! pixel shows the same, bit for bit, by whichever of the two.

use std::ops::Range;

use catch_body::{
    Pose,
    ray_cast::{Hit, RayCaster},
};
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use crate::{CameraModel, PixelWindow};

/// What is nearer to the camera's plane than this, in metres, may be anywhere in the image.
const NEAR_M: f64 = 1e-4;
/// Distance of a camera from the box around a surface in metres, below which rays draw it: no part of it that
/// an image shows is then nearer than [`NEAR_M`].
const BESIDE_M: f64 = 0.01;
/// A surface with fewer triangles than this for each pixel is rasterized.
const TRIANGLES_PER_PIXEL: usize = 4;
/// Triangles and pixels that are drawn, and pixels that are cleared, in the time of a ray. The triangles were
/// measured on one machine, the pixels estimated; they change no result.
const TRIANGLES_PER_RAY: usize = 4;
const COVERED_PIXELS_PER_RAY: usize = 16;
const CLEARED_PIXELS_PER_RAY: usize = 64;

/// A surface in front of a camera.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    camera: &'a CameraModel,
    surface: &'a RayCaster,
    /// Orientation and position of the camera in the surface's frame B.
    R_BC: Matrix3<f64>,
    p_BC: Point3<f64>,
    centre_C: Point3<f64>,
    window: PixelWindow,
}

impl<'a> Sight<'a> {
    /// A surface with its pose X_WB.
    pub fn new(camera: &'a CameraModel, X_WB: &Pose, surface: &'a RayCaster) -> Self {
        let X_BC = X_WB.inv_mul(&camera.X_WC);
        let (R_BC, p_BC) = (X_BC.rotation.to_rotation_matrix().into_inner(), X_BC.translation.vector.into());
        let centre_C = Point3::from(R_BC.tr_mul(&(surface.centre - p_BC)));
        let mut sight = Self { camera, surface, R_BC, p_BC, centre_C, window: PixelWindow::default() };
        sight.window = sight.window_of(&centre_C);
        sight
    }

    /// The smallest and the largest depth that the surface may have, in metres.
    pub fn depths_m(&self) -> [f64; 2] {
        [self.centre_C.z - self.surface.radius, self.centre_C.z + self.surface.radius]
    }

    /// The smallest depth that the surface may have, in metres.
    pub fn nearest_m(&self) -> f64 {
        self.depths_m()[0]
    }

    /// The pixels that the surface may cover.
    pub fn window(&self) -> PixelWindow {
        self.window
    }

    /// The nearest point of the surface at image coordinates, if its depth is below `limit_m`.
    pub fn at(&self, uv: &Point2<f64>, limit_m: f64) -> Option<Hit> {
        self.along(&self.camera.back_project(uv, 1.0).coords, limit_m)
    }

    /// The nearest point of the surface along a ray in C whose third component is one, which makes the hit's
    /// parameter the depth, if that is below `limit_m`.
    pub fn along(&self, ray_C: &Vector3<f64>, limit_m: f64) -> Option<Hit> {
        // Most rays pass by the ball around the surface, which costs least to find out here.
        let along = self.centre_C.coords.dot(ray_C) / ray_C.norm_squared();
        let passes_by =
            (self.centre_C.coords - ray_C * along).norm_squared() > self.surface.radius.powi(2) * (1.0 + 1e-9);
        if passes_by { None } else { self.surface.cast_within(&self.p_BC, &(self.R_BC * ray_C), limit_m) }
    }

    /// Normal of a triangle in C, of length one.
    pub fn normal_C(&self, triangle: usize) -> Vector3<f64> {
        self.R_BC.tr_mul(&self.surface.normal(triangle))
    }

    fn in_camera(&self, p_B: &Point3<f64>) -> Point3<f64> {
        self.R_BC.tr_mul(&(p_B - self.p_BC)).into()
    }

    fn window_of(&self, centre_C: &Point3<f64>) -> PixelWindow {
        let (camera, z, radius) = (self.camera, centre_C.z, self.surface.radius);
        if z + radius <= 0.0 {
            return PixelWindow::default();
        }
        let half_size = self.surface.half_size;
        let [a, b, c] = [0, 1, 2].map(|axis| self.R_BC.row(axis).transpose() * half_size[axis]);
        let corners = [a + b + c, a + b - c, a - b + c, a - b - c].map(|corner| [corner, -corner]);
        // The image of a ball or box that the camera's plane cuts is unbounded.
        if z - radius <= NEAR_M || corners.iter().flatten().any(|corner| z + corner.z <= NEAR_M) {
            return camera.full_window();
        }
        // Image coordinates of the ball's tangents, x/z = (x·z ± r·√(x² + z² − r²))/(z² − r²), and of the
        // box's corners.
        let pixels = |axis: usize, of: Range<u32>| {
            let x = centre_C[axis];
            let reach = radius * (x * x + z * z - radius * radius).sqrt();
            let ball = [x * z - reach, x * z + reach].map(|slope| slope / (z * z - radius * radius));
            let slopes = corners.iter().flatten().map(|corner| (x + corner[axis]) / (z + corner.z));
            let (low, high) = slopes.fold((f64::MAX, f64::MIN), |(low, high), slope| (low.min(slope), high.max(slope)));
            centres_within(self.in_pixels(axis, ball[0].max(low)), self.in_pixels(axis, ball[1].min(high)), of)
        };
        PixelWindow::of(&pixels(0, 0..camera.width_px), &pixels(1, 0..camera.height_px))
    }

    /// Returns whether rays draw this many pixels of the surface.
    fn is_cast(&self, pixels: usize) -> bool {
        let from_centre = (self.p_BC - self.surface.centre).abs();
        let is_within = (from_centre - self.surface.half_size).max() < BESIDE_M;
        is_within || self.surface.mesh.triangles.len() >= TRIANGLES_PER_PIXEL * pixels
    }

    /// About how many rays take as long as drawing the surface in a window.
    fn drawing_rays(&self, window: &PixelWindow) -> usize {
        let covered = self.window.intersection(window).area();
        let (triangles, pixels) = (self.surface.mesh.triangles.len(), covered / COVERED_PIXELS_PER_RAY);
        if self.is_cast(covered) { covered } else { triangles / TRIANGLES_PER_RAY + pixels }
    }

    /// Puts the surface, number `number` of a buffer, where it is nearer than what is there.
    fn draw(&self, number: u32, buffer: &mut DepthBuffer) {
        let part = self.window.intersection(&buffer.window);
        if self.is_cast(part.area()) {
            for row in part.rows() {
                for column in part.columns() {
                    let pixel = buffer.pixel(column, row);
                    if let Some(hit) = self.along(&self.ray_C(column, row), pixel.depth_m) {
                        *pixel = Pixel::new(number, hit);
                    }
                }
            }
        } else {
            self.rasterize(number, &part, buffer);
        }
    }

    /// Draws a part of a buffer by scan conversion.
    fn rasterize(&self, number: u32, part: &PixelWindow, buffer: &mut DepthBuffer) {
        let mesh = &self.surface.mesh;
        let (mut slopes, mut vertices) = (std::mem::take(&mut buffer.slopes), std::mem::take(&mut buffer.vertices));
        slopes.clear();
        slopes.extend(part.columns().map(|column| self.ray_C(column, 0).x));
        let is_cut = self.nearest_m() <= NEAR_M;
        let in_image = |p_C: Point3<f64>| {
            let [u, v] = [0, 1].map(|axis| self.in_pixels(axis, p_C[axis] / p_C.z));
            Point3::new(u, v, p_C.z)
        };
        let seen = |p_C: Point3<f64>| if is_cut { p_C } else { in_image(p_C) };
        vertices.clear();
        vertices.extend(mesh.vertices.iter().map(|p_B| seen(self.in_camera(p_B))));
        // Those that face the camera first, because they hide the others.
        for faces_camera in [true, false] {
            for (triangle, corners) in mesh.triangles.iter().enumerate() {
                let [a, b, c] = corners.map(|index| vertices[index as usize]);
                let (polygon, count) = if is_cut { before_camera([a, b, c]) } else { ([a, b, c, c], 3) };
                let polygon = &if is_cut { polygon.map(in_image) } else { polygon }[..count];
                let [a, b, c, ..] = polygon else { continue };
                let turn = (b - a).xy().perp(&(c - a).xy());
                let range = |axis: usize| {
                    let ends = |[low, high]: [f64; 2], it: &Point3<f64>| [low.min(it[axis]), high.max(it[axis])];
                    polygon.iter().fold([f64::MAX, f64::MIN], ends)
                };
                let [highest, lowest] = range(1);
                let rows = centres_within(highest, lowest, part.rows());
                if (turn < 0.0) != faces_camera || rows.is_empty() {
                    continue;
                }
                let least_m = range(2)[0] * (1.0 - SLACK);
                let edges: [Option<Edge>; 4] =
                    std::array::from_fn(|i| (i < count).then(|| Edge::new(polygon[i], polygon[(i + 1) % count])));
                for row in rows {
                    let spans = edges.iter().flatten().filter_map(|edge| edge.span(f64::from(row) + 0.5));
                    let join = |one: [f64; 2], other: [f64; 2]| [one[0].min(other[0]), one[1].max(other[1])];
                    let [left, right] = spans.fold([f64::MAX, f64::MIN], join);
                    let slope = self.ray_C(0, row).y;
                    for column in centres_within(left, right, part.columns()) {
                        let pixel = buffer.pixel(column, row);
                        if least_m > pixel.depth_m {
                            continue;
                        }
                        let ray_B = self.R_BC * Vector3::new(slopes[(column - part.left) as usize], slope, 1.0);
                        let hit = self.surface.cast_at(triangle, &self.p_BC, &ray_B);
                        if let Some(hit) = hit.filter(|hit| pixel.is_behind(number, hit)) {
                            *pixel = Pixel::new(number, hit);
                        }
                    }
                }
            }
        }
        (buffer.slopes, buffer.vertices) = (slopes, vertices);
    }

    /// The ray through a pixel's centre, in C; its third component is one.
    fn ray_C(&self, column: u32, row: u32) -> Vector3<f64> {
        let uv = Point2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
        self.camera.back_project(&uv, 1.0).coords
    }

    fn in_pixels(&self, axis: usize, slope: f64) -> f64 {
        slope * self.camera.focal_px + self.camera.principal_px[axis]
    }
}

/// A pixel of a [`DepthBuffer`].
#[derive(Debug, Clone, Copy)]
struct Pixel {
    depth_m: f64,
    surface: u32,
    triangle: u32,
}

impl Pixel {
    fn new(surface: u32, hit: Hit) -> Self {
        Self { depth_m: hit.t, surface, triangle: hit.triangle as u32 }
    }

    fn hit(&self) -> Hit {
        Hit { t: self.depth_m, triangle: self.triangle as usize }
    }

    /// Returns whether a point of a surface is seen before what is there.
    fn is_behind(&self, surface: u32, hit: &Hit) -> bool {
        if self.surface == surface { hit.is_before(&self.hit()) } else { hit.t < self.depth_m }
    }
}

/// A z-buffer: the nearest surface behind the centre of each pixel in a window.
#[derive(Debug, Clone, Default)]
pub struct DepthBuffer {
    window: PixelWindow,
    pixels: Vec<Pixel>,
    /// Room for the rays' slopes across the columns, and for the corners of a surface in the image.
    slopes: Vec<f64>,
    vertices: Vec<Point3<f64>>,
}

impl DepthBuffer {
    /// Draws surfaces, numbered as they come. Of two that are equally near the first is seen. From near to
    /// far costs least.
    pub fn new<'a>(window: PixelWindow, surfaces: impl IntoIterator<Item = Sight<'a>>) -> Self {
        let mut buffer = Self::default();
        buffer.redraw(window, surfaces);
        buffer
    }

    /// About how many rays take as long as [drawing](Self::redraw) these surfaces.
    pub fn drawing_rays<'a>(window: &PixelWindow, surfaces: impl IntoIterator<Item = Sight<'a>>) -> usize {
        let of_surfaces: usize = surfaces.into_iter().map(|it| it.drawing_rays(window)).sum();
        window.area() / CLEARED_PIXELS_PER_RAY + of_surfaces
    }

    /// Draws other surfaces in the same memory.
    pub fn redraw<'a>(&mut self, window: PixelWindow, surfaces: impl IntoIterator<Item = Sight<'a>>) {
        let nothing = Pixel { depth_m: f64::INFINITY, surface: u32::MAX, triangle: 0 };
        self.window = window;
        self.pixels.clear();
        self.pixels.resize(window.area(), nothing);
        for (number, surface) in (0..).zip(surfaces) {
            surface.draw(number, self);
        }
    }

    /// The depth that the pixel at image coordinates shows, infinite where that is none; `None` outside of
    /// the window.
    pub fn depth_m(&self, uv: &Point2<f64>) -> Option<f64> {
        let Self { window, pixels, .. } = self;
        let [column, row] = [uv.x, uv.y].map(|at| at as u32);
        let at = || (row - window.top) as usize * window.width as usize + (column - window.left) as usize;
        window.contains(uv).then(|| pixels[at()].depth_m)
    }

    /// Number of the surface that each pixel shows, row by row, and where it is hit; its parameter is the
    /// depth.
    pub fn pixels(&self) -> impl Iterator<Item = Option<(usize, Hit)>> {
        self.pixels.iter().map(|it| (it.surface != u32::MAX).then_some((it.surface as usize, it.hit())))
    }

    fn pixel(&mut self, column: u32, row: u32) -> &mut Pixel {
        let Self { window, pixels, .. } = self;
        &mut pixels[(row - window.top) as usize * window.width as usize + (column - window.left) as usize]
    }
}

/// Distance around a box or a triangle in which a pixel still counts as covered, in pixels: far above
/// rounding.
const SLACK: f64 = 1e-5;

/// The pixels of a row or column whose centres lie between two image coordinates, and a little around them.
fn centres_within(from: f64, to: f64, of: Range<u32>) -> Range<u32> {
    // The smallest whole number that is not below, which casts find in less time than `ceil` does.
    let from = (from - 0.5 - SLACK).min(f64::from(of.end));
    let first = from as u32 + u32::from(f64::from(from as u32) < from);
    first.clamp(of.start, of.end)..((to + 0.5 + SLACK) as u32).clamp(of.start, of.end)
}

/// The part of a triangle in C that lies before the camera, and its number of corners: three, four where the
/// camera's plane cuts one off, none where all is behind (Sutherland and Hodgman, Reentrant polygon clipping,
/// 1974).
fn before_camera(corners: [Point3<f64>; 3]) -> ([Point3<f64>; 4], usize) {
    let (mut polygon, mut count) = ([Point3::new(0.0, 0.0, 1.0); 4], 0);
    for (from, to) in [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (corners[from], corners[to])) {
        let cut = || from + (to - from) * ((NEAR_M - from.z) / (to.z - from.z));
        let kept = [(from.z > NEAR_M).then_some(from), ((from.z > NEAR_M) != (to.z > NEAR_M)).then(cut)];
        for corner in kept.into_iter().flatten() {
            polygon[count] = corner;
            count += 1;
        }
    }
    (polygon, count)
}

/// An edge of a clipped triangle in the image.
struct Edge {
    from: Point3<f64>,
    /// The ranges of its image coordinates.
    u: [f64; 2],
    v: [f64; 2],
    /// Change of u with v.
    slope: f64,
}

impl Edge {
    fn new(from: Point3<f64>, to: Point3<f64>) -> Self {
        let range = |a: f64, b: f64| [a.min(b), a.max(b)];
        let slope = (to.x - from.x) / (to.y - from.y);
        Self { from, u: range(from.x, to.x), v: range(from.y, to.y), slope }
    }

    /// The part of a row's centre line that it covers.
    fn span(&self, v: f64) -> Option<[f64; 2]> {
        let is_level = self.v[1] - self.v[0] <= SLACK;
        let at = (self.from.x + (v - self.from.y) * self.slope).clamp(self.u[0], self.u[1]);
        let is_met = v >= self.v[0] - SLACK && v <= self.v[1] + SLACK;
        is_met.then_some(if is_level { self.u } else { [at; 2] })
    }
}

#[cfg(test)]
mod tests {
    use catch_body::{
        TriangleMesh,
        shape::{Capsule, Cuboid},
    };
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;

    fn camera() -> CameraModel {
        CameraModel::with_field_of_view(Pose::identity(), 120, 80, 0.9)
    }

    fn surfaces() -> Vec<RayCaster> {
        let capsule = Capsule { from: Point3::new(0.0, -0.2, 0.0), to: Point3::new(0.05, 0.3, 0.1), radius: 0.07 };
        let half = TriangleMesh {
            triangles: TriangleMesh::sphere(0.2, 2).triangles.into_iter().step_by(2).collect(),
            ..TriangleMesh::sphere(0.2, 2)
        };
        let cuboid = TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size: Vector3::new(0.3, 0.1, 0.2) });
        [TriangleMesh::capsule(&capsule, 24), half, cuboid].iter().map(RayCaster::new).collect()
    }

    proptest! {
        /// Whatever is near or far, open or closed, within the image or across its border.
        #[test]
        fn pixels_show_what_their_rays_hit(
            place in prop::array::uniform3(-1.0_f64..1.0),
            ahead_m in -0.2_f64..2.0,
            turn in prop::array::uniform3(-3.0_f64..3.0),
            left in 0_u32..100,
            width in 1_u32..120,
        ) {
            let (camera, surfaces) = (camera(), surfaces());
            let rotation = UnitQuaternion::from_scaled_axis(turn.into());
            let at = |number: usize| {
                let p = Vector3::new(0.5 * place[0], 0.3 * place[1], ahead_m + 0.1 * number as f64 * place[2]);
                Pose::from_parts(p.into(), rotation)
            };
            let sights: Vec<Sight> = (0..).zip(&surfaces).map(|(i, it)| Sight::new(&camera, &at(i), it)).collect();
            let window = PixelWindow { left, top: 7, width, height: 61 }.intersection(&camera.full_window());
            // In the memory of another picture.
            let mut buffer = DepthBuffer::new(camera.full_window(), sights[1..].iter().copied());
            buffer.redraw(window, sights.iter().copied());
            prop_assert_eq!(buffer.depth_m(&Point2::new(f64::from(left) + 0.5, 6.5)), None);
            for (pixel, seen) in buffer.pixels().enumerate() {
                let uv = window.pixel_centre(pixel);
                let nearest = sights.iter().enumerate().fold(None, |nearest: Option<(usize, Hit)>, (i, sight)| {
                    sight.at(&uv, nearest.map_or(f64::INFINITY, |(_, hit)| hit.t)).map(|hit| (i, hit)).or(nearest)
                });
                prop_assert_eq!(seen, nearest, "pixel {}", pixel);
                prop_assert_eq!(buffer.depth_m(&uv), Some(nearest.map_or(f64::INFINITY, |(_, hit)| hit.t)));
            }
        }
    }
}
