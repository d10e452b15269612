//! An imported robot as one page: its links' shapes with the capsules around them, and a slider for each
//! joint.

use catch_body::{Robot, TriangleMesh, robot::Joint, shape::Capsule};
use serde_json::json;

use super::{
    VIEWER,
    catch_page::{joint_data, packed_surface, seven},
    document, fill, packed,
};
use crate::surfaces::thinned;
use catch_lab::VERSION;

const PAGE: &str = include_str!("robot_page/page.html");
const SCRIPT: &str = include_str!("robot_page/robot.js");
/// Flat strips around a capsule.
const SEGMENTS: u32 = 24;

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
        let capsules = capsules.iter().map(|it| ("capsule", TriangleMesh::capsule(it, SEGMENTS)));
        let mesh = Some(("mesh", thinned(surface))).filter(|(_, it)| !it.triangles.is_empty());
        surfaces.extend(mesh.into_iter().chain(capsules).map(|(kind, mesh)| packed_surface(kind, link, &mesh, None)));
    }
    let joint = |joint: &Joint| {
        let mut data = joint_data(joint);
        (data["lower"], data["upper"]) = (json!(joint.limits.lower), json!(joint.limits.upper));
        data
    };
    // All that the page's script reads. Poses are (x, y, z, qx, qy, qz, qw).
    let data = json!({
        "version": VERSION,
        "base": seven(&robot.X_WB),
        "gripper": seven(&robot.X_LG),
        "joints": robot.joints.iter().map(joint).collect::<Vec<_>>(),
        "ready_rad": &robot.ready_q.as_slice()[..robot.dof()],
        "surfaces": surfaces,
        "is_covered": is_covered,
        "coverage": coverage,
    });
    let script = [VIEWER, SCRIPT].concat();
    let (heading, data) = (packed::text_in_html(&robot.name), packed::json_in_html(&data));
    document(&robot.name, "catch", "", &fill(PAGE, &[("title", &heading), ("data", &data), ("script", &script)]))
}
