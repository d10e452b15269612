//! Signs of a cloud's normals, which estimators leave open: neighbours face the same way (Hoppe et al.,
//! Surface reconstruction from unorganized points, 1992).
//!
//! Normals of two points agree if a circle's arc joins them that is perpendicular to both: one is the other
//! mirrored at the plane between the points (König & Gumhold, Consistent propagation of normal orientations
//! in point clouds, 2009). So it is decided across sharp edges and thin walls, too.

use std::collections::BinaryHeap;

use catch_body::{
    InputError,
    neighbours::{PointGrid, bounds},
};
use nalgebra::{Point3, Vector3};

use crate::cloud_file::CloudFile;

/// Nearest points that a normal is compared with.
const NEIGHBOURS: usize = 8;
/// Neighbours are looked for within this many spacings of points spread over a square as long as the cloud.
const REACH: f64 = 3.0;
/// Greatest fraction of neighbours that face opposite ways: of directions of no surface a third does,
/// whatever their signs, of normals that are 30° off an eighth.
const MOST_OPPOSITE: f64 = 0.25;
/// Other signs than the given ones leave this fraction of it at most.
const CLEARLY: f64 = 0.5;

/// Gives the normals of a cloud all around something signs with which neighbours face the same way, outwards;
/// a sentence for each change.
///
/// # Errors
/// Normals that no signs make those of a surface.
pub(super) fn orient(file: &str, cloud: &mut CloudFile) -> Result<Vec<String>, InputError> {
    let Some(given) = &mut cloud.normals else { return Ok(Vec::new()) };
    let neighbours = neighbours(&cloud.points);
    let opposite = |normals: &[Vector3<f64>]| {
        let pairs = neighbours.iter().enumerate().flat_map(|(i, all)| all.iter().map(move |j| (i, *j as usize)));
        let (all, opposite) = pairs.fold((0.0, 0.0), |(all, opposite), (i, j)| {
            let is_opposite = agreement(&cloud.points, normals, i, j) < 0.0;
            (all + 1.0, opposite + f64::from(u8::from(is_opposite)))
        });
        opposite / f64::max(all, 1.0)
    };
    let mut findings = Vec::new();
    let propagated = propagated(&cloud.points, given, &neighbours);
    let fractions = [opposite(given), opposite(&propagated)];
    let is_mixed = fractions[1] < CLEARLY * fractions[0];
    if is_mixed {
        let turned = given.iter().zip(&propagated).filter(|(one, other)| one.dot(other) < 0.0).count();
        findings.push(format!("{turned} of {} normals faced another way than those around them: turned", given.len()));
        *given = propagated;
    } else if outwards(&cloud.points, given, 0..given.len()) < 0.0 {
        findings.push("the normals face inwards: turned".into());
        given.iter_mut().for_each(|it| *it = -*it);
    }
    let left = fractions[usize::from(is_mixed)];
    if left > MOST_OPPOSITE {
        let found = format!("directions of which {:.0} % are opposite to those around them", left * 100.0);
        return Err(InputError::new(file, "normals", found, "normals of the surface, or a cloud without any"));
    }
    Ok(findings)
}

/// Cosine of the angle between a normal and the one that a circle's arc leads to from another point's.
fn agreement(points: &[Point3<f64>], normals: &[Vector3<f64>], i: usize, j: usize) -> f64 {
    let along = (points[j] - points[i]).try_normalize(0.0).unwrap_or_default();
    (normals[i] - along * (2.0 * normals[i].dot(&along))).dot(&normals[j])
}

/// Points that are near each other, both ways.
fn neighbours(points: &[Point3<f64>]) -> Vec<Vec<u32>> {
    let (low, high) = bounds(points);
    let reach = REACH * (high - low).max() / (points.len() as f64).sqrt();
    let grid = PointGrid::new(points, reach);
    let mut neighbours = vec![Vec::new(); points.len()];
    let mut near: Vec<(f64, usize)> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        near.clear();
        grid.near(point, reach, |j| near.push(((points[j] - point).norm_squared(), j)));
        near.retain(|it| it.1 != i);
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, j) in near.iter().take(NEIGHBOURS) {
            neighbours[i].push(j as u32);
            neighbours[j].push(i as u32);
        }
    }
    neighbours
}

/// The normals with signs that are passed on from one to the next, along the pairs that decide them best;
/// each piece of the cloud faces away from the middle of all.
fn propagated(points: &[Point3<f64>], given: &[Vector3<f64>], neighbours: &[Vec<u32>]) -> Vec<Vector3<f64>> {
    let mut normals = given.to_vec();
    let mut is_known = vec![false; points.len()];
    for first in 0..points.len() {
        let mut piece = Vec::new();
        // Bits of numbers that are not negative have the order of the numbers.
        let mut open = BinaryHeap::from([(0, first, first)]);
        while let Some((_, from, to)) = open.pop() {
            if std::mem::replace(&mut is_known[to], true) {
                continue;
            }
            if from != to && agreement(points, &normals, from, to) < 0.0 {
                normals[to] = -normals[to];
            }
            piece.push(to);
            let further = neighbours[to].iter().map(|it| *it as usize).filter(|it| !is_known[*it]);
            open.extend(further.map(|it| (agreement(points, &normals, to, it).abs().to_bits(), to, it)));
        }
        if outwards(points, &normals, piece.iter().copied()) < 0.0 {
            piece.iter().for_each(|it| normals[*it] = -normals[*it]);
        }
    }
    normals
}

/// Σ n·(p − c) over some points of a cloud: three times a volume where they are all around one, by the
/// divergence theorem.
fn outwards(points: &[Point3<f64>], normals: &[Vector3<f64>], some: impl Iterator<Item = usize>) -> f64 {
    let (low, high) = bounds(points);
    some.map(|i| normals[i].dot(&(points[i] - nalgebra::center(&low, &high)))).sum()
}
