//! Meshes of an imported arm's links: kept by the import, checked, seen by cameras, shown by exports.

use std::{fs, path::Path};

use catch_body::{
    TriangleMesh, mesh_file::obj_text, ray_cast::ArmSurface, shape::Capsule, visual::MOST_VISUAL_TRIANGLES,
};
use catch_lab::scenario::setup::{Choice, Setup};
use catch_view::{export::mjcf, playback::Playback, surfaces::surfaces};
use nalgebra::{Point3, Vector3};
use serde_json::Value;

use crate::{catchingbot, robot_import::package, stderr, stdout};

/// Radius of the links' visual meshes; those for collisions are tubes of 40 mm.
const RADIUS_M: f64 = 0.045;

/// An imported arm each link of which has a visual mesh, one with more triangles than are kept and another
/// one inside.
fn imported(folder: &Path) -> String {
    let file = package(folder);
    let shape = Capsule { from: Point3::new(0.0, 0.0, 0.05), to: Point3::new(0.0, 0.0, 0.2), radius: RADIUS_M };
    let mut mesh = TriangleMesh::capsule(&shape, 160);
    mesh.merge(&TriangleMesh::sphere(0.01, 4).translated(&Vector3::new(0.0, 0.0, 0.1)));
    assert!(mesh.triangles.len() > 2 * MOST_VISUAL_TRIANGLES);
    fs::write(folder.join("arm_support/meshes/cover.obj"), obj_text(&[mesh])).unwrap();
    let visual =
        "<visual><geometry><mesh filename=\"package://arm_support/meshes/cover.obj\"/></geometry></visual><collision>";
    fs::write(&file, fs::read_to_string(&file).unwrap().replace("<collision>", visual)).unwrap();
    let out = folder.join("arm").to_str().unwrap().to_owned();
    let output = catchingbot(&["robot", "import", file.to_str().unwrap(), "--out", &out, "--no-ready"]);
    assert!(output.status.success(), "{}", stderr(&output));
    out
}

#[test]
fn meshes_are_kept_and_seen() {
    let folder = tempfile::tempdir().unwrap();
    let out = imported(folder.path());
    let check = stdout(&catchingbot(&["check", &out]));
    assert!(check.contains("cameras see the meshes of 7 links, inside their capsules, "), "{check}");
    let toml = fs::read_to_string(Path::new(&out).join("robot.toml")).unwrap();
    assert!(toml.contains("source = \"arm.urdf: package://arm_support/meshes/cover.obj: the outside, "), "{toml}");

    let setup = Setup::load(&Choice { robot: Some(&out), ..Choice::default() }).unwrap();
    let robot = &setup.robot;
    assert_eq!(robot.visuals.keys().copied().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
    for visual in robot.visuals.values() {
        let mesh = visual.mesh().unwrap();
        assert!((1000..=MOST_VISUAL_TRIANGLES).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());
    }
    // Along x through the middle of the last link: at the mesh, not at its capsules; and nothing within.
    let surface = ArmSurface::new(robot, &setup.gripper);
    let X_WL = robot.link_poses(&robot.ready_q);
    let (X_WB, last) = surface.parts(&X_WL, 0.05).nth(6).unwrap();
    assert!((X_WB.inverse() * X_WL[6]).translation.vector.norm() < 1e-12);
    let (from, along) = (Point3::new(1.0, 0.0, 0.1), -Vector3::x());
    let seen_m = 1.0 - last.cast(&from, &along).unwrap();
    assert!((seen_m - RADIUS_M).abs() < 2e-4, "{seen_m}");
    let inside = last.cast(&Point3::new(0.0, 0.0, 0.1), &along).unwrap();
    assert!((inside - RADIUS_M).abs() < 2e-4, "{inside}");

    // Exports show the mesh of each link.
    let shown = surfaces(robot, &setup.gripper, None);
    assert_eq!(shown.iter().filter(|it| robot.visuals.values().any(|of| of.mesh() == Some(&it.mesh))).count(), 7);
    let scene = mjcf::scene(&setup, 1, 0);
    assert_eq!(scene.matches("type=\"mesh\" mesh=\"link").count(), 7);
    assert_eq!(
        scene.matches("<geom name=\"arm:").count(),
        scene.matches("<pair geom1=\"object:0\" geom2=\"arm:").count()
    );
}

/// The brain of a recording sees the meshes, too, wherever the arm's files are by then.
#[test]
fn recordings_hold_the_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let out = imported(folder.path());
    let records = folder.path().join("records");
    let arguments = ["catch", "--scenario", "honest", "--object", "tennis_ball", "--throw", "random_by_reach"];
    let of_arm = ["--robot", &out, "--out", records.to_str().unwrap(), "--json", "--mcap"];
    let output = catchingbot(&[&arguments[..], &of_arm].concat());
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    fs::remove_dir_all(&out).unwrap();
    let recording = document["recording"].as_str().unwrap();
    let playback = Playback::read(Path::new(recording)).unwrap();
    assert_eq!(playback.robot.visuals.values().filter(|it| it.mesh().is_some()).count(), 7);
    let replay: Value = serde_json::from_str(&stdout(&catchingbot(&["replay", recording, "--json"]))).unwrap();
    assert!(replay["difference"].is_null() && replay["ticks"].as_u64() > Some(10), "{replay}");
    let mcap = fs::read(document["pictures"]["mcap"].as_str().unwrap()).unwrap();
    let scene = mcap::MessageStream::new(&mcap).unwrap().map(Result::unwrap).find(|it| it.channel.topic == "/scene");
    assert!(scene.unwrap().data.len() > 7 * 1000 * 24, "the meshes' points");
}

#[test]
fn faults_of_meshes_name_file_field_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let out = imported(folder.path());
    let [toml, mesh] = ["robot.toml", "visual/link2.obj"].map(|it| Path::new(&out).join(it));
    let (right_toml, right_mesh) = (fs::read_to_string(&toml).unwrap(), fs::read_to_string(&mesh).unwrap());
    let ball = obj_text(&[TriangleMesh::sphere(0.1, 6)]);
    let cases = [
        (
            right_toml.replace("visual/link2.obj", "../link2.obj"),
            right_mesh.clone(),
            "visuals.two.mesh: found `../link2.obj`",
        ),
        (
            right_toml.replace("[visuals.two]", "[visuals.toe]"),
            right_mesh.clone(),
            "visuals.toe: found a link that is not",
        ),
        (
            right_toml.replace("link2.obj", "link9.obj"),
            right_mesh.clone(),
            "visual/link9.obj: the file: found nothing there",
        ),
        (right_toml.clone(), "f 1 2 3\n".to_owned(), "visual/link2.obj: faces: found vertex number 3"),
        (right_toml.clone(), ball, "`catchingbot robot import` simplifies"),
    ];
    for (toml_text, mesh_text, expected) in cases {
        fs::write(&toml, toml_text).unwrap();
        fs::write(&mesh, mesh_text).unwrap();
        let check = catchingbot(&["check", &out]);
        let said = stdout(&check) + &stderr(&check);
        assert!(check.status.code() == Some(2) && said.contains(expected), "{expected}: {said}");
        let fault = Setup::load(&Choice { robot: Some(&out), ..Choice::default() }).unwrap_err().to_string();
        assert!(fault.contains(expected), "{expected}: {fault}");
    }
}
