//! Other libraries at the work that the brain and the arena do, on the same problems, in one run on one core.
//!
//! Each row makes problems, solves them here, and writes both as JSON to a folder. A script of
//! `benches/peers` of the same name solves them with the peers and adds its tables.

mod clouds;
mod depths;
mod dynamics;
mod growth;
mod motions;
mod physics;
mod postures;
mod trials;

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};
use catch_body::{JointVector, Pose, Robot, robot::Joint};
use catch_lab::planner_cases;
use catch_sim::random_streams::Draws;
use serde_json::Value;

use crate::{Options, results::Table, spread::cpu_ms};

/// Rows of the page: the name of the script, and what writes its problems.
type Row = (&'static str, fn(&Options, &Path) -> Result<Value>);

const ROWS: [Row; 6] = [
    ("dynamics", dynamics::problems),
    ("depths", depths::problems),
    ("physics", physics::problems),
    ("motions", motions::problems),
    ("clouds", clouds::problems),
    ("postures", postures::problems),
];

/// Folder of the problems, and of the environment of Python.
const FOLDER: &str = "target/peers";
/// Repetitions of each measurement, of which the fastest counts.
const REPETITIONS: usize = 5;

/// Measures us and the peers.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    let folder = Path::new(FOLDER);
    fs::create_dir_all(folder)?;
    let mut tables = Vec::new();
    for (name, problems) in ROWS {
        let file = folder.join(name).with_extension("json");
        let document = problems(options, folder).with_context(|| format!("problems of {name}"))?;
        fs::write(&file, serde_json::to_string(&document)?)?;
        tables.extend(of_peers(name, &file)?);
    }
    tables.push(trials::table(options)?);
    tables.push(growth::table(options)?);
    tables.extend(of_peers("versions", folder)?);
    Ok(tables)
}

/// Tables that a script makes of its problems.
fn of_peers(name: &str, problems: &Path) -> Result<Vec<Table>> {
    let tables = Path::new(FOLDER).join(format!("{name}.tables.json"));
    let script = PathBuf::from("benches/peers").join(name).with_extension("py");
    let python = Path::new(FOLDER).join("venv/bin/python");
    let status = Command::new(&python).arg(&script).args([problems, &tables]).status();
    let status = status.with_context(|| format!("{}: benches/peers/run makes it", python.display()))?;
    if !status.success() {
        bail!("{} failed", script.display());
    }
    Ok(serde_json::from_str(&fs::read_to_string(&tables)?)?)
}

/// Returns the result of some work, and its least CPU time in seconds.
fn measured<T>(mut work: impl FnMut() -> T) -> (T, f64) {
    let mut once = || {
        let before_ms = cpu_ms();
        let result = work();
        (result, (cpu_ms() - before_ms) * 1e-3)
    };
    let least_s = (1..REPETITIONS).map(|_| once().1).fold(f64::INFINITY, f64::min);
    let (result, last_s) = once();
    (result, least_s.min(last_s))
}

/// The arm of the default scenario, without a gripper on it.
fn arm() -> Result<Robot> {
    Ok(planner_cases::arm(None, ("experiment", "robot"))?.0)
}

/// Joint positions within the limits.
fn any_posture(robot: &Robot, draws: &mut Draws) -> JointVector {
    drawn(robot, draws, |joint| [joint.limits.lower, joint.limits.upper])
}

/// A value for each joint between two bounds.
fn drawn(robot: &Robot, draws: &mut Draws, bounds: impl Fn(&Joint) -> [f64; 2]) -> JointVector {
    let mut values = JointVector::zeros();
    for (value, joint) in values.iter_mut().zip(&robot.joints) {
        *value = draws.between(bounds(joint));
    }
    values
}

/// Values of the joints that the arm has.
fn values(robot: &Robot, q: &JointVector) -> Vec<f64> {
    q.as_slice()[..robot.dof()].to_vec()
}

/// Rows of a pose's matrix.
fn rows(pose: &Pose) -> [[f64; 4]; 4] {
    pose.to_homogeneous().transpose().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Entry;

    #[test]
    fn tables_of_scripts_have_words_counts_and_numbers() {
        let text = r#"[{"title": "T", "columns": ["a", "b", "c", "d"], "rows": [["x", 3, 0.5, null]]}]"#;
        let tables: Vec<Table> = serde_json::from_str(text).unwrap();
        let expected = [Entry::text("x"), Entry::Count(3), Entry::Number(Some(0.5)), Entry::Number(None)];
        assert_eq!(tables[0].rows, [expected]);
    }
}
