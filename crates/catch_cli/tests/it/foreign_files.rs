//! Files as other programs write them, in `foreign_files/`: each is read as it is meant, or refused with what
//! is not read.
//!
//! Volumes, extents and centres of mass are those of trimesh, ranges of arms those of urdfdom.

use std::{fs, path::Path};

use catch_body::{Robot, robot_file::RobotFiles};
use catch_sim::ThrownObject;
use nalgebra::Vector3;

use crate::{catchingbot, stderr, stdout};

/// Imports one of the files into `folder`; what was said, or the complaint.
fn import(kind: &str, source: &str, folder: &Path) -> Result<String, String> {
    // A whole path stays what it is.
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/foreign_files").join(source);
    let source = source.display().to_string();
    let out = folder.join(if kind == "robot" { "arm" } else { "thing.toml" });
    let more: &[&str] = if kind == "robot" { &["--no-ready"] } else { &[] };
    let output = catchingbot(&[&[kind, "import", &source, "--out", out.to_str().unwrap()], more].concat());
    if output.status.success() {
        return Ok(stdout(&output));
    }
    assert_eq!(output.status.code(), Some(2), "{source}: {}", stderr(&output));
    assert!(!out.exists(), "{source}");
    Err(stderr(&output))
}

fn robot(source: &str) -> Result<Robot, String> {
    let folder = tempfile::tempdir().unwrap();
    import("robot", source, folder.path())?;
    let read = |name: &str| fs::read_to_string(folder.path().join("arm").join(name)).unwrap();
    let (urdf, toml) = (read("robot.urdf"), read("robot.toml"));
    // Requirements of urdfdom and Pinocchio for every joint that moves.
    for limit in urdf.split("<limit").skip(1) {
        let limit = limit.split_once('>').unwrap().0;
        assert!(limit.contains("velocity=") && limit.contains("effort="), "{source}: {limit}");
    }
    let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
    Ok(Robot::from_files(&files).unwrap())
}

fn range(robot: &Robot, joint: usize) -> [f64; 2] {
    let limits = &robot.joints[joint].limits;
    [limits.lower, limits.upper]
}

#[test]
fn arms_are_what_their_files_say() {
    let upper = robot("01-urdf-upper-only/arm.urdf").unwrap();
    assert_eq!(range(&upper, 2), [0.0, 1.4]);
    assert_eq!(robot("02-urdf-xacro-in-comment/arm.urdf").unwrap().dof(), 6);
    assert_eq!(robot("18-joint-limits-flow/arm.urdf").unwrap().joints[1].limits.velocity, 2.0);
    assert_eq!(robot("18-joint-limits-null/arm.urdf").unwrap().dof(), 6);
    let narrowed = robot("18-joint-limits-only-max/arm.urdf").unwrap();
    assert_eq!(range(&narrowed, 2), [-2.4, 1.0]);
    assert_eq!((narrowed.joints[1].limits.velocity, narrowed.joints[1].limits.acceleration), (2.0, 4.0));
    for (source, expected) in [
        ("03-urdf-swapped-limits/arm.urdf", "joint joint_2: limit: found from 2.1 to -1.9"),
        ("06-urdf-mimic-in-arm/arm.urdf", "joint joint_4: found a joint that another drives"),
        ("64-sdf-nested/thing.sdf", "found <sdf>, expected a URDF description of a robot"),
    ] {
        let fault = robot(source).unwrap_err();
        assert!(fault.contains(expected), "{source}: {fault}");
    }
}

/// A model is MuJoCo's to compile; the command that has it do so is named.
#[test]
fn models_of_mujoco_are_converted_first() {
    for kind in ["robot", "object"] {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("thing.xml");
        fs::write(&model, "<!-- --><mujoco><worldbody><body><geom size=\"0.03\"/></body></worldbody></mujoco>")
            .unwrap();
        let fault = import(kind, model.to_str().unwrap(), folder.path()).unwrap_err();
        let command = format!("`python -m catchingbot.mujoco {} --out DIR`", model.display());
        assert!(fault.contains(&command), "{kind}: {fault}");
    }
}

#[test]
fn things_are_what_their_files_say() {
    let bracket = (85.5, [0.08, 0.06, 0.03]);
    let block = (270.0, [0.06, 0.05, 0.09]);
    for (source, (volume_cm3, size_m)) in [
        ("50-stl-ascii-leading-blank/thing.stl", bracket),
        ("50-stl-ascii-two-solids/thing.stl", (93.5, [0.13, 0.06, 0.03])),
        ("50-stl-ascii-upper/thing.stl", bracket),
        ("50-stl-solid-trailing/thing.stl", bracket),
        ("51-obj-continuation/thing.obj", bracket),
        ("51-obj-crlf-bom/thing.obj", bracket),
        ("51-obj-lines-points/thing.obj", bracket),
        ("52-ply-comment-end/thing.ply", bracket),
        ("52-ply-tristrips/thing.ply", bracket),
        ("53-gltf-no-scene/thing.gltf", (10.6875, [0.04, 0.03, 0.015])),
        ("64-sdf-auto-inertia/thing.sdf", block),
        ("64-sdf-ellipsoid/thing.sdf", (150.8, [0.04, 0.06, 0.12])),
        ("64-sdf-nested/thing.sdf", block),
        ("64-sdf-relative-to-self/thing.sdf", block),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let said = import("object", source, folder.path()).unwrap_or_else(|it| panic!("{source}: {it}"));
        let read = |name: &str| Ok(fs::read(folder.path().join(name)).unwrap());
        let toml = fs::read_to_string(folder.path().join("thing.toml")).unwrap();
        let object = ThrownObject::from_toml("thing.toml", &toml, &read).unwrap();
        let ratio = object.mesh.volume() * 1e6 / volume_cm3;
        assert!((ratio - 1.0).abs() < 0.005, "{source}: {ratio} of the volume\n{said}");
        let off = object.mesh.aabb().size - Vector3::from(size_m);
        assert!(off.amax() < 0.002 * size_m[0].max(size_m[2]), "{source}: {}", object.mesh.aabb().size);
        let mass_kg = match &source[..2] {
            "64" if source.contains("auto") => 0.108,
            _ => object.mass_kg,
        };
        assert!((object.mass_kg - mass_kg).abs() < 1e-6, "{source}: {} kg", object.mass_kg);
    }
}

#[test]
fn what_is_not_read_of_a_thing_is_refused_or_told() {
    for (source, expected) in [
        ("53-gltf-instancing/thing.gltf", "extensionsRequired: found EXT_mesh_gpu_instancing"),
        ("53-gltf-morph/thing.gltf", "found `weights`, which is not read"),
        ("53-gltf-sparse/thing.gltf", "found `sparse`, which is not read"),
        ("130-depth-inverse-poses/scan", "of what some images show where others see nothing"),
        ("bounds/dae_vertices_without_faces-a.dae", "no triangles"),
        ("bounds/gltf_points_without_end-a.gltf", "nodes without end"),
        ("bounds/gltf_vertices_merged-a.gltf", "more triangles in all that is shown"),
        ("64-sdf-include/thing.sdf", "found <include>"),
        ("64-sdf-submesh/thing.sdf", "found <submesh>"),
        ("64-sdf-two-models/thing.sdf", "found 2 models: ground, can"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let fault = import("object", source, folder.path()).unwrap_err();
        assert!(fault.contains(expected), "{source}: {fault}");
    }
    let folder = tempfile::tempdir().unwrap();
    let said = import("object", "64-sdf-mixed-ellipsoid/thing.sdf", folder.path()).unwrap();
    assert!(said.contains("shells whose boxes overlap"), "{said}");
}
