//! Shells, the connected pieces of a surface: which are specks, inside out, or within another one.

use std::{collections::HashSet, f64::consts::PI};

use nalgebra::{Point3, Vector3};

use super::edges::Edges;
use catch_body::TriangleMesh;

/// Shells are compared with each other up to this number.
const MOST_SHELLS: usize = 256;
/// Number of a shell's triangles that are tested for whether the shell is within another one.
const TRIED: usize = 32;
/// Pairs of a triangle and a place that are looked at for each two shells.
const MOST_PAIRS: usize = 300_000;
/// Number of such pairs for all shells that may be within another one.
const MOST_WORK: usize = 400_000_000;

/// Leaves out shells that are open and smaller than `size_m`; how many.
pub(super) fn drop_specks(mesh: &mut TriangleMesh, shell_of: Vec<u32>, size_m: f64) -> usize {
    let edges = Edges::of(&mesh.triangles);
    let mut specks: HashSet<u32> =
        edges.groups().filter(|it| it.len() == 1).map(|it| shell_of[it[0].2 as usize / 3]).collect();
    let shells = Shell::all(mesh, &shell_of);
    specks.retain(|it| (shells[*it as usize].high - shells[*it as usize].low).max() < size_m);
    leave_out(mesh, shell_of, &specks)
}

/// Leaves out shells with less volume than this fraction of the largest one's; how many.
pub(super) fn drop_small(mesh: &mut TriangleMesh, shell_of: Vec<u32>, least_fraction: f64) -> usize {
    let shells = Shell::all(mesh, &shell_of);
    let most_m3 = shells.iter().map(|it| it.volume_m3.abs()).fold(0.0, f64::max);
    let is_small = |it: &(u32, &Shell)| it.1.volume_m3.abs() < least_fraction * most_m3;
    let small = (0..).zip(&shells).filter(is_small).map(|it| it.0).collect();
    leave_out(mesh, shell_of, &small)
}

fn leave_out(mesh: &mut TriangleMesh, shell_of: Vec<u32>, shells: &HashSet<u32>) -> usize {
    let mut numbers = shell_of.into_iter();
    mesh.triangles.retain(|_| numbers.next().is_none_or(|shell| !shells.contains(&shell)));
    shells.len()
}

/// Turns shells outwards and leaves out those inside another one; cavities face inwards and stay. How many of
/// each.
pub(super) fn face_outwards(mesh: &mut TriangleMesh, shell_of: &[u32]) -> (usize, usize) {
    let is_inside_out = mesh.volume() < 0.0;
    if is_inside_out {
        mesh.triangles.iter_mut().for_each(|it| it.swap(1, 2));
    }
    let shells = Shell::all(mesh, shell_of);
    let count = shells.len();
    let turned = if is_inside_out { count } else { 0 };
    if !(2..=MOST_SHELLS).contains(&count) {
        return (turned, 0);
    }
    let (mut turn, mut drop) = (vec![false; count], vec![false; count]);
    let tried = (MOST_WORK / (count * mesh.triangles.len())).clamp(1, TRIED);
    for (number, own) in shells.iter().enumerate() {
        let around: Vec<bool> = (0..count).map(|it| it != number && shells[it].may_hold(own)).collect();
        if !around.contains(&true) {
            turn[number] = own.volume_m3 < 0.0;
            continue;
        }
        let others = || shells.iter().zip(&around).filter(|(_, is_around)| **is_around).flat_map(|it| &it.0.triangles);
        let turns = |at: &Point3<f64>| others().map(|it| solid_angle(at, it)).sum::<f64>() / (4.0 * PI);
        let mut tested = own.triangles.iter().step_by(own.triangles.len().div_ceil(tried));
        let is_within = tested.all(|[a, b, c]| turns(&Point3::from((a.coords + b.coords + c.coords) / 3.0)) > 0.5);
        turn[number] = own.volume_m3 < 0.0 && !is_within;
        drop[number] = own.volume_m3 >= 0.0 && is_within;
    }
    for (triangle, shell) in mesh.triangles.iter_mut().zip(shell_of) {
        if turn[*shell as usize] {
            triangle.swap(1, 2);
        }
    }
    let mut numbers = shell_of.iter();
    mesh.triangles.retain(|_| numbers.next().is_none_or(|shell| !drop[*shell as usize]));
    (turned + turn.iter().filter(|it| **it).count(), drop.iter().filter(|it| **it).count())
}

/// Number of shells that cross another one, so that they have a volume in common which counts twice.
pub(super) fn crossing(mesh: &TriangleMesh, shell_of: &[u32]) -> usize {
    let shells = Shell::all(mesh, shell_of);
    let count = shells.len();
    if !(2..=MOST_SHELLS).contains(&count) {
        return 0;
    }
    let mut crosses = vec![false; count];
    for one in 0..count {
        for other in one + 1..count {
            // Cavities are within another shell, and what was left out has no triangle.
            let are_solid = shells[one].volume_m3 > 0.0 && shells[other].volume_m3 > 0.0;
            if are_solid && shells[one].meets(&shells[other]) {
                let pairs = [(one, other), (other, one)];
                if pairs.iter().any(|&(a, b)| enters(&shells[a].triangles, &shells[b])) {
                    (crosses[one], crosses[other]) = (true, true);
                }
            }
        }
    }
    crosses.iter().filter(|it| **it).count()
}

/// Returns whether a surface enters a closed one: a triangle's middle is inside, or an edge goes through a
/// triangle.
fn enters(surface: &[[Point3<f64>; 3]], of_closed: &Shell) -> bool {
    let closed = &of_closed.triangles;
    let is_near = |it: &&[Point3<f64>; 3]| {
        let mut own = Shell::default();
        own.add(**it);
        own.meets(of_closed)
    };
    let near: Vec<&[Point3<f64>; 3]> = surface.iter().filter(is_near).collect();
    let tried = (MOST_PAIRS / closed.len().max(1)).max(1);
    let sampled = || near.iter().step_by(near.len().div_ceil(tried).max(1));
    sampled().any(|corners| {
        // A little inside of its own shell, as faces of two shells may lie on each other.
        let [a, b, c] = corners;
        let inwards = (c - a).cross(&(b - a)).try_normalize(0.0).unwrap_or_default();
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0) + inwards * (1e-6 * (b - a).norm());
        let inside = closed.iter().map(|it| solid_angle(&middle, it)).sum::<f64>() / (4.0 * PI);
        let edges = [[0, 1], [1, 2], [2, 0]];
        inside > 0.75 || edges.iter().any(|&[i, j]| closed.iter().any(|it| pierces([corners[i], corners[j]], it)))
    })
}

/// Returns whether a segment goes through the inside of a triangle.
fn pierces([p, q]: [Point3<f64>; 2], [a, b, c]: &[Point3<f64>; 3]) -> bool {
    let volume =
        |a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>, d: &Point3<f64>| (a - d).dot(&(b - d).cross(&(c - d)));
    let least = 1e-9 * (q - p).norm() * (b - a).norm() * (c - a).norm();
    let ends = [volume(a, b, c, &p), volume(a, b, c, &q)];
    let sides = [volume(a, b, &p, &q), volume(b, c, &p, &q), volume(c, a, &p, &q)];
    ends[0] * ends[1] < 0.0
        && ends.iter().all(|it| it.abs() > least)
        && (sides.iter().all(|it| *it > least) || sides.iter().all(|it| *it < -least))
}

/// Triangles, bounding box and volume of a shell.
#[derive(Debug, Clone)]
struct Shell {
    triangles: Vec<[Point3<f64>; 3]>,
    low: Point3<f64>,
    high: Point3<f64>,
    volume_m3: f64,
}

impl Default for Shell {
    fn default() -> Self {
        let far = Point3::from(Vector3::repeat(f64::INFINITY));
        Self { triangles: Vec::new(), low: far, high: -far, volume_m3: 0.0 }
    }
}

impl Shell {
    /// The shells of a surface by their numbers.
    fn all(mesh: &TriangleMesh, shell_of: &[u32]) -> Vec<Self> {
        let count = shell_of.iter().max().map_or(0, |last| *last as usize + 1);
        let mut shells = vec![Self::default(); count];
        for (corners, number) in mesh.all_corners().zip(shell_of) {
            shells[*number as usize].add(corners);
        }
        shells
    }

    fn add(&mut self, corners: [Point3<f64>; 3]) {
        let [a, b, c] = corners.map(|it| it.coords);
        self.triangles.push(corners);
        for corner in &corners {
            (self.low, self.high) = (self.low.inf(corner), self.high.sup(corner));
        }
        self.volume_m3 += a.dot(&b.cross(&c)) / 6.0;
    }

    /// Returns whether the boxes around this shell and another one have a place in common.
    fn meets(&self, other: &Self) -> bool {
        self.low <= other.high && other.low <= self.high
    }

    /// Returns whether the box around this shell holds the one around another.
    fn may_hold(&self, other: &Self) -> bool {
        self.low <= other.low && other.high <= self.high
    }
}

/// Signed solid angle of a triangle as seen from `at`, positive where its back is seen (Van Oosterom &
/// Strackee, The solid angle of a plane triangle, 1983).
fn solid_angle(at: &Point3<f64>, corners: &[Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - at);
    let [l, m, n] = [a.norm(), b.norm(), c.norm()];
    let numerator = a.dot(&b.cross(&c));
    let denominator = l * m * n + a.dot(&b) * n + b.dot(&c) * l + c.dot(&a) * m;
    2.0 * libm::atan2(numerator, denominator)
}
