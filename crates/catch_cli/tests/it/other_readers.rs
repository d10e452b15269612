//! Comparison with other programs that read the files written and read here: Pinocchio, yourdfpy and mcap,
//! where pip has put them.

mod descriptions;
mod sdf;

use std::{
    fs,
    io::Write,
    path::Path,
    process::{Command, Stdio},
};

use catch_body::{JointVector, Robot, robot_file::RobotFiles};

use crate::{catchingbot, robot_import::package, skipped_without, stderr};

/// Runs a script in Python with what is installed for the tests, `input` on its standard input; `None`, and a
/// word, where a package that it imports is missing.
fn python(packages: &str, script: &str, input: &str) -> Option<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/python");
    // Folders of packages that others point to count, too.
    let path = format!("import site, sys\nsite.addsitedir({:?})\n", folder.display().to_string());
    let run = |script: &str, input: &str| {
        let mut child = Command::new("python3")
            .args(["-c", &(path.clone() + script)])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        child.stdin.take().map_or(Ok(()), |mut it| it.write_all(input.as_bytes()))?;
        child.wait_with_output()
    };
    let imports: Vec<&str> = script.lines().filter(|it| it.starts_with("import ")).collect();
    if !run(&imports.join("\n"), "").is_ok_and(|it| it.status.success()) {
        skipped_without(&format!("{packages} (python3 -m pip install --target target/python {packages})"));
        return None;
    }
    let output = run(script, input).unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    Some(String::from_utf8(output.stdout).unwrap())
}

/// Prints the names of a robot's joints, their limits, and where its last link is, all joints at a tenth of a
/// radian.
const LOAD: &str = r#"
import io, json, sys
import numpy, pinocchio, yourdfpy
text = sys.stdin.read()
model = pinocchio.buildModelFromXML(text)
data = model.createData()
q = pinocchio.neutral(model)
for joint in model.joints[1:]:
    q[joint.idx_q:joint.idx_q + joint.nq] = [0.1] if joint.nq == 1 else [numpy.cos(0.1), numpy.sin(0.1)]
pinocchio.forwardKinematics(model, data, q)
urdf = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False, build_scene_graph=False)
assert [joint.name for joint in urdf.robot.joints] == list(model.names)[1:]
print(json.dumps({
    "position": list(data.oMi[-1].translation),
    "velocity": list(model.velocityLimit),
    "effort": list(model.effortLimit),
}))
"#;

/// Also where nobody published a speed or a torque.
#[test]
fn robots_that_are_written_are_loaded_by_others() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(folder.path());
    let all = fs::read_to_string(&file).unwrap();
    let nothing_known = all.replace(" velocity=\"3\" effort=\"80\"", "").replace(" velocity=\"3\"", "");
    for (name, text) in [("all", all), ("few", nothing_known)] {
        fs::write(&file, text).unwrap();
        let out = folder.path().join(name);
        let output =
            catchingbot(&["robot", "import", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-ready"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let [urdf, toml] = ["robot.urdf", "robot.toml"].map(|it| fs::read_to_string(out.join(it)).unwrap());
        let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
        let robot = Robot::from_files(&files).unwrap();
        let Some(said) = python("pin yourdfpy", LOAD, &urdf) else { return };
        let said: serde_json::Value = serde_json::from_str(&said).unwrap();
        let numbers =
            |key: &str| -> Vec<f64> { said[key].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect() };
        // In the base's own frame.
        let X_WL = robot.link_poses(&JointVector::repeat(0.1));
        let last = X_WL[0].inv_mul(&X_WL[robot.dof()]).translation.vector;
        let off = numbers("position").iter().zip(last.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "{name}: {off} m");
        for (i, joint) in robot.joints.iter().enumerate() {
            let limits = [joint.limits.velocity, joint.limits.torque];
            assert_eq!([numbers("velocity")[i], numbers("effort")[i]], limits, "{name}: {}", joint.name);
        }
    }
}

/// Counts the messages of an MCAP file, whose path stands on standard input.
const COUNT: &str = r#"
import json, sys
import mcap.reader
with open(sys.stdin.read(), "rb") as file:
    reader = mcap.reader.make_reader(file, validate_crcs=True)
    counts = {}
    for schema, channel, message in reader.iter_messages():
        counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert sum(counts.values()) == reader.get_summary().statistics.message_count
print(json.dumps(counts))
"#;

#[test]
fn mcap_files_are_read_by_their_own_library() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let output = catchingbot(&["catch", "--scenario", "paper", "--out", out, "--mcap"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let files = fs::read_dir(folder.path()).unwrap().map(|it| it.unwrap().path());
    let file = files.into_iter().find(|it| it.extension().is_some_and(|it| it == "mcap")).unwrap();
    let Some(counts) = python("mcap", COUNT, file.to_str().unwrap()) else { return };
    let counts: std::collections::BTreeMap<String, u64> = serde_json::from_str(&counts).unwrap();
    assert!(counts.len() >= 5 && counts.values().all(|it| *it > 0), "{counts:?}");
}
