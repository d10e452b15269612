//! Files that this program writes and reads again: a valid one of each kind.

use std::{fs, path::Path};

use catch_body::{InputError, Robot, robot_file::RobotFiles};
use catch_bot::trajectory_optimization::reach_map::{ReachMap, ReachSamples};
use catch_cell::{RigCalibration, rig_from_toml, rig_to_toml};
use catch_lab::{
    evaluation::{Cell, Evaluation, results::Results},
    flights::{flight_prior::FlightPrior, track_file},
    recording::throw_times::ThrowTimes,
    scenario::setup::{Choice, Setup},
};
use serde_json::json;

use super::{Load, Mutator, read, root, text};

/// Ways of loading for the files that this program writes, recordings aside.
pub fn loads() -> Vec<(String, Load<'static>)> {
    let [of_rows, of_identity] = results();
    let learned = FlightPrior::any_object().text().unwrap();
    let times = json!({
        "stages": { "tick": { "count": 2, "p50_ms": 0.1, "p99_ms": 0.2, "max_ms": 0.2 } },
        "ticks": [{ "time_s": 0.1, "stage_ms": [["perception", 0.2]] }],
    });
    let times_of = |file: &Path| {
        let read = ThrowTimes::read(&file.with_extension("").with_extension("catch"));
        read.map(drop).ok_or_else(|| ignored("a.times.json"))
    };
    let rig = calibrated_rig();
    vec![
        ("rows".into(), of_rows),
        ("evaluation".into(), of_identity),
        ("learned flight".into(), file("f.toml", learned, |file| FlightPrior::read(file).map(drop))),
        ("wall times".into(), file("a.times.json", times.to_string(), times_of)),
        ("calibrated rig".into(), Box::new(move |it| rig_from_toml("r.toml", &text(it.text(&rig))?).map(drop))),
        ("track with orientations".into(), track()),
        ("reach map".into(), reach_map()),
    ]
}

/// Error about a file that the program ignores.
fn ignored(file: &str) -> InputError {
    InputError::new(file, "content", "another", "what the program has written")
}

/// Changes a text and reads it from a file.
fn file(name: &'static str, right: String, load: impl Fn(&Path) -> Result<(), InputError> + 'static) -> Load<'static> {
    let folder = tempfile::tempdir().unwrap();
    Box::new(move |it| {
        let path = folder.path().join(name);
        fs::write(&path, it.text(&right)).unwrap();
        load(&path)
    })
}

/// Rows and their identity, as an evaluation that goes on finds them.
fn results() -> [Load<'static>; 2] {
    ["trials.jsonl", "evaluation.toml"].map(|changed| -> Load<'static> {
        let setup = Setup::load(&Choice::default()).unwrap();
        let evaluation = Evaluation { cells: vec![Cell::new(setup)], seed: 1, first: 0, trials: 3 };
        let folder = tempfile::tempdir().unwrap();
        let (mut results, _) = Results::open(folder.path(), &evaluation, false).unwrap();
        evaluation.run(0, 1, &mut |row, _| results.add(&row)).unwrap();
        drop(results);
        let right = read(&folder.path().join(changed));
        Box::new(move |it: &mut Mutator| {
            fs::write(folder.path().join(changed), it.text(&right)).unwrap();
            Results::open(folder.path(), &evaluation, true).map(drop)
        })
    })
}

fn calibrated_rig() -> String {
    let cameras = rig_from_toml("r.toml", &read(&root().join("assets/rigs/d435_2.toml"))).unwrap();
    let known = RigCalibration {
        covariance: (0..36).map(|i| if i % 7 == 0 { 1e-6 } else { 0.0 }).collect(),
        depth_scale: 0.001,
        time_offset_s: 0.002,
        time_offset_sd_s: Some(0.001),
        inverse_depth_sd_per_m: 0.004,
        silhouette_sd_px: 1.0,
        images: 12,
    };
    let cameras: Vec<_> = cameras.into_iter().map(|camera| (camera, Some(known.clone()))).collect();
    rig_to_toml("Calibrated.", &cameras)
}

fn track() -> Load<'static> {
    let row = |i: u32| format!("{},{},0.1,1,0,0,0,1\n", 0.01 * f64::from(i), 0.02 * f64::from(i));
    let track: String = (0..40).map(row).collect();
    Box::new(move |it| track_file::parse("t.csv", &text(it.text(&track))?).map(drop))
}

/// A map from few samples.
fn reach_map() -> Load<'static> {
    let [urdf, toml] = ["robot.urdf", "robot.toml"].map(|it| read(&root().join("assets/robots/iiwa14").join(it)));
    let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
    let robot = Robot::from_files(&files).unwrap();
    let mut samples = ReachSamples::new(&robot);
    samples.draw(0);
    let right = samples.map().to_bytes();
    Box::new(move |it| {
        let map = ReachMap::from_bytes(&robot, &it.bytes(&right));
        map.map(drop).ok_or_else(|| ignored("a.map"))
    })
}
