//! Whatever a file holds that the program accepts, the command that uses it ends with finite results;
//! whatever it refuses, it says why.
//!
//! Files of every kind are changed at random, always in the same way. Some belong to the suite; as many of
//! each kind as one likes are tried by
//!
//! ```sh
//! CATCHINGBOT_MUTATIONS=800 cargo test --release -p catch_cli --test it mutated_files -- --ignored --nocapture
//! ```

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use catch_body::TriangleMesh;
use serde_json::Value;

use crate::{catchingbot, depth_scan, mutations::mutator::Mutator};

/// CPU seconds and KiB of memory after which the system ends the program.
const MOST_CPU_S: u32 = 60;
const MOST_KIB: u32 = 4 << 20;

/// A right file, and the command that uses it.
struct Kind {
    name: String,
    /// Files beside the changed one.
    beside: Vec<(String, Vec<u8>)>,
    file: String,
    right: Vec<u8>,
    /// `FILE` and `FOLDER` stand for the changed file and for the folder that it lies in.
    command: Vec<String>,
}

impl Kind {
    fn new(name: &str, file: &str, right: impl Into<Vec<u8>>, command: &str) -> Self {
        let command = command.split(' ').map(str::to_owned).collect();
        Self { name: name.to_owned(), beside: Vec::new(), file: file.to_owned(), right: right.into(), command }
    }

    fn beside(mut self, file: &str, content: impl Into<Vec<u8>>) -> Self {
        self.beside.push((file.to_owned(), content.into()));
        self
    }
}

/// The files that are built in, by their folder.
fn assets(folder: &str) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<PathBuf> = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets").join(folder))
        .unwrap()
        .map(|it| it.unwrap().path())
        .collect();
    files.sort();
    files.iter().map(|it| (it.file_stem().unwrap().display().to_string(), fs::read(it).unwrap())).collect()
}

fn kinds() -> Vec<Kind> {
    let mut kinds = Vec::new();
    let mut add = |kind: Kind| kinds.push(kind);
    let throw = "catch --json";
    for (name, right) in assets("scenarios") {
        add(Kind::new(&format!("scenario {name}"), "s.toml", right, &format!("{throw} --scenario FILE")));
    }
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        for (name, right) in assets(&format!("objects/{object}")) {
            let file = format!("{name}.toml");
            let other = if name == "truth" { "known" } else { "truth" };
            let beside = assets(&format!("objects/{object}")).into_iter().find(|(it, _)| it == other).unwrap().1;
            let kind = Kind::new(&format!("object {object}, {name}"), &file, right, &format!("{throw} --object FILE"));
            add(kind.beside(&format!("{other}.toml"), beside));
        }
    }
    for (name, right) in assets("cameras") {
        add(Kind::new(&format!("camera {name}"), "c.toml", right, &format!("{throw} --set camera=FILE")));
    }
    for (name, right) in assets("throws") {
        let command = format!("{throw} --scenario honest --throw FILE");
        add(Kind::new(&format!("throw {name}"), "t.toml", right, &command));
    }
    for (name, right) in assets("rigs") {
        let use_of_it = if name.contains("reference") { "reference_rig" } else { "flight_rig" };
        let command = format!("{throw} --set {use_of_it}=FILE");
        add(Kind::new(&format!("rig {name}"), "r.toml", right, &command));
    }
    for (name, right) in assets("grippers") {
        add(Kind::new(&format!("gripper {name}"), "g.toml", right, &format!("{throw} --set gripper=FILE")));
    }
    for (name, right) in assets("workcells") {
        add(Kind::new(&format!("workcell {name}"), "w.toml", right, &format!("{throw} --workcell FILE")));
    }
    let [urdf, toml] = ["robot.urdf", "robot.toml"].map(|file| {
        fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/robots/iiwa14").join(file)).unwrap()
    });
    let robot = format!("{throw} --robot FOLDER/robot.toml");
    add(Kind::new("robot TOML", "robot.toml", toml.clone(), &robot).beside("robot.urdf", urdf.clone()));
    add(Kind::new("robot URDF", "robot.urdf", urdf, &robot).beside("robot.toml", toml));
    add_meshes_and_data(&mut add);
    kinds
}

fn add_meshes_and_data(add: &mut impl FnMut(Kind)) {
    let object = "name = \"thing\"\n[truth]\nmass_kg = 0.1\nrestitution = 0.3\ndrag_per_m = 0.0\n\
                  shape = { kind = \"mesh\", file = \"a.obj\" }\n[known]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n";
    let command = "catch --json --object FOLDER/o.toml";
    add(Kind::new("mesh OBJ", "a.obj", octahedron(), command).beside("o.toml", object));
    let rows: Vec<String> = (0..200)
        .map(|i| {
            let (z, angle) = (f64::from(i) / 100.0 - 0.995, 2.4 * f64::from(i));
            let r = (1.0 - z * z).sqrt();
            let n = [r * libm::cos(angle), r * libm::sin(angle), z];
            format!("{} {} {} {} {} {}", 0.05 * n[0], 0.03 * n[1], 0.08 * n[2], n[0], n[1], n[2])
        })
        .collect();
    let header = "ply\nformat ascii 1.0\nelement vertex 200\nproperty float x\nproperty float y\nproperty float z\n\
                  property float nx\nproperty float ny\nproperty float nz\nend_header\n";
    let cloud = header.to_owned() + &rows.join("\n") + "\n";
    let command = "register --cloud FILE --reference FOLDER/right.ply --json";
    add(Kind::new("cloud PLY", "a.ply", cloud.clone(), command).beside("right.ply", cloud.clone()));
    add(Kind::new("cloud XYZ", "a.xyz", rows.join("\n"), command).beside("right.ply", cloud));
    let track: String = (0..60)
        .map(|i| {
            let t = 0.01 * f64::from(i);
            let angle = 3.0 * t;
            let (q, z) = ([libm::sin(angle), 0.0, 0.0, libm::cos(angle)], 1.0 + 4.0 * t - 4.905 * t * t);
            format!("{t},{},{},{z},{},{},{},{}\n", 2.0 * t, -1.5 * t, q[0], q[1], q[2], q[3])
        })
        .collect();
    add(Kind::new("track", "t.csv", track.clone(), "predict --track FILE --up z --at 0.7 --json"));
    add(depth_scan());
    let learned = assets("flights").remove(0).1;
    let command = "predict --track FOLDER/t.csv --object FILE --json";
    add(Kind::new("learned flight", "f.toml", learned, command).beside("t.csv", track));
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../catch_bot/benches/cases/planner_cases.json");
    let mut cases: Value = serde_json::from_slice(&fs::read(cases).unwrap()).unwrap();
    if let Some(list) = cases["cases"].as_array_mut() {
        list.truncate(2);
    }
    add(Kind::new("cases", "c.json", cases.to_string(), "plan --cases FILE --json"));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("results");
    catchingbot(&[&["eval"], PAPER_EVALUATION, &["--out", out.to_str().unwrap()]].concat());
    let [log, identity] = ["trials.jsonl", "evaluation.toml"].map(|it| fs::read(out.join(it)).unwrap());
    let resume = &format!("eval {} --resume --json --out FOLDER", PAPER_EVALUATION.join(" "));
    add(Kind::new("rows", "trials.jsonl", log.clone(), resume).beside("evaluation.toml", identity.clone()));
    add(Kind::new("evaluation", "evaluation.toml", identity, resume).beside("trials.jsonl", log));
}

/// The cameras of a scan of a ball.
fn depth_scan() -> Kind {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("scan");
    depth_scan::write(&scan, &TriangleMesh::sphere(0.05, 3));
    let command = "object import FOLDER --out FOLDER/o/ball --json";
    let files = fs::read_dir(scan).unwrap().map(|it| it.unwrap().path());
    let images = files.filter(|it| it.extension().is_some_and(|it| it == "png"));
    images.fold(Kind::new("depth scan", "rig.toml", depth_scan::RIG, command), |kind, image| {
        kind.beside(image.file_name().unwrap().to_str().unwrap(), fs::read(&image).unwrap())
    })
}

/// An evaluation of a throw that is always the same.
const PAPER_EVALUATION: &[&str] = &["--scenario", "paper", "--trials", "4", "--object", "banana", "--throw", "near"];

/// Eight triangles.
fn octahedron() -> &'static str {
    "v 0.03 0 0\nv -0.03 0 0\nv 0 0.03 0\nv 0 -0.03 0\nv 0 0 0.05\nv 0 0 -0.05\n\
     f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n"
}

/// Results of the changed files of one kind.
#[derive(Default)]
struct Outcome {
    used: usize,
    told: usize,
    untold: usize,
    failures: Vec<String>,
}

/// Changes a file as `mutator` says and runs its command.
fn use_changed(kind: &Kind, seed: u64, mut mutator: Mutator, outcome: &mut Outcome) {
    let folder = tempfile::tempdir().unwrap();
    let at = |file: &str| folder.path().join(file);
    for (file, content) in &kind.beside {
        fs::write(at(file), content).unwrap();
    }
    let right = std::str::from_utf8(&kind.right).expect("these files are text");
    fs::write(at(&kind.file), mutator.text(right)).unwrap();
    let named = |it: &String| {
        it.replace("FILE", at(&kind.file).to_str().unwrap()).replace("FOLDER", folder.path().to_str().unwrap())
    };
    let limits = format!("ulimit -t {MOST_CPU_S} -v {MOST_KIB}; exec \"$0\" \"$@\"");
    let output = Command::new("sh")
        .args(["-c", &limits, env!("CARGO_BIN_EXE_catchingbot")])
        .args(kind.command.iter().map(named))
        .current_dir(folder.path())
        .output()
        .unwrap();
    let mut failed = |why: String| outcome.failures.push(format!("{} {seed}: {why}", kind.name));
    let complaint = String::from_utf8_lossy(&output.stderr);
    if complaint.contains("panicked") {
        return failed(complaint.into_owned());
    }
    let Ok(document) = serde_json::from_slice::<Value>(&output.stdout) else {
        return failed(format!("{}: no JSON document: {complaint}", output.status));
    };
    match output.status.code() {
        Some(0) if document["faults"].as_array().is_none_or(Vec::is_empty) => outcome.used += 1,
        Some(0 | 2) => {
            let faults = document["faults"].as_array().cloned().unwrap_or_default();
            let has_all = |fault: &Value| {
                let texts = ["file", "field", "found", "expected"].map(|it| fault[it].as_str().unwrap_or_default());
                texts.iter().all(|it| !it.is_empty()) && texts[1] != "the file"
            };
            if !faults.is_empty() && faults.iter().all(has_all) {
                outcome.told += 1;
            } else {
                println!("{} {seed}: {document}", kind.name);
                outcome.untold += 1;
            }
        }
        _ => failed(format!("{}: {document}", output.status)),
    }
}

/// Tries so many changes of each kind, prints a table, and complains of failures.
fn try_all(count: u64) {
    println!("| file | tried | used | refused | of them told |\n|---|---|---|---|---|");
    let mut all = Outcome::default();
    for (seeds, kind) in kinds().iter().enumerate() {
        let mut right = Outcome::default();
        use_changed(kind, 0, Mutator::idle(), &mut right);
        assert!(right.used == 1, "{}: the right file is refused: {:#?}", kind.name, right.failures);
        let mut outcome = Outcome::default();
        for seed in (seeds as u64 * 1_000_000..).take(count as usize) {
            use_changed(kind, seed, Mutator::new(seed), &mut outcome);
        }
        let refused = outcome.told + outcome.untold;
        println!("| {} | {count} | {} | {refused} | {} |", kind.name, outcome.used, outcome.told);
        all.used += outcome.used;
        all.told += outcome.told;
        all.untold += outcome.untold;
        all.failures.extend(outcome.failures);
    }
    let refused = all.told + all.untold;
    println!("{} used, {refused} refused, {} of them with file, field, value and remedy", all.used, all.told);
    assert!(all.failures.is_empty(), "{:#?}", all.failures);
    assert!(100 * all.told >= 99 * refused, "{} of {refused} refusals say what would be right", all.told);
}

#[test]
fn some_mutated_files_are_used_or_refused() {
    try_all(1);
}

#[test]
#[ignore = "takes as long as one likes"]
fn as_many_mutated_files_as_one_likes() {
    try_all(std::env::var("CATCHINGBOT_MUTATIONS").ok().and_then(|it| it.parse().ok()).unwrap_or(20));
}
