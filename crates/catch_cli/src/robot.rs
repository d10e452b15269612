//! `catchingbot robot`: arms that others described.

use std::{
    fs,
    path::{Path, PathBuf},
};

use catch_body::{InputError, JointVector};
use catch_import::robot_import::{ImportOptions, ImportedRobot};
use catch_lab::{
    reachability::ready::{Corridor, Ready},
    scenario::setup::{Choice, Setup},
};
use catch_recording::whole_file::{self, check_new, unfinished_folder};
use catch_view::pages::robot_page;
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::{MOST, whole};
use crate::{number, screen};

/// Commands of `robot`.
#[derive(Debug, Subcommand)]
pub enum RobotCommand {
    Import(ImportArguments),
}

/// Makes a robot from a description that somebody else published
///
/// The arm is the serial chain of revolute joints in the description: fixed joints are folded, fingers are
/// taken off. Capsules are fitted around the shapes of its links, for which meshes are looked for as
/// `package://` and relative paths say, in the folders above the description. What cameras see of each
/// link, its mesh for display, is kept in at most 4,000 triangles. Limits in a joint_limits.yaml
/// beside it only narrow what it states. What no file says is assumed, and marked so in robot.toml, where
/// `catchingbot check` lists it.
///
/// Example:
///   catchingbot robot import kortex_description/robots/gen3.urdf --out gen3
///   catchingbot --robot gen3
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ImportArguments {
    /// A URDF file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Folder for robot.urdf, robot.toml, meshes and capsules.html; it must not exist yet
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The link at whose frame the gripper is mounted [default: found]
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// The link that stands still [default: the first]
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Limits as MoveIt keeps them [default: joint_limits.yaml beside the description]
    #[arg(long, value_name = "FILE")]
    joint_limits: Option<PathBuf>,
    /// Acceleration limits in rad/s²: one for all joints, or one for each
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', value_parser = number)]
    max_acceleration: Vec<f64>,
    /// Rotor inertias reflected to the joints in kg·m², likewise
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', value_parser = number)]
    rotor_inertia: Vec<f64>,
    /// Jerk limits in rad/s³, likewise
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', value_parser = number)]
    max_jerk: Vec<f64>,
    /// Do not search for the best waiting pose
    #[arg(long)]
    no_ready: bool,
    /// Poses that are tried in the search
    #[arg(long, value_name = "N", default_value_t = 100, conflicts_with = "no_ready", value_parser = whole(1, 10_000_000))]
    tries: u64,
    /// Throw to wait for; may be repeated [default: past the arm, where it can reach]
    #[arg(long = "throw", value_name = "NAME|FILE", conflicts_with = "no_ready")]
    throws: Vec<String>,
    /// Seed of the throws and of the poses
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
}

/// Throws at an arm by default.
const THROWS: [&str; 1] = ["random_by_reach"];
/// Throws of each kind for which the waiting pose is chosen.
const CHOSEN_FOR: u64 = 12;
/// Throws of each kind on which it is tried afterwards.
const TRIED_ON: u64 = 50;
/// Shapes that could not be read, of which each is told.
const MOST_FAULTS: usize = 3;
/// Poses from which the search may begin.
const STARTS: usize = 30;

/// Imports a robot.
///
/// # Errors
/// Faults of the description, the options or the folder.
pub fn run(RobotCommand::Import(arguments): &RobotCommand, json: bool) -> anyhow::Result<()> {
    let out = &arguments.out;
    check_new([out], "--out")?;
    let options = ImportOptions {
        base: arguments.base.clone(),
        tip: arguments.tip.clone(),
        joint_limits: arguments.joint_limits.clone(),
        max_acceleration: arguments.max_acceleration.clone(),
        rotor_inertia: arguments.rotor_inertia.clone(),
        max_jerk: arguments.max_jerk.clone(),
    };
    let setup = Setup::load(&Choice::default())?;
    let bar = screen::spinner("fitting capsules");
    let mut imported = ImportedRobot::read(&arguments.file, &options, &setup.gripper)?;
    bar.finish_and_clear();

    // All is written to a folder beside, which takes the name when it is complete.
    let unfinished = unfinished_folder(out)?;
    let folder = unfinished.path();
    let write = |name: &str, text: String| whole_file::write(&folder.join(name), text);
    write("robot.urdf", imported.draft.urdf())?;
    write("robot.toml", imported.draft.toml())?;
    let meshes = imported.meshes();
    if !meshes.is_empty() {
        fs::create_dir(folder.join("visual"))?;
    }
    for (name, text) in meshes {
        write(&name, text)?;
    }
    let reach = if arguments.no_ready { None } else { Some(choose_ready_pose(arguments, folder, &mut imported)?) };
    write("robot.toml", imported.draft.toml())?;
    write("capsules.html", page(&imported))?;
    fs::rename(folder, out).map_err(|it| InputError::unwritten(out.display(), &it, "a folder that can be written"))?;
    tell(arguments, &imported, reach, json)
}

/// The page that shows the capsules over the shapes of the links.
fn page(imported: &ImportedRobot) -> String {
    let shapes = imported.draft.shapes.iter().map(|it| (&it.surface, &it.capsules[..]));
    robot_page::page(&imported.robot, shapes, imported.coverage())
}

/// Searches for the best waiting pose, and tries it on other throws: how many of how many it reaches.
fn choose_ready_pose(
    arguments: &ImportArguments,
    folder: &Path,
    imported: &mut ImportedRobot,
) -> anyhow::Result<[usize; 2]> {
    let robot = folder.join("robot.toml").display().to_string();
    let named: Vec<&str> = arguments.throws.iter().map(String::as_str).collect();
    let throws = if named.is_empty() { &THROWS[..] } else { &named };
    let setups = throws
        .iter()
        .map(|throw| Setup::load(&Choice { robot: Some(&robot), throw: Some(throw), ..Choice::default() }))
        .collect::<Result<Vec<Setup>, InputError>>()?;
    let corridor = Corridor::new(&setups, CHOSEN_FOR, arguments.seed);
    let starts: Vec<JointVector> = imported.starts.iter().copied().take(STARTS).collect();
    let tries = arguments.tries as usize;
    let bar = screen::progress_bar(starts.len() + tries, "poses");
    let mut best: Option<Ready> = None;
    for start in &starts {
        if let Some(ready) = corridor.value(start, best.map_or(f64::INFINITY, |best| best.cost))
            && best.is_none_or(|best| ready.cost < best.cost)
        {
            best = Some(ready);
        }
        bar.inc(1);
    }
    let start = best.map_or(imported.robot.ready_q, |it| it.q);
    let best = corridor.search(&start, tries, arguments.seed, &mut |tried, best| {
        bar.set_position((starts.len() + tried) as u64);
        bar.set_message(format!("{} of {} throws within reach", best.caught, best.throws));
    });
    bar.finish_and_clear();
    if let Some(best) = best {
        imported.set_ready(&best.q)?;
    }
    let others = Corridor::new(&setups, TRIED_ON, arguments.seed.wrapping_add(1));
    let at_rest = others.value(&imported.robot.ready_q, f64::INFINITY);
    let throws = setups.len() * TRIED_ON as usize;
    Ok([at_rest.map_or(0, |it| it.caught), throws])
}

/// The robot as one document.
fn document(
    arguments: &ImportArguments,
    imported: &ImportedRobot,
    unread: &[String],
    reach: Option<[usize; 2]>,
) -> Value {
    let (chain, robot) = (&imported.draft.chain, &imported.robot);
    let fingers = chain.fingers.as_ref();
    json!({
        "robot": arguments.out.to_string_lossy(),
        "name": robot.name,
        "joints": robot.joints.iter().map(|it| &it.name).collect::<Vec<_>>(),
        "flange": chain.flange,
        "taken_off": fingers.map_or(&[][..], |it| &it.links),
        "taken_off_reason": fingers.map(|it| &it.reason),
        "left_out": chain.left_out,
        "capsules": robot.capsules.len(),
        "unread": unread,
        "ignored": imported.ignored,
        "assumed": imported.assumptions(),
        "ready_rad": robot.ready_q.as_slice()[..robot.dof()],
        "reach": reach.map(|[within_reach, throws]| json!({ "within_reach": within_reach, "throws": throws })),
    })
}

/// Says what was made, and what to do next.
fn tell(
    arguments: &ImportArguments,
    imported: &ImportedRobot,
    reach: Option<[usize; 2]>,
    json: bool,
) -> anyhow::Result<()> {
    let chain = &imported.draft.chain;
    let robot = &imported.robot;
    let mut unread: Vec<String> =
        imported.draft.shapes.iter().flat_map(|it| &it.unread).map(ToString::to_string).collect();
    unread.dedup();
    if json {
        return screen::document(&document(arguments, imported, &unread, reach));
    }
    let arm = format!("{}: {} joints from {} to {}", robot.name, robot.dof(), chain.base.links[0], chain.flange);
    screen::fact("arm", &arm)?;
    if robot.has_few_joints() {
        let few =
            format!("{}: balls are caught with the hand turned as it can be, few throws of other objects", robot.dof());
        screen::fact("few joints", &few)?;
    }
    if let Some(it) = &chain.fingers {
        screen::fact("taken off", &format!("{} ({})", it.links.join(", "), it.reason))?;
    }
    if !chain.left_out.is_empty() {
        screen::fact("left out", &format!("what moves on its own: {}", chain.left_out.join(", ")))?;
    }
    let (_, coverage) = imported.coverage();
    let page = arguments.out.join("capsules.html");
    screen::fact("capsules", &format!("{}; {coverage} ({})", robot.capsules.len(), page.display()))?;
    for fault in unread.iter().take(MOST_FAULTS) {
        screen::fact("not read", fault)?;
    }
    if unread.len() > MOST_FAULTS {
        screen::fact("not read", &format!("{} more shapes", unread.len() - MOST_FAULTS))?;
    }
    if !imported.ignored.is_empty() {
        screen::fact("ignored", &imported.ignored.join(", "))?;
    }
    screen::fact("assumed", &format!("{} values that no file says", imported.assumptions().len()))?;
    let not_searched = "not searched: until `catchingbot ready` finds one, few throws are caught".to_owned();
    let pose = reach.map_or(not_searched, |[within, of]| format!("reaches {within} of {of} other throws"));
    screen::fact("waiting pose", &pose)?;
    let out = arguments.out.to_string_lossy();
    screen::fact("written", &out)?;
    screen::fact("what is assumed?", &screen::command(&["check", &out]))?;
    Ok(screen::fact("try it", &screen::command(&["--robot", &out]))?)
}
