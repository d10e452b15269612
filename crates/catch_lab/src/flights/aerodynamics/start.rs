//! Where the smoother starts: which samples belong to the flight, which of them agree with their neighbours, and a rough
//! motion through these. All by medians, so that a few outliers change nothing.

use nalgebra::{UnitQuaternion, Vector3};

use super::{
    dynamics::State,
    smoother::{Node, Sample},
};
use crate::statistics::median_in_place;

/// Neighbours on each side that a sample is compared with.
const REACH: usize = 5;
/// Velocities before and after a sample are taken over this time,
const SPAN_S: f64 = 0.07;
/// and at least over so many samples.
const SPAN_SAMPLES: usize = 5;
/// A change of velocity beyond gravity that is a contact: larger than drag and tumbling explain, smaller than a bounce.
const CONTACT_MPS: f64 = 2.0;
/// Samples of a flight, at least.
pub const LEAST_SAMPLES: usize = 6;

fn median_vector(vectors: &[Vector3<f64>], buffer: &mut Vec<f64>) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        buffer.clear();
        buffer.extend(vectors.iter().map(|it| it[axis]));
        median_in_place(buffer)
    })
}

/// Buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    pairs: Vec<Vector3<f64>>,
    slopes: Vec<Vector3<f64>>,
    numbers: Vec<f64>,
    distances: Vec<f64>,
}

/// The first free flight among samples: its range, and whether a contact ends it.
pub(super) fn free_flight(g: &Vector3<f64>, samples: &[Sample], scratch: &mut Scratch) -> (usize, usize, bool) {
    let mut start = 0;
    let mut i = 0;
    while i < samples.len() {
        let change = velocity_change(g, samples, i, scratch);
        if change < CONTACT_MPS {
            i += 1;
            continue;
        }
        // The contact is where the change is largest.
        let (mut contact, mut largest) = (i, change);
        while i + 1 < samples.len() {
            i += 1;
            let change = velocity_change(g, samples, i, scratch);
            if change < CONTACT_MPS {
                break;
            }
            if change > largest {
                (contact, largest) = (i, change);
            }
        }
        let long_enough = contact - start >= LEAST_SAMPLES && samples[contact - 1].time_s - samples[start].time_s > 0.1;
        if long_enough {
            return (start, contact, true);
        }
        if samples.len() - contact < LEAST_SAMPLES {
            break;
        }
        start = contact;
    }
    (start, samples.len(), false)
}

/// How far the velocity after a sample is from that before, gravity aside and beyond what the scatter of the samples explains.
fn velocity_change(g: &Vector3<f64>, samples: &[Sample], at: usize, scratch: &mut Scratch) -> f64 {
    let time_s = samples[at].time_s;
    let first = samples[..at].partition_point(|it| it.time_s < time_s - SPAN_S).min(at.saturating_sub(SPAN_SAMPLES));
    let reached = at + 1 + samples[at + 1..].partition_point(|it| it.time_s <= time_s + SPAN_S);
    let last = reached.max(at + 1 + SPAN_SAMPLES).min(samples.len());
    if at - first < SPAN_SAMPLES || last - at <= SPAN_SAMPLES {
        return 0.0;
    }
    let mut slope = |samples: &[Sample]| {
        scratch.pairs.clear();
        // One of these samples may be an outlier: fewer than half of the pairs have it.
        let apart = (samples.len() / 3).max(1);
        for (i, a) in samples.iter().enumerate() {
            scratch.pairs.extend(samples.iter().skip(i + apart).map(|b| slope(g, a, b)));
        }
        let velocity = median_vector(&scratch.pairs, &mut scratch.numbers);
        scratch.numbers.clear();
        scratch.numbers.extend(scratch.pairs.iter().map(|it| (it - velocity).norm()));
        (velocity, median_in_place(&mut scratch.numbers))
    };
    let (after, scatter_after) = slope(&samples[at + 1..last]);
    let (before, scatter_before) = slope(&samples[first..at]);
    (after - before).norm() - 2.0 * (scatter_after + scatter_before)
}

/// Velocity at time zero of the parabola through two samples.
fn slope(g: &Vector3<f64>, a: &Sample, b: &Sample) -> Vector3<f64> {
    (b.p - a.p) / (b.time_s - a.time_s) - g * (0.5 * (a.time_s + b.time_s))
}

/// Motion at each sample and weights of the samples, as their neighbours have it.
pub(super) fn nodes(g: &Vector3<f64>, samples: &[Sample], nodes: &mut [Node], scratch: &mut Scratch) {
    let count = samples.len();
    scratch.distances.clear();
    for (j, node) in nodes.iter_mut().enumerate() {
        let first = j.saturating_sub(REACH).min(count.saturating_sub(2 * REACH + 1));
        let last = (first + 2 * REACH + 1).min(count);
        let at = samples[j].time_s;
        let (mut pairs, mut slopes) = (std::mem::take(&mut scratch.pairs), std::mem::take(&mut scratch.slopes));
        pairs.clear();
        slopes.clear();
        for a in first..last {
            for b in a + 1..last {
                let slope = slope(g, &samples[a], &samples[b]);
                slopes.push(slope + g * at);
                let ratio = (at - samples[a].time_s) / (samples[b].time_s - samples[a].time_s);
                if a != j && b != j && ratio.abs() < 2.5 {
                    let passed = samples[a].time_s;
                    pairs.push(samples[a].p + slope * (at - passed) + g * (0.5 * (at * at - passed * passed)));
                }
            }
        }
        let p = if pairs.is_empty() { samples[j].p } else { median_vector(&pairs, &mut scratch.numbers) };
        node.state.v = median_vector(&slopes, &mut scratch.numbers);
        node.state.p = p;
        scratch.distances.push((samples[j].p - p).norm());
        (scratch.pairs, scratch.slopes) = (pairs, slopes);
    }
    scratch.numbers.clear();
    scratch.numbers.extend(&scratch.distances);
    let scale_m = (2.0 * median_in_place(&mut scratch.numbers)).max(1e-3);
    for (node, distance) in nodes.iter_mut().zip(&scratch.distances) {
        node.weight_p = (5.0 / (4.0 + (distance / scale_m).powi(2))).min(1.0);
    }
    orientations(samples, nodes, scratch);
}

/// Rotation vector from one sample to another in the body frame.
fn turn(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> Vector3<f64> {
    (from.inverse() * to).scaled_axis()
}

fn orientations(samples: &[Sample], nodes: &mut [Node], scratch: &mut Scratch) {
    let count = samples.len();
    let rate = |i: usize| {
        let (from, to) = (samples[i].R?, samples[i + 1].R?);
        Some(turn(&from, &to) / (samples[i + 1].time_s - samples[i].time_s))
    };
    for (j, node) in nodes.iter_mut().enumerate() {
        scratch.pairs.clear();
        scratch.pairs.extend((j.saturating_sub(REACH)..(j + REACH).min(count - 1)).filter_map(rate));
        node.state.w = median_vector(&scratch.pairs, &mut scratch.numbers);
    }
    // A sample's orientation against those of its neighbours, each carried to its time.
    scratch.distances.clear();
    for j in 0..count {
        let Some(R) = samples[j].R else {
            scratch.distances.push(f64::INFINITY);
            continue;
        };
        scratch.pairs.clear();
        let neighbours = (j.saturating_sub(2)..(j + 3).min(count)).filter(|i| *i != j);
        scratch.numbers.clear();
        for i in neighbours {
            let Some(from) = samples[i].R else { continue };
            let carried =
                from * UnitQuaternion::from_scaled_axis(nodes[i].state.w * (samples[j].time_s - samples[i].time_s));
            scratch.numbers.push(carried.angle_to(&R));
        }
        scratch.distances.push(median_in_place(&mut scratch.numbers));
    }
    scratch.numbers.clear();
    scratch.numbers.extend(scratch.distances.iter().filter(|it| it.is_finite()));
    let scale = (2.0 * median_in_place(&mut scratch.numbers)).max(0.01);
    for (node, distance) in nodes.iter_mut().zip(&scratch.distances) {
        node.weight_R = if distance.is_finite() { (5.0 / (4.0 + (distance / scale).powi(2))).min(1.0) } else { 0.0 };
    }
    // Where a sample is not to be trusted, the nearest trusted one is carried there.
    for j in 0..count {
        let trusted = |i: &usize| nodes[*i].weight_R > 0.2;
        let nearest = (0..count).filter(trusted).min_by_key(|i| i.abs_diff(j));
        let carried = nearest.and_then(|i| {
            let by = UnitQuaternion::from_scaled_axis(nodes[i].state.w * (samples[j].time_s - samples[i].time_s));
            Some(samples[i].R? * by)
        });
        nodes[j].state.R = carried.unwrap_or_default();
    }
}

impl State {
    /// At rest in the origin.
    pub(super) fn origin() -> Self {
        Self { p: Vector3::zeros(), v: Vector3::zeros(), R: UnitQuaternion::identity(), w: Vector3::zeros() }
    }
}
