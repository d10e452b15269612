//! Fills the holes of an oriented surface.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::edges::Edges;
use catch_body::TriangleMesh;

/// Result of filling holes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Filling {
    /// Holes that were filled.
    pub holes: usize,
    /// Width of the widest hole that was filled, in metres.
    pub widest_m: f64,
    /// Holes that are too wide.
    pub left: usize,
    /// Middle of the rim and width of the widest hole that is left.
    pub widest_left: Option<(Point3<f64>, f64)>,
}

/// Rims with more vertices are filled from their middle.
const MOST_RIM: usize = 250;

/// Fills holes up to a width.
pub(super) fn fill(mesh: &mut TriangleMesh, largest_m: f64) -> Filling {
    let mut filling = Filling::default();
    for rim in rims(&mesh.triangles) {
        let points: Vec<Point3<f64>> = rim.iter().map(|it| mesh.vertices[*it as usize]).collect();
        let width_m = width_m(&points);
        if width_m > largest_m {
            filling.left += 1;
            if filling.widest_left.is_none_or(|(_, widest_m)| width_m > widest_m) {
                filling.widest_left = Some((middle(&points), width_m));
            }
            continue;
        }
        filling.holes += 1;
        filling.widest_m = filling.widest_m.max(width_m);
        if rim.len() <= MOST_RIM {
            mesh.triangles.extend(least_area(&points).map(|triangle| triangle.map(|corner| rim[corner])));
        } else {
            let centre = mesh.vertices.len() as u32;
            mesh.vertices.push(middle(&points));
            mesh.triangles.extend((0..rim.len()).map(|i| [rim[i], rim[(i + 1) % rim.len()], centre]));
        }
    }
    filling
}

/// The rims of holes, each in the order in which a triangle within runs along it.
fn rims(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    // The hole's side runs against that of its neighbour.
    let mut onwards: HashMap<u32, Vec<u32>> = HashMap::new();
    let mut starts = Vec::new();
    for side in Edges::of(triangles).groups().filter(|it| it.len() == 1).map(|it| it[0].2 as usize) {
        let triangle = triangles[side / 3];
        let (from, to) = (triangle[side % 3], triangle[(side % 3 + 1) % 3]);
        onwards.entry(to).or_default().push(from);
        starts.push(to);
    }
    let mut rims = Vec::new();
    for start in starts {
        let (mut path, mut places) = (vec![start], HashMap::from([(start, 0)]));
        while let Some(next) = path.last().and_then(|at| onwards.get_mut(at)).and_then(Vec::pop) {
            // A rim is complete where a path meets itself.
            if let Some(at) = places.get(&next) {
                let rim = path.split_off(*at);
                for vertex in &rim {
                    places.remove(vertex);
                }
                rims.push(rim);
            }
            places.insert(next, path.len());
            path.push(next);
        }
    }
    rims.retain(|rim| rim.len() >= 3);
    rims
}

fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    Point3::from(points.iter().map(|it| it.coords).sum::<Vector3<f64>>() / points.len() as f64)
}

/// Width of a hole in metres: the distance across a slit, the diameter of a circle.
fn width_m(rim: &[Point3<f64>]) -> f64 {
    let centre = middle(rim);
    let sides = || rim.iter().zip(rim.iter().cycle().skip(1));
    let length_m: f64 = sides().map(|(from, to)| (to - from).norm()).sum();
    let area_m2 = sides().map(|(from, to)| (from - centre).cross(&(to - centre))).sum::<Vector3<f64>>().norm() / 2.0;
    // 4·A/L is the diameter of a circle and twice the distance across a slit.
    if length_m > 0.0 { 4.0 * area_m2 / length_m } else { 0.0 }
}

/// The triangulation of a polygon in space whose triangles have the least area together, by corners (Barequet
/// & Sharir, Filling gaps in the boundary of a polyhedron, 1995).
fn least_area(rim: &[Point3<f64>]) -> impl Iterator<Item = [usize; 3]> {
    let count = rim.len();
    let area = |a: usize, b: usize, c: usize| (rim[b] - rim[a]).cross(&(rim[c] - rim[a])).norm();
    // For each stretch of the rim the least area between it and its chord, and the corner opposite to the
    // chord.
    let mut best = vec![(0.0, 0); count * count];
    for length in 2..count {
        for from in 0..count - length {
            let to = from + length;
            let cost =
                |corner: usize| best[from * count + corner].0 + best[corner * count + to].0 + area(from, corner, to);
            let least = (from + 1..to).map(|corner| (cost(corner), corner)).min_by(|a, b| a.0.total_cmp(&b.0));
            best[from * count + to] = least.unwrap_or_default();
        }
    }
    let (mut triangles, mut chords) = (Vec::new(), vec![(0, count - 1)]);
    while let Some((from, to)) = chords.pop() {
        if to - from >= 2 {
            let corner = best[from * count + to].1;
            triangles.push([from, corner, to]);
            chords.extend([(from, corner), (corner, to)]);
        }
    }
    triangles.into_iter()
}
