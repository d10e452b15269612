//! `learn`, and `predict` with what was learned, on tumbling throws and on tracks that are none.

use std::{fmt::Write, fs, path::Path};

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

fn json(arguments: &[&str]) -> Value {
    let output = catchingbot(arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

/// A tumbling object with drag by direction, 15 mm beside whose centre of mass a point is tracked at 100 Hz;
/// y is up. Another throw for each number; bounces from a floor, if there is one.
fn write_throw(path: &Path, number: u32, rows: u32, floor_m: f64, unit_m: f64) -> [f64; 3] {
    let turn = f64::from(number);
    let drag = Matrix3::from_diagonal(&Vector3::new(0.1, 0.06, 0.03));
    let point = Vector3::new(0.01, -0.01, 0.005);
    let (mut p, mut v) = (Vector3::new(0.0, 1.2, 0.0), Vector3::new(5.0 + 0.2 * turn, 4.0, 0.5 * libm::sin(turn)));
    let (mut R, w) = (
        UnitQuaternion::from_euler_angles(turn, 0.4 * turn, -0.3),
        Vector3::new(6.0 + libm::sin(turn), 9.0 * libm::cos(turn), -4.0),
    );
    let mut text = "t,x,y,z,qx,qy,qz,qw\n".to_owned();
    let mut last = [0.0; 3];
    for i in 0..rows {
        // This is as good as noise of 0.3 mm.
        let noise = Vector3::from_fn(|axis, _| 4e-4 * libm::sin(f64::from(i * 37 + number * 11) + 2.0 * axis as f64));
        let seen = (p + R * point + noise) / unit_m;
        last = seen.into();
        let q = R.coords;
        writeln!(text, "{:.4},{},{},{},{},{},{},{}", f64::from(i) * 0.01, seen.x, seen.y, seen.z, q.x, q.y, q.z, q.w)
            .unwrap();
        for _ in 0..100 {
            let h = 1e-4;
            let force = R * (drag * (R.inverse() * v)) * v.norm();
            v += (Vector3::y() * -9.81 - force + w.cross(&v) * 0.003) * h;
            p += v * h;
            R = UnitQuaternion::from_scaled_axis(w * h) * R;
            if p.y < floor_m && v.y < 0.0 {
                v.y *= -0.7;
            }
        }
    }
    fs::write(path, text).unwrap();
    last
}

#[test]
fn what_is_learned_predicts_other_throws() {
    let folder = tempfile::tempdir().unwrap();
    let throws = folder.path().join("throws");
    fs::create_dir(&throws).unwrap();
    for number in 0..6 {
        write_throw(&throws.join(format!("{number}.csv")), number, 60, -9.0, 1.0);
    }
    let file = folder.path().join("object.toml");
    let [throws, out] = [&throws, &file].map(|it| it.to_str().unwrap());
    let document = json(&["learn", "--tracks", throws, "--up", "y", "--out", out, "--folds", "2", "--json"]);
    let half = &document["cross_validated"][0];
    assert_eq!((half["seen"].as_str(), half["throws"].as_u64()), (Some("half"), Some(6)));
    assert!(half["median_m"].as_f64().unwrap() < 0.05, "{half}");

    let track = folder.path().join("new.csv");
    let end = write_throw(&track, 9, 80, -9.0, 1.0);
    let track = track.to_str().unwrap();
    for object in [&["--object", out][..], &[]] {
        let asked = ["predict", "--track", track, "--up", "y", "--until", "0.4", "--json"];
        let document = json(&[&asked, object].concat());
        assert_eq!(document["status"], "predicted");
        let position = &document["end"]["position"];
        let error: f64 = (0..3).map(|i| (position[i].as_f64().unwrap() - end[i]).powi(2)).sum::<f64>().sqrt();
        assert!(error < 0.05, "{object:?}: {error}");
        assert_eq!(document["end"]["covariance"].as_array().unwrap().len(), 6);
    }
}

#[test]
fn a_contact_is_reported_and_what_does_not_fall_has_a_status() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.csv");
    let track = path.to_str().unwrap();
    write_throw(&path, 1, 100, 1.0, 1.0);
    let bounced = json(&["predict", "--track", track, "--up", "y", "--json"]);
    let contact_s = bounced["contact_s"].as_f64().unwrap();
    assert!((0.7..0.9).contains(&contact_s), "{bounced}");
    let seen = ["predict", "--track", track, "--until", "0.6", "--json"];
    assert!(json(&[&seen[..], &["--up", "y"]].concat())["contact_s"].is_null());
    let wrong = json(&seen);
    assert_eq!((&wrong["status"], &wrong["end"]), (&"no_gravity".into(), &Value::Null));
    write_throw(&path, 1, 60, -9.0, 1e-3);
    assert_eq!(json(&["predict", "--track", track, "--up", "y", "--json"])["status"], "no_gravity", "millimetres");
    let shown = catchingbot(&["predict", "--track", track, "--up", "y"]);
    assert!(stdout(&shown).contains("9.81 m/s²"), "{}", stdout(&shown));
}

/// A track may have any axis up.
#[test]
fn any_axis_may_point_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.csv");
    let row = |i: u32, axes: [usize; 3], sign: f64| {
        let t = f64::from(i) * 0.01;
        let p = [3.0 * t + 0.5, 0.4 * t, 1.0 + (3.5 * t - 4.905 * t * t) * sign];
        format!("{t},{},{},{}\n", p[axes[0]], p[axes[1]], p[axes[2]])
    };
    for (axes, name) in [([2, 0, 1], "x"), ([0, 2, 1], "y"), ([0, 1, 2], "z")] {
        for sign in [1.0, -1.0] {
            fs::write(&path, (0..50).map(|i| row(i, axes, sign)).collect::<String>()).unwrap();
            let up = if sign > 0.0 { name.to_owned() } else { format!("-{name}") };
            let track = path.to_str().unwrap();
            assert_eq!(json(&["predict", "--track", track, "--up", &up, "--json"])["status"], "predicted", "{up}");
            let wrong = if sign > 0.0 { format!("-{name}") } else { format!("+{name}") };
            assert_eq!(json(&["predict", "--track", track, "--up", &wrong, "--json"])["status"], "no_gravity", "{up}");
        }
    }
}

/// One sample in ten of the sample track is an outlier.
#[test]
fn outliers_are_no_contact() {
    let folder = tempfile::tempdir().unwrap();
    assert!(catchingbot(&["new", "track", "sample", "--out", folder.path().to_str().unwrap()]).status.success());
    let track = folder.path().join("sample.csv");
    for until in ["0.3", "0.4", "0.59"] {
        let document = json(&["predict", "--track", track.to_str().unwrap(), "--until", until, "--json"]);
        assert!(document["contact_s"].is_null(), "{document}");
        let end = &document["end"];
        let (time_s, position) = (end["time_s"].as_f64().unwrap(), &end["position"]);
        let right = [2.0 - 3.0 * time_s, 0.4 * time_s, 1.0 + 3.5 * time_s - 4.905 * time_s * time_s];
        for (i, right) in right.into_iter().enumerate() {
            assert!((position[i].as_f64().unwrap() - right).abs() < 0.02, "until {until}: {document}");
        }
    }
}

#[test]
fn as_many_rows_as_a_file_may_have_are_fitted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.csv");
    for orientation in ["", ",0,0,0,1"] {
        let row = |i: u32| {
            let t = f64::from(i) * 4e-6;
            format!("{t:.6},{:.7},0,{:.7}{orientation}\n", 3.0 * t, 4.0 * t - 4.905 * t * t)
        };
        fs::write(&path, (0..250_000).map(row).collect::<String>()).unwrap();
        let track = path.to_str().unwrap();
        let document = json(&["predict", "--track", track, "--until", "0.7", "--json"]);
        assert_eq!(document["status"], "predicted");
        assert!((document["end"]["position"][0].as_f64().unwrap() - 3.0).abs() < 0.05, "{document}");
    }
}

#[test]
fn files_that_teach_nothing_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("0.csv");
    write_throw(&path, 1, 60, -9.0, 1.0);
    let few = folder.path().to_str().unwrap();
    let out = folder.path().join("out.toml");
    let out = out.to_str().unwrap();
    let track = path.to_str().unwrap();
    for (arguments, hint) in [
        (vec!["learn", "--tracks", few, "--out", out], "5 or more"),
        (vec!["learn", "--tracks", "no-folder", "--out", out], "no-folder"),
        (vec!["predict", "--track", track, "--object", "missing.toml"], "missing.toml"),
        (vec!["predict", "--track", track, "--object", track], "catchingbot learn"),
    ] {
        let output = catchingbot(&arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(hint), "{arguments:?}: {}", stderr(&output));
    }
}

/// A folder of tracks is a throw: released as recorded, or moved along the recording.
#[test]
fn recorded_tracks_are_thrown() {
    let folder = tempfile::tempdir().unwrap();
    let throws = folder.path().join("tumbling");
    fs::create_dir(&throws).unwrap();
    for number in 0..2 {
        write_throw(&throws.join(format!("{number}.csv")), number, 70, -9.0, 1.0);
    }
    let out = folder.path().join("out");
    let [throws, out] = [&throws, &out].map(|it| it.to_str().unwrap());
    let prior = "brain.trajectory_prediction.spin_prior_sd_radps=8";
    let run = |throw: &str| {
        json(&[
            "catch",
            "--scenario",
            "paper",
            "--object",
            "tennis_ball",
            "--throw",
            throw,
            "--set",
            prior,
            "--out",
            out,
            "--seed",
            "2",
            "--json",
        ])
    };
    let released = run(throws);
    assert_eq!(released["scene"]["throw"], "tumbling");
    assert!(released["caught"].as_bool().unwrap(), "{}", released["reason"]);
    fs::write(Path::new(throws).join("throw.toml"), "[motion]\nkind = \"recorded\"\nflight = \"recorded\"\n").unwrap();
    let recorded = run(throws);
    assert_eq!(recorded["scene"]["throw"], "tumbling");
    assert_ne!(released["measures"], recorded["measures"]);
    let life = json(&["play", "--scenario", "paper", "--throw", throws, "--trials", "2", "--set", prior, "--json"]);
    assert_eq!(life["throws"], 2);
}

#[test]
fn tracks_that_cannot_be_thrown_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one.csv");
    let throw = folder.path().to_str().unwrap();
    let refused = |expected: &[&str]| {
        let output = catchingbot(&["catch", "--throw", throw, "--out", throw]);
        assert_eq!(output.status.code(), Some(2), "{}", stdout(&output));
        let fault = stderr(&output);
        assert!(expected.iter().all(|it| fault.contains(it)), "{expected:?}: {fault}");
    };
    refused(&["CSV files: found 0"]);
    write_throw(&path, 1, 60, -9.0, 1e-3);
    refused(&["one.csv: x, y, z", "places in metres"]);
    write_throw(&path, 1, 20, -9.0, 1.0);
    refused(&["one.csv: t", "0.3 s or more"]);
    write_throw(&path, 1, 3, -9.0, 1.0);
    refused(&["one.csv: rows: found 3", "6 or more"]);
    let still: String = (0..60).map(|i| format!("{},1,2,3\n", f64::from(i) * 0.01)).collect();
    fs::write(&path, still).unwrap();
    refused(&["one.csv: x, y, z", "9.81 m/s²"]);
    fs::write(&path, "0,NaN,2,3\n").unwrap();
    refused(&["one.csv: rows"]);
    write_throw(&path, 1, 60, -9.0, 1.0);
    let whole = fs::read_to_string(&path).unwrap();
    let with_gap: Vec<&str> = whole.lines().enumerate().filter(|(i, _)| !(20..35).contains(i)).map(|it| it.1).collect();
    fs::write(&path, with_gap.join("\n")).unwrap();
    refused(&["one.csv: t: found none from", "every 0.1 s"]);
}
