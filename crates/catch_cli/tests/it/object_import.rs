//! `object import`: from a mesh or a description to an object, with one command.

use std::{fmt::Write, fs, path::Path};

use catch_body::{TriangleMesh, mesh::TubeRing};
use catch_import::cloud_file;
use catch_lab::{
    assets::{Asset, Kind},
    png,
};
use catch_sim::ThrownObject;
use nalgebra::{Point3, Vector3};
use serde_json::Value;

use crate::{catchingbot, depth_scan, stderr, stdout};

/// A bottle in millimetres: a body and a neck.
fn bottle() -> TriangleMesh {
    TriangleMesh::revolution(&[[0.0, 25.0], [60.0, 25.0], [70.0, 12.0], [90.0, 12.0]], 48)
}

/// An STL file whose triangles know nothing of each other, some facing the wrong way, one missing.
fn broken_stl(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend((mesh.triangles.len() as u32 - 1).to_le_bytes());
    for (i, mut corners) in mesh.all_corners().enumerate().skip(1) {
        if i % 9 == 0 {
            corners.swap(0, 1);
        }
        let points = std::iter::once(Point3::origin()).chain(corners);
        bytes.extend(points.flat_map(<[f64; 3]>::from).flat_map(|it| (it as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn obj(mesh: &TriangleMesh) -> String {
    let mut text = String::new();
    for p in &mesh.vertices {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|it| it + 1);
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    text
}

/// A glTF file with its buffer inside, y up.
fn gltf(mesh: &TriangleMesh) -> String {
    let numbers = mesh.vertices.iter().flat_map(|p| [p.x, p.z, -p.y]).flat_map(|it| (it as f32).to_le_bytes());
    let mut bytes: Vec<u8> = numbers.collect();
    let vertices = bytes.len();
    bytes.extend(mesh.triangles.iter().flatten().flat_map(|it| (*it as u16).to_le_bytes()));
    let (count, corners) = (mesh.vertices.len(), 3 * mesh.triangles.len());
    serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "children": [1], "scale": [0.001, 0.001, 0.001] }, { "mesh": 0, "translation": [0.0, 0.0, 0.0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": corners, "type": "SCALAR" }],
        "bufferViews": [
            { "buffer": 0, "byteLength": vertices }, { "buffer": 0, "byteOffset": vertices, "byteLength": 2 * corners }],
        "buffers": [{ "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{}", base64(&bytes)) }]
    })
    .to_string()
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |it: &[u8]| {
        let word = it.iter().enumerate().fold(0u32, |word, (i, byte)| word | u32::from(*byte) << (16 - 8 * i));
        let digit =
            |k: usize| if k <= it.len() { char::from(DIGITS[(word >> (18 - 6 * k)) as usize & 63]) } else { '=' };
        [0, 1, 2, 3].map(digit)
    };
    bytes.chunks(3).flat_map(group).collect()
}

/// Imports, and returns what was said and the object that its file describes.
fn imported(source: &Path, out: &Path, more: &[&str]) -> (Value, ThrownObject) {
    let arguments = ["object", "import", source.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"];
    let output = catchingbot(&[&arguments[..], more].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let check = catchingbot(&["check", out.to_str().unwrap()]);
    assert!(check.status.success(), "{}", stdout(&check));
    let object = Asset::on_disk(Kind::Object, out).unwrap().thrown_object().unwrap();
    (serde_json::from_str(&stdout(&output)).unwrap(), object)
}

fn findings(said: &Value) -> String {
    said["findings"].as_array().unwrap().iter().filter_map(Value::as_str).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_broken_mesh_in_millimetres_becomes_an_object() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("bottle.stl");
    fs::write(&source, broken_stl(&bottle())).unwrap();
    let (said, object) = imported(&source, &folder.path().join("flask.toml"), &[]);
    let findings = findings(&said);
    for expected in ["millimetres, guessed", "triangles turned", "holes filled: 1", "kg assumed, 500 kg/m³"] {
        assert!(findings.contains(expected), "{findings}");
    }
    assert!((object.mesh.volume() / (bottle().volume() * 1e-9) - 1.0).abs() < 1e-3);
    assert!((object.mass_kg / object.mesh.volume() - 500.0).abs() < 5.0);
    // The next command works as printed.
    let out = folder.path().join("cup.toml");
    let arguments = ["object", "import", source.to_str().unwrap(), "--out", out.to_str().unwrap(), "--mass", "0.1"];
    let output = catchingbot(&arguments);
    assert!(stdout(&output).contains(&format!("--object {}", out.display())), "{}", stdout(&output));
    let none = catchingbot(&arguments);
    assert!(stderr(&none).contains("which is already there"), "{}", stderr(&none));
}

#[test]
fn a_description_brings_its_mass_and_placeholders_are_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    fs::create_dir(&model).unwrap();
    fs::write(model.join("bottle.obj"), obj(&bottle())).unwrap();
    let urdf = |inertia: &str| {
        format!(
            "<?xml version=\"0.0\"?><robot name=\"b\"><link name=\"base\"><contact><lateral_friction value=\"0.8\"/></contact>\
             <inertial><origin xyz=\"0 0 0.045\"/><mass value=\"0.12\"/>{inertia}</inertial>\
             <visual><geometry><mesh filename=\"bottle.obj\" scale=\"0.001 0.001 0.001\"/></geometry></visual>\
             <collision><geometry><mesh filename=\"bottle.obj\" scale=\"0.001 0.001 0.001\"/></geometry></collision>\
             </link></robot>"
        )
    };
    let inertia = |moment: &str| {
        format!("<inertia ixx=\"{moment}\" iyy=\"{moment}\" izz=\"{moment}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>")
    };
    fs::write(model.join("model.urdf"), urdf(&inertia("1e-3"))).unwrap();
    let (said, object) = imported(&model, &folder.path().join("one.toml"), &[]);
    assert!(findings(&said).contains("equal about all axes"), "{}", findings(&said));
    assert_eq!((object.mass_kg, object.friction), (0.12, Some(catch_sim::config::Drawn::Always(0.8))));
    assert!(object.inertia_kgm2[(0, 0)] < 2e-4);
    let measured = inertia("7e-5").replace("izz=\"7e-5\"", "izz=\"3.5e-5\"");
    fs::write(model.join("model.urdf"), urdf(&measured)).unwrap();
    let (_, object) = imported(&model.join("model.urdf"), &folder.path().join("two.toml"), &[]);
    assert!((object.inertia_kgm2[(0, 0)] - 7e-5).abs() < 1e-12);
    // The bottom, at z = 0 of the link, is that far below the stated centre of mass.
    let low = object.mesh.vertices.iter().map(|it| it.z).fold(f64::INFINITY, f64::min);
    assert!((low + 0.045).abs() < 1e-6, "{low}");
}

#[test]
fn an_sdf_with_a_gltf_mesh_stands_as_its_simulator_has_it() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("meshes")).unwrap();
    fs::write(folder.path().join("meshes/bottle.gltf"), gltf(&bottle())).unwrap();
    let sdf = "<sdf version=\"1.7\"><model name=\"m\"><link name=\"l\"><inertial><pose>0 0 0.13 0 0 0</pose><mass>0.2</mass></inertial>\
        <visual name=\"v\"><pose>0 0 0.1 0 0 0</pose><geometry><mesh><uri>package://any/meshes/bottle.gltf</uri></mesh></geometry></visual>\
        <collision name=\"c\"><pose>0 0 0.13 0 0 0</pose><geometry><cylinder><radius>0.025</radius><length>0.06</length></cylinder></geometry>\
        </collision><collision name=\"n\"><pose>0 0 0.175 0 0 0</pose><geometry><cylinder><radius>0.012</radius><length>0.03</length></cylinder></geometry>\
        </collision></link></model></sdf>";
    let source = folder.path().join("bottle.sdf");
    fs::write(&source, sdf).unwrap();
    let (said, object) = imported(&source, &folder.path().join("bottle.toml"), &[]);
    assert!(findings(&said).contains("metres, as the format says: 90.0 mm"), "{}", findings(&said));
    let size = object.mesh.aabb().size;
    assert!((size - Vector3::new(0.05, 0.05, 0.09)).norm() < 3e-4, "{size}");
    assert_eq!(object.parts.len(), 2, "the cylinders: {}", findings(&said));
    // Without the neck fingers would close through it.
    let (from, to) = (sdf.find("<collision name=\"n\">").unwrap(), sdf.find("</link>").unwrap());
    fs::write(&source, sdf.replace(&sdf[from..to], "")).unwrap();
    let (said, _) = imported(&source, &folder.path().join("bottle2.toml"), &[]);
    assert!(findings(&said).contains("mm from where the surface does"), "{}", findings(&said));
    // Nothing that is left out is left out in silence.
    let weight = "<link name=\"k\"><inertial><mass>0.05</mass></inertial></link></model>";
    let mu = "<surface><friction><ode><mu>1e6</mu></ode></friction></surface></collision>";
    fs::write(&source, sdf.replace("</model>", weight).replacen("</collision>", mu, 1)).unwrap();
    let (said, _) = imported(&source, &folder.path().join("bottle3.toml"), &[]);
    for expected in ["without the masses of other links: k", "a friction coefficient of 1000000 is none of a surface"] {
        assert!(findings(&said).contains(expected), "{}", findings(&said));
    }
}

/// A cloud of points in millimetres, without faces, with normals if wanted.
/// A cloud upon a mesh; normals as long as is said, inwards below zero.
fn cloud(mesh: &TriangleMesh, normals: Option<f64>) -> String {
    let mut rows = Vec::new();
    for [a, b, c] in mesh.all_corners() {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-9) else { continue };
        let steps = ((b - a).norm().max((c - a).norm()).max((c - b).norm()) / 1.5).ceil() as u32;
        for (i, j) in (0..steps).flat_map(|i| (0..steps - i).map(move |j| (i, j))) {
            let fraction = |k: u32| (f64::from(k) + 1.0 / 3.0) / f64::from(steps);
            let p = a + (b - a) * fraction(i) + (c - a) * fraction(j);
            let normal = normals.map(|it| normal * it).map(|it| format!(" {} {} {}", it.x, it.y, it.z));
            let normal = normal.unwrap_or_default();
            rows.push(format!("{} {} {}{normal}", p.x, p.y, p.z));
        }
    }
    let names = if normals.is_some() { &["x", "y", "z", "nx", "ny", "nz"][..] } else { &["x", "y", "z"] };
    let properties: String = names.iter().map(|it| format!("property float {it}\n")).collect();
    let count = rows.len();
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n{}\n", rows.join("\n"))
}

#[test]
fn a_scan_without_faces_becomes_an_object() {
    let folder = tempfile::tempdir().unwrap();
    for (i, normals) in [Some(1.0), None, Some(0.0), Some(-127.0)].into_iter().enumerate() {
        let source = folder.path().join(format!("scan_{i}.ply"));
        fs::write(&source, cloud(&bottle(), normals)).unwrap();
        let (said, object) = imported(&source, &folder.path().join(format!("object_{i}.toml")), &["--mass", "0.1"]);
        let findings = findings(&said);
        assert!(findings.contains("a cloud of") && findings.contains("millimetres, guessed"), "{findings}");
        assert_eq!(findings.contains("no normals"), normals.is_none_or(|it| it == 0.0), "{findings}");
        assert_eq!(findings.contains("face inwards: turned"), normals.is_some_and(|it| it < 0.0), "{findings}");
        let volume = object.mesh.volume() / (bottle().volume() * 1e-9);
        assert!((volume - 1.0).abs() < 0.03, "{volume}: {findings}");
        // The bottom stands as far below the centre of mass as that of the true mesh does.
        let low = object.mesh.vertices.iter().map(|it| it.z).fold(f64::INFINITY, f64::min);
        let centre = bottle().mass_properties(1.0).com.z * 1e-3;
        assert!((low + centre).abs() < 1e-3, "{low} {centre}");
    }
    let source = folder.path().join("few.ply");
    fs::write(&source, "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n").unwrap();
    let out = folder.path().join("few.toml");
    let output = catchingbot(&["object", "import", source.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(stderr(&output).contains("1 points"), "{}", stderr(&output));
}

/// A scan in millimetres whose normals are changed row by row.
fn with_normals(mesh: &TriangleMesh, change: impl Fn(usize, &[f64; 6]) -> [f64; 3]) -> String {
    let text = cloud(mesh, Some(1.0));
    let (header, rows) = text.split_once("end_header\n").unwrap();
    let row = |(i, row): (usize, &str)| {
        let row: Vec<f64> = row.split_whitespace().map(|it| it.parse().unwrap()).collect();
        let [nx, ny, nz] = change(i, row[..].try_into().unwrap());
        format!("{} {} {} {nx} {ny} {nz}\n", row[0], row[1], row[2])
    };
    format!("{header}end_header\n{}", rows.lines().enumerate().map(row).collect::<String>())
}

#[test]
fn normals_of_mixed_sign_are_turned_and_others_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut cup = cup();
    cup.vertices.iter_mut().for_each(|it| it.coords *= 1e3);
    let at_random = |i: usize, row: &[f64; 6]| {
        if i * i * 7 % 11 < 5 { [-row[3], -row[4], -row[5]] } else { [row[3], row[4], row[5]] }
    };
    let below =
        |_: usize, row: &[f64; 6]| if row[2] < 30.0 { [-row[3], -row[4], -row[5]] } else { [row[3], row[4], row[5]] };
    for (name, mesh, text) in [
        ("bottle", bottle(), with_normals(&bottle(), at_random)),
        ("halves", bottle(), with_normals(&bottle(), below)),
        ("cup", cup.clone(), with_normals(&cup, at_random)),
    ] {
        let source = folder.path().join(format!("{name}.ply"));
        fs::write(&source, text).unwrap();
        let (said, object) = imported(&source, &folder.path().join(format!("{name}.toml")), &["--mass", "0.1"]);
        let findings = findings(&said);
        assert!(findings.contains("normals faced another way than those around them: turned"), "{name}: {findings}");
        let volume = object.mesh.volume() / (mesh.volume() * 1e-9);
        assert!((volume - 1.0).abs() < 0.05, "{name}: {volume}: {findings}");
    }
    let source = folder.path().join("none.ply");
    fs::write(&source, with_normals(&bottle(), |i, _| [i % 3, i * i % 7, i * 31 % 5].map(|it| it as f64 - 2.1)))
        .unwrap();
    let out = folder.path().join("none");
    let output = catchingbot(&["object", "import", source.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(stderr(&output).contains("none.ply: normals: found directions of which"), "{}", stderr(&output));
}

/// A cup in metres, its wall and bottom 4 mm thick.
fn cup() -> TriangleMesh {
    let profile = [[0.0, 0.0], [0.0, 0.035], [0.04, 0.035], [0.04, 0.031], [0.004, 0.031], [0.004, 0.0]];
    TriangleMesh::revolution(&profile, 64)
}

/// Distances of the vertices of one mesh from points that lie upon another, in ascending order.
fn distances_m(from: &TriangleMesh, to: &TriangleMesh) -> Vec<f64> {
    let on_surface = cloud_file::on_surface(to).points;
    let nearest = |p: &Point3<f64>| on_surface.iter().map(|it| (it - p).norm_squared()).fold(f64::INFINITY, f64::min);
    let mut all: Vec<f64> = from.vertices.iter().map(|p| nearest(p).sqrt()).collect();
    all.sort_by(f64::total_cmp);
    all
}

#[test]
fn depth_images_become_an_object() {
    let folder = tempfile::tempdir().unwrap();
    let mut bottle = bottle();
    bottle.vertices.iter_mut().for_each(|it| it.coords *= 1e-3);
    for (name, mesh) in [("bottle", bottle), ("ring", ring()), ("cup", cup())] {
        let source = folder.path().join(name);
        // It stands where no camera knows.
        let com = mesh.mass_properties(1.0).com.coords;
        depth_scan::write(&source, &mesh.clone().translated(&Vector3::new(0.02, -0.01, -0.03)));
        let (said, object) = imported(&source, &folder.path().join(format!("{name}.toml")), &["--mass", "0.1"]);
        let findings = findings(&said);
        assert!(findings.contains("12 depth images"), "{findings}");
        let volume = object.mesh.volume() / mesh.volume();
        assert!((volume - 1.0).abs() < 0.05, "{name}: {volume}: {findings}");
        // Both about their centres of mass. What few images see of a cup's inside may be farther off.
        let far_m = distances_m(&object.mesh, &mesh.translated(&-com));
        let at = |quantile: f64| far_m[(quantile * (far_m.len() - 1) as f64) as usize];
        assert!(at(0.95) < 0.0015, "{name}: {}: {findings}", at(0.95));
        assert!(name == "cup" || at(1.0) < 0.0015, "{name}: {}: {findings}", at(1.0));
    }
    let source = folder.path().join("cup");
    let refused = |expected: &str| {
        let out = folder.path().join("out.toml");
        let output = catchingbot(&["object", "import", source.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{}", stdout(&output));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    };
    let image = fs::read(source.join("depth_3.png")).unwrap();
    fs::write(source.join("depth_3.png"), &image[..100]).unwrap();
    refused("depth_3.png: image: found unexpected end of file");
    fs::write(source.join("depth_3.png"), depth_scan::gray16(2, 2, &[1; 4])).unwrap();
    refused("depth_3.png: size: found 2 × 2 pixels, expected the camera's 320 × 240");
    fs::remove_file(source.join("depth_3.png")).unwrap();
    refused("images: found 11 PNG files, expected 12");
    fs::write(source.join("depth_3.png"), &image).unwrap();
    fs::write(source.join("rig.toml"), depth_scan::RIG.replace("[0.0, 0.0, 0.0]", "[9.0, 0.0, 0.0]")).unwrap();
    refused("depths: found none within 0.3 m of the origin of R");
    fs::write(source.join("rig.toml"), depth_scan::RIG.replace("radius_m", "radius")).unwrap();
    refused("rig.toml: uv_sphere");
    // Two images under each other's name, and depths in tenths of a millimetre.
    fs::write(source.join("rig.toml"), depth_scan::RIG).unwrap();
    let other = fs::read(source.join("depth_4.png")).unwrap();
    fs::write(source.join("depth_3.png"), &other).unwrap();
    fs::write(source.join("depth_4.png"), &image).unwrap();
    refused("cameras[3] of depth_3.png");
    refused("cameras[4] of depth_4.png");
    for i in 0..12 {
        let path = source.join(format!("depth_{i}.png"));
        let depths = png::gray16_values("", &fs::read(&path).unwrap(), [320, 240]).unwrap();
        fs::write(&path, depth_scan::gray16(320, 240, &depths.iter().map(|it| it * 10).collect::<Vec<_>>())).unwrap();
    }
    refused("(median) from cameras that are 0.500 m away from it, expected depths in millimetres, or `--scale");
}

/// A flat ring in metres.
fn ring() -> TriangleMesh {
    let rings: Vec<TubeRing> = (0..=96)
        .map(|i| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(i % 96) / 96.0);
            let outwards = Vector3::new(cos, sin, 0.0);
            TubeRing { centre: (outwards * 0.035).into(), axes: [outwards, Vector3::z()], semi_axes_m: [0.008, 0.003] }
        })
        .collect();
    // The ends of the tube lie on each other and face each other, so they are no surface.
    TriangleMesh::tube(&rings, 24)
}

#[test]
fn openings_and_thin_walls_are_outside_and_inside_of_the_model() {
    check_model("ring", &ring());
    check_model("cup", &cup());
}

fn check_model(name: &str, mesh: &TriangleMesh) {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("scan.obj");
    fs::write(&source, obj(mesh)).unwrap();
    let out = folder.path().join(format!("{name}.toml"));
    imported(&source, &out, &["--mass", "0.1"]);
    let checked = stdout(&catchingbot(&["check", out.to_str().unwrap()]));
    let number = |after: &str| -> f64 {
        let (_, rest) = checked.split_once(after).unwrap_or_else(|| panic!("{checked}"));
        rest.split_whitespace().next().unwrap().trim_end_matches(['%', ')', ',']).parse().unwrap()
    };
    assert!(number("its centre of mass is ") <= 2.0, "{checked}");
    assert!((number("model: volume ") / number("(the mesh: ") - 1.0).abs() < 0.15, "{checked}");
    assert!(checked.contains("symmetry: about an axis"), "{checked}");
    assert!(number("grasps: ") > 0.0 && checked.contains("in paper"), "{checked}");
}

#[test]
fn what_cannot_be_imported_is_refused_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let mut open = bottle();
    open.triangles.retain(|it| it.iter().any(|vertex| open.vertices[*vertex as usize].z > 1.0));
    let open = write("open.obj", obj(&open).as_bytes());
    let two = "<robot name=\"r\"><link name=\"a\"><visual><geometry><sphere radius=\"0.03\"/></geometry></visual></link>\
        <link name=\"b\"><visual><geometry><sphere radius=\"0.03\"/></geometry></visual></link>\
        <joint name=\"j\" type=\"fixed\"><parent link=\"a\"/><child link=\"b\"/></joint></robot>";
    let two = write("two.urdf", two.as_bytes());
    let draco = write("c.gltf", br#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#);
    let early = write(
        "e.gltf",
        br#"{"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":9000000,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":4}],"buffers":[{"uri":"data:;base64,AAAAAA=="}]}"#,
    );
    let loops = write("l.gltf", br#"{"nodes":[{"children":[0]}]}"#);
    let ball = write("ball.obj", obj(&TriangleMesh::sphere(0.03, 2)).as_bytes());
    let many = folder.path().join("many");
    fs::create_dir(&many).unwrap();
    ["a.obj", "b.obj"].iter().for_each(|name| fs::write(many.join(name), "v 0 0 0\n").unwrap());
    let out = folder.path().join("out.toml");
    let out = out.to_str().unwrap();
    for (arguments, expected) in [
        (vec![&open[..], "--fill-holes", "0.01"], "a hole of 49.9 mm around ["),
        (vec![&two], "found 2 with shapes: a, b, expected one of them as `--link NAME`"),
        (vec![&two, "--link", "c"], "--link: found `c`, expected one of a, b"),
        (vec![&draco], "KHR_draco_mesh_compression"),
        (vec![&early], "a buffer that ends early"),
        (vec![&loops], "nodes without end"),
        (vec![&ball, "--scale", "100"], "something 6.000 m long"),
        (vec![&ball, "--mass", "80"], "--mass: found 80"),
        (vec![many.to_str().unwrap()], "the folder: found 2 files: a.obj, b.obj"),
        (vec!["none.ply"], "none.ply: the file"),
    ] {
        let output = catchingbot(&[&["object", "import", "--out", out], &arguments[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stdout(&output));
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
        assert!(!Path::new(out).exists());
    }
    let output = catchingbot(&["object", "import", &ball, "--out", "/"]);
    assert!(stderr(&output).contains("a folder NAME or a file NAME.toml"), "{}", stderr(&output));
}
