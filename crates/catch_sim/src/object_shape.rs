//! Shapes of objects: from the few numbers of an object's file to its surface, its convex parts and its
//! inertia.

use std::ops::RangeInclusive;

use catch_body::{
    InputError, TriangleMesh,
    mesh::TubeRing,
    mesh_file::{groups_from_bytes, mesh_from_bytes},
    quantity,
    robot::Inertia,
};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::convex_parts::{convex_parts, hull_volume_m3};

/// Flat strips around a solid of revolution or a tube: at 32 a radius of 25 mm is 0.12 mm short between them.
const SEGMENTS: u32 = 32;
/// Number of times that the triangles of a ball are cut into four: at 4 its faces lie at most 0.03 mm inside
/// a tennis ball.
const BALL_SUBDIVISIONS: u32 = 4;

/// A convex piece of an object, in the object's frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ColliderPart {
    /// A ball.
    Ball {
        /// Centre of the ball.
        centre: Point3<f64>,
        /// Radius of the ball in metres.
        radius_m: f64,
    },
    /// The convex hull of points.
    Hull(Vec<Point3<f64>>),
}

impl ColliderPart {
    /// Moves the part.
    pub fn translated(self, offset: &Vector3<f64>) -> Self {
        match self {
            Self::Ball { centre, radius_m } => Self::Ball { centre: centre + offset, radius_m },
            Self::Hull(points) => Self::Hull(points.into_iter().map(|point| point + offset).collect()),
        }
    }

    /// Volume of the part in m³; zero for points that span none.
    pub fn volume_m3(&self) -> f64 {
        match self {
            Self::Ball { radius_m, .. } => 4.0 / 3.0 * std::f64::consts::PI * radius_m.powi(3),
            Self::Hull(points) => hull_volume_m3(points),
        }
    }
}

/// Shape of an object as its file describes it.
#[quantity::checked(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) enum ShapeFields {
    /// A ball, hollow (all mass in its skin) or solid.
    Ball {
        /// Diameter.
        diameter_m: quantity::shape_size_m,
        /// True if all mass is in the skin.
        hollow: bool,
    },
    /// Solid of revolution that a profile of points (z, r) sweeps around the z axis.
    Revolution {
        /// Points (z, r), from the bottom up.
        profile_m: quantity::shape_m<Vec<[f64; 2]>>,
    },
    /// A round tube along an arc in the y–z plane, its radii evenly spaced along it.
    BentTube {
        /// Radius of the arc.
        arc_radius_m: quantity::shape_size_m,
        /// Angle of the arc.
        arc_angle_deg: quantity::arc_deg,
        /// Radii of the tube.
        radii_m: quantity::shape_radius_m<Vec<f64>>,
    },
    /// A round tube along a curve in the y–z plane.
    Tube {
        /// Points (y, z, r): of the curve, and the radius there.
        curve_m: quantity::shape_m<Vec<[f64; 3]>>,
    },
    /// A mesh from a file beside this one. It collides as the groups of the `parts` files, the convex hull of
    /// each; without them it is cut into convex parts.
    Mesh {
        /// An OBJ or STL file, closed.
        file: String,
        /// Files whose groups are the convex parts.
        #[serde(default)]
        parts: Vec<String>,
        /// Length of the files' unit in metres.
        #[serde(default = "one")]
        scale: quantity::scale,
    },
}

fn one() -> f64 {
    1.0
}

/// Reads a file that another one names.
pub(crate) type Load<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, InputError>;

/// A shape worked out: surface, convex parts and inertia, all in the frame in which it was described.
pub(crate) struct Solid {
    pub mesh: TriangleMesh,
    pub parts: Vec<ColliderPart>,
    pub inertia: Inertia,
}

impl ShapeFields {
    /// Works the shape out at a mass. Density is uniform but for a hollow ball.
    pub fn solid(&self, file: &str, mass_kg: f64, load: Load) -> Result<Solid, InputError> {
        let (mesh, parts) = match self {
            Self::Ball { diameter_m, .. } => {
                let radius_m = *diameter_m / 2.0;
                let ball = ColliderPart::Ball { centre: Point3::origin(), radius_m };
                (TriangleMesh::sphere(radius_m, BALL_SUBDIVISIONS), vec![ball])
            }
            Self::Revolution { profile_m } => revolution(file, profile_m)?,
            Self::BentTube { arc_radius_m, arc_angle_deg, radii_m } => {
                tube(&bent_rings(file, *arc_radius_m, *arc_angle_deg, radii_m)?)
            }
            Self::Tube { curve_m } => tube(&curved_rings(file, curve_m)?),
            Self::Mesh { file: mesh_file, parts, scale } => {
                let mesh = mesh_from_bytes(mesh_file, &load(mesh_file)?, *scale)?;
                check_size(file, &mesh)?;
                let parts = if parts.is_empty() {
                    convex_parts(&mesh).into_iter().map(ColliderPart::Hull).collect()
                } else {
                    named_parts(parts, *scale, &mesh, load)?
                };
                (mesh, parts)
            }
        };
        check_size(file, &mesh)?;
        let mut inertia = mesh.mass_properties(mass_kg);
        if let Self::Ball { diameter_m, hollow } = self {
            // 2/3·m·r² for a spherical shell, 2/5·m·r² for a solid ball.
            let fraction = if *hollow { 2.0 / 3.0 } else { 2.0 / 5.0 };
            let radius_m = *diameter_m / 2.0;
            let about_com = Matrix3::identity() * (fraction * mass_kg * radius_m * radius_m);
            inertia = Inertia { mass: mass_kg, com: Point3::origin(), about_com };
        }
        Ok(Solid { mesh, parts, inertia })
    }
}

/// Surface and convex parts of a shape.
type Surface = (TriangleMesh, Vec<ColliderPart>);

/// Most convex parts of an object.
const MOST_PARTS: usize = 64;
/// Most points of a profile and radii of a tube.
const MOST_RINGS: usize = 65;
/// Two points of a profile at the same height are at least this far apart, and a radius that is not zero is
/// at least as long.
const LEAST_STEP_M: f64 = 1e-4;
/// The thinnest shape: its volume as a fraction of the cube of its longest side.
const LEAST_FILLING: f64 = 1e-6;
/// Largest distance by which parts may stick out of the box around their mesh, as a fraction of its longest
/// side.
const STICKS_OUT: f64 = 0.05;

/// Length of an object that can be thrown, in metres: other lengths come from a file in other units.
const LENGTHS_M: RangeInclusive<f64> = 0.005..=0.5;

/// Checks that a shape is as long as an object that can be thrown; `advice` is given to the user if it is in
/// millimetres.
///
/// # Errors
/// If the length is out of this range.
pub fn check_length(file: &str, field: &str, length_m: f64, advice: &str) -> Result<(), InputError> {
    if LENGTHS_M.contains(&length_m) {
        return Ok(());
    }
    let advice = if length_m > *LENGTHS_M.end() { format!("; {advice}") } else { String::new() };
    let expected = format!("{} m to {} m{advice}", LENGTHS_M.start(), LENGTHS_M.end());
    let digits = if length_m < 1e-3 { 6 } else { 3 };
    Err(InputError::new(file, field, format!("something {length_m:.digits$} m long"), expected))
}

/// Checks that a mesh has the size of something that is thrown, before its mass properties are worked out.
fn check_size(file: &str, mesh: &TriangleMesh) -> Result<(), InputError> {
    let (length_m, volume_m3) = (mesh.aabb().size.max(), mesh.volume());
    check_length(file, "truth.shape", length_m, "a mesh in millimetres needs `scale = 0.001`")?;
    if volume_m3 > LEAST_FILLING * length_m.powi(3) {
        return Ok(());
    }
    let found = format!("{length_m:.3} m long with a volume of {volume_m3:.1e} m³");
    Err(InputError::new(file, "truth.shape", found, "a solid that is thicker"))
}

/// The convex hulls of all groups of the `files`, which must lie where the mesh does.
fn named_parts(files: &[String], scale: f64, mesh: &TriangleMesh, load: Load) -> Result<Vec<ColliderPart>, InputError> {
    let bounds = mesh.aabb();
    let most = bounds.size / 2.0 + Vector3::repeat(STICKS_OUT * bounds.size.max());
    let mut parts = Vec::new();
    for file in files {
        for (i, points) in groups_from_bytes(file, &load(file)?, scale)?.into_iter().enumerate() {
            let outside = points
                .iter()
                .find(|point| (*point - bounds.centre).abs().zip_fold(&most, false, |is, at, most| is || at > most));
            if let Some(point) = outside {
                let found = format!("a vertex at [{:.3}, {:.3}, {:.3}] m", point.x, point.y, point.z);
                return Err(InputError::new(
                    file,
                    format!("group {}", i + 1),
                    found,
                    "parts that fill the mesh and no more",
                ));
            }
            let part = ColliderPart::Hull(points);
            if part.volume_m3() <= 0.0 {
                return Err(InputError::new(file, format!("group {}", i + 1), "a flat part", "one that has a volume"));
            }
            if parts.len() == MOST_PARTS {
                let expected = format!("at most {MOST_PARTS} convex parts");
                return Err(InputError::new(file, "groups", "more", expected));
            }
            parts.push(part);
        }
    }
    Ok(parts)
}

/// A list as an error repeats it.
fn list(values: &[impl std::fmt::Debug]) -> String {
    match values.len() {
        0..=10 => format!("{values:?}"),
        length => format!("{length} values, {:?} …", &values[..3]),
    }
}

fn revolution(file: &str, profile_m: &[[f64; 2]]) -> Result<Surface, InputError> {
    let rising = profile_m.windows(2).all(|pair| pair[0][0] + LEAST_STEP_M <= pair[1][0]);
    let thick = profile_m.iter().all(|[_, r]| *r == 0.0 || *r >= LEAST_STEP_M);
    let is_solid = rising && thick && profile_m.iter().any(|[_, r]| *r > 0.0);
    if !(2..=MOST_RINGS).contains(&profile_m.len()) || !is_solid {
        let expected = format!(
            "2 to {MOST_RINGS} points (z, r), z rising by {LEAST_STEP_M} m or more, r zero or from {LEAST_STEP_M} m on"
        );
        return Err(InputError::new(file, "truth.shape.profile_m", list(profile_m), expected));
    }
    // A profile that bends inwards is cut there, so that each part is convex.
    let mut parts = Vec::new();
    let mut start = 0;
    for i in 1..profile_m.len() {
        let is_last = i + 1 == profile_m.len();
        if is_last || bends_inwards(&profile_m[i - 1..=i + 1]) {
            parts.push(ColliderPart::Hull(with_square_ends(&profile_m[start..=i])));
            start = i;
        }
    }
    Ok((TriangleMesh::revolution(profile_m, SEGMENTS), parts))
}

/// Height of the middle of a flat end above its rim, in metres.
const END_BULGE_M: f64 = 3e-4;

/// Points of a solid of revolution whose flat ends are squares within the rim, which stands back a little. On
/// a face of 32 corners the collision library would choose others of them as contacts in every step, and what
/// is squeezed there would creep.
fn with_square_ends(profile_m: &[[f64; 2]]) -> Vec<Point3<f64>> {
    let mut rims = profile_m.to_vec();
    let last = rims.len() - 1;
    rims[0][0] += END_BULGE_M;
    rims[last][0] -= END_BULGE_M;
    let mut points = TriangleMesh::revolution(&rims, SEGMENTS).vertices;
    for [z, r] in [profile_m[0], profile_m[last]] {
        points.extend([[r, 0.0], [0.0, r], [-r, 0.0], [0.0, -r]].map(|[x, y]| Point3::new(x, y, z)));
    }
    points
}

/// Returns whether the middle of three profile points lies below the line between its neighbours.
fn bends_inwards(points: &[[f64; 2]]) -> bool {
    let [[z0, r0], [z1, r1], [z2, r2]] = [points[0], points[1], points[2]];
    (r1 - r0) * (z2 - z1) < (r2 - r1) * (z1 - z0) - 1e-12
}

/// Rings of a tube along an arc.
fn bent_rings(file: &str, arc_radius_m: f64, arc_angle_deg: f64, radii_m: &[f64]) -> Result<Vec<TubeRing>, InputError> {
    if !(2..=MOST_RINGS).contains(&radii_m.len()) || radii_m.iter().any(|&radius| radius >= arc_radius_m) {
        let expected = format!("2 to {MOST_RINGS} radii below arc_radius_m");
        return Err(InputError::new(file, "truth.shape.radii_m", list(radii_m), expected));
    }
    let angle = arc_angle_deg.to_radians();
    let ring = |(i, &radius): (usize, &f64)| {
        let (sin, cos) = libm::sincos(angle * (i as f64 / (radii_m.len() - 1) as f64 - 0.5));
        let outwards = Vector3::new(0.0, cos, sin);
        let axes = [Vector3::x(), outwards];
        TubeRing { centre: (outwards * arc_radius_m).into(), axes, semi_axes_m: [radius; 2] }
    };
    Ok(radii_m.iter().enumerate().map(ring).collect())
}

/// Rings of a tube, which are across its curve.
fn curved_rings(file: &str, curve_m: &[[f64; 3]]) -> Result<Vec<TubeRing>, InputError> {
    let expected =
        format!("2 to {MOST_RINGS} points (y, z, r) with radii of at least {LEAST_STEP_M} m, apart from each other");
    let fault = || InputError::new(file, "truth.shape.curve_m", format!("{curve_m:?}"), expected.clone());
    let last = curve_m.len().saturating_sub(1);
    if !(2..=MOST_RINGS).contains(&curve_m.len()) || curve_m.iter().any(|[_, _, radius]| *radius < LEAST_STEP_M) {
        return Err(fault());
    }
    let at = |i: usize| Vector3::new(0.0, curve_m[i][0], curve_m[i][1]);
    let ring = |i: usize| {
        let along = (at((i + 1).min(last)) - at(i.saturating_sub(1))).try_normalize(LEAST_STEP_M)?;
        let axes = [Vector3::x(), along.cross(&Vector3::x())];
        Some(TubeRing { centre: at(i).into(), axes, semi_axes_m: [curve_m[i][2]; 2] })
    };
    (0..=last).map(ring).collect::<Option<_>>().ok_or_else(fault)
}

fn tube(rings: &[TubeRing]) -> Surface {
    let parts = rings.windows(2).map(|pair| ColliderPart::Hull(TriangleMesh::tube(pair, SEGMENTS).vertices)).collect();
    (TriangleMesh::tube(rings, SEGMENTS), parts)
}
