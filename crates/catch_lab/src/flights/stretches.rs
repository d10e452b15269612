//! Rows of a track that count, and the stretches between contacts. All by medians, so that a few outliers
//! change nothing.

use catch_body::{dynamics::gravity, statistics::median_in_place};
use nalgebra::{Unit, Vector3};

use super::track_file::Sighting;

/// Velocities before and after a row are taken over this time,
const SPAN_S: f64 = 0.07;
/// and at least over so many rows.
const SPAN_ROWS: usize = 5;
/// A change of velocity beyond gravity that is a contact: larger than drag and tumbling explain, smaller than
/// a bounce.
const CONTACT_MPS: f64 = 2.0;
/// Rows of a flight, at least.
pub const LEAST_SIGHTINGS: usize = 6;
/// Shortest stretch between contacts.
const SHORTEST_S: f64 = 0.1;

/// The rows that are sightings: finite, in the order of time, neither zero nor a repetition of the row
/// before.
///
/// Trackers that lost an object go on with zeros or with the last sighting; logs that are faster than the
/// tracker repeat it.
pub fn sighted(rows: &[Sighting]) -> Vec<Sighting> {
    let mut seen: Vec<Sighting> = Vec::with_capacity(rows.len());
    let mut last = None;
    for row in rows {
        let finite = row.time_s.is_finite() && row.p.coords.iter().all(|it| it.is_finite());
        let repeated = last.replace(row.p) == Some(row.p);
        if finite
            && !repeated
            && row.p.coords != Vector3::zeros()
            && seen.last().is_none_or(|it| it.time_s < row.time_s)
        {
            seen.push(Sighting {
                rotation: row.rotation.filter(|it| it.coords.iter().all(|it| it.is_finite())),
                ..*row
            });
        }
    }
    seen
}

/// Leaves every second, third … row, the newest among them, so that no more than `most` are left.
pub fn thinned(rows: &[Sighting], most: usize) -> Vec<Sighting> {
    let mut left: Vec<Sighting> = rows.iter().rev().step_by(rows.len().div_ceil(most).max(1)).copied().collect();
    left.reverse();
    left
}

/// The stretches between contacts, which change the velocity by more than gravity, drag and tumbling do.
pub fn between_contacts(g: &Vector3<f64>, rows: &[Sighting]) -> Vec<std::ops::Range<usize>> {
    let (mut stretches, mut start, mut i) = (Vec::new(), 0, 0);
    while i < rows.len() {
        let (mut contact, mut largest) = (i, velocity_change(g, rows, i));
        if largest < CONTACT_MPS {
            i += 1;
            continue;
        }
        // The contact is where the change is largest.
        while i + 1 < rows.len() {
            i += 1;
            let change = velocity_change(g, rows, i);
            if change < CONTACT_MPS {
                break;
            }
            if change > largest {
                (contact, largest) = (i, change);
            }
        }
        if contact - start >= LEAST_SIGHTINGS && rows[contact - 1].time_s - rows[start].time_s > SHORTEST_S {
            stretches.push(start..contact);
        } else if rows.len() - contact < LEAST_SIGHTINGS {
            break;
        }
        start = contact;
    }
    stretches.push(start..rows.len());
    stretches
}

/// Change of velocity at a row, without gravity and beyond the part that the scatter of the rows explains.
fn velocity_change(g: &Vector3<f64>, rows: &[Sighting], at: usize) -> f64 {
    let time_s = rows[at].time_s;
    let first = rows[..at].partition_point(|it| it.time_s < time_s - SPAN_S).min(at.saturating_sub(SPAN_ROWS));
    let reached = at + 1 + rows[at + 1..].partition_point(|it| it.time_s <= time_s + SPAN_S);
    let last = reached.max(at + 1 + SPAN_ROWS).min(rows.len());
    if at - first < SPAN_ROWS || last - at <= SPAN_ROWS {
        return 0.0;
    }
    let slope = |rows: &[Sighting]| {
        // One of these rows may be an outlier: fewer than half of the pairs have it.
        let apart = (rows.len() / 3).max(1);
        let pairs: Vec<Vector3<f64>> = rows
            .iter()
            .enumerate()
            .flat_map(|(i, a)| rows.iter().skip(i + apart).map(move |b| slope(g, a, b)))
            .collect();
        let velocity = median_vector(&pairs);
        let mut distances: Vec<f64> = pairs.iter().map(|it| (it - velocity).norm()).collect();
        (velocity, median_in_place(&mut distances))
    };
    let (after, scatter_after) = slope(&rows[at + 1..last]);
    let (before, scatter_before) = slope(&rows[first..at]);
    (after - before).norm() - 2.0 * (scatter_after + scatter_before)
}

/// Velocity at time zero of the parabola through two rows.
fn slope(g: &Vector3<f64>, a: &Sighting, b: &Sighting) -> Vector3<f64> {
    (b.p - a.p) / (b.time_s - a.time_s) - g * (0.5 * (a.time_s + b.time_s))
}

/// Median along each axis.
pub fn median_vector(vectors: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| median_in_place(&mut vectors.iter().map(|it| it[axis]).collect::<Vec<_>>()))
}

/// Position, velocity and acceleration at the time of the first row.
#[derive(Debug, Clone, Copy)]
pub struct Parabola {
    /// Position at the time of the first row.
    pub p: Vector3<f64>,
    /// See `p`.
    pub v: Vector3<f64>,
    /// Throughout.
    pub a: Vector3<f64>,
    /// Median distance of the rows from it.
    pub off_m: f64,
}

/// Parabolas that are tried.
const TRIALS: usize = 120;

impl Parabola {
    /// Least median of distances over parabolas through three rows, one of each third (Rousseeuw, 1984).
    /// `None` of fewer than three.
    pub fn through(rows: &[Sighting]) -> Option<Self> {
        let (count, third) = (rows.len(), rows.len() / 3);
        let start_s = rows.first()?.time_s;
        let mut found: Option<Self> = None;
        for trial in 0..TRIALS {
            // The low-discrepancy sequence of Roberts in three dimensions.
            let [i, j, k] = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9]
                .map(|step: f64| (((trial as f64 + 0.5) * step).fract() * third as f64) as usize);
            let [a, b, c] = [rows.get(i)?, rows.get(third + j)?, rows.get(count - third + k)?];
            let (first, second) = ((b.p - a.p) / (b.time_s - a.time_s), (c.p - b.p) / (c.time_s - b.time_s));
            let a2 = (second - first) / (c.time_s - a.time_s);
            // Newton's form at the first row's time.
            let (ta, tb) = (a.time_s - start_s, b.time_s - start_s);
            let p = a.p.coords - first * ta + a2 * (ta * tb);
            let v = first - a2 * (ta + tb);
            let off = |row: &Sighting| {
                let t = row.time_s - start_s;
                (row.p.coords - p - (v + a2 * t) * t).norm()
            };
            let off_m = median_in_place(&mut rows.iter().map(off).collect::<Vec<_>>());
            if off_m.is_finite() && found.is_none_or(|it| off_m < it.off_m) {
                found = Some(Self { p, v, a: a2 * 2.0, off_m });
            }
        }
        found
    }
}

/// The direction of the axis against which a track falls, by the votes of its parts. A long part's vote
/// counts more: the tracked point of an object that tumbles falls along other axes for a tenth of a second.
pub fn up(rows: &[Sighting]) -> Unit<Vector3<f64>> {
    let mut votes = [0.0; 6];
    for parts in PARTS {
        for part in rows.chunks(rows.len().div_ceil(parts).max(LEAST_SIGHTINGS)) {
            let Some(parabola) = Parabola::through(part) else { continue };
            let off = |direction: &usize| (parabola.a - axis(*direction) * -gravity().norm()).norm();
            if let Some(nearest) = (0..6).min_by(|a, b| off(a).total_cmp(&off(b))) {
                // A part in a hand or across a contact falls nowhere.
                let falls = off(&nearest) < 0.5 * gravity().norm();
                votes[nearest] += if falls { 1.0 } else { 0.1 } / (parts * parts) as f64;
            }
        }
    }
    Unit::new_unchecked(axis((0..6).max_by(|a, b| votes[*a].total_cmp(&votes[*b])).unwrap_or(4)))
}

/// Numbers of parts into which a track is divided, to see which axis points up.
const PARTS: [usize; 4] = [1, 2, 4, 8];

/// x, −x, y, −y, z, −z.
pub fn axis(direction: usize) -> Vector3<f64> {
    Vector3::ith(direction / 2, if direction.is_multiple_of(2) { 1.0 } else { -1.0 })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, UnitQuaternion};

    use super::*;

    /// A point 40 mm beside the centre of mass of an object that tumbles at 20 rad/s is accelerated by 16
    /// m/s², more than by gravity; in a tenth of a second it falls anywhere. Before, a hand holds it.
    #[test]
    fn a_tumbling_point_falls_down_in_the_long_run() {
        let (held_s, flies_s, step_s) = (0.3, 0.9, 1.0 / 120.0);
        for direction in 0..6 {
            let up = axis(direction);
            let spin = (up + axis((direction + 2) % 6) * 0.5).normalize() * 20.0;
            let beside = axis((direction + 4) % 6) * 0.04;
            let row = |i: usize| {
                let time_s = i as f64 * step_s;
                let t = (time_s - held_s).max(0.0);
                let start = Vector3::new(1.0, 2.0, 3.0);
                let v = (axis((direction + 2) % 6) + up) * 4.0;
                let centre = start + v * t - up * (0.5 * gravity().norm() * t * t);
                let p = Point3::from(centre + UnitQuaternion::from_scaled_axis(spin * t) * beside);
                Sighting { time_s, p, rotation: None }
            };
            let rows: Vec<Sighting> = (0..((held_s + flies_s) / step_s) as usize).map(row).collect();
            assert_eq!(super::up(&sighted(&rows)).into_inner(), up, "{direction}");
        }
    }
}
