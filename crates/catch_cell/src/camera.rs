//! Depth cameras, their images, and the scan of an object that is known beforehand.

use std::ops::Range;

use catch_body::{Pose, quantity};
use nalgebra::{Point2, Point3};
use serde::{Deserialize, Serialize};

use crate::DataSheet;

/// A pinhole depth camera at a known place.
///
/// Frame C: z along the optical axis, x to the right, y down in the image. Pixel (0, 0) covers image
/// coordinates 0 to 1, so its centre is at (0.5, 0.5).
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraModel {
    /// Pose of the camera in the world (for a reference scan: in the reference frame R), as calibrated.
    pub X_WC: quantity::pose<Pose>,
    /// Image width.
    pub width_px: quantity::image_px<u32>,
    /// Image height.
    pub height_px: quantity::image_px<u32>,
    /// Focal length in pixels, the same along both axes; there is no lens distortion.
    pub focal_px: quantity::focal_px,
    /// Principal point in image coordinates.
    pub principal_px: quantity::image_coordinate_px<[f64; 2]>,
    /// Images per second, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_hz: quantity::rate_hz<Option<f64>>,
    /// Depth errors according to the camera's data sheet; none are expected without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheet: Option<DataSheet>,
}

impl CameraModel {
    /// A camera whose principal point is the image centre, with a vertical field of view in radians.
    pub fn with_field_of_view(X_WC: Pose, width_px: u32, height_px: u32, vertical_rad: f64) -> Self {
        let [width, height] = [f64::from(width_px), f64::from(height_px)];
        let focal_px = height / 2.0 / libm::tan(vertical_rad / 2.0);
        Self {
            X_WC,
            width_px,
            height_px,
            focal_px,
            principal_px: [width / 2.0, height / 2.0],
            rate_hz: None,
            sheet: None,
        }
    }

    /// Point in C seen at image coordinates `uv` at depth `depth_m` along the optical axis.
    #[inline]
    pub fn back_project(&self, uv: &Point2<f64>, depth_m: f64) -> Point3<f64> {
        let [cx, cy] = self.principal_px;
        Point3::new((uv.x - cx) / self.focal_px * depth_m, (uv.y - cy) / self.focal_px * depth_m, depth_m)
    }

    /// Image coordinates in pixels of a point in C, given in metres; `None` behind the camera. They may lie
    /// outside of the image.
    #[inline]
    pub fn project(&self, p_C: &Point3<f64>) -> Option<Point2<f64>> {
        let [cx, cy] = self.principal_px;
        (p_C.z > 1e-6).then(|| Point2::new(cx + self.focal_px * p_C.x / p_C.z, cy + self.focal_px * p_C.y / p_C.z))
    }

    /// The whole image.
    pub fn full_window(&self) -> PixelWindow {
        PixelWindow { left: 0, top: 0, width: self.width_px, height: self.height_px }
    }

    /// The pixels that a sphere at `centre_C` may cover, cut to the image; empty if it cannot be seen.
    pub fn window_around(&self, centre_C: &Point3<f64>, radius_m: f64) -> PixelWindow {
        let near = centre_C.z - radius_m;
        let Some(uv) = self.project(centre_C).filter(|_| near > 1e-6) else { return PixelWindow::default() };
        // The outline reaches at most this far from the image of the centre: |Δ(x/z)| ≤ (r + |x/z|·r)/(z −
        // r).
        let reach = |offset: f64| (radius_m * self.focal_px + offset.abs() * radius_m) / near + 1.0;
        let cut = |value: f64, most: u32| value.clamp(0.0, f64::from(most)) as u32;
        let [cx, cy] = self.principal_px;
        let (du, dv) = (reach(uv.x - cx), reach(uv.y - cy));
        let (left, right) = (cut((uv.x - du).floor(), self.width_px), cut((uv.x + du).ceil(), self.width_px));
        let (top, bottom) = (cut((uv.y - dv).floor(), self.height_px), cut((uv.y + dv).ceil(), self.height_px));
        if right <= left || bottom <= top {
            return PixelWindow::default();
        }
        PixelWindow { left, top, width: right - left, height: bottom - top }
    }
}

/// A rectangle of pixels; the default is empty.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PixelWindow {
    /// First column.
    pub left: quantity::pixel<u32>,
    /// First row.
    pub top: quantity::pixel<u32>,
    /// Number of columns.
    pub width: quantity::pixel<u32>,
    /// Number of rows.
    pub height: quantity::pixel<u32>,
}

impl PixelWindow {
    /// The window of some columns and rows.
    pub fn of(columns: &Range<u32>, rows: &Range<u32>) -> Self {
        let empty = columns.is_empty() || rows.is_empty();
        let [columns, rows] = if empty { [0..0, 0..0] } else { [columns.clone(), rows.clone()] };
        Self { left: columns.start, top: rows.start, width: columns.end - columns.start, height: rows.end - rows.start }
    }

    /// Columns of the image. Windows come from outside and may be anything.
    pub fn columns(&self) -> Range<u32> {
        self.left..self.left.saturating_add(self.width)
    }

    /// Rows of the image.
    pub fn rows(&self) -> Range<u32> {
        self.top..self.top.saturating_add(self.height)
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Returns whether a point of the image, in pixels, lies in the window.
    #[inline]
    pub fn contains(&self, uv: &Point2<f64>) -> bool {
        let within = |at: f64, range: Range<u32>| at >= f64::from(range.start) && at < f64::from(range.end);
        within(uv.x, self.columns()) && within(uv.y, self.rows())
    }

    /// Image coordinates of the centre of the `index`-th pixel, row by row.
    #[inline]
    pub fn pixel_centre(&self, index: usize) -> Point2<f64> {
        let width = self.width as usize;
        let (column, row) = (index % width, index / width);
        Point2::new(f64::from(self.left) + column as f64 + 0.5, f64::from(self.top) + row as f64 + 0.5)
    }

    /// The smallest window around this one and another.
    pub fn hull(&self, other: &Self) -> Self {
        let around = |a: Range<u32>, b: Range<u32>| a.start.min(b.start)..a.end.max(b.end);
        match (self.area(), other.area()) {
            (0, _) => *other,
            (_, 0) => *self,
            _ => Self::of(&around(self.columns(), other.columns()), &around(self.rows(), other.rows())),
        }
    }

    /// The window with so many pixels more on each side, cut to another; one that is empty stays so.
    pub fn widened(&self, margin_px: u32, within: &Self) -> Self {
        if self.area() == 0 {
            return *self;
        }
        let wide = |of: Range<u32>| of.start.saturating_sub(margin_px)..of.end.saturating_add(margin_px);
        Self::of(&wide(self.columns()), &wide(self.rows())).intersection(within)
    }

    /// The pixels that it shares with another window; where there are none, an empty window in its own first
    /// corner.
    pub fn intersection(&self, other: &Self) -> Self {
        let (left, top) = (self.left.max(other.left), self.top.max(other.top));
        let right = self.columns().end.min(other.columns().end);
        let bottom = self.rows().end.min(other.rows().end);
        if right <= left || bottom <= top {
            return Self { left: self.left, top: self.top, width: 0, height: 0 };
        }
        Self { left, top, width: right - left, height: bottom - top }
    }
}

/// One depth image, or the window of it that was read out.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthFrame {
    /// Camera that took the image: an index into the cell's list of cameras.
    pub camera: usize,
    /// Time at which the shutter closed, in seconds on the cell's clock.
    pub capture_s: quantity::clock_s,
    /// The part of the image that follows.
    pub window: PixelWindow,
    /// Depth along the optical axis (z of C, not the length of the ray) in metres, row by row, one value per
    /// pixel of the window; NaN where nothing was measured.
    pub depth_m: Vec<f32>,
    /// True for each pixel that shows the thrown object, in the order of the depths; `None` where the cell's
    /// sensors cannot tell the object apart.
    pub mask: Option<Vec<bool>>,
}

/// Depth images of an object, taken beforehand from all around: all that is known of its shape.
///
/// The cameras' poses are in the reference frame R, in which the object stood still.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ReferenceScan {
    /// Cameras that took the images.
    pub cameras: Vec<CameraModel>,
    /// Images, masked: at least one per camera.
    pub frames: Vec<DepthFrame>,
}

impl ReferenceScan {
    /// Returns whether no image shows anything.
    pub fn is_empty(&self) -> bool {
        !self.frames.iter().flat_map(|frame| &frame.depth_m).any(|depth| depth.is_finite())
    }
}

/// Values that `pick` chooses for each pixel of an image, `wide` pixels wide, among all within `reach` rows
/// and columns.
pub fn among_neighbours<T: Copy>(values: &[T], wide: usize, reach: usize, pick: impl Fn(T, T) -> T) -> Vec<T> {
    let merge =
        |into: &mut [T], from: &[T]| into.iter_mut().zip(from).for_each(|(into, from)| *into = pick(*into, *from));
    let mut in_rows = values.to_vec();
    for (into, from) in in_rows.chunks_mut(wide.max(1)).zip(values.chunks(wide.max(1))) {
        for apart in 1..=reach.min(wide) {
            merge(&mut into[apart..], from);
            merge(into, &from[apart..]);
        }
    }
    let mut all = in_rows.clone();
    for apart in (1..=reach).map(|rows| rows * wide).take_while(|apart| *apart < values.len()) {
        merge(&mut all[apart..], &in_rows);
        merge(&mut all, &in_rows[apart..]);
    }
    all
}
