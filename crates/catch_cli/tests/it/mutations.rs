//! Whatever a file holds, its loader neither panics nor hangs nor swells, and a refusal says what would be
//! right.
//!
//! Files of every kind are changed at random, always in the same way. Some thousands of changes belong to the
//! suite; as many as one likes are tried by
//!
//! ```sh
//! CATCHINGBOT_MUTATIONS=20000 cargo test --release -p catch_cli --test it mutations -- --ignored --nocapture
//! ```

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod imported;
pub mod mutator;
mod values;
mod written;

use std::{
    collections::BTreeMap,
    fs,
    io::{Read, Write},
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    time::Duration,
};

use catch_body::{Gripper, InputError, Robot, TriangleMesh, mesh_file, robot_file::RobotFiles, visual::Visual};
use catch_cell::{DataSheet, ObjectFigures, rig_from_toml};
use catch_import::{cloud_file, templates};
use catch_lab::{
    assets::{Asset, Origin},
    flights::track_file,
    planner_cases, png,
    recording::replay::replay,
    scenario::{
        Scenario,
        setup::{Choice, Setup},
    },
    trial,
};
use catch_sim::{Throw, ThrownObject};
use catch_view::{pages::catch_page, playback::Playback};
use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use rmpv::Value;

use mutator::Mutator;

/// Root of the workspace.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|fault| panic!("{}: {fault}", path.display()))
}

/// No file may take longer, in CPU time of the thread.
const MOST_TIME: Duration = Duration::from_secs(5);
/// Nor more memory, in bytes.
const MOST_MEMORY: u64 = 1 << 30;

/// Results of the changed files of one kind.
#[derive(Debug, Default)]
struct Outcome {
    accepted: usize,
    /// Refusals that name file, field, value and remedy.
    told: usize,
    /// Other refusals.
    untold: usize,
    slowest: Duration,
    most_bytes: u64,
    /// Panics, hangs, swellings and results that are not finite, with the seed that makes each again.
    failures: Vec<String>,
}

/// Changes a file and loads it.
type Load<'a> = Box<dyn Fn(&mut Mutator) -> Result<(), InputError> + 'a>;

/// Tries `count` changes of one kind of file.
fn tried(kind: &str, count: u64, load: &Load) -> Outcome {
    let mut outcome = Outcome::default();
    // Else changes would test nothing but the first refusal.
    load(&mut Mutator::idle()).unwrap_or_else(|fault| panic!("{kind}: the right file is refused: {fault}"));
    for seed in 0..count {
        let start_ms = cpu_ms();
        let mut result = None;
        let memory = allocation_counter::measure(|| {
            result = Some(catch_unwind(AssertUnwindSafe(|| load(&mut Mutator::new(seed)))));
        });
        let took = Duration::from_secs_f64((cpu_ms() - start_ms) / 1e3);
        match result {
            Some(Ok(Ok(()))) => outcome.accepted += 1,
            Some(Ok(Err(fault))) if is_told(&fault) => outcome.told += 1,
            Some(Ok(Err(fault))) => {
                outcome.untold += 1;
                println!("{kind} {seed}: {fault}");
            }
            _ => outcome.failures.push(format!("{kind} {seed}: panicked")),
        }
        if took > MOST_TIME {
            outcome.failures.push(format!("{kind} {seed}: took {took:?}"));
        }
        if memory.bytes_max > MOST_MEMORY {
            outcome.failures.push(format!("{kind} {seed}: took {} bytes", memory.bytes_max));
        }
        outcome.slowest = outcome.slowest.max(took);
        outcome.most_bytes = outcome.most_bytes.max(memory.bytes_max);
    }
    outcome
}

/// CPU time of this thread in milliseconds, which other programs do not disturb; zero where it cannot be
/// told.
fn cpu_ms() -> f64 {
    #[cfg(unix)]
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    #[cfg(unix)]
    return time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6;
    #[cfg(not(unix))]
    0.0
}

/// Returns whether an error names file, field, value and remedy.
fn is_told(fault: &InputError) -> bool {
    let InputError { file, field, found, expected, .. } = fault;
    [file, field, found, expected].iter().all(|it| !it.is_empty()) && field != "the file"
}

fn text(changed: Vec<u8>) -> Result<String, InputError> {
    String::from_utf8(changed).map_err(|fault| {
        let byte = fault.utf8_error().valid_up_to();
        InputError::new("changed", format!("byte {byte}"), "no UTF-8", "text")
    })
}

fn finite(values: impl IntoIterator<Item = f64>) {
    assert!(values.into_iter().all(f64::is_finite), "an accepted file gives what is not finite");
}

/// A mesh as an OBJ file.
fn obj(mesh: &TriangleMesh) -> String {
    let vertices = mesh.vertices.iter().map(|it| format!("v {:.6} {:.6} {:.6}\n", it.x, it.y, it.z));
    let faces = mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(faces).collect()
}

/// A mesh as STL files: text and binary.
fn stl(mesh: &TriangleMesh) -> [Vec<u8>; 2] {
    let mut text = "solid s\n".to_owned();
    let mut binary = [vec![0; 80], (mesh.triangles.len() as u32).to_le_bytes().to_vec()].concat();
    for corners in mesh.all_corners() {
        text += "facet normal 0 0 1\nouter loop\n";
        binary.extend([0; 12]);
        for corner in corners {
            text += &format!("vertex {:.6} {:.6} {:.6}\n", corner.x, corner.y, corner.z);
            binary.extend(corner.iter().flat_map(|it| (*it as f32).to_le_bytes()));
        }
        text += "endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    [(text + "endsolid s\n").into_bytes(), binary]
}

/// Clouds in every format, with their extensions.
fn clouds() -> Vec<(&'static str, Vec<u8>)> {
    let points: Vec<[f32; 3]> = (0..20).map(|i| [0.01 * i as f32, 0.1, 0.2]).collect();
    let rows: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let raw: Vec<u8> = points.iter().flatten().flat_map(|it| it.to_le_bytes()).collect();
    let ply = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 20\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        )
    };
    let pcd = |data: &str| {
        format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\nHEIGHT 1\nPOINTS 20\nDATA {data}\n"
        )
    };
    let binary = |header: String| [header.into_bytes(), raw.clone()].concat();
    vec![
        ("text.ply", (ply("ascii") + &rows).into_bytes()),
        ("binary.ply", binary(ply("binary_little_endian"))),
        ("text.pcd", (pcd("ascii") + &rows).into_bytes()),
        ("binary.pcd", binary(pcd("binary"))),
        ("text.xyz", format!("x y z\n{rows}").into_bytes()),
    ]
}

/// A way of loading for every kind of file but recordings.
fn loads() -> BTreeMap<String, Load<'static>> {
    let asset = |path: &str| read(&root().join("assets").join(path));
    let mut loads: BTreeMap<String, Load> = BTreeMap::new();
    let mut add = |name: &str, load: Load<'static>| drop(loads.insert(name.to_owned(), load));
    for name in ["paper", "honest"] {
        let right = asset(&format!("scenarios/{name}.toml"));
        add(
            &format!("scenario {name}"),
            Box::new(move |it| {
                let (name, file, origin) = ("s".to_owned(), "s.toml".to_owned(), Origin::BuiltIn(PathBuf::new()));
                Scenario::of_asset(&Asset { name, file, text: text(it.text(&right))?, origin }).map(drop)
            }),
        );
    }
    let (urdf, toml) = (asset("robots/iiwa14/robot.urdf"), asset("robots/iiwa14/robot.toml"));
    let toml = toml + "[visuals.iiwa_link_1]\nmesh = 'visual/a.obj'\nsource = 'a ball'\n";
    let robot = |urdf: &str, toml: &str| {
        let robot = Robot::from_files(&RobotFiles { urdf_file: "robot.urdf", urdf, toml_file: "robot.toml", toml })?;
        finite(robot.gripper_pose(&robot.ready_q).translation.vector.iter().copied());
        Ok(())
    };
    let (right_urdf, right_toml) = (urdf.clone(), toml.clone());
    add("robot URDF", Box::new(move |it| robot(&text(it.text(&urdf))?, &right_toml)));
    add("robot TOML", Box::new(move |it| robot(&right_urdf, &text(it.text(&toml))?)));
    let ball = mesh_file::obj_text(&[TriangleMesh::sphere(0.1, 1)]);
    let visual: Visual = toml::from_str("mesh = 'visual/a.obj'\nsource = 'a ball'").unwrap();
    add(
        "visual mesh",
        Box::new(move |it| {
            let bytes = it.text(&ball);
            let mut visual = visual.clone();
            visual.read(&|name| Ok((name.to_owned(), bytes.clone())))?;
            finite(visual.mesh().unwrap().vertices.iter().flat_map(|it| <[f64; 3]>::from(it.coords)));
            Ok(())
        }),
    );
    let gripper = asset("grippers/wsg50.toml")
        + "[visuals.housing]\nmesh = 'a.obj'\nsource = 'a'\n[visuals.finger]\nmesh = 'b.obj'\nsource = 'b'\n";
    add(
        "gripper",
        Box::new(move |it| {
            let gripper = Gripper::from_toml("g.toml", &text(it.text(&gripper))?)?;
            finite(gripper.inertia(gripper.max_width_m).about_com.iter().copied());
            Ok(())
        }),
    );
    for file in fs::read_dir(root().join("assets/throws")).unwrap().map(|it| it.unwrap().path()) {
        let right = read(&file);
        let setup = Setup::load(&Choice { scenario: Some("honest"), ..Choice::default() }).unwrap();
        add(
            &format!("throw {}", file.file_stem().unwrap().display()),
            Box::new(move |it| {
                let throw = Throw::from_toml("t.toml", &text(it.text(&right))?)?;
                for index in 0..3 {
                    let release = throw.release("thing", &setup.conditions(1, index), 1, index);
                    finite(release.p_WO.iter().chain(release.v_WO.iter()).copied());
                }
                Ok(())
            }),
        );
    }
    for file in fs::read_dir(root().join("assets/rigs")).unwrap().map(|it| it.unwrap().path()) {
        let right = read(&file);
        add(
            &format!("rig {}", file.file_stem().unwrap().display()),
            Box::new(move |it| {
                let cameras = rig_from_toml("r.toml", &text(it.text(&right))?)?;
                finite(cameras.iter().flat_map(|it| it.X_WC.translation.vector.data.0[0]));
                Ok(())
            }),
        );
    }
    let object = |text: &str, mesh: &[u8]| {
        let object = ThrownObject::from_toml("o.toml", text, &|_| Ok(mesh.to_vec()))?;
        finite(object.inertia_kgm2.iter().copied().chain([object.bounding_radius_m]));
        Ok(())
    };
    for folder in fs::read_dir(root().join("assets/objects")).unwrap().map(|it| it.unwrap().path()) {
        let name = folder.file_name().unwrap().display();
        let (truth, known) = (read(&folder.join("truth.toml")), read(&folder.join("known.toml")));
        add(&format!("object {name}"), Box::new(move |it| object(&text(it.text(&truth))?, &[])));
        let figures = move |it: &mut Mutator| ObjectFigures::from_toml("known.toml", &text(it.text(&known))?).map(drop);
        add(&format!("knowledge of {name}"), Box::new(figures));
    }
    let sheet = asset("cameras/d435.toml");
    add("camera", Box::new(move |it| DataSheet::from_toml("c.toml", &text(it.text(&sheet))?).map(drop)));
    let sphere = TriangleMesh::sphere(0.03, 1);
    let of_mesh = |file: &str| {
        format!(
            "name = \"thing\"\n[truth]\nmass_kg = 0.1\nrestitution = 0.3\ndrag_per_m = 0.0\nshape = {{ kind = \"mesh\", file = \"{file}\" }}\n\
             [known]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n"
        )
    };
    let [stl_text, stl_binary] = stl(&sphere);
    let (of_obj, of_stl, right_obj) = (of_mesh("a.obj"), of_mesh("a.stl"), obj(&sphere));
    let also = (of_stl.clone(), right_obj.clone());
    add("OBJ", Box::new(move |it| object(&of_obj, &it.text(&right_obj))));
    add("OBJ groups", Box::new(move |it| mesh_file::groups_from_bytes("a.obj", &it.text(&also.1), 1.0).map(drop)));
    add("STL text", Box::new(move |it| object(&of_stl, &it.text(std::str::from_utf8(&stl_text).unwrap()))));
    add("STL binary", Box::new(move |it| object(&also.0, &it.bytes(&stl_binary))));
    for (file, right) in clouds() {
        add(
            file,
            Box::new(move |it| {
                let changed = match std::str::from_utf8(&right) {
                    Ok(text) if !file.starts_with("binary") => it.text(text),
                    _ => it.bytes(&right),
                };
                let cloud = cloud_file::parse(file, &changed, false)?;
                finite(cloud.points.iter().flat_map(|it| [it.x, it.y, it.z]));
                Ok(())
            }),
        );
    }
    let image = crate::depth_scan::gray16(5, 4, &(0..20).map(|it| it * 77).collect::<Vec<u16>>());
    add("PNG", Box::new(move |it| png::gray16_values("a.png", &it.bytes(&image), [5, 4]).map(drop)));
    let track: String =
        (0..40).map(|i| format!("{},{},0.1,{}\n", 0.01 * f64::from(i), 0.02 * f64::from(i), 1.0)).collect();
    add(
        "track CSV",
        Box::new(move |it| {
            let (track, end_s) = track_file::parse("t.csv", &text(it.text(&track))?)?;
            finite(track.iter().flat_map(|it| [it.time_s, it.p.x, it.p.y, it.p.z]).chain([end_s]));
            Ok(())
        }),
    );
    let cases = read(&root().join("crates/catch_bot/benches/cases/planner_cases.json"));
    add("cases JSON", Box::new(move |it| planner_cases::parse("c.json", &text(it.text(&cases))?).map(drop)));
    add(
        "template",
        Box::new(move |it| {
            let name = text(it.text("can"))?;
            templates::files(catch_lab::assets::Kind::Object, &name).map(drop)
        }),
    );
    loads.extend(imported::loads());
    loads.extend(written::loads());
    loads
}

/// A recording, shortened, as the values of its parts.
fn recorded_parts(folder: &Path) -> Vec<Value> {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    let recorded = catch_lab::recording::recorded_throw::record(&setup, 1, 0, folder, &mut |_| Ok(())).unwrap();
    let mut bytes = Vec::new();
    GzDecoder::new(fs::File::open(recorded.recording).unwrap()).read_to_end(&mut bytes).unwrap();
    let mut rest = &bytes[..];
    let mut parts = Vec::new();
    while !rest.is_empty() {
        parts.push(rmpv::decode::read_value(&mut rest).unwrap());
    }
    let ending = parts.pop().unwrap();
    let (header, ticks) = parts.split_first().unwrap();
    // The first ticks plan, one in ten later ones is enough.
    let few = ticks.iter().enumerate().filter(|(i, _)| *i < 12 || i % 10 == 0).map(|(_, tick)| tick.clone());
    [header.clone()].into_iter().chain(few).chain([ending]).collect()
}

/// Reads a changed recording as `view` and `replay` do.
fn load_recording(parts: &[Value], path: &Path, it: &mut Mutator, seed: u64) -> Result<(), InputError> {
    let which = [0, 1, parts.len() / 2, parts.len() - 1][seed as usize % 4];
    let mut changed = parts[which].clone();
    it.value(&mut changed);
    let mut out = GzEncoder::new(fs::File::create(path).unwrap(), Compression::fast());
    for (i, part) in parts.iter().enumerate() {
        let mut bytes = Vec::new();
        rmpv::encode::write_value(&mut bytes, if i == which { &changed } else { part }).unwrap();
        out.write_all(&bytes).unwrap();
    }
    out.finish().unwrap();
    let playback = Playback::read(path)?;
    // Packed numbers are in base64, in which these letters may follow each other.
    let is_packed =
        |it: &&str| it.len() > 40 && it.bytes().all(|it| it.is_ascii_alphanumeric() || b"+/=".contains(&it));
    let page = catch_page::page(&playback);
    assert!(!page.split('"').any(|it| !is_packed(&it) && it.contains("NaN")), "a page with what is no number");
    replay(path).map(drop)
}

/// Tries all loaders; returns what became of each kind.
fn run(count: u64, recordings: u64) -> BTreeMap<String, Outcome> {
    let mut outcomes: BTreeMap<String, Outcome> = BTreeMap::new();
    for (kind, load) in loads() {
        outcomes.insert(kind.clone(), tried(&kind, count, &load));
    }
    let folder = tempfile::tempdir().unwrap();
    let parts = recorded_parts(folder.path());
    let path = folder.path().join("changed.catch");
    let seed = std::cell::Cell::new(0);
    let load: Load = Box::new(|it| {
        seed.set(seed.get() + 1);
        load_recording(&parts, &path, it, seed.get())
    });
    outcomes.insert("recording".to_owned(), tried("recording", recordings, &load));
    outcomes
}

/// Prints a table of what became of the files, and complains of failures.
fn judge(outcomes: &BTreeMap<String, Outcome>) {
    println!("| file | tried | accepted | refused | of them told | slowest | memory |\n|---|---|---|---|---|---|---|");
    let (mut all, mut told, mut refused) = (0, 0, 0);
    for (kind, it) in outcomes {
        let refusals = it.told + it.untold;
        let tried = it.accepted + refusals + it.failures.len();
        (all, told, refused) = (all + tried, told + it.told, refused + refusals);
        let (slowest, mib) = (it.slowest.as_secs_f64(), it.most_bytes >> 20);
        println!("| {kind} | {tried} | {} | {refusals} | {} | {slowest:.2} s | {mib} MiB |", it.accepted, it.told);
    }
    println!("{all} files, {refused} refused, {told} of them with file, field, value and remedy");
    let failures: Vec<&String> = outcomes.values().flat_map(|it| &it.failures).collect();
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(100 * told >= 99 * refused, "{told} of {refused} refusals say what would be right");
}

#[test]
fn changed_files_are_read_or_refused() {
    judge(&run(200, 24));
}

/// Changes of each kind, `CATCHINGBOT_MUTATIONS` of them, a tenth of them of recordings.
#[test]
#[ignore = "takes as long as one likes"]
fn as_many_changed_files_as_one_likes() {
    let count = std::env::var("CATCHINGBOT_MUTATIONS").ok().and_then(|it| it.parse().ok()).unwrap_or(1000);
    judge(&run(count, count / 10));
}

/// An accepted scenario can be thrown: one throw for each of some changed scenarios.
#[test]
#[ignore = "takes as long as one likes"]
fn accepted_scenarios_run() {
    let count: u64 = std::env::var("CATCHINGBOT_MUTATIONS").ok().and_then(|it| it.parse().ok()).unwrap_or(50);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed.toml");
    let load: Load = Box::new(|it| {
        let right = read(&root().join("assets/scenarios/honest.toml"));
        fs::write(&path, it.text(&right)).unwrap();
        let setup = Setup::load(&Choice { scenario: path.to_str(), ..Choice::default() })?;
        let trial = trial::run(&setup, 1, 0, &mut |_, _| Ok(())).unwrap();
        finite(trial.truth.samples.iter().flat_map(|it| it.X_WO.translation.vector.data.0[0]));
        Ok(())
    });
    let outcome = tried("scenario, thrown", count, &load);
    // A throw takes its time.
    let failures: Vec<&String> = outcome.failures.iter().filter(|it| !it.contains("took")).collect();
    println!("{} thrown, {} refused, slowest {:?}", outcome.accepted, outcome.told, outcome.slowest);
    assert!(failures.is_empty(), "{failures:#?}");
}
