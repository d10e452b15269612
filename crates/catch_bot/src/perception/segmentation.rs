//! Segmentation of the object in images without masks: the pixels in front of all known surfaces.
//!
//! Known surfaces are the floor, if the cameras see it, and the arm, at which the brain casts its own rays. A
//! pixel is in front of them if it is nearer by some standard deviations of the depth noise at that depth.
//! While the object is tracked only pixels where it is expected are evaluated. Where the object is too close
//! to the background to be distinguished from it, the pixel has no label, and the silhouette does not use it
//! either.

use catch_body::{
    Pose,
    kinematics::LinkPoses,
    ray_cast::{ArmSurface, Hit, RayCaster, SurfacePart},
    workcell::FLOOR_Z_M,
};
use catch_cell::{
    CameraModel, DepthFrame, PixelWindow,
    sight::{DepthBuffer, Sight},
};
use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::Config;

/// Surroundings of the object that the cameras see.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// The arm and its gripper.
    pub arm: &'a ArmSurface,
    /// Poses of the arm's links when the images were taken.
    pub X_WL: LinkPoses,
    /// Opening of the gripper then, in metres.
    pub width_m: f64,
}

impl Surroundings<'_> {
    /// Returns whether this arm stands as it stood before: each link is within this distance of where it was,
    /// in metres and radians, and so is the gripper's opening.
    pub(super) fn stands_as(&self, (X_WL, width_m): &(LinkPoses, f64), within: f64) -> bool {
        let is_near = |(A, B): (&Pose, &Pose)| {
            (A.translation.vector - B.translation.vector).norm() < within && A.rotation.angle_to(&B.rotation) < within
        };
        X_WL.iter().zip(&self.X_WL).all(is_near) && (width_m - self.width_m).abs() < within
    }
}

/// Returns whether an image is that of all pixels of its camera.
pub(super) fn is_full(frame: &DepthFrame, camera: &CameraModel) -> bool {
    frame.window == camera.full_window() && frame.depth_m.len() >= frame.window.area()
}

/// Label of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Label {
    /// The pixel does not show the object.
    #[default]
    Elsewhere,
    /// The pixel shows the object.
    Object,
    /// The pixel is ambiguous.
    Unknown,
}

/// Pixels of a row that are looked at together.
const RUN: usize = 8;

/// Most bodies that an arm consists of.
const MAX_BODIES: usize = 16;

/// Expected view of one camera without the object.
pub struct Background<'a> {
    camera: &'a CameraModel,
    bodies: [Option<Sight<'a>>; MAX_BODIES],
    /// Depth before which a pixel shows something in front of all bodies, by the bounding sphere of each.
    before_bodies_m: f64,
    /// Height of the camera over the floor and the vertical in C.
    floor: Option<(f64, Vector3<f64>)>,
    /// Distance beside an edge of these bodies within which a pixel may show them, in pixels.
    bleeding_px: u32,
    /// What pixels show of these bodies, where they have been drawn.
    drawn: Option<&'a DepthBuffer>,
}

impl<'a> Background<'a> {
    /// Background of a part of an image.
    pub fn new(
        camera: &'a CameraModel,
        surroundings: Option<&Surroundings<'a>>,
        part: &PixelWindow,
        config: &Config,
    ) -> Self {
        let all = surroundings.map(|known| known.arm.parts(&known.X_WL, known.width_m));
        Self::of_parts(camera, all.into_iter().flatten(), part, config)
    }

    /// Background of a full image without the arm: the obstacles and the floor.
    pub fn without_arm(camera: &'a CameraModel, surroundings: &Surroundings<'a>, config: &Config) -> Self {
        let all = surroundings.arm.named_parts(&surroundings.X_WL, surroundings.width_m);
        let obstacles = all.filter(|(part, ..)| *part == SurfacePart::Obstacle).map(|(_, X_WB, caster)| (X_WB, caster));
        Self::of_parts(camera, obstacles, &camera.full_window(), config)
    }

    fn of_parts(
        camera: &'a CameraModel,
        parts: impl Iterator<Item = (Pose, &'a RayCaster)>,
        part: &PixelWindow,
        config: &Config,
    ) -> Self {
        let bleeding_px = bleeding_px(config);
        let around = part.widened(bleeding_px, &camera.full_window());
        let in_sight = parts.map(|(X_WB, surface)| Sight::new(camera, &X_WB, surface));
        let mut in_sight = in_sight.filter(|it| it.window().intersection(&around).area() > 0);
        let bodies: [Option<Sight<'_>>; MAX_BODIES] = std::array::from_fn(|_| in_sight.next());
        // Noise grows with the depth, so that either end of a body may leave less room before it.
        let ends_m = bodies.iter().flatten().flat_map(Sight::depths_m);
        let before_bodies_m = ends_m.map(|end_m| nearer_than_m(end_m, config)).fold(f64::INFINITY, f64::min);
        let up_C = camera.X_WC.rotation.inverse() * Vector3::z();
        let floor = config.sees_floor().then_some((camera.X_WC.translation.z - FLOOR_Z_M, up_C));
        Self { camera, bodies, before_bodies_m, floor, bleeding_px, drawn: None }
    }

    /// Draws the bodies around a part of the image, where that takes less time than so many rays.
    pub fn draw(&mut self, part: &PixelWindow, rays: impl FnOnce() -> usize, buffer: &'a mut DepthBuffer) {
        let bodies = || self.bodies.iter().flatten().copied();
        let window = part.widened(self.bleeding_px, &self.camera.full_window());
        if bodies().next().is_some() && DepthBuffer::drawing_rays(&window, bodies()) < rays() {
            buffer.redraw(window, bodies());
            self.drawn = Some(buffer);
        }
    }

    /// Returns whether a depth at image coordinates is clearly nearer than the bounds of all that is there,
    /// which cost no ray.
    pub fn is_before_all(&self, found_m: f64, uv: &Point2<f64>, config: &Config) -> bool {
        let floor_m = self.floor_m(&self.camera.back_project(uv, 1.0).coords);
        found_m < self.before_bodies_m && found_m < nearer_than_m(floor_m, config)
    }

    /// Depths of the full image, row by row.
    pub fn cast_all(&self) -> Vec<f32> {
        let window = self.camera.full_window();
        let seen = DepthBuffer::new(window, self.bodies.iter().flatten().copied());
        let depth_m = |(i, seen): (usize, Option<(usize, Hit)>)| {
            let floor_m = self.floor_m(&self.camera.back_project(&window.pixel_centre(i), 1.0).coords);
            seen.map_or(floor_m, |(_, hit)| hit.t.min(floor_m)) as f32
        };
        seen.pixels().enumerate().map(depth_m).collect()
    }

    /// Depth of the floor along a ray whose third component is one.
    fn floor_m(&self, ray_C: &Vector3<f64>) -> f64 {
        let depth_m = self.floor.map_or(f64::INFINITY, |(height_m, up_C)| -height_m / up_C.dot(ray_C));
        if depth_m > 0.0 { depth_m } else { f64::INFINITY }
    }

    /// Depth at image coordinates, infinite where there is nothing; of the pixel there, where bodies are
    /// drawn.
    pub fn depth_m(&self, uv: &Point2<f64>) -> f64 {
        self.bodies_m(uv, self.floor_m(&self.camera.back_project(uv, 1.0).coords))
    }

    /// The least depth that may be measured there: that of anything within the width of an edge.
    pub fn nearest_m(&self, uv: &Point2<f64>) -> f64 {
        let (behind_m, aside_px) = (self.depth_m(uv), f64::from(self.bleeding_px));
        if self.bleeding_px == 0 || self.bodies[0].is_none() {
            return behind_m;
        }
        let offsets = [-1.0, 0.0, 1.0].into_iter().flat_map(|u| [-1.0, 0.0, 1.0].map(|v| Vector2::new(u, v)));
        let beside = offsets.filter(|offset| *offset != Vector2::zeros());
        beside.fold(behind_m, |nearest_m, offset| self.bodies_m(&(uv + offset * aside_px), nearest_m))
    }

    /// Depth of the nearest body at image coordinates if it is nearer than `behind_m`, else that.
    fn bodies_m(&self, uv: &Point2<f64>, behind_m: f64) -> f64 {
        if let Some(depth_m) = self.drawn.and_then(|it| it.depth_m(uv)) {
            return depth_m.min(behind_m);
        }
        let ray_C = self.camera.back_project(uv, 1.0).coords;
        let nearer = |nearest_m: f64, body: &Sight<'_>| body.along(&ray_C, nearest_m).map_or(nearest_m, |hit| hit.t);
        self.bodies.iter().flatten().fold(behind_m, nearer)
    }
}

/// Standard deviations of depth noise by which a pixel must be nearer than what is known to be there. Of 2.4
/// million pixels 76 exceed four by noise alone, which are too few to hang together.
const BACKGROUND_SD: f64 = 4.0;
/// Additional margin in metres, for errors of the arm's model and of the cameras' calibration.
pub(super) const BACKGROUND_MARGIN_M: f64 = 0.01;

/// Distance by which a pixel must be nearer than the known background, in metres: the depth noise there, and
/// errors of the model.
pub(super) fn threshold_m(depth_m: f64, config: &Config) -> f64 {
    BACKGROUND_MARGIN_M + BACKGROUND_SD * config.depth_sd_m(depth_m)
}

/// Depth before which a pixel shows an object in front of the background at `depth_m`, in metres.
pub(super) fn nearer_than_m(depth_m: f64, config: &Config) -> f64 {
    if depth_m.is_finite() { depth_m - threshold_m(depth_m, config) } else { f64::INFINITY }
}

/// Distance beside an edge of the arm within which a pixel may show the arm, in pixels: the width of edges,
/// and one pixel for the error of the arm's position.
pub(super) fn bleeding_px(config: &Config) -> u32 {
    if config.edge_px() > 0 { config.edge_px() + 1 } else { 0 }
}

/// Region of a camera's image in which the object is expected: a ball in C, and the window that it may cover.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    pub window: PixelWindow,
    centre_C: Point3<f64>,
    radius_m: f64,
}

impl Expected {
    pub fn new(X_WO: &Pose, camera: &CameraModel, radius_m: f64) -> Self {
        let centre_C = camera.X_WC.inverse_transform_point(&X_WO.translation.vector.into());
        Self { window: camera.window_around(&centre_C, radius_m), centre_C, radius_m }
    }

    /// Returns whether a depth may be that of the object.
    fn is_near(&self, found_m: f64, config: &Config) -> bool {
        (found_m - self.centre_C.z).abs() < self.radius_m + BACKGROUND_SD * config.depth_sd_m(found_m)
    }
}

/// A pixel asks up to nine rays, most of which end early: they take as long as this many whole ones.
const RAYS_OF_PIXEL: usize = 4;

/// A part of a frame in which an object is expected.
pub(super) struct Search<'a> {
    pub frame: &'a DepthFrame,
    pub part: &'a PixelWindow,
    pub background: Background<'a>,
    pub expected: &'a Expected,
    pub config: &'a Config,
}

impl<'a> Search<'a> {
    /// Labels the pixels of the part, row by row, and returns the box around those that show the object.
    ///
    /// What is behind a pixel costs rays, unless it is before all that may be there. So it is asked of pixels
    /// at the object's depth alone, and then of those beside the object's: all others are left unknown.
    pub fn label(mut self, labels: &mut Vec<Label>, buffer: &'a mut DepthBuffer) -> PixelWindow {
        let Self { frame, part, expected, config, .. } = self;
        let (wide, high) = (part.width as usize, part.height as usize);
        let rows = frame.depth_m[self.start_of_row(0)..].chunks(frame.window.width as usize).take(high);
        let before_m = self.background.before_bodies_m;
        let costs_rays = |found_m: f64| found_m >= before_m && expected.is_near(found_m, config);
        let near = rows.flat_map(|row| &row[..wide]).filter(|found_m| costs_rays(f64::from(**found_m)));
        self.background.draw(part, || RAYS_OF_PIXEL * near.count(), buffer);
        let first = labels.len();
        labels.resize(first + wide * high, Label::Unknown);
        let labels = &mut labels[first..];
        // The box around the object's pixels.
        let (mut low, mut past) = ([usize::MAX; 2], [0; 2]);
        for y in 0..high {
            let start = self.start_of_row(y);
            for (run, depths_m) in frame.depth_m[start..start + wide].chunks(RUN).enumerate() {
                // All at once, because in most runs nothing is measured. Not a number is nearer than nothing.
                if !depths_m.iter().fold(false, |any, found_m| any | (*found_m > 0.0)) {
                    continue;
                }
                for (x, found_m) in (run * RUN..).zip(depths_m) {
                    if is_measured(f64::from(*found_m)) && expected.is_near(f64::from(*found_m), config) {
                        let label = self.judge(x, y);
                        labels[y * wide + x] = label;
                        if label == Label::Object {
                            low = [low[0].min(x), low[1].min(y)];
                            past = [past[0].max(x + 1), past[1].max(y + 1)];
                        }
                    }
                }
            }
        }
        self.judge_edges(labels, low, past);
        if config.misses_depths() {
            mark_uncertain_holes(labels, part, |column, row| {
                is_measured(self.depth_m((column - part.left) as usize, (row - part.top) as usize))
            });
        }
        let (left, top) = (part.left + low[0].min(wide) as u32, part.top + low[1].min(high) as u32);
        let [width, height] = [0, 1].map(|axis| past[axis].saturating_sub(low[axis]) as u32);
        PixelWindow { left, top, width, height }
    }

    /// Labels what is still unknown beside the object's pixels, all of which lie in a box.
    fn judge_edges(&self, labels: &mut [Label], low: [usize; 2], past: [usize; 2]) {
        let (wide, high) = (self.part.width as usize, self.part.height as usize);
        for y in low[1].saturating_sub(1)..(past[1] + 1).min(high) {
            for x in low[0].saturating_sub(1)..(past[0] + 1).min(wide) {
                let i = y * wide + x;
                let is_object = |i: usize| labels[i] == Label::Object;
                let beside = x > 0 && is_object(i - 1)
                    || x + 1 < wide && is_object(i + 1)
                    || y > 0 && is_object(i - wide)
                    || y + 1 < high && is_object(i + wide);
                if beside && labels[i] == Label::Unknown {
                    labels[i] = self.judge(x, y);
                }
            }
        }
    }

    /// Index in the frame at which the depths of a row of the part begin.
    fn start_of_row(&self, y: usize) -> usize {
        let Self { frame, part, .. } = self;
        let [left, top] = [part.left - frame.window.left, part.top - frame.window.top].map(|offset| offset as usize);
        (top + y) * frame.window.width as usize + left
    }

    fn depth_m(&self, x: usize, y: usize) -> f64 {
        f64::from(self.frame.depth_m[self.start_of_row(y) + x])
    }

    fn judge(&self, x: usize, y: usize) -> Label {
        let Self { part, background, config, .. } = self;
        let Expected { centre_C, radius_m, .. } = self.expected;
        let found_m = self.depth_m(x, y);
        let uv = Point2::new(f64::from(part.left) + x as f64 + 0.5, f64::from(part.top) + y as f64 + 0.5);
        let ray_C = background.camera.back_project(&uv, 1.0).coords;
        // (r·c)² of rays r that touch the ball, in |r|².
        let grazing_m2 = centre_C.coords.norm_squared() - radius_m * radius_m;
        if ray_C.dot(&centre_C.coords).powi(2) < ray_C.norm_squared() * grazing_m2 {
            return Label::Unknown;
        }
        let is_object = is_measured(found_m) && self.expected.is_near(found_m, config);
        if is_object && background.is_before_all(found_m, &uv, config) {
            return Label::Object;
        }
        let nearest_m = background.nearest_m(&uv);
        // Too close to tell apart, or in front of where the object is.
        let is_hidden = nearest_m.is_finite() && nearest_m - radius_m - threshold_m(nearest_m, config) < centre_C.z;
        let is_behind = found_m > nearer_than_m(nearest_m, config);
        match is_measured(found_m) {
            false if nearest_m.is_infinite() => Label::Elsewhere,
            false if is_hidden || config.misses_depths() => Label::Unknown,
            false => Label::Elsewhere,
            true if is_behind && is_hidden => Label::Unknown,
            true if is_behind => Label::Elsewhere,
            true if is_object => Label::Object,
            true => Label::Unknown,
        }
    }
}

fn is_measured(found_m: f64) -> bool {
    found_m > 0.0 && found_m.is_finite()
}

/// Least number of a pixel's eight neighbours that show the object if it is a hole in the object's image, or
/// at least not clearly beside it: a straight edge has five on its inside and three on its outside.
const HOLE_NEIGHBOURS: usize = 4;

/// Labels pixels without a depth as unknown if the object surrounds them, where depths may be missing: if
/// half of their neighbours show it, or pixels on all four sides do, as around a larger hole. Others without
/// one, with nothing known behind them, are most likely beside the object: all of these have no depth, of the
/// object's only a few.
fn mark_uncertain_holes(labels: &mut [Label], part: &PixelWindow, is_measured: impl Fn(u32, u32) -> bool) {
    let (wide, high) = (part.width as usize, part.height as usize);
    for y in 0..high {
        for x in 0..wide {
            let i = y * wide + x;
            if labels[i] != Label::Elsewhere || is_measured(part.left + x as u32, part.top + y as u32) {
                continue;
            }
            let rows = y.saturating_sub(1)..(y + 2).min(high);
            let columns = x.saturating_sub(1)..(x + 2).min(wide);
            let around = rows.flat_map(|row| columns.clone().map(move |column| row * wide + column));
            let is_object = |at: usize| labels[at] == Label::Object;
            let shows = |first: usize, past: usize, step: usize| (first..past).step_by(step).any(is_object);
            let is_enclosed = || {
                shows(y * wide, i, 1) && shows(i, (y + 1) * wide, 1) && shows(x, i, wide) && shows(i, high * wide, wide)
            };
            if around.filter(|&at| is_object(at)).count() >= HOLE_NEIGHBOURS || is_enclosed() {
                labels[i] = Label::Unknown;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Labels of 7×7 pixels: a square of 3×3 that shows the object, in the middle.
    fn square() -> (PixelWindow, Vec<Label>) {
        let part = PixelWindow { left: 10, top: 20, width: 7, height: 7 };
        let inside = |i: usize| (2..5).contains(&(i % 7)) && (2..5).contains(&(i / 7));
        (part, (0..49).map(|i| if inside(i) { Label::Object } else { Label::Elsewhere }).collect())
    }

    #[test]
    fn a_hole_cannot_tell_and_what_is_beside_the_object_is_elsewhere() {
        let (part, mut labels) = square();
        // The middle and one of the edge are missing.
        for hole in [3 * 7 + 3, 2 * 7 + 3] {
            labels[hole] = Label::Elsewhere;
        }
        let before = labels.clone();
        mark_uncertain_holes(&mut labels, &part, |_, _| false);
        assert_eq!((labels[3 * 7 + 3], labels[2 * 7 + 3]), (Label::Unknown, Label::Unknown));
        let others = (0..49).filter(|i| ![24, 17].contains(i));
        assert!(others.into_iter().all(|i| labels[i] == before[i]));
    }

    /// Near a camera a hole is larger than its pixels' neighbours; a bay is none.
    #[test]
    fn a_hole_of_many_pixels_cannot_tell_but_a_bay_of_the_outline_can() {
        let part = PixelWindow { left: 0, top: 0, width: 12, height: 12 };
        let inside = |range: std::ops::Range<usize>, i: usize| range.contains(&(i % 12)) && range.contains(&(i / 12));
        let labelled = |is_missing: &dyn Fn(usize) -> bool| -> Vec<Label> {
            let label = |i| if inside(1..11, i) && !is_missing(i) { Label::Object } else { Label::Elsewhere };
            let mut labels = (0..144).map(label).collect::<Vec<_>>();
            mark_uncertain_holes(&mut labels, &part, |_, _| false);
            labels
        };
        let hole = labelled(&|i| inside(4..8, i));
        assert!((0..144).filter(|&i| inside(4..8, i)).all(|i| hole[i] == Label::Unknown));
        assert!((0..144).filter(|&i| !inside(1..11, i)).all(|i| hole[i] == Label::Elsewhere));
        // Four pixels wide, up to the upper edge.
        let bay = labelled(&|i| (4..8).contains(&(i % 12)) && i / 12 < 6);
        assert_eq!([bay[3 * 12 + 5], bay[3 * 12 + 6]], [Label::Elsewhere; 2]);
    }

    #[test]
    fn a_pixel_with_a_depth_is_believed() {
        let (part, mut labels) = square();
        labels[24] = Label::Elsewhere;
        mark_uncertain_holes(&mut labels, &part, |column, row| (column, row) == (13, 23));
        assert_eq!(labels[24], Label::Elsewhere);
    }
}
