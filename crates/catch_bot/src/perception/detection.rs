//! Position of an object that is not tracked yet: blobs of pixels in front of the known background, in
//! several cameras that agree on one point.

use catch_cell::{CameraModel, DepthFrame, sight::DepthBuffer};
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::{
    Config, ReferenceModel,
    known_background::KnownBackground,
    segmentation::{BACKGROUND_MARGIN_M, Background, Surroundings, nearer_than_m},
    view::View,
};

/// Detection: its buffers, and what the cameras see before anything flies.
#[derive(Debug, Clone, Default)]
pub(super) struct Detector {
    pub background: KnownBackground,
    blobs: Vec<Blob>,
    /// Pixels of an image that could be the object.
    candidates: Vec<u32>,
    /// True for a pixel that is a candidate and that no blob has taken yet; all false between two images.
    is_free: Vec<bool>,
    stack: Vec<u32>,
    /// Room for what the arm's surface hides.
    drawn: DepthBuffer,
}

/// Pixels of one image that hang together, without a step in depth as high as half the object.
#[derive(Debug, Clone, Copy)]
struct Blob {
    camera: usize,
    pixels: usize,
    p_WC: Point3<f64>,
    /// Unit vector to its middle.
    direction_W: Vector3<f64>,
    /// Mean distance along it, and its standard deviation.
    along_m: f64,
    along_sd_m: f64,
    /// True if the blob is at least about as large as the object.
    is_whole: bool,
}

/// Pixels that a blob has at least: single ones are noise.
const MIN_PIXELS: usize = 3;
/// Fraction of the pixels of the largest ball within the object that a blob has which is enough alone: noise
/// makes no such blobs.
const WHOLE_FRACTION: f64 = 0.3;
/// Blobs that are looked at, the largest of all.
const MAX_BLOBS: usize = 96;
/// A blob's box may be larger than the object's by this factor.
const SLACK: f64 = 1.5;
/// Pixels that are looked at together.
const RUN: usize = 32;

impl Detector {
    /// Collects the blobs of all images.
    pub fn collect(&mut self, view: &View<'_>, reference: &ReferenceModel, config: &Config) {
        let View { cameras, surroundings, .. } = *view;
        let known = std::mem::take(&mut self.background);
        self.blobs.clear();
        for (index, frame) in
            view.seen().filter(|(_, frame)| frame.mask.is_none() && frame.depth_m.len() >= frame.window.area())
        {
            if let Some(camera) = cameras.get(frame.camera) {
                let surroundings = surroundings.get(index);
                self.choose_candidates((frame, camera), &known, surroundings, config);
                self.add_blobs(frame, camera, reference, config);
            }
        }
        let blobs = &mut self.blobs;
        blobs.sort_by(|a, b| b.pixels.cmp(&a.pixels).then(a.camera.cmp(&b.camera)));
        blobs.truncate(MAX_BLOBS);
        // Blobs of one camera one after the other, so that each camera counts once.
        blobs.sort_by_key(|it| it.camera);
        self.background = known;
    }

    /// The place that most cameras agree on, if any; its blobs are not looked at again.
    pub fn next_place(&mut self, view: &View<'_>, reference: &ReferenceModel, config: &Config) -> Option<Point3<f64>> {
        let blobs = &mut self.blobs;
        // Each pair of rays that meet is tried; with one blob alone its own place.
        let reach_m = reference.radius_m + BACKGROUND_MARGIN_M;
        let mut best: Option<(usize, usize, Point3<f64>)> = None;
        let mut offer = |place: Point3<f64>| {
            let (mut agreeing, mut pixels, mut last) = (0, 0, usize::MAX);
            for blob in blobs.iter().filter(|blob| blob.passes(&place, reach_m)) {
                agreeing += usize::from(blob.camera != last);
                pixels += blob.pixels;
                last = blob.camera;
            }
            if best.is_none_or(|(most, many, _)| (agreeing, pixels) > (most, many)) {
                best = Some((agreeing, pixels, place));
            }
        };
        for (i, one) in blobs.iter().enumerate() {
            offer(one.p_WC + one.direction_W * one.along_m);
            for two in blobs[..i].iter().filter(|two| two.camera != one.camera) {
                if let Some(place) = meeting(one, two, reach_m) {
                    offer(place);
                }
            }
        }
        let (agreeing, _, place) = best?;
        let is_enough = agreeing >= 2 || is_enough_alone(blobs, &place, reach_m, view, config);
        let refined = is_enough.then(|| refined(blobs, &place, reach_m));
        blobs.retain(|blob| !blob.passes(&place, reach_m));
        refined
    }

    /// The pixels of one image that show something in front of all that is known to be there. The arm's
    /// surface decides where what is known of a waiting arm does not.
    fn choose_candidates(
        &mut self,
        (frame, camera): (&DepthFrame, &CameraModel),
        known: &KnownBackground,
        surroundings: Option<&Surroundings<'_>>,
        config: &Config,
    ) {
        const ANYWHERE: [f32; RUN] = [f32::INFINITY; RUN];
        let columns = frame.window.width as usize;
        let (left, top, wide) = (frame.window.left as usize, frame.window.top as usize, camera.width_px as usize);
        let known_m = known.limits_m(frame.camera, surroundings);
        self.candidates.clear();
        for (row, depths_m) in frame.depth_m[..frame.window.area()].chunks(columns.max(1)).enumerate() {
            let limits_m = known_m.and_then(|limits_m| limits_m.get((row + top) * wide + left..));
            for (run, depths_m) in depths_m.chunks(RUN).enumerate() {
                let limits_m = limits_m.and_then(|limits_m| limits_m.get(run * RUN..)).unwrap_or(&ANYWHERE);
                // Not a number is nearer than nothing. All at once, because in nearly all runs there is
                // nothing to find.
                let is_near = |(depth_m, limit_m): (&f32, &f32)| (*depth_m > 0.0) & (depth_m < limit_m);
                if !depths_m.iter().zip(limits_m).fold(false, |any, both| any | is_near(both)) {
                    continue;
                }
                let near = depths_m.iter().zip(limits_m).enumerate().filter(|(_, both)| is_near(*both));
                self.candidates.extend(near.map(|(i, _)| (row * columns + run * RUN + i) as u32));
            }
        }
        let Self { candidates, drawn, .. } = self;
        let mut background = Background::new(camera, surroundings, &frame.window, config);
        background.draw(&frame.window, || candidates.len(), drawn);
        candidates.retain(|&i| {
            let (uv, found_m) = (frame.window.pixel_centre(i as usize), f64::from(frame.depth_m[i as usize]));
            let is_before = |known_m: f64| found_m < nearer_than_m(known_m, config);
            // The surroundings of the pixel cost more rays.
            is_before(background.depth_m(&uv)) && is_before(background.nearest_m(&uv))
        });
    }

    /// The blobs of one image that could be the object.
    fn add_blobs(&mut self, frame: &DepthFrame, camera: &CameraModel, reference: &ReferenceModel, config: &Config) {
        let (columns, rows) = (frame.window.width as usize, frame.window.height as usize);
        let (left, top) = (frame.window.left as usize, frame.window.top as usize);
        self.is_free.resize(self.is_free.len().max(frame.window.area()), false);
        for &i in &self.candidates {
            self.is_free[i as usize] = true;
        }
        for &first in &self.candidates {
            if !std::mem::take(&mut self.is_free[first as usize]) {
                continue;
            }
            self.stack.clear();
            self.stack.push(first);
            let (mut pixels, mut sum_m, mut squares_m2) = (0_usize, 0.0, 0.0);
            let (mut sum_u, mut sum_v) = (0.0, 0.0);
            let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
            while let Some(i) = self.stack.pop() {
                let i = i as usize;
                let (column, row) = (i % columns, i / columns);
                let depth_m = f64::from(frame.depth_m[i]);
                pixels += 1;
                sum_m += depth_m;
                squares_m2 += depth_m * depth_m;
                sum_u += column as f64;
                sum_v += row as f64;
                low = [low[0].min(column), low[1].min(row)];
                high = [high[0].max(column), high[1].max(row)];
                let across = column.saturating_sub(1)..=(column + 1).min(columns - 1);
                for neighbour_row in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
                    for neighbour in across.clone().map(|column| neighbour_row * columns + column) {
                        let apart_m = (frame.depth_m[neighbour] - frame.depth_m[i]).abs();
                        if f64::from(apart_m) < reference.radius_m && std::mem::take(&mut self.is_free[neighbour]) {
                            self.stack.push(neighbour as u32);
                        }
                    }
                }
            }
            let count = pixels as f64;
            let depth_m = sum_m / count;
            let widest_px = SLACK * 2.0 * reference.radius_m * camera.focal_px / depth_m + 3.0;
            let extent_px = (high[0] - low[0]).max(high[1] - low[1]) as f64;
            if pixels < MIN_PIXELS || extent_px > widest_px {
                continue;
            }
            let inner_px = reference.inner_radius_m * camera.focal_px / depth_m;
            let uv = Point2::new(left as f64 + sum_u / count + 0.5, top as f64 + sum_v / count + 0.5);
            let ray_C = camera.back_project(&uv, 1.0).coords;
            let length = ray_C.norm();
            let spread_m2 = (squares_m2 / count - depth_m * depth_m).max(0.0);
            self.blobs.push(Blob {
                camera: frame.camera,
                pixels,
                p_WC: Point3::from(camera.X_WC.translation.vector),
                direction_W: camera.X_WC.rotation * (ray_C / length),
                along_m: depth_m * length,
                along_sd_m: (spread_m2.max(config.depth_sd_m(depth_m).powi(2)) / count).sqrt() * length,
                is_whole: count >= WHOLE_FRACTION * std::f64::consts::PI * inner_px * inner_px,
            });
        }
    }
}

impl Blob {
    /// Returns whether the blob's ray passes a point, and its depth does not contradict.
    fn passes(&self, place: &Point3<f64>, reach_m: f64) -> bool {
        let from_camera = place - self.p_WC;
        let along_m = from_camera.dot(&self.direction_W);
        (from_camera - self.direction_W * along_m).norm() < reach_m
            && (along_m - self.along_m).abs() < reach_m + 4.0 * self.along_sd_m
    }
}

/// Returns whether a blob of one camera alone is the object: it is large enough, and no other camera sees
/// that point.
fn is_enough_alone(blobs: &[Blob], place: &Point3<f64>, reach_m: f64, view: &View<'_>, config: &Config) -> bool {
    let Some(blob) = blobs.iter().filter(|blob| blob.is_whole).find(|blob| blob.passes(place, reach_m)) else {
        return false;
    };
    let sees_place = |(index, frame): (usize, &DepthFrame)| {
        let Some(camera) = view.cameras.get(frame.camera) else { return false };
        let p_C = camera.X_WC.inverse_transform_point(place);
        let Some(uv) = camera.project(&p_C) else { return false };
        let (u, v) = (uv.x - f64::from(frame.window.left), uv.y - f64::from(frame.window.top));
        let margin_px = reach_m * camera.focal_px / p_C.z;
        let is_within = |at: f64, length: u32| at > margin_px && at < f64::from(length) - margin_px;
        let background = || Background::new(camera, view.surroundings.get(index), &frame.window, config);
        is_within(u, frame.window.width)
            && is_within(v, frame.window.height)
            && p_C.z < nearer_than_m(background().nearest_m(&uv), config)
    };
    !view.seen().filter(|(_, frame)| frame.mask.is_none() && frame.camera != blob.camera).any(sees_place)
}

/// Point at which two rays come closest, if their distance there is below `reach_m` and both depths agree
/// with it.
fn meeting(one: &Blob, two: &Blob, reach_m: f64) -> Option<Point3<f64>> {
    let apart = two.p_WC - one.p_WC;
    let cosine = one.direction_W.dot(&two.direction_W);
    let sine_squared = 1.0 - cosine * cosine;
    if sine_squared < 0.01 {
        return None;
    }
    let along_one = (apart.dot(&one.direction_W) - apart.dot(&two.direction_W) * cosine) / sine_squared;
    let along_two = along_one * cosine - apart.dot(&two.direction_W);
    let (a, b) = (one.p_WC + one.direction_W * along_one, two.p_WC + two.direction_W * along_two);
    let place = nalgebra::center(&a, &b);
    ((a - b).norm() < reach_m && one.passes(&place, reach_m) && two.passes(&place, reach_m)).then_some(place)
}

/// The place nearest to all rays that pass `place`: Σ n·(1 − d·dᵀ)·(x − c) = 0, and along each by what its
/// depths tell.
fn refined(blobs: &[Blob], place: &Point3<f64>, reach_m: f64) -> Point3<f64> {
    let (mut information, mut pull) = (Matrix3::zeros(), Vector3::zeros());
    for blob in blobs.iter().filter(|blob| blob.passes(place, reach_m)) {
        let outer = blob.direction_W * blob.direction_W.transpose();
        let (across, along) = ((0.25 * reach_m).powi(-2), (blob.along_sd_m.powi(2) + (0.25 * reach_m).powi(2)).recip());
        let weights = (Matrix3::identity() - outer) * across + outer * along;
        information += weights;
        pull += weights * (blob.p_WC + blob.direction_W * blob.along_m - place);
    }
    information.cholesky().map_or(*place, |factor| place + factor.solve(&pull))
}
