//! An imported robot as one page: its links' shapes with the capsules around them, and a slider for each
//! joint.

use catch_body::{Robot, TriangleMesh, shape::Capsule};
use serde::Serialize;

use super::{
    VIEWER,
    catch_page::{PackedSurface, seven},
    document, fill, packed,
};
use crate::surfaces::thinned;
use catch_lab::VERSION;

const PAGE: &str = include_str!("robot_page/page.html");
const SCRIPT: &str = include_str!("robot_page/robot.js");
/// Flat strips around a capsule.
const SEGMENTS: u32 = 24;

/// All that the page's script reads. Poses are (x, y, z, qx, qy, qz, qw).
#[derive(Debug, Serialize)]
struct PageData {
    version: &'static str,
    base: [f64; 7],
    gripper: [f64; 7],
    joints: Vec<JointData>,
    ready_rad: Vec<f64>,
    surfaces: Vec<PackedSurface<Kind>>,
    is_covered: bool,
    coverage: String,
}

#[derive(Debug, Serialize)]
struct JointData {
    name: String,
    parent: [f64; 7],
    axis: [f64; 3],
    lower: f64,
    upper: f64,
}

/// Kind of a surface.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// A shape of the description.
    Mesh,
    /// A capsule around one.
    Capsule,
}

/// A link's surface in its frame, and the capsules around it.
pub type LinkShape<'a> = (&'a TriangleMesh, &'a [Capsule]);

/// The page of a robot with the shapes of its base and of each moved link; `coverage` says whether the
/// capsules hold them all, in a sentence, too.
pub fn page<'a>(
    robot: &Robot,
    shapes: impl IntoIterator<Item = LinkShape<'a>>,
    (is_covered, coverage): (bool, String),
) -> String {
    let mut surfaces = Vec::new();
    for (link, (surface, capsules)) in shapes.into_iter().enumerate() {
        let capsules = capsules.iter().map(|it| (Kind::Capsule, TriangleMesh::capsule(it, SEGMENTS)));
        let mesh = Some((Kind::Mesh, thinned(surface))).filter(|(_, it)| !it.triangles.is_empty());
        surfaces.extend(mesh.into_iter().chain(capsules).map(|(kind, mesh)| PackedSurface::new(kind, link, &mesh)));
    }
    let data = PageData {
        version: VERSION,
        base: seven(&robot.X_WB),
        gripper: seven(&robot.X_LG),
        joints: joints(robot),
        ready_rad: robot.ready_q.iter().take(robot.dof()).copied().collect(),
        surfaces,
        is_covered,
        coverage,
    };
    let script = [VIEWER, SCRIPT].concat();
    let (heading, data) = (packed::text_in_html(&robot.name), packed::json_in_html(&data));
    document(&robot.name, "catch", "", &fill(PAGE, &[("title", &heading), ("data", &data), ("script", &script)]))
}

fn joints(robot: &Robot) -> Vec<JointData> {
    let of_joint = |joint: &catch_body::robot::Joint| JointData {
        name: joint.name.clone(),
        parent: seven(&joint.X_PL),
        axis: joint.axis.into_inner().into(),
        lower: joint.limits.lower,
        upper: joint.limits.upper,
    };
    robot.joints.iter().map(of_joint).collect()
}
