//! Mesh repair: from triangles as files have them to the closed surface of a solid.
//!
//! Only what is safe is repaired, and each repair is told; what is left open is located.

mod edges;
mod hole_filling;
mod shells;

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use catch_body::{InputError, TriangleMesh};
use edges::{Edges, Side};
use shells::{drop_small, drop_specks, face_outwards, overlapping};

/// Vertices this close are one, as fractions of the longest side; the first with which the surface is closed.
const WELDING: [f64; 3] = [0.0, 1e-5, 2e-4];
/// A shell smaller than this fraction of the longest side, and open, is a speck.
const SPECK: f64 = 0.02;
/// The thinnest solid: its volume as a fraction of the cube of its longest side.
const LEAST_FILLING: f64 = 1e-6;

/// What a file should have, and what helps where it has something else.
const SOLID: &str = "the closed surface of a solid";
const FILLED: &str = "the closed surface of a solid; `--fill-holes METRES` fills wider holes";
const UNITED: &str = "one closed surface that faces outwards, without walls inside: unite the parts before (Blender's \
                      Boolean modifier, `trimesh.boolean.union`)";

/// Repairs the surface of `file`: the closed surface of a solid, its triangles facing outwards, and a
/// sentence for each kind of repair, in the order in which they were made. Holes up to `largest_hole_m` are
/// filled.
///
/// # Errors
/// The defect that cannot be repaired, located.
pub fn repaired(
    file: &str,
    soup: &TriangleMesh,
    largest_hole_m: f64,
) -> Result<(TriangleMesh, Vec<String>), InputError> {
    let fault = |found: String, expected: &str| Err(InputError::new(file, "the surface", found, expected));
    let size_m = soup.aabb().size.max();
    let (open, Welded { mut mesh, mut repairs }) = Welded::least_open(soup, size_m);
    if mesh.triangles.is_empty() {
        return fault("no triangles".into(), SOLID);
    }

    let (mut shell_of, turned) = orient(&mut mesh.triangles);
    told(&mut repairs, "triangles turned to face as their neighbours do", turned);
    let mut dropped = 0;
    if open > 0 {
        dropped = drop_specks(&mut mesh, &shell_of, SPECK * size_m);
        let filled = hole_filling::fill(&mut mesh, largest_hole_m);
        if filled.holes > 0 {
            repairs.push(format!("holes filled: {}, the widest {:.1} mm", filled.holes, filled.widest_m * 1e3));
        }
        if let Some((centre, width_m)) = filled.widest_left {
            let others =
                if filled.left > 1 { format!("{} wide holes, the widest of", filled.left) } else { "a hole of".into() };
            return fault(format!("{others} {:.1} mm around {}", width_m * 1e3, in_mm(&centre)), FILLED);
        }
        shell_of = orient(&mut mesh.triangles).0;
    }
    let (shells_turned, within) = face_outwards(&mut mesh, &shell_of);
    let open: Vec<(u32, u32)> = unbalanced(&mesh.triangles);
    if let Some(&(a, b)) = open.first() {
        let at = in_mm(&nalgebra::center(&mesh.vertices[a as usize], &mesh.vertices[b as usize]));
        return fault(format!("{} edges where surfaces meet that bound no solid, one at {at}", open.len()), UNITED);
    }
    told(&mut repairs, "shells turned, which were inside out", shells_turned);
    told(&mut repairs, "shells left out, within another one or specks", dropped + within);
    if within > 0 {
        shell_of = orient(&mut mesh.triangles).0;
    }
    let overlapping = overlapping(&mesh, &shell_of);
    told(
        &mut repairs,
        "shells whose boxes overlap: a common volume would count twice (unite them before)",
        overlapping,
    );
    mesh.drop_unused_vertices();
    let volume_m3 = mesh.volume();
    if volume_m3.is_finite() && volume_m3 > LEAST_FILLING * size_m.powi(3) {
        Ok((mesh, repairs))
    } else {
        fault("a surface without a volume".into(), SOLID)
    }
}

/// Adds a repair that was made `count` times, if it was made at all.
fn told(repairs: &mut Vec<String>, repair: &str, count: usize) {
    if count > 0 {
        repairs.push(format!("{repair}: {count}"));
    }
}

fn in_mm(p: &Point3<f64>) -> String {
    format!("[{:.1}, {:.1}, {:.1}] mm", p.x * 1e3, p.y * 1e3, p.z * 1e3)
}

/// Leaves out the shells of a surface whose volume is less than this fraction of the largest one's; how many.
pub fn without_specks(mesh: &mut TriangleMesh, least_fraction: f64) -> usize {
    let (shell_of, _) = orient(&mut mesh.triangles);
    let dropped = drop_small(mesh, &shell_of, least_fraction);
    mesh.drop_unused_vertices();
    dropped
}

/// A surface whose vertices are welded, and how it was.
#[derive(Default)]
struct Welded {
    mesh: TriangleMesh,
    repairs: Vec<String>,
}

impl Welded {
    /// Welds with the least tolerance that leaves fewest sides open; how many those are.
    fn least_open(soup: &TriangleMesh, size_m: f64) -> (usize, Self) {
        let mut best: Option<(usize, Self)> = None;
        let mut distinct = 0;
        for fraction in WELDING {
            let welded = Self::new(soup, fraction * size_m, distinct);
            distinct = distinct.max(welded.mesh.vertices.len());
            let open = Edges::of(&welded.mesh.triangles).open().count();
            if best.as_ref().is_none_or(|(least, _)| open < *least) {
                best = Some((open, welded));
            }
            if open == 0 {
                break;
            }
        }
        best.unwrap_or_default()
    }

    /// Welds vertices that lie within a tolerance; the file has `distinct` different ones, zero if that is
    /// not known yet.
    fn new(soup: &TriangleMesh, tolerance_m: f64, distinct: usize) -> Self {
        let (of_vertex, vertices) = places(&soup.vertices, tolerance_m);
        let merged = distinct.saturating_sub(vertices.len());
        let corners = soup.triangles.iter().map(|triangle| triangle.map(|vertex| of_vertex[vertex as usize]));
        let triangles = without_doubles(corners.collect());
        let mut repairs = Vec::new();
        let within = format!("vertices welded, each within {:.4} mm of another one", tolerance_m * 1e3);
        told(&mut repairs, &within, merged);
        let dropped = soup.triangles.len() - triangles.len();
        told(&mut repairs, "triangles left out, without area or there twice", dropped);
        Self { mesh: TriangleMesh { vertices, triangles }, repairs }
    }
}

/// Index of each point's place, and the places: points within `tolerance_m` of an earlier place are there.
fn places(points: &[Point3<f64>], tolerance_m: f64) -> (Vec<u32>, Vec<Point3<f64>>) {
    // Along a direction that is no edge of anything few points lie side by side.
    let along = Vector3::new(0.374_1, 0.541_3, 0.752_9);
    let mut order: Vec<(f64, u32)> = points.iter().zip(0..).map(|(it, i)| (it.coords.dot(&along), i)).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut first_at = vec![u32::MAX; points.len()];
    for (k, &(at, i)) in order.iter().enumerate() {
        if first_at[i as usize] != u32::MAX {
            continue;
        }
        first_at[i as usize] = i;
        let near = order[k + 1..].iter().take_while(|(other, _)| other - at <= tolerance_m);
        for &(_, j) in near {
            let is_free = first_at[j as usize] == u32::MAX;
            if is_free && (points[j as usize] - points[i as usize]).norm_squared() <= tolerance_m * tolerance_m {
                first_at[j as usize] = i;
            }
        }
    }
    let (mut number, mut kept) = (vec![u32::MAX; points.len()], Vec::new());
    let of_point = first_at.iter().map(|&first| {
        let place = &mut number[first as usize];
        if *place == u32::MAX {
            *place = kept.len() as u32;
            kept.push(points[first as usize]);
        }
        *place
    });
    (of_point.collect(), kept)
}

/// Triangles with three corners, each once; a surface that is there from both sides everywhere is kept from
/// one.
fn without_doubles(mut triangles: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    // For each three corners how many triangles have them in each of both directions, and the first of these.
    let mut sheets: HashMap<[u32; 3], [(u32, usize); 2]> = HashMap::new();
    for (i, triangle) in triangles.iter().enumerate() {
        let mut corners = *triangle;
        corners.sort_unstable();
        let at = triangle.iter().position(|it| *it == corners[0]).unwrap_or(0);
        let direction = usize::from(triangle[(at + 1) % 3] != corners[1]);
        let (count, first) = &mut sheets.entry(corners).or_default()[direction];
        *first = if *count == 0 { i } else { *first };
        *count += 1;
    }
    let is_balanced = |[one, other]: &[(u32, usize); 2]| one.0 == other.0;
    let is_double = sheets.values().all(is_balanced);
    let kept = sheets.values().filter(|it| is_double || !is_balanced(it));
    let mut kept: Vec<usize> = kept.map(|[one, other]| if one.0 >= other.0 { one.1 } else { other.1 }).collect();
    kept.sort_unstable();
    kept.into_iter().map(|i| triangles[i]).collect()
}

/// Edges along which more triangles run in one direction than in the other.
fn unbalanced(triangles: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let runs_up = |side: u32, low: u32| triangles[side as usize / 3][side as usize % 3] == low;
    let is_unbalanced =
        |group: &&[Side]| 2 * group.iter().filter(|(low, _, side)| runs_up(*side, *low)).count() != group.len();
    Edges::of(triangles).groups().filter(is_unbalanced).map(|it| (it[0].0, it[0].1)).collect()
}

/// Flips triangles so that neighbours face the same way. Returns the number of each one's shell, and how many
/// were flipped.
///
/// Neighbours share an edge that no third triangle has. Of each shell the smaller part is turned.
fn orient(triangles: &mut [[u32; 3]]) -> (Vec<u32>, usize) {
    const NONE: u32 = u32::MAX;
    let mut neighbour = vec![NONE; 3 * triangles.len()];
    for group in Edges::of(triangles).groups() {
        if let [(_, _, one), (_, _, other)] = *group {
            neighbour[one as usize] = other;
            neighbour[other as usize] = one;
        }
    }
    let start_of = |triangles: &[[u32; 3]], side: u32| triangles[side as usize / 3][side as usize % 3];
    let (mut shell_of, mut is_turned) = (vec![NONE; triangles.len()], vec![false; triangles.len()]);
    let (mut shells, mut turned) = (0, 0);
    for first in 0..triangles.len() {
        if shell_of[first] != NONE {
            continue;
        }
        let mut members = vec![first];
        shell_of[first] = shells;
        let mut next = 0;
        while let Some(&triangle) = members.get(next) {
            next += 1;
            for side in 3 * triangle as u32..3 * triangle as u32 + 3 {
                let other = neighbour[side as usize];
                if other == NONE || shell_of[other as usize / 3] != NONE {
                    continue;
                }
                let same_direction = start_of(triangles, side) == start_of(triangles, other);
                let other_triangle = other as usize / 3;
                shell_of[other_triangle] = shells;
                is_turned[other_triangle] = is_turned[triangle] != same_direction;
                members.push(other_triangle);
            }
        }
        let count = members.iter().filter(|it| is_turned[**it]).count();
        let turn = 2 * count <= members.len();
        for triangle in members.iter().copied().filter(|it| is_turned[*it] == turn) {
            triangles[triangle].swap(1, 2);
        }
        turned += count.min(members.len() - count);
        shells += 1;
    }
    (shell_of, turned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::shape::Cuboid;

    fn repaired(mesh: &TriangleMesh) -> Result<(TriangleMesh, Vec<String>), String> {
        super::repaired("a.obj", mesh, 0.02).map_err(|it| it.to_string())
    }

    fn cube(size_m: f64) -> TriangleMesh {
        TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size: Vector3::repeat(size_m) })
    }

    /// A soup of triangles, each with corners of its own, moved by up to `noise_m`.
    fn soup(mesh: &TriangleMesh, noise_m: f64) -> TriangleMesh {
        let mut soup = TriangleMesh::default();
        for (i, corners) in mesh.all_corners().enumerate() {
            let vertices = corners.map(|it| it + Vector3::repeat(noise_m * ((i % 3) as f64 - 1.0))).to_vec();
            soup.merge(&TriangleMesh { vertices, triangles: vec![[0, 1, 2]] });
        }
        soup
    }

    #[test]
    fn a_clean_solid_needs_no_repair() {
        let sphere = TriangleMesh::sphere(0.05, 3);
        let (mesh, repairs) = repaired(&sphere).unwrap();
        assert_eq!((mesh.volume(), repairs), (sphere.volume(), vec![]));
    }

    #[test]
    fn seams_are_welded_and_triangles_turned() {
        let sphere = TriangleMesh::sphere(0.05, 3);
        let mut broken = soup(&sphere, 1e-7);
        broken.triangles.iter_mut().step_by(7).for_each(|it| it.swap(0, 1));
        broken.triangles.push(broken.triangles[5]);
        let (mesh, repairs) = repaired(&broken).unwrap();
        assert!(mesh.is_closed() && (mesh.volume() / sphere.volume() - 1.0).abs() < 1e-4);
        let kinds = [
            "vertices welded, each within 0.0010 mm of another one: ",
            "triangles left out, without area or there twice: 1",
            "triangles turned to face as their neighbours do: ",
        ];
        assert_eq!(repairs.len(), kinds.len());
        assert!(repairs.iter().zip(kinds).all(|(it, kind)| it.starts_with(kind)), "{repairs:?}");
    }

    #[test]
    fn small_holes_are_filled_and_wide_ones_located() {
        let sphere = TriangleMesh::sphere(0.05, 4);
        let without = |z: f64| {
            let keeps = |it: &&[u32; 3]| it.iter().any(|vertex| sphere.vertices[*vertex as usize].z < z);
            TriangleMesh { triangles: sphere.triangles.iter().filter(keeps).copied().collect(), ..sphere.clone() }
        };
        let (mesh, repairs) = repaired(&without(0.0495)).unwrap();
        assert!(mesh.is_closed() && (mesh.volume() / sphere.volume() - 1.0).abs() < 0.01);
        assert!(repairs.len() == 1 && repairs[0].starts_with("holes filled: 1, the widest "), "{repairs:?}");
        let defect = repaired(&without(0.03)).unwrap_err();
        let (hole, centre) = defect.split_once(" mm around [").unwrap();
        let width_mm: f64 = hole.strip_prefix("a.obj: the surface: found a hole of ").unwrap().parse().unwrap();
        let centre = centre.split_once(']').unwrap().0.split(", ").map(|it| it.parse().unwrap());
        let centre_mm = Point3::from_slice(&centre.collect::<Vec<f64>>());
        assert!((centre_mm - Point3::new(0.0, 0.0, 30.0)).norm() < 4.0 && (60.0..80.0).contains(&width_mm), "{defect}");
    }

    #[test]
    fn cavities_stay_and_what_is_inside_goes() {
        let mut hollow = cube(0.1);
        let mut within = cube(0.05);
        hollow.merge(&within);
        let (mesh, repairs) = repaired(&hollow).unwrap();
        assert_eq!(
            (mesh.triangles.len(), &repairs[..]),
            (12, &["shells left out, within another one or specks: 1".to_owned()][..])
        );
        within.triangles.iter_mut().for_each(|it| it.swap(0, 1));
        let mut hollow = cube(0.1);
        hollow.merge(&within);
        let (mesh, repairs) = repaired(&hollow).unwrap();
        assert!((mesh.volume() - (1e-3 - 1.25e-4)).abs() < 1e-12 && repairs.is_empty());
        // A part that sticks out is a part, and what it shares with the other is told; one beside it shares
        // nothing.
        for (to, crossing) in [
            ([0.04, 0.0, 0.0], 1),
            ([0.09, 0.03, 0.0], 0),
            ([0.075, 0.0, 0.01], 0),
            ([0.03, 0.03, 0.03], 1),
            ([0.02, 0.06, 0.0], 1),
        ] {
            let mut apart = cube(0.1);
            apart.merge(&cube(0.05).translated(&Vector3::from(to)));
            let (mesh, repairs) = repaired(&apart).unwrap();
            assert_eq!((mesh.triangles.len(), repairs.len()), (24, crossing), "{to:?}");
            let said = "shells whose boxes overlap: a common volume would count twice (unite them before): 2";
            assert!(repairs.iter().all(|it| it == said), "{repairs:?}");
        }
    }

    #[test]
    fn specks_go_and_other_shells_stay() {
        let mut mesh = cube(0.1);
        for (size_m, x) in [(0.05, 0.2), (0.01, 0.3), (0.005, -0.2)] {
            mesh.merge(&cube(size_m).translated(&Vector3::new(x, 0.0, 0.0)));
        }
        assert_eq!(without_specks(&mut mesh, 0.05), 2);
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (16, 24));
    }

    #[test]
    fn what_is_no_solid_is_told() {
        let mut fin = cube(0.1);
        let tip = fin.vertices.len() as u32;
        fin.vertices.push(Point3::new(0.0, 0.0, 0.3));
        let [a, b, _] = fin.triangles[0];
        fin.triangles.push([a, b, tip]);
        for (mesh, expected) in [
            (TriangleMesh::default(), "no triangles"),
            (TriangleMesh { triangles: cube(0.1).triangles[..2].to_vec(), ..cube(0.1) }, "a hole of"),
        ] {
            let defect = repaired(&mesh).unwrap_err();
            assert!(defect.contains(expected), "{defect}");
        }
        assert!(super::repaired("a.obj", &fin, 0.0).is_err());
        // Of two cubes with a face in common one is inside out: no hole is there to be filled.
        let mut beside = cube(0.1).translated(&Vector3::x().scale(0.1));
        beside.triangles.iter_mut().for_each(|it| it.swap(0, 1));
        beside.merge(&cube(0.1));
        let defect = repaired(&beside).unwrap_err();
        assert!(defect.contains("found 4 edges") && defect.contains("unite the parts"), "{defect}");
    }
}
