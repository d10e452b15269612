//! Points of the depth cameras' images, in W.

use catch_body::Pose;
use nalgebra::Point3;

use crate::{pages::packed::Packed, playback::Playback, points::points_of};
use serde_json::{Value, json};

/// Points that a page carries in all, spread over its ticks: 6 bytes each.
pub const MOST_POINTS: usize = 40_000;
/// Points within this many radii of the object are kept before all others.
const NEAR_RADII: f64 = 2.0;

/// Points of all frames tick by tick, at most so many.
pub fn points_by_tick(playback: &Playback, most: usize) -> Value {
    let seen = playback.ticks.iter().filter(|tick| !tick.observation.frames.is_empty());
    let most = (most / seen.clone().count().max(1)).max(20);
    let radius_m = match playback.ground_truth() {
        Some(it) => it.surface.mesh().bounding_radius(),
        None => playback.known.reference.radius_m,
    } * NEAR_RADII;
    let (mut time_s, mut first, mut values) = (Vec::new(), vec![0], Vec::new());
    for tick in seen {
        let frames = &tick.observation.frames;
        let points = points_of(frames, &playback.header.cell.cameras);
        let capture_s = frames.iter().map(|frame| frame.capture_s).fold(f64::NEG_INFINITY, f64::max);
        let estimated = || tick.report.flight.as_ref().map(|flight| flight.pose_at(capture_s));
        let X_WO = playback.truth_at(capture_s).map(|sample| sample.X_WO).or_else(estimated);
        let X_WO = X_WO.unwrap_or_else(Pose::identity);
        let centre_O = Point3::from(X_WO.translation.vector);
        let (near, far): (Vec<Point3<f64>>, Vec<Point3<f64>>) =
            points.into_iter().partition(|point| (point - centre_O).norm() < radius_m);
        let near = thinned(&near, most);
        let far = thinned(&far, most - near.len());
        for point in near.iter().chain(&far) {
            values.extend([point.x, point.y, point.z]);
        }
        time_s.push(capture_s - playback.start_s());
        first.push(values.len() / 3);
    }
    json!({
        // Capture time of the images, for each set of points, from the beginning of the recording.
        "time_s": time_s,
        // Number of the first point of each set, and the number of all points at the end.
        "first": first,
        "p_W": Packed::numbers(&values, 3),
    })
}

/// Selects at most `most` of the points, evenly.
fn thinned(points: &[Point3<f64>], most: usize) -> Vec<Point3<f64>> {
    let kept = most.min(points.len());
    (0..kept).map(|i| points[i * points.len() / kept]).collect()
}
