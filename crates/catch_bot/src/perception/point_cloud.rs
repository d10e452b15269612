//! Conversion of pixels to points in W that belong to the object.

use catch_body::{Pose, quantity};
use catch_cell::{CameraModel, DepthFrame, PixelWindow, sight::DepthBuffer};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Config, ReferenceModel,
    segmentation::{Background, Expected, Label, Search},
    silhouette::Silhouette,
    thinning::{KEPT_OF_IMAGE, is_kept, stride},
    view::View,
};

/// Standard deviation of a measured depth: σ(z) = c + q·z², in metres.
///
/// The quadratic part is that of stereo: σ = z²·subpixel/(f·baseline).
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthNoise {
    /// c in metres.
    pub constant_m: quantity::error_m,
    /// q in 1/m.
    pub quadratic_per_m: quantity::inverse_depth_per_m,
}

impl DepthNoise {
    /// σ at depth `z_m`.
    pub fn sd_m(&self, z_m: f64) -> f64 {
        self.constant_m + self.quadratic_per_m * z_m * z_m
    }
}

/// A point of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScenePoint {
    /// Position of the point.
    pub p_W: Point3<f64>,
    /// Displacement of the point per metre of depth: along its pixel's ray.
    pub per_depth_W: Vector3<f64>,
    /// Standard deviation of its depth in metres.
    pub depth_sd_m: f64,
    /// Size of its pixel there, in metres.
    pub pixel_m: f64,
    /// Number of its image among those that its cloud is from: depths of one image err together.
    pub image: usize,
}

/// Residual of a pose of the object at a point of the scene.
#[derive(Debug, Clone, Default)]
pub(super) struct PointResidual {
    /// Number of the point in its cloud, and of its image.
    pub point: usize,
    pub image: usize,
    /// The point in O.
    pub p_O: Point3<f64>,
    /// Signed distance of the point from the reference in metres, and its gradient in O.
    pub distance_m: f64,
    pub n_O: Vector3<f64>,
    /// Standard deviation of the distance, and by how much a standard deviation of the depth changes it.
    pub sd_m: f64,
    pub by_depth_m: f64,
}

/// Points, silhouette rays and labels for which there is room from the start, so that larger images of the
/// object than those before do not allocate.
const ROOM_POINTS: usize = 4096;
const ROOM_LABELS: usize = 1 << 17;

/// Observations of the object in the images.
#[derive(Debug, Clone, Default)]
pub struct SceneCloud {
    /// Points on its surface.
    pub points: Vec<ScenePoint>,
    /// Silhouette of the object, if it has been collected.
    pub silhouette: Silhouette,
    /// Room for how a pose stands to the points.
    pub(super) residuals: Vec<PointResidual>,
    /// The frames that show it.
    shown: Vec<Shown>,
    /// Labels of the pixels of frames that have no mask.
    labels: Vec<Label>,
    /// Room for what is known to be behind them.
    drawn: DepthBuffer,
}

/// A frame that shows the object.
#[derive(Debug, Clone, Copy)]
struct Shown {
    frame: usize,
    /// Pose of the camera.
    X_WC: Pose,
    /// The box around the object's pixels.
    pixels: PixelWindow,
    /// The part of the frame whose labels stand from a place on, where there is no mask.
    labelled: Option<(PixelWindow, usize)>,
}

impl SceneCloud {
    /// Collects the object's points from all images, in place of those collected before.
    ///
    /// A pixel is the object's if the image's mask says so; without a mask, if it lies in front of the
    /// surroundings and near the predicted pose, which then must be given: X_WO, and how far beside the
    /// object it may be, in metres.
    pub fn collect(
        &mut self,
        view: &View<'_>,
        reference: &ReferenceModel,
        prior: Option<(&Pose, f64)>,
        config: &Config,
    ) {
        let View { cameras, surroundings, .. } = *view;
        self.points.clear();
        self.residuals.clear();
        self.shown.clear();
        self.labels.clear();
        self.points.reserve(ROOM_POINTS);
        self.residuals.reserve(ROOM_POINTS);
        self.silhouette.clear(ROOM_POINTS);
        self.shown.reserve(cameras.len());
        self.labels.reserve(ROOM_LABELS);
        for (index, frame) in view.seen() {
            let Some(camera) = cameras.get(frame.camera) else { continue };
            if frame.depth_m.len() < frame.window.area() || !frame.capture_s.is_finite() {
                continue;
            }
            let in_image = prior.map(|(X_WO, _)| (X_WO, view.in_image(frame, X_WO)));
            let radius_m = reference.radius_m + prior.map_or(0.0, |(_, gate_m)| gate_m);
            let expected = in_image.map(|(_, X_WO)| Expected::new(&X_WO, camera, radius_m));
            // The object in this image looks as if seen from this pose at the view's capture time.
            let moved = in_image.filter(|(X_WO, then)| **X_WO != *then);
            let X_WC = moved.map_or(camera.X_WC, |(X_WO, then)| X_WO * then.inverse() * camera.X_WC);
            let part = expected.map_or(frame.window, |expected| frame.window.intersection(&expected.window));
            let mut labelled = None;
            let (columns, points) = (frame.window.width as usize, &mut self.points);
            let image = Image { number: index, frame, camera: &CameraModel { X_WC, ..camera.clone() } };
            let pixels = match (&frame.mask, expected) {
                (Some(mask), _) if mask.len() >= frame.window.area() => {
                    let label = |column: usize, row: usize| {
                        [Label::Elsewhere, Label::Object][usize::from(mask[row * columns + column])]
                    };
                    image.collect(points, &part, config, label)
                }
                (None, Some(expected)) if part.area() > 0 => {
                    let from = self.labels.len();
                    let background = Background::new(camera, surroundings.get(index), &part, config);
                    let search = Search { frame, part: &part, background, expected: &expected, config };
                    let pixels = search.label(&mut self.labels, &mut self.drawn);
                    labelled = Some((part, from));
                    image.collect(points, &pixels, config, label_in(frame, part, &self.labels[from..]));
                    pixels
                }
                _ => continue,
            };
            if pixels.area() > 0 {
                self.shown.push(Shown { frame: index, X_WC, pixels, labelled });
            }
        }
    }

    /// Collects the silhouette of what [`collect`](Self::collect) found in the same view.
    pub fn collect_silhouette(&mut self, view: &View<'_>, reference: &ReferenceModel, config: &Config) {
        self.silhouette.clear(ROOM_POINTS);
        let centroid_W = self.centroid();
        for shown in &self.shown {
            let frame = &view.frames[shown.frame];
            let Some(camera) = view.cameras.get(frame.camera) else { continue };
            let camera = &CameraModel { X_WC: shown.X_WC, ..camera.clone() };
            let depth_m = camera.X_WC.inverse_transform_point(&centroid_W).z;
            let nearest_m = depth_m - reference.radius_m - 3.0 * config.depth_sd_m(depth_m);
            let columns = frame.window.width as usize;
            match (&frame.mask, shown.labelled) {
                (Some(mask), _) => {
                    self.silhouette.collect(frame.window, camera, &shown.pixels, 0, |column, row| {
                        let i = row * columns + column;
                        // Something in front of the object.
                        let is_hidden = !mask[i] && f64::from(frame.depth_m[i]) < nearest_m;
                        [if mask[i] { Label::Object } else { Label::Elsewhere }, Label::Unknown][usize::from(is_hidden)]
                    });
                }
                (None, Some((part, from))) => {
                    let labels = &self.labels[from..from + part.area()];
                    let label = label_in(frame, part, labels);
                    self.silhouette.collect(frame.window, camera, &shown.pixels, config.edge_px(), label);
                }
                (None, None) => {}
            }
        }
    }

    /// The part of a frame without mask that was looked at, and the labels of its pixels.
    pub fn labels_of(&self, frame: usize) -> Option<(PixelWindow, &[Label])> {
        let shown = self.shown.iter().find(|shown| shown.frame == frame)?;
        shown.labelled.map(|(part, from)| (part, &self.labels[from..from + part.area()]))
    }

    /// The labels of a frame without mask, by column and row in it, if it shows the object.
    pub(super) fn label_in(&self, frame: usize, image: &DepthFrame) -> Option<impl Fn(usize, usize) -> Label> {
        let (part, labels) = self.labels_of(frame)?;
        Some(label_in(image, part, labels))
    }

    /// Mean standard deviation of the points' depths, as told, in metres.
    pub fn mean_noise_m(&self) -> f64 {
        mean_sd_m(&self.points)
    }

    /// Mean of the points.
    pub fn centroid(&self) -> Point3<f64> {
        let sum: Vector3<f64> = self.points.iter().map(|point| point.p_W.coords).sum();
        Point3::from(sum / self.points.len().max(1) as f64)
    }

    /// Takes over at most about `most` of another cloud's points and half as many of its silhouette's rays,
    /// evenly.
    pub(super) fn thin_from(&mut self, other: &Self, most: usize) {
        self.points.clear();
        self.points.extend(other.points.iter().step_by(stride(other.points.len(), most)));
        self.silhouette.thin_from(&other.silhouette, most / 2);
    }
}

/// Mean standard deviation of depths in metres.
pub(super) fn mean_sd_m(points: &[ScenePoint]) -> f64 {
    points.iter().map(|it| it.depth_sd_m).sum::<f64>() / points.len().max(1) as f64
}

/// Returns the label of the pixel at a column and row of a frame, whose part `part` has these `labels`;
/// elsewhere it is unknown.
fn label_in(frame: &DepthFrame, part: PixelWindow, labels: &[Label]) -> impl Fn(usize, usize) -> Label {
    let [left, top] = [part.left - frame.window.left, part.top - frame.window.top].map(|offset| offset as usize);
    let (wide, high) = (part.width as usize, part.height as usize);
    move |column, row| {
        let (x, y) = (column.wrapping_sub(left), row.wrapping_sub(top));
        if x < wide && y < high { labels[y * wide + x] } else { Label::Unknown }
    }
}

/// An image and its number among those of one capture time.
struct Image<'a> {
    number: usize,
    frame: &'a DepthFrame,
    camera: &'a CameraModel,
}

impl Image<'_> {
    /// Collects the measured pixels of a part that show the object by their labels, given by column and row
    /// in the frame: about [`KEPT_OF_IMAGE`] where there are more, which are counted first. Returns the box
    /// around all that show it, measured or not.
    fn collect(
        &self,
        points: &mut Vec<ScenePoint>,
        part: &PixelWindow,
        config: &Config,
        label: impl Fn(usize, usize) -> Label,
    ) -> PixelWindow {
        let Self { number: image, frame, camera } = *self;
        let columns = frame.window.width as usize;
        let left = (part.left - frame.window.left.min(part.left)) as usize;
        let top = (part.top - frame.window.top.min(part.top)) as usize;
        let R_WC = camera.X_WC.rotation.to_rotation_matrix();
        let p_WC = camera.X_WC.translation.vector;
        let depth_m = |i: usize| f64::from(frame.depth_m[i]);
        let is_measured = |i: usize| depth_m(i) > 0.0 && depth_m(i).is_finite();
        let (mut low, mut high, mut count) = ([usize::MAX; 2], [0; 2], 0);
        for row in top..top + part.height as usize {
            for column in left..left + part.width as usize {
                if label(column, row) == Label::Object {
                    low = [low[0].min(column), low[1].min(row)];
                    high = [high[0].max(column + 1), high[1].max(row + 1)];
                    count += usize::from(is_measured(row * columns + column));
                }
            }
        }
        let mut pixels = points.len();
        for row in low[1]..high[1] {
            for column in low[0]..high[0] {
                let i = row * columns + column;
                if label(column, row) != Label::Object || !is_measured(i) {
                    continue;
                }
                pixels += 1;
                if !is_kept(pixels, count, KEPT_OF_IMAGE) {
                    continue;
                }
                let per_depth_W = R_WC * camera.back_project(&frame.window.pixel_centre(i), 1.0).coords;
                points.push(ScenePoint {
                    p_W: Point3::from(p_WC + per_depth_W * depth_m(i)),
                    per_depth_W,
                    depth_sd_m: config.depth_sd_m(depth_m(i)),
                    pixel_m: depth_m(i) / camera.focal_px,
                    image,
                });
            }
        }
        if low[0] >= high[0] {
            return PixelWindow::default();
        }
        PixelWindow {
            left: frame.window.left + low[0] as u32,
            top: frame.window.top + low[1] as u32,
            width: (high[0] - low[0]) as u32,
            height: (high[1] - low[1]) as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::synthetic::{self, Shape};

    /// As near as this a ball covers 12,000 pixels.
    #[test]
    fn an_object_that_fills_an_image_leaves_as_much_from_all_over_it() {
        let camera = CameraModel::with_field_of_view(Pose::identity(), 400, 300, 1.0);
        let shape = Shape::ball();
        let (reference, config) = (synthetic::reference(&shape, 100), Config::default());
        let frame = synthetic::depth_frame(0, &camera, &shape, &Pose::translation(0.0, 0.0, 0.15), 0.0);
        let shown = frame.depth_m.iter().enumerate().filter(|(_, depth_m)| depth_m.is_finite());
        let shown = shown.map(|(i, depth_m)| camera.back_project(&frame.window.pixel_centre(i), f64::from(*depth_m)));
        let shown: Vec<Vector3<f64>> = shown.map(|it| it.coords).collect();
        assert!(shown.len() > 10_000, "{}", shown.len());
        let middle = shown.iter().sum::<Vector3<f64>>() / shown.len() as f64;
        let view = View { frames: &[frame], cameras: &[camera], ..View::default() };
        let mut scene = SceneCloud::default();
        scene.collect(&view, &reference, None, &config);
        scene.collect_silhouette(&view, &reference, &config);
        for count in [scene.points.len(), scene.silhouette.len()] {
            assert!(count.abs_diff(KEPT_OF_IMAGE) < 10, "{count}");
        }
        let off_m = (scene.centroid().coords - middle).norm();
        assert!(off_m < 1e-3, "{off_m}");
    }
}
