//! Shells, the connected pieces of a surface: which are specks, inside out, or within another one.

use std::{collections::HashSet, f64::consts::PI};

use nalgebra::{Point3, Vector3};

use super::edges::Edges;
use catch_body::TriangleMesh;

/// Shells are compared with each other up to this number.
const MOST_SHELLS: usize = 256;
/// Number of a shell's triangles that are tested for whether the shell is within another one.
const TRIED: usize = 32;
/// Pairs of a triangle and a place that are looked at for all shells that may be within another one.
const MOST_WORK: usize = 400_000_000;

/// Leaves out shells that are open and smaller than `size_m`; how many.
pub(super) fn drop_specks(mesh: &mut TriangleMesh, shell_of: &[u32], size_m: f64) -> usize {
    let edges = Edges::of(&mesh.triangles);
    let mut specks: HashSet<u32> =
        edges.groups().filter(|it| it.len() == 1).map(|it| shell_of[it[0].2 as usize / 3]).collect();
    let shells = Shell::all(mesh, shell_of);
    specks.retain(|it| (shells[*it as usize].high - shells[*it as usize].low).max() < size_m);
    leave_out(mesh, shell_of, &specks)
}

/// Leaves out shells with less volume than this fraction of the largest one's; how many.
pub(super) fn drop_small(mesh: &mut TriangleMesh, shell_of: &[u32], least_fraction: f64) -> usize {
    let shells = Shell::all(mesh, shell_of);
    let most_m3 = shells.iter().map(|it| it.volume_m3.abs()).fold(0.0, f64::max);
    let is_small = |it: &(u32, &Shell)| it.1.volume_m3.abs() < least_fraction * most_m3;
    let small = (0..).zip(&shells).filter(is_small).map(|it| it.0).collect();
    leave_out(mesh, shell_of, &small)
}

fn leave_out(mesh: &mut TriangleMesh, shell_of: &[u32], shells: &HashSet<u32>) -> usize {
    let mut numbers = shell_of.iter();
    mesh.triangles.retain(|_| numbers.next().is_none_or(|shell| !shells.contains(shell)));
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
    let (mut turn, mut drop) = (vec![false; count], HashSet::new());
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
        if own.volume_m3 >= 0.0 && is_within {
            drop.insert(number as u32);
        }
    }
    for (triangle, shell) in mesh.triangles.iter_mut().zip(shell_of) {
        if turn[*shell as usize] {
            triangle.swap(1, 2);
        }
    }
    (turned + turn.iter().filter(|it| **it).count(), leave_out(mesh, shell_of, &drop))
}

/// Number of solid shells, of the first [`MOST_SHELLS`], whose boxes overlap: what two of them hold counts
/// twice.
pub(super) fn overlapping(mesh: &TriangleMesh, shell_of: &[u32]) -> usize {
    let shells = Shell::all(mesh, shell_of);
    // Cavities are within another shell, and what was left out has no triangle.
    let solid: Vec<&Shell> = shells.iter().filter(|it| it.volume_m3 > 0.0).take(MOST_SHELLS).collect();
    let overlaps = |i: &usize| (0..solid.len()).any(|j| j != *i && solid[*i].overlaps(solid[j]));
    (0..solid.len()).filter(overlaps).count()
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

    /// Returns whether the boxes around this shell and another one have more than a face in common.
    fn overlaps(&self, other: &Self) -> bool {
        let margin = (self.high - self.low) * 1e-6;
        self.low + margin < other.high && other.low + margin < self.high
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
