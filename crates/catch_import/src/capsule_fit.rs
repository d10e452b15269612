//! Fits capsules around surfaces, conservatively: every triangle is inside one of them.

use nalgebra::{Matrix3, Point3, Unit, Vector2, Vector3};

use catch_body::{TriangleMesh, shape::Capsule};

/// Directions in which the outermost points are looked for; all others count only in the last step.
const DIRECTIONS: usize = 400;
/// Directions in which the outermost points are looked for where two partitions are compared.
const FEW_DIRECTIONS: usize = 50;
/// Capsules for one surface at most.
pub const MOST_CAPSULES: usize = 4;
/// Least fraction of the volume that one more capsule has to save.
const LEAST_SAVING: f64 = 0.12;
/// Places where a surface is cut in two, as fractions of its extent.
const CUTS: [f64; 7] = [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
/// Margin in metres that is added to every radius, so that rounding leaves nothing outside.
const MARGIN_M: f64 = 1e-6;

/// Capsules that hold a surface between them, at most [`MOST_CAPSULES`]: each triangle is inside one of them.
///
/// A capsule is convex, so that it holds a triangle as soon as it holds its corners. Triangles are divided by
/// planes across the principal axes as long as that saves volume.
pub fn enclosing_capsules(surface: &TriangleMesh) -> Vec<Capsule> {
    let all: Vec<[Point3<f64>; 3]> = surface.all_corners().collect();
    let Some(whole) = Part::of(all) else { return Vec::new() };
    let mut parts = vec![whole];
    while parts.len() < MOST_CAPSULES {
        let halves = parts.iter().enumerate().filter_map(|(i, part)| {
            let (one, other) = part.best_halves()?;
            let saved = volume(&part.capsule) - volume(&one.capsule) - volume(&other.capsule);
            Some((saved, i, one, other))
        });
        let best = halves.max_by(|one, other| one.0.total_cmp(&other.0));
        let total: f64 = parts.iter().map(|part| volume(&part.capsule)).sum();
        match best {
            Some((saved, i, one, other)) if saved > LEAST_SAVING * total => {
                parts[i] = one;
                parts.push(other);
            }
            _ => break,
        }
    }
    parts.into_iter().map(|part| part.capsule).collect()
}

/// A small capsule that holds all points, `None` without any.
///
/// The axis is the best of the coordinate axes, the principal axes and directions that a pattern search finds
/// from the best of these; for an axis the circle around the points across it and the hemispheres at both
/// ends follow.
pub fn enclosing_capsule(points: &[Point3<f64>]) -> Option<Capsule> {
    let outermost = few(points, DIRECTIONS);
    let centre = centroid(&outermost)?;
    let mut best = smallest(starts(&outermost, &centre).map(|axis| along(&outermost, axis)))?;
    let mut step = 0.2;
    while step > 0.01 {
        let (u, v) = perpendicular(&best.0);
        let tries =
            [u, -u, v, -v].map(|aside| along(&outermost, Unit::new_normalize(best.0.into_inner() + aside * step)));
        let nearest = smallest(tries)?;
        if volume(&nearest.1) < volume(&best.1) * (1.0 - 1e-4) { best = nearest } else { step /= 2.0 }
    }
    let mut capsule = best.1;
    let outside = points.iter().map(|point| capsule.distance_to_point(point)).fold(0.0, f64::max);
    capsule.radius += outside + MARGIN_M;
    Some(capsule)
}

/// Volume of a capsule in m³.
pub fn volume(capsule: &Capsule) -> f64 {
    let (radius, length) = (capsule.radius, (capsule.to - capsule.from).norm());
    std::f64::consts::PI * radius * radius * (length + 4.0 / 3.0 * radius)
}

/// Triangles, and a capsule around them.
struct Part {
    triangles: Vec<[Point3<f64>; 3]>,
    capsule: Capsule,
}

impl Part {
    fn of(triangles: Vec<[Point3<f64>; 3]>) -> Option<Self> {
        let capsule = enclosing_capsule(triangles.as_flattened())?;
        Some(Self { triangles, capsule })
    }

    /// The two parts on both sides of a plane across a principal axis that have the smallest capsules.
    fn best_halves(&self) -> Option<(Self, Self)> {
        let middle = |triangle: &[Point3<f64>; 3]| (triangle[0].coords + triangle[1].coords + triangle[2].coords) / 3.0;
        let centre = centroid(self.triangles.as_flattened())?;
        let axes = principal_axes(self.triangles.as_flattened(), &centre);
        let cuts = axes.iter().flat_map(|axis| CUTS.map(|cut| (*axis, cut)));
        let halves = cuts.filter_map(|(axis, cut)| {
            let along = |triangle: &[Point3<f64>; 3]| axis.dot(&middle(triangle));
            let (low, high) = self
                .triangles
                .iter()
                .map(along)
                .fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(it), high.max(it)));
            let plane = low + (high - low) * cut;
            let (below, above): (Vec<_>, Vec<_>) = self.triangles.iter().partition(|it| along(it) < plane);
            let size = |triangles: &[[Point3<f64>; 3]]| rough(triangles.as_flattened()).map(|it| volume(&it));
            Some((size(&below)? + size(&above)?, below, above))
        });
        let (_, below, above) = halves.min_by(|one, other| one.0.total_cmp(&other.0))?;
        Some((Self::of(below)?, Self::of(above)?))
    }
}

/// The capsule of least volume, with its axis.
fn smallest<const N: usize>(all: [(Unit<Vector3<f64>>, Capsule); N]) -> Option<(Unit<Vector3<f64>>, Capsule)> {
    all.into_iter().min_by(|one, other| volume(&one.1).total_cmp(&volume(&other.1)))
}

/// A capsule along the best of the first directions; its volume tells which of two partitions is the better
/// one.
fn rough(points: &[Point3<f64>]) -> Option<Capsule> {
    let some = few(points, FEW_DIRECTIONS);
    smallest(starts(&some, &centroid(&some)?).map(|axis| along(&some, axis))).map(|(_, capsule)| capsule)
}

fn starts(points: &[Point3<f64>], centre: &Point3<f64>) -> [Unit<Vector3<f64>>; 6] {
    let [a, b, c] = principal_axes(points, centre);
    [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis(), a, b, c]
}

fn principal_axes(points: &[Point3<f64>], centre: &Point3<f64>) -> [Unit<Vector3<f64>>; 3] {
    let covariance: Matrix3<f64> = points.iter().map(|point| (point - centre) * (point - centre).transpose()).sum();
    let vectors = covariance.symmetric_eigen().eigenvectors;
    [0, 1, 2].map(|i| Unit::new_normalize(vectors.column(i).into_owned()))
}

fn centroid(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    (!points.is_empty()).then(|| Point3::from(sum / points.len() as f64))
}

/// The outermost points, each once, or all where there are few.
fn few(points: &[Point3<f64>], directions: usize) -> Vec<Point3<f64>> {
    if points.len() <= directions {
        return points.to_vec();
    }
    let mut chosen: Vec<usize> = outermost(points, directions).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|i| points[i]).collect()
}

/// So many directions, evenly spread over the sphere (a Fibonacci lattice).
pub(crate) fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (sin, cos) = libm::sincos(golden * i as f64);
        Vector3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vector3::z() * z
    })
}

/// Indices of the points that lie farthest in so many directions. A point may be the farthest in several.
fn outermost(points: &[Point3<f64>], count: usize) -> impl Iterator<Item = usize> {
    directions(count).filter_map(|direction| {
        let along = |i: &usize| direction.dot(&points[*i].coords);
        (0..points.len()).max_by(|a, b| along(a).total_cmp(&along(b)))
    })
}

fn perpendicular(axis: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let reference = if axis.z.abs() > 0.9 { Vector3::x() } else { Vector3::z() };
    let u = axis.cross(&reference).normalize();
    (u, axis.cross(&u))
}

/// The capsule along `axis` that holds all points, as short as the radius of its circle allows, or a little
/// wider and shorter.
fn along(points: &[Point3<f64>], axis: Unit<Vector3<f64>>) -> (Unit<Vector3<f64>>, Capsule) {
    let (u, v) = perpendicular(&axis);
    let across: Vec<Vector2<f64>> =
        points.iter().map(|it| Vector2::new(u.dot(&it.coords), v.dot(&it.coords))).collect();
    let (centre, least) = circle(&across);
    let with_radius = |radius: f64| {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for (point, across) in points.iter().zip(&across) {
            let cap = (radius * radius - (across - centre).norm_squared()).max(0.0).sqrt();
            let s = axis.dot(&point.coords);
            (from, to) = (from.min(s + cap), to.max(s - cap));
        }
        if from > to {
            (from, to) = (f64::midpoint(from, to), f64::midpoint(from, to));
        }
        let at = |s: f64| Point3::from(u * centre.x + v * centre.y + axis.into_inner() * s);
        Capsule { from: at(from), to: at(to), radius }
    };
    let capsules = [1.0, 1.05, 1.1, 1.2, 1.3].map(|factor| with_radius((least * factor).max(1e-3)));
    smallest(capsules.map(|it| (axis, it))).unwrap_or_else(|| (axis, with_radius(least.max(1e-3))))
}

/// A small circle around points: centre and radius. Steps towards the farthest point, ever shorter, approach
/// the smallest circle (Badoiu & Clarkson, Smaller core-sets for balls, 2003).
fn circle(points: &[Vector2<f64>]) -> (Vector2<f64>, f64) {
    let farthest = |centre: &Vector2<f64>| {
        let distances = points.iter().map(|point| ((point - centre).norm(), *point));
        distances.max_by(|one, other| one.0.total_cmp(&other.0)).unwrap_or((0.0, *centre))
    };
    let low = points.iter().fold(Vector2::repeat(f64::MAX), |low, point| low.inf(point));
    let high = points.iter().fold(Vector2::repeat(f64::MIN), |high, point| high.sup(point));
    let mut centre = if points.is_empty() { Vector2::zeros() } else { (low + high) / 2.0 };
    let mut best = (centre, farthest(&centre).0);
    for i in 0..60 {
        let (distance, point) = farthest(&centre);
        if distance < best.1 {
            best = (centre, distance);
        }
        centre += (point - centre) / f64::from(i + 3);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn holds(capsules: &[Capsule], surface: &TriangleMesh) -> bool {
        surface.all_corners().all(|corners| {
            capsules.iter().any(|capsule| corners.iter().all(|corner| capsule.distance_to_point(corner) <= 0.0))
        })
    }

    #[test]
    fn a_capsule_is_found_again() {
        let capsule = Capsule { from: Point3::new(0.1, 0.0, 0.2), to: Point3::new(0.3, 0.2, -0.1), radius: 0.07 };
        let surface = TriangleMesh::capsule(&capsule, 32);
        let found = enclosing_capsules(&surface);
        assert!(holds(&found, &surface) && found.len() == 1);
        assert!(volume(&found[0]) < 1.05 * volume(&capsule), "{found:?}");
    }

    #[test]
    fn an_angled_link_gets_several() {
        let leg = |to| TriangleMesh::capsule(&Capsule { from: Point3::origin(), to, radius: 0.05 }, 32);
        let mut surface = leg(Point3::new(0.4, 0.0, 0.0));
        surface.merge(&leg(Point3::new(0.0, 0.0, 0.4)));
        let found = enclosing_capsules(&surface);
        assert!(holds(&found, &surface) && found.len() >= 2, "{found:?}");
        let one = enclosing_capsule(&surface.vertices).unwrap();
        assert!(found.iter().map(volume).sum::<f64>() < 0.6 * volume(&one));
    }

    proptest! {
        #[test]
        fn every_triangle_is_inside_a_capsule(
            points in prop::collection::vec(prop::array::uniform3(-0.5f64..0.5), 3..200), flat in any::<bool>(),
        ) {
            let vertices: Vec<Point3<f64>> =
                points.iter().map(|&[x, y, z]| Point3::new(x, y, if flat { 0.0 } else { z })).collect();
            let triangles = (0..vertices.len() as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
            let surface = TriangleMesh { vertices, triangles };
            let found = enclosing_capsules(&surface);
            prop_assert!(holds(&found, &surface));
            prop_assert!(!found.is_empty() && found.len() <= MOST_CAPSULES);
        }
    }

    #[test]
    fn single_points_and_nothing_are_no_trouble() {
        let point = Point3::new(0.1, 0.2, 0.3);
        assert!(enclosing_capsule(&[point; 3]).unwrap().distance_to_point(&point) <= 0.0);
        assert!(enclosing_capsule(&[]).is_none());
        assert!(enclosing_capsules(&TriangleMesh::default()).is_empty());
    }
}
