//! Capsules around the links of an arm, and the links' own surfaces below them.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::{
    InputError,
    mesh::TriangleMesh,
    quantity::{self, Quantity},
    shape::Capsule,
    visual::{MOST_VISUAL_TRIANGLES, Visual},
};

use super::{MOST_CAPSULES, RobotFiles, unreasoned};

/// Flat strips around a capsule without depths.
const BARE_SEGMENTS: u32 = 24;
/// Rings and columns of depths below a capsule at most: finer ones would make cameras slow.
const MOST_RINGS: usize = 48;

/// All points within a radius of a segment.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
pub(super) struct CapsuleFields {
    /// Name of the link that the capsule belongs to, in whose frame the points are.
    link: String,
    /// First end of the segment.
    from_m: quantity::offset_m<[f64; 3]>,
    /// Second end of the segment.
    to_m: quantity::offset_m<[f64; 3]>,
    /// Radius.
    radius_m: quantity::radius_m,
    /// Depth of the link's own surface below the capsule, as cameras see it: 3 to 48 rings from the first
    /// pole to the second, at equal distances along the surface. A pole is one number, each ring between has
    /// 3 to 48, as many as the others. They begin at the x axis of the capsule's frame: the link's frame, z
    /// turned the shortest way along the segment. A mesh in `[visuals]` takes their place.
    #[serde(default)]
    depths_mm: Vec<Vec<f64>>,
    /// True if nobody published the capsule.
    #[serde(default)]
    assumed: bool,
    /// Reason for the assumption.
    reason: Option<String>,
}

/// Capsules with the numbers of their links, and the surfaces that are stated below them.
type Shapes = (Vec<(usize, Capsule)>, BTreeMap<usize, Visual>);

/// Reads the capsules of the links that are called `link_names`.
///
/// # Errors
/// If there are too many; other faults are added to `faults`.
pub(super) fn collision_shapes(
    files: &RobotFiles,
    stated: &[CapsuleFields],
    link_names: &[&str],
    faults: &mut Vec<InputError>,
) -> Result<Shapes, InputError> {
    if stated.len() > MOST_CAPSULES {
        let (found, expected) = (format!("{} capsules", stated.len()), format!("at most {MOST_CAPSULES}"));
        return Err(InputError::new(files.toml_file, "collision.capsules", found, expected));
    }
    let (mut capsules, mut bare) = (Vec::new(), Vec::new());
    let mut surfaces = BTreeMap::<usize, TriangleMesh>::new();
    for (i, capsule) in stated.iter().enumerate() {
        let field = |name: &str| format!("collision.capsules[{i}].{name}");
        let link = link_names.iter().position(|name| *name == capsule.link).unwrap_or_else(|| {
            let expected = format!("one of {}", link_names.join(", "));
            faults.push(InputError::new(files.toml_file, field("link"), &capsule.link, expected));
            0
        });
        let &CapsuleFields { from_m, to_m, radius_m, ref depths_mm, .. } = capsule;
        let solid = Capsule { from: from_m.into(), to: to_m.into(), radius: radius_m };
        match checked_depths(files.toml_file, &field("depths_mm"), radius_m, depths_mm) {
            Err(fault) => faults.push(fault),
            Ok(()) if depths_mm.is_empty() => bare.push((link, solid)),
            Ok(()) => surfaces.entry(link).or_default().merge(&TriangleMesh::below_capsule(&solid, depths_mm)),
        }
        capsules.push((link, solid));
        faults.extend(unreasoned(files, &field(""), capsule.assumed, capsule.reason.as_ref()));
    }
    // Of a link with depths below some capsules the others are seen as they are.
    for (link, solid) in bare {
        surfaces.entry(link).and_modify(|it| it.merge(&TriangleMesh::capsule(&solid, BARE_SEGMENTS)));
    }
    for (link, surface) in &surfaces {
        let count = surface.triangles.len();
        if count > MOST_VISUAL_TRIANGLES {
            let field = format!("collision.capsules.depths_mm of {}", link_names[*link]);
            let expected = format!("at most {MOST_VISUAL_TRIANGLES}");
            faults.push(InputError::new(files.toml_file, field, format!("{count} triangles"), expected));
        }
    }
    Ok((capsules, surfaces.into_iter().map(|(link, it)| (link, Visual::of_surface(it))).collect()))
}

/// Checks the depths of a link's surface below a capsule.
fn checked_depths(file: &str, field: &str, radius_m: f64, depths_mm: &[Vec<f64>]) -> Result<(), InputError> {
    let count = depths_mm.len();
    if count > 0 && !(3..=MOST_RINGS).contains(&count) {
        return Err(InputError::new(file, field, format!("{count} rings"), format!("3 to {MOST_RINGS}")));
    }
    let columns = depths_mm.get(1).map_or(3, Vec::len).clamp(3, MOST_RINGS);
    for (i, ring) in depths_mm.iter().enumerate() {
        let expected = if i == 0 || i + 1 == count { 1 } else { columns };
        if ring.len() != expected {
            let expected = format!("{expected}: one at a pole, as many in each ring between, 3 to {MOST_RINGS}");
            return Err(InputError::new(file, format!("{field}[{i}]"), format!("{} numbers", ring.len()), expected));
        }
        // A depth of the whole radius would make triangles without area.
        let within = Quantity { least: 0.0, most: (radius_m * 1e4).floor() / 10.0 - 0.1, unit: "mm" };
        for (k, depth_mm) in ring.iter().enumerate() {
            within.check(file, format!("{field}[{i}][{k}]"), *depth_mm)?;
        }
    }
    Ok(())
}
