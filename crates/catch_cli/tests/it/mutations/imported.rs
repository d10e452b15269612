//! Valid files of other programs, one of each kind, for tests of importers and readers.

use std::fs;

use base64::{Engine, engine::general_purpose::STANDARD};
use catch_body::{Gripper, InputError, TriangleMesh, workcell::Workcell};
use catch_import::{
    object_import::{self, ImportedObject},
    robot_import::{self, ImportedRobot},
    ros_calibration::{camera_info, hand_eye},
};
use serde_json::json;

use super::{Load, obj, read, root, text};

/// A valid file: its name and its content.
type Right = (&'static str, Vec<u8>);

/// Ways of loading for the files of other programs and workcells.
pub fn loads() -> Vec<(String, Load<'static>)> {
    let mut loads: Vec<(String, Load)> = Vec::new();
    for (name, right) in objects() {
        loads.push((format!("object import {name}"), import(vec![(name, right)], 0)));
    }
    let mesh = ("a.obj", obj(&solid()).into_bytes());
    for (name, right) in descriptions() {
        loads.push((format!("object import {name} with a mesh"), import(vec![(name, right), mesh.clone()], 0)));
    }
    let [_, (name, urdf)] = &descriptions()[..] else { unreachable!("two descriptions") };
    let in_package = text(urdf.clone()).unwrap().replace("a.obj", "package://arm_support/a.obj").into_bytes();
    let manifest =
        b"<?xml version=\"1.0\"?>\n<package format=\"3\">\n  <name>arm_support</name>\n</package>\n".to_vec();
    let files = vec![("package.xml", manifest), (*name, in_package), mesh];
    loads.push(("object import package.xml".into(), import(files, 1)));
    loads.extend(robots());
    let camera = "image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]\n\
                  distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.0, 0.0, 0.0, 0.0, 0.0]\n";
    let stands = "parameters:\n  name: a\n  calibration_type: eye_on_base\n  robot_base_frame: base\n  tracking_base_frame: camera_depth_optical_frame\n\
                  transform:\n  translation:\n    x: 1.0\n    y: 0.5\n    z: 1.2\n  rotation:\n    x: 0.0\n    y: 0.0\n    z: 0.0\n    w: 1.0\n";
    loads.push(("camera_info YAML".into(), Box::new(|it| camera_info("c.yaml", &text(it.text(camera))?).map(drop))));
    loads.push(("hand-eye YAML".into(), Box::new(|it| hand_eye("h.calib", &text(it.text(stands))?, "base").map(drop))));
    let workcell = read(&root().join("assets/workcells/table_and_fence.toml"));
    loads.push((
        "workcell".into(),
        Box::new(move |it| Workcell::from_toml("w.toml", &text(it.text(&workcell))?).map(drop)),
    ));
    loads
}

/// A ball of few triangles, as large as a fist.
fn solid() -> TriangleMesh {
    TriangleMesh::sphere(0.04, 1)
}

/// Changes the first of some files and imports an object from number `described` of them.
fn import(files: Vec<Right>, described: usize) -> Load<'static> {
    Box::new(move |it| {
        let folder = tempfile::tempdir().unwrap();
        for (i, (name, right)) in files.iter().enumerate() {
            let changed = match (i, std::str::from_utf8(right)) {
                (0, Ok(right)) => it.text(right),
                (0, Err(_)) => it.bytes(right),
                _ => right.clone(),
            };
            fs::write(folder.path().join(name), changed).unwrap();
        }
        let path = folder.path().join(files[described].0);
        ImportedObject::read(&path, "thing", &object_import::ImportOptions::default()).map(drop)
    })
}

/// Meshes of every format that only the importer reads.
fn objects() -> Vec<Right> {
    let (json, binary) = gltf();
    let mut document = json.clone();
    document["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&binary)).into();
    vec![
        ("a.gltf", document.to_string().into_bytes()),
        ("a.glb", glb(&json, &binary)),
        ("a.dae", collada().into_bytes()),
        ("text.ply", ply("ascii")),
        ("binary.ply", ply("binary_little_endian")),
    ]
}

/// The document and the buffer of a glTF file.
fn gltf() -> (serde_json::Value, Vec<u8>) {
    let mesh = solid();
    let numbers = mesh.vertices.iter().flat_map(|p| [p.x, p.z, -p.y]).flat_map(|it| (it as f32).to_le_bytes());
    let mut bytes: Vec<u8> = numbers.collect();
    let vertices = bytes.len();
    bytes.extend(mesh.triangles.iter().flatten().flat_map(|it| (*it as u16).to_le_bytes()));
    let (count, corners) = (mesh.vertices.len(), 3 * mesh.triangles.len());
    let document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "children": [1], "scale": [1.0, 1.0, 1.0] }, { "mesh": 0, "translation": [0.0, 0.0, 0.0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": corners, "type": "SCALAR" }],
        "bufferViews": [
            { "buffer": 0, "byteLength": vertices },
            { "buffer": 0, "byteOffset": vertices, "byteLength": 2 * corners }],
        "buffers": [{ "byteLength": bytes.len() }],
    });
    (document, bytes)
}

/// The two in one file, as chunks of whole words.
fn glb(document: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let padded = |mut bytes: Vec<u8>, with: u8| {
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let chunk = |kind: &[u8; 4], bytes: Vec<u8>| [&(bytes.len() as u32).to_le_bytes()[..], kind, &bytes].concat();
    let chunks =
        [chunk(b"JSON", padded(document.to_string().into_bytes(), b' ')), chunk(b"BIN\0", padded(binary.to_vec(), 0))]
            .concat();
    [&b"glTF"[..], &2_u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

fn collada() -> String {
    let mesh = solid();
    let words = |it: Vec<String>| it.join(" ");
    let positions = words(mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).map(|it| format!("{it:.5}")).collect());
    let corners = words(mesh.triangles.iter().flatten().map(ToString::to_string).collect());
    let (numbers, vertices, triangles) = (3 * mesh.vertices.len(), mesh.vertices.len(), mesh.triangles.len());
    format!(
        "<?xml version=\"1.0\"?>\n<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">\n\
         <asset><unit meter=\"1\"/><up_axis>Z_UP</up_axis></asset>\n<library_geometries><geometry id=\"g\"><mesh>\n\
         <source id=\"p\"><float_array id=\"a\" count=\"{numbers}\">{positions}</float_array>\n\
         <technique_common><accessor source=\"#a\" count=\"{vertices}\" stride=\"3\"/></technique_common></source>\n\
         <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>\n\
         <triangles count=\"{triangles}\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>{corners}</p></triangles>\n\
         </mesh></geometry></library_geometries>\n\
         <library_visual_scenes><visual_scene id=\"s\"><node><instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes>\n\
         <scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>\n"
    )
}

fn ply(format: &str) -> Vec<u8> {
    let mesh = solid();
    let (vertices, faces) = (mesh.vertices.len(), mesh.triangles.len());
    let header = format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    );
    if format == "ascii" {
        let points = mesh.vertices.iter().map(|p| format!("{:.5} {:.5} {:.5}\n", p.x, p.y, p.z));
        let faces = mesh.triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}\n"));
        return (header + &points.chain(faces).collect::<String>()).into_bytes();
    }
    let points = mesh.vertices.iter().flat_map(|p| [p.x, p.y, p.z]).flat_map(|it| (it as f32).to_le_bytes());
    let faces =
        mesh.triangles.iter().flat_map(|it| [vec![3_u8], it.iter().flat_map(|i| i.to_le_bytes()).collect()].concat());
    header.into_bytes().into_iter().chain(points).chain(faces).collect()
}

/// Descriptions of one link that name the mesh `a.obj`.
fn descriptions() -> Vec<Right> {
    let inertial =
        "<inertial><mass>0.2</mass><inertia><ixx>1e-4</ixx><iyy>1.1e-4</iyy><izz>1.2e-4</izz></inertia></inertial>";
    let sdf = format!(
        "<?xml version=\"1.0\"?>\n<sdf version=\"1.7\"><model name=\"m\"><link name=\"l\">{inertial}\n\
         <visual name=\"v\"><geometry><mesh><uri>a.obj</uri></mesh></geometry></visual>\n\
         <collision name=\"c\"><geometry><box><size>0.08 0.08 0.08</size></box></geometry></collision>\n</link></model></sdf>\n"
    );
    let urdf = "<?xml version=\"1.0\"?>\n<robot name=\"b\"><link name=\"base\">\n<inertial><origin xyz=\"0 0 0\"/><mass value=\"0.2\"/>\
                <inertia ixx=\"1e-4\" iyy=\"1.1e-4\" izz=\"1.2e-4\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>\n\
                <visual><geometry><mesh filename=\"a.obj\"/></geometry></visual>\n</link></robot>\n";
    vec![("a.sdf", sdf.into_bytes()), ("a.urdf", urdf.as_bytes().to_vec())]
}

/// Descriptions of arms, and the limits beside one.
fn robots() -> Vec<(String, Load<'static>)> {
    let gripper = Gripper::from_toml("g.toml", &read(&root().join("assets/grippers/wsg50.toml"))).unwrap();
    let urdf = read(&root().join("assets/robots/iiwa14/robot.urdf"));
    let limits: String = (1..=7)
        .map(|i| format!("  iiwa_joint_{i}:\n    has_velocity_limits: true\n    max_velocity: 1.5\n    has_acceleration_limits: true\n    max_acceleration: 5.0\n"))
        .collect();
    let limits = format!("joint_limits:\n{limits}");
    let load = move |urdf: Vec<u8>, limits: Vec<u8>| -> Result<(), InputError> {
        let folder = tempfile::tempdir().unwrap();
        let [description, beside] = ["arm.urdf", "joint_limits.yaml"].map(|name| folder.path().join(name));
        fs::write(&description, urdf).unwrap();
        fs::write(beside, limits).unwrap();
        ImportedRobot::read(&description, &robot_import::ImportOptions::default(), &gripper).map(drop)
    };
    let (again, right_urdf, right_limits) = (load.clone(), urdf.clone(), limits.clone());
    vec![
        ("robot import URDF".into(), Box::new(move |it| load(it.text(&urdf), right_limits.clone().into_bytes()))),
        ("robot import YAML".into(), Box::new(move |it| again(right_urdf.clone().into_bytes(), it.text(&limits)))),
    ]
}
