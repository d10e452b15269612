//! Other people's data: recorded tracks and point clouds from files.

use std::{f64::consts::TAU, fmt::Write, fs, path::Path};

use catch_body::{TriangleMesh, mesh::TubeRing};
use catch_sim::random_streams::{Draws, Stream};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

fn json(arguments: &[&str]) -> Value {
    let output = catchingbot(arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_iterator(value.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()))
}

/// Position and velocity after each hundredth of a second under gravity along −z and quadratic drag, by fine
/// steps of Heun's method.
fn flight(drag_per_m: f64, count: usize) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let acceleration = |v: &Vector3<f64>| Vector3::new(0.0, 0.0, -9.81) - v * (drag_per_m * v.norm());
    let (mut p, mut v, h) = (Vector3::new(1.6, 1.6, 0.5), Vector3::new(-2.0, -3.0, 4.0), 1e-4);
    let mut states = vec![(p, v)];
    for _ in 1..count {
        for _ in 0..100 {
            let (a, v_end) = (acceleration(&v), v + acceleration(&v) * h);
            p += (v + v_end) * (h / 2.0);
            v += (a + acceleration(&v_end)) * (h / 2.0);
        }
        states.push((p, v));
    }
    states
}

/// A track with noise of 2 mm, every tenth sighting far off and every seventh missing.
fn write_track(path: &Path, states: &[(Vector3<f64>, Vector3<f64>)], up_is_y: bool) {
    let mut noise = Draws::new(Stream::Sensors, 3, 0);
    let mut text = "t,x,y,z\n".to_owned();
    for (i, (p, _)) in states.iter().enumerate() {
        let mut seen = p + Vector3::from_fn(|_, _| 0.002 * noise.normal());
        if i % 10 == 4 {
            seen += Vector3::new(0.1, -0.15, 0.05);
        }
        let seen = if up_is_y { Vector3::new(seen.x, seen.z, -seen.y) } else { seen };
        let t = i as f64 / 100.0;
        match i % 7 {
            3 => writeln!(text, "{t},NaN,,nan").unwrap(),
            _ => writeln!(text, "{t},{},{},{}", seen.x, seen.y, seen.z).unwrap(),
        }
    }
    fs::write(path, text).unwrap();
}

#[test]
fn a_track_is_predicted_within_what_is_claimed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.csv");
    let states = flight(0.12, 91);
    for up_is_y in [false, true] {
        write_track(&path, &states, up_is_y);
        let up = if up_is_y { "y" } else { "z" };
        let track = path.to_str().unwrap();
        let document = json(&["predict", "--track", track, "--up", up, "--until", "0.45", "--at", "0.7", "--json"]);
        assert_eq!(document["status"], "predicted");
        assert!((document["drag_per_m"].as_f64().unwrap() - 0.12).abs() < 0.03, "{document}");
        for (prediction, index) in [(&document["end"], 90), (&document["at"][0], 70)] {
            let (p, v) = states[index];
            let turned = |w: Vector3<f64>| if up_is_y { Vector3::new(w.x, w.z, -w.y) } else { w };
            let error = vector(&prediction["position"]) - turned(p);
            assert!(error.norm() < 0.02, "{error}");
            assert!((vector(&prediction["velocity"]) - turned(v)).norm() < 0.1);
            for axis in 0..3 {
                let variance = prediction["covariance"][axis][axis].as_f64().unwrap();
                assert!(error[axis].abs() < 4.0 * variance.sqrt(), "{error} but {variance}");
                assert!(variance.sqrt() < 0.03);
            }
        }
    }
}

#[test]
fn a_track_of_rows_that_are_no_flight_has_a_status() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.csv");
    let mut random = Pcg64::seed_from_u64(5);
    let rows = (0..40).map(|i| {
        let [x, y, z] = [0; 3].map(|_| random.random_range(-3.0..3.0));
        format!("{},{x},{y},{z}\n", f64::from(i) * 0.01)
    });
    fs::write(&path, rows.collect::<String>()).unwrap();
    let document = json(&["predict", "--track", path.to_str().unwrap(), "--json"]);
    let text = document.to_string();
    assert!(!text.contains("NaN"), "{text}");
    if document["status"] == "predicted" || document["status"] == "implausible" {
        // Agreement by accident promises little.
        for axis in 0..3 {
            let variance = document["end"]["covariance"][axis][axis].as_f64().unwrap();
            assert!(variance.sqrt() > 0.3, "{text}");
        }
    } else {
        assert!(document["end"].is_null(), "{text}");
    }
}

/// A bent tube of two thicknesses: no symmetry.
fn horn() -> TriangleMesh {
    let rings: Vec<TubeRing> = (0..24)
        .map(|i| {
            let fraction = f64::from(i) / 23.0;
            let (sin, cos) = libm::sincos(1.8 * fraction);
            let outwards = Vector3::new(0.0, cos, sin);
            TubeRing {
                centre: (outwards * 0.08).into(),
                axes: [Vector3::x(), outwards],
                semi_axes_m: [0.012 + 0.014 * fraction, 0.012 + 0.008 * fraction],
            }
        })
        .collect();
    TriangleMesh::tube(&rings, 48)
}

fn write_obj(path: &Path, mesh: &TriangleMesh) {
    let mut text = String::new();
    for vertex in &mesh.vertices {
        writeln!(text, "v {} {} {}", vertex.x, vertex.y, vertex.z).unwrap();
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
    }
    fs::write(path, text).unwrap();
}

#[test]
fn a_cloud_is_registered_against_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh_file, cloud_file) = (folder.path().join("horn.obj"), folder.path().join("seen.ply"));
    let mesh = horn();
    write_obj(&mesh_file, &mesh);
    let X_CR = nalgebra::Isometry3::from_parts(
        Vector3::new(0.7, -1.2, 2.1).into(),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), TAU * 0.3)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.1),
    );
    // Points of two cameras far away along x and y, with noise of half a millimetre.
    let mut random = Draws::new(Stream::Sensors, 7, 0);
    let mut points: Vec<Point3<f64>> = Vec::new();
    for [a, b, c] in mesh.all_corners() {
        let turned = X_CR.rotation * (b - a).cross(&(c - a));
        if turned.x > 0.0 || turned.y > 0.0 {
            let noise = Vector3::from_fn(|_, _| 0.0005 * random.normal());
            points.push(X_CR * Point3::from((a.coords + b.coords + c.coords) / 3.0) + noise);
        }
    }
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    for point in &points {
        writeln!(text, "{} {} {}", point.x, point.y, point.z).unwrap();
    }
    fs::write(&cloud_file, text).unwrap();
    // An object of the same shape, whose origin is its centre of mass.
    let object_file = folder.path().join("horn.toml");
    fs::write(
        &object_file,
        "name = \"horn\"\n[truth]\nmass_kg = 0.1\nrestitution = 0.3\ndrag_per_m = 0.0\n\
         shape = { kind = \"mesh\", file = \"horn.obj\" }\n[known]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n",
    )
    .unwrap();
    let centre = mesh.mass_properties(0.1).com;
    for (reference, origin) in [(&mesh_file, Point3::origin()), (&object_file, centre)] {
        let files = ["--cloud", cloud_file.to_str().unwrap(), "--reference", reference.to_str().unwrap()];
        let document = json(&[&["register"], &files[..], &["--json"]].concat());
        assert_eq!(document["status"], "registered", "{document}");
        let rotation = document["X_CR"]["rotation_xyzw"].as_array().unwrap();
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| rotation[i].as_f64().unwrap());
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).angle_to(&X_CR.rotation);
        let shift = (vector(&document["X_CR"]["translation_m"]) - (X_CR * origin).coords).norm();
        assert!(turn < 0.02 && shift < 0.002, "{turn} rad, {shift} m");
    }

    // Nothing is found in three points, and it says what may help.
    let few = folder.path().join("few.xyz");
    fs::write(&few, "0 0 0\n0 0 1\n0 1 0\n").unwrap();
    let output = catchingbot(&["register", "--cloud", few.to_str().unwrap(), "--reference", "banana"]);
    let said = stdout(&output);
    assert!(output.status.success() && said.contains("too_few_points") && said.contains("what may help"), "{said}");
}

#[test]
fn data_that_is_none_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let (short, words) = (file("short.csv", "0,1,2,3\n"), file("words.csv", "0,1,2,3\n1,a,b,c\n"));
    let (cloud, broken) = (file("one.xyz", "1 2 3\n"), file("broken.ply", "solid\n"));
    let (empty, unseen) = (file("empty.xyz", ""), file("unseen.xyz", "nan nan nan\n"));
    for (arguments, hint) in [
        (vec!["predict", "--track", &short], "6 rows or more"),
        (vec!["predict", "--track", &words], "line 2"),
        (vec!["predict", "--track", "missing.csv"], "missing.csv"),
        (vec!["register", "--cloud", &broken, "--reference", &cloud], "header"),
        (vec!["register", "--cloud", &empty, "--reference", "banana"], "points: found none"),
        (vec!["register", "--cloud", &unseen, "--reference", "banana"], "points: found none"),
        (vec!["register", "--cloud", &cloud, "--reference", &cloud], "a surface"),
        (vec!["register", "--cloud", &cloud, "--reference", &short, "--noise=-1"], "--noise"),
    ] {
        let output = catchingbot(&arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(hint), "{arguments:?}: {}", stderr(&output));
    }
}
