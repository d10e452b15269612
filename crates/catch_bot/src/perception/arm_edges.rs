//! Edges of the waiting arm's silhouette along rows and columns of a camera's image, and their check against
//! an image.

use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::Vector4;

use super::{
    Config,
    segmentation::{Background, Surroundings, threshold_m},
};

/// A stretch of a row or a column that is half on the arm.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Number of the first pixel, and what leads from one to the next.
    first: usize,
    step: usize,
    /// Pixels on each side.
    reach: usize,
    /// True if the arm is on the far side, false if on the near one.
    begins: bool,
    /// Depth of the arm at the edge, and at its far end within the arm.
    depth_m: f32,
    inner_m: f32,
    /// Motion of the edge along its line when the image moves by a pixel to the right, and down.
    gradient: [f64; 2],
}

/// The edges of the waiting arm in the image of one camera.
#[derive(Debug, Clone)]
pub(super) struct ArmEdges {
    /// The size of the images that they are of.
    pub window: PixelWindow,
    edges: Vec<Edge>,
    /// Mean depth of the arm in metres.
    pub mean_depth_m: f64,
    tolerance_m: f32,
}

/// Agreement of an image with the arm's silhouette.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sight {
    /// Fraction of the pixels that should show the arm which have any depth.
    pub measured_fraction: f64,
    /// Fraction of the pixels on both sides that show the arm where they should and else not. `None` if
    /// another body stands before most of them.
    pub explained: Option<f64>,
    /// Number of edges, and sums over them: of the regressors' products, and of these with the pixels of the
    /// arm that are missing.
    pub edges: usize,
    pub information: nalgebra::Matrix4<f64>,
    pub pull: Vector4<f64>,
    /// Mean of measured less expected depths within the arm, in metres; `None` if there are none.
    pub depth_error_m: Option<f64>,
}

/// Pixels on each side of an edge, at least and at most.
const MIN_REACH: usize = 3;
const MAX_REACH: usize = 12;
/// Edges of a camera, at least and at most.
const MIN_EDGES: usize = 12;
const MAX_EDGES: usize = 96;
/// Edges more slanted than this to their line are left to the lines across.
const STEEPEST: f64 = 1.3;
/// Variation of the arm's depth within the pixels around an edge, in metres.
const RELIEF_M: f64 = 0.05;

impl ArmEdges {
    /// Finds the edges that a camera sees of an arm that stands as `known`.
    pub fn new(camera: &CameraModel, known: &Surroundings<'_>, config: &Config) -> Self {
        let window = camera.full_window();
        let with_m = Background::new(camera, Some(known), &window, config).cast_all();
        let without_m = Background::without_arm(camera, known, config).cast_all();
        let image = ArmImage { window, with_m, without_m };
        let mut edges: Vec<Edge> = [true, false].into_iter().flat_map(|along_row| image.edges(along_row)).collect();
        let step = edges.len().div_ceil(MAX_EDGES).max(1);
        edges = edges.into_iter().step_by(step).collect();
        let mean_depth_m = edges.iter().map(|it| f64::from(it.depth_m)).sum::<f64>() / edges.len().max(1) as f64;
        let tolerance_m = (RELIEF_M + threshold_m(mean_depth_m, config)) as f32;
        // The background must differ from the arm.
        edges.retain(|it| !image.is_near_ground(it, 2.0 * tolerance_m));
        Self { window, edges, mean_depth_m, tolerance_m }
    }

    /// Returns whether there are enough edges to judge a camera by.
    pub fn are_enough(&self) -> bool {
        self.edges.len() >= MIN_EDGES
    }

    /// Numbers of at most `count` pixels within the arm.
    pub fn samples(&self, count: usize) -> impl Iterator<Item = usize> {
        self.edges.iter().step_by(self.edges.len().div_ceil(count).max(1)).map(Edge::inner)
    }

    /// Compares a full image with the edges.
    pub fn look(&self, frame: &DepthFrame) -> Sight {
        let mut sight = Sight::default();
        let (mut inside, mut measured, mut pixels, mut right) = (0_usize, 0_usize, 0_usize, 0_usize);
        let (mut depth_errors, mut sum_m) = (0, 0.0);
        for edge in &self.edges {
            let (mut shown, mut is_hidden) = ([0_usize; 2], false);
            for i in 0..2 * edge.reach {
                let found_m = frame.depth_m[edge.first + i * edge.step];
                let is_inside = (i >= edge.reach) == edge.begins;
                let has_depth = found_m.is_finite() && found_m > 0.0;
                inside += usize::from(is_inside);
                measured += usize::from(is_inside && has_depth);
                is_hidden |= has_depth && found_m < edge.depth_m - self.tolerance_m;
                shown[usize::from(is_inside)] +=
                    usize::from(has_depth && (found_m - edge.depth_m).abs() <= self.tolerance_m);
            }
            if is_hidden {
                continue;
            }
            pixels += 2 * edge.reach;
            right += edge.reach - shown[0] + shown[1];
            // The arm's pixels along the line are fewer by the shift of an edge at which it begins, by the
            // fraction without a depth, and by what edges lose or gain.
            let side = if edge.begins { 1.0 } else { -1.0 };
            let [u, v] = edge.gradient;
            let regressor = Vector4::new(side * u, side * v, edge.reach as f64, 1.0);
            sight.edges += 1;
            sight.information += regressor * regressor.transpose();
            sight.pull += regressor * (edge.reach as f64 - (shown[0] + shown[1]) as f64);
            let inner_m = frame.depth_m[edge.inner()];
            if (inner_m - edge.inner_m).abs() <= self.tolerance_m {
                depth_errors += 1;
                sum_m += f64::from(inner_m - edge.inner_m);
            }
        }
        sight.measured_fraction = measured as f64 / inside.max(1) as f64;
        sight.explained = (2 * sight.edges > self.edges.len()).then(|| right as f64 / pixels.max(1) as f64);
        sight.depth_error_m = (depth_errors >= MIN_EDGES).then(|| sum_m / depth_errors as f64);
        sight
    }
}

impl Edge {
    /// The pixel farthest within the arm.
    fn inner(&self) -> usize {
        self.first + if self.begins { (2 * self.reach - 1) * self.step } else { 0 }
    }
}

/// Depths of a camera's image with and without the arm.
struct ArmImage {
    window: PixelWindow,
    with_m: Vec<f32>,
    without_m: Vec<f32>,
}

impl ArmImage {
    fn shows_arm(&self, pixel: usize) -> bool {
        self.with_m[pixel] < self.without_m[pixel]
    }

    /// Returns whether a surface behind the arm is so near that depths do not distinguish it from the arm.
    fn is_near_ground(&self, edge: &Edge, apart_m: f32) -> bool {
        let from = if edge.begins { 0 } else { edge.reach };
        (from..from + edge.reach).any(|i| self.with_m[edge.first + i * edge.step] < edge.depth_m + apart_m)
    }

    /// Crossings of the silhouette with all rows, or all columns.
    fn edges(&self, along_row: bool) -> Vec<Edge> {
        let (wide, high) = (self.window.width as usize, self.window.height as usize);
        let (lines, length, step, across) = if along_row { (high, wide, 1, wide) } else { (wide, high, wide, 1) };
        let mut edges = Vec::new();
        for line in 1..lines.saturating_sub(1) {
            for last in 0..length.saturating_sub(1) {
                let Some(begins) = self.crosses(line * across, step, last) else { continue };
                let is_clean = |reach: usize| {
                    last + 1 >= reach
                        && last + reach < length
                        && self.shows_arm(line * across + (last + 1 - reach) * step) != begins
                        && self.shows_arm(line * across + (last + reach) * step) == begins
                };
                let reach = (1..=MAX_REACH).take_while(|reach| is_clean(*reach)).count();
                let beside = [line - 1, line + 1].map(|line| {
                    let near = last.saturating_sub(2)..(last + 3).min(length - 1);
                    near.clone().find(|at| self.crosses(line * across, step, *at) == Some(begins))
                });
                let [Some(before), Some(after)] = beside else { continue };
                let slope = (after as f64 - before as f64) / 2.0;
                if reach < MIN_REACH || slope.abs() > STEEPEST {
                    continue;
                }
                let first = line * across + (last + 1 - reach) * step;
                let (at, inner) = if begins { (last + 1, last + reach) } else { (last, last + 1 - reach) };
                edges.push(Edge {
                    first,
                    step,
                    reach,
                    begins,
                    depth_m: self.with_m[line * across + at * step],
                    inner_m: self.with_m[line * across + inner * step],
                    gradient: if along_row { [1.0, -slope] } else { [-slope, 1.0] },
                });
            }
        }
        edges
    }

    /// Returns whether the arm begins after a pixel of a line (`true`) or ends there; `None` if neither.
    fn crosses(&self, from: usize, step: usize, last: usize) -> Option<bool> {
        let [before, after] = [last, last + 1].map(|at| self.shows_arm(from + at * step));
        (before != after).then_some(after)
    }
}
