//! The command line of CatchingBot: one module per subcommand, each of which reads its arguments, calls
//! [`catch_lab`] and prints.
//!
//! Begin with [`main`] (the program), [`command`] (its arguments as data) and [`ChoiceArguments`] (what is
//! thrown at what):
//!
//! ```
//! let eval = catch_cli::command().find_subcommand("eval").cloned();
//! assert!(eval.is_some_and(|it| it.get_arguments().any(|it| it.get_id() == "trials")));
//! ```
//!
//! A program has this command line by calling [`main`]. Every arena that it runs is made by
//! [`catch_lab::scenario::setup::Setup::arena`], the one place where another physics engine would come in.
//!
//! Exit code 0: it ran, whatever was caught; 2: something is wrong with what was asked for; 1: anything else.

mod calibrate;
mod catch;
mod check;
mod compare;
mod doctor;
mod drive;
mod eval;
mod export;
mod failure;
mod gripper_latency;
mod learn;
mod list;
mod new;
mod object;
mod opening;
mod place_cameras;
mod plan;
mod play;
mod predict;
mod ready;
mod register;
mod replay;
mod robot;
mod screen;
mod view;
mod watch;

use std::{io, process::ExitCode, sync::LazyLock};

use catch_body::InputError;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

use catch_lab::{
    VERSION,
    scenario::setup::{Choice, DEFAULT_SCENARIO, Setup},
};
use catch_recording::brain::Method;

use failure::Failure;

/// Throws things at a robot arm that catches them from depth images alone.
///
/// Without a subcommand it does what `catch` does: one throw, simulated from the thrower's hand to
/// the arm's, with its story on the terminal and a recording on disk.
///
/// Examples:
///   catchingbot                                     a tennis ball, thrown at random
///   catchingbot --scenario paper --object banana    a banana, as in the paper
///   catchingbot eval --throw random_by_reach        57 throws of each object: a table
///   catchingbot list                                what there is to throw, and how
///   catchingbot catch --json --seed 7 | jq .caught  for scripts: one JSON document
///   catchingbot view out/honest-tennis_ball-random-1-0.catch
///                                                   the throw in the browser
///   catchingbot replay out/honest-tennis_ball-random-1-0.catch
///                                                   would the brain do the same again?
///
/// Exit codes: 0 it ran, whatever was caught; 2 something is wrong with what was asked for;
/// 1 anything else.
#[derive(Debug, Parser)]
#[command(name = "catchingbot", version = version_with_commit(), args_conflicts_with_subcommands = true, max_term_width = 100)]
#[command(verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    catch: catch::CatchArguments,
    /// Print one JSON document instead of the story
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Throws once: shows the events as they happen and the outcome, and writes a recording and a page
    Catch(Box<catch::CatchArguments>),
    /// Throws many times: prints a table, writes a row per trial
    Eval(Box<eval::EvalArguments>),
    /// Throws many times to one arm, which holds what it caught, puts it down and returns for the next throw
    Play(Box<play::PlayArguments>),
    List(list::ListArguments),
    Plan(plan::PlanArguments),
    Predict(predict::PredictArguments),
    Learn(learn::LearnArguments),
    Calibrate(Box<calibrate::CalibrateArguments>),
    PlaceCameras(Box<place_cameras::PlaceCamerasArguments>),
    Ready(ready::ReadyArguments),
    /// Imports objects from meshes, scans, depth images, SDF and URDF
    #[command(subcommand)]
    Object(object::ObjectCommand),
    /// Imports arms from URDF
    #[command(subcommand)]
    Robot(robot::RobotCommand),
    Register(register::RegisterArguments),
    /// Runs the brain again on the observations of a recording, and compares every command bit for bit
    Replay(replay::ReplayArguments),
    /// Exports throws to the formats of other tools
    Export(Box<export::ExportArguments>),
    /// Shows a recording in the browser, in three dimensions with plots; two recordings on one slider; two
    /// evaluations compared throw by throw
    ///
    /// With `--json` a comparison is printed as one document, and no browser is opened.
    View(view::ViewArguments),
    GripperLatency(gripper_latency::GripperLatencyArguments),
    /// Writes a commented file to start from: your own robot, gripper, workcell, cameras, object, throw or
    /// scenario, a real cell, or sample data
    New(new::NewArguments),
    /// Checks the files of robots, grippers, workcells, objects, throws, rigs, scenarios and cells
    Check(check::CheckArguments),
    /// Catches with a real arm, through the driver that a cell's file names
    ///
    /// With `--json` what the driver says goes to standard error.
    Drive(drive::DriveArguments),
    /// Measures the links to a real arm and its cameras, and predicts its catch rate
    ///
    /// For ten seconds the driver holds the arm. It measures jitter, losses, latency and clock drift, and the
    /// cameras' rates and depth noise. Then the arena throws with these figures: at the cell's
    /// `speed_scaling`, and at full speed. With `--json` what the driver says goes to standard error.
    Doctor(doctor::DoctorArguments),
}

/// The version, with the commit where the program was built from a repository.
fn version_with_commit() -> &'static str {
    const COMMIT: Option<&str> = option_env!("CATCHINGBOT_COMMIT");
    static VERSION_AND_COMMIT: LazyLock<String> =
        LazyLock::new(|| COMMIT.map_or(VERSION.to_owned(), |commit| format!("{VERSION} ({commit})")));
    &VERSION_AND_COMMIT
}

/// The largest number that a throw or a seed can have: what TOML can hold.
pub const MOST: u64 = i64::MAX as u64;

/// Reads whole numbers in a range.
pub fn whole(least: u64, most: u64) -> impl Fn(&str) -> Result<u64, String> + Clone {
    move |text| {
        let number = text.parse().ok().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| format!("expected a whole number from {least} to {most}"))
    }
}

/// The names, or none where the scenario's is meant.
fn each_or_default(names: &[String]) -> Vec<Option<String>> {
    if names.is_empty() { vec![None] } else { names.iter().cloned().map(Some).collect() }
}

/// Reads numbers within a range.
pub fn between(least: f64, most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let number = text.parse().ok().filter(|it: &f64| (least..=most).contains(it));
        number.ok_or_else(|| format!("expected a number from {least} to {most}"))
    }
}

/// Reads a number of an option.
pub fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "expected a number, such as 0.25".to_owned())
}

/// Scenario, and changes to it.
#[derive(Debug, Args)]
pub struct ChoiceArguments {
    /// Scenario: a built-in name or a file
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_SCENARIO)]
    scenario: String,
    /// Arm: a built-in name, or a robot.toml with a robot.urdf beside it [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    robot: Option<String>,
    /// Gripper: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    gripper: Option<String>,
    /// Surroundings of the arm: a built-in workcell or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    workcell: Option<String>,
    /// Method that catches [default: the scenario's, which is ours if it names none]
    #[arg(long, value_enum)]
    method: Option<MethodArgument>,
    /// Changes one field of the scenario, such as arena.restitution_scale=0.5; may be repeated
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    settings: Vec<String>,
}

/// Method that catches.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodArgument {
    /// The method of this project
    Ours,
    /// The paper's own: ICP, RANSAC, its grasp selection and its trajectory optimization
    Paper,
}

impl ChoiceArguments {
    /// The choice, with an object and a throw.
    pub fn with<'a>(&'a self, object: Option<&'a str>, throw: Option<&'a str>) -> Choice<'a> {
        Choice {
            scenario: Some(&self.scenario),
            robot: self.robot.as_deref(),
            gripper: self.gripper.as_deref(),
            workcell: self.workcell.as_deref(),
            object,
            throw,
            method: self.method.map(|method| match method {
                MethodArgument::Ours => Method::Ours,
                MethodArgument::Paper => Method::Paper,
            }),
            settings: &self.settings,
        }
    }
}

/// Choice of one throw.
#[derive(Debug, Args)]
pub struct ThrowArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    object: Option<String>,
    /// Throw: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    throw: Option<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
    /// Number of the throw, for throws that differ
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole(0, MOST))]
    index: u64,
}

impl ThrowArguments {
    /// The setup of the throw, which can be thrown.
    pub fn setup(&self) -> Result<Setup, InputError> {
        let setup = Setup::load(&self.choice.with(self.object.as_deref(), self.throw.as_deref()))?;
        setup.check_throw(self.seed, self.index)?;
        Ok(setup)
    }
}

/// The command line as data: its arguments with their help, for completions and documentation.
pub fn command() -> clap::Command {
    with_negative_numbers(Arguments::command())
}

/// Numbers below zero are values, so that their own message tells what would be right.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let as_values = |it: clap::Arg| if it.get_action().takes_values() { it.allow_negative_numbers(true) } else { it };
    command.mut_args(as_values).mut_subcommands(with_negative_numbers)
}

/// Reads the program's arguments, does what they ask for, and says on standard error what went wrong.
pub fn main() -> ExitCode {
    let wants_json = std::env::args_os().any(|argument| argument == "--json");
    let arguments = match command().try_get_matches().and_then(|it| Arguments::from_arg_matches(&it)) {
        Ok(arguments) => arguments,
        Err(fault) if wants_json && fault.use_stderr() => {
            let mut asked = &command();
            for argument in std::env::args().skip(1) {
                asked = asked.find_subcommand(argument).unwrap_or(asked);
            }
            return Failure::of_arguments(&fault, asked).tell(true);
        }
        Err(fault) => fault.exit(),
    };
    let Err(fault) = run(arguments) else { return ExitCode::SUCCESS };
    let of_output = fault.chain().find_map(|cause| cause.downcast_ref::<io::Error>());
    if of_output.is_some_and(|it| it.kind() == io::ErrorKind::BrokenPipe) {
        // Whoever read the output has seen enough.
        return ExitCode::SUCCESS;
    }
    match fault.downcast_ref::<Failure>() {
        // The faults of a check are its result, which has been printed.
        Some(failure) => failure.tell(false),
        None => Failure::of_command(&fault).tell(wants_json),
    }
}

fn run(arguments: Arguments) -> anyhow::Result<()> {
    let json = arguments.json;
    match arguments.command {
        None => catch::run(&arguments.catch, json),
        Some(Command::Catch(catch)) => catch::run(&catch, json),
        Some(Command::Eval(eval)) => eval::run(&eval, json),
        Some(Command::Play(play)) => play::run(&play, json),
        Some(Command::List(list)) => list::run(&list, json, command()),
        Some(Command::Plan(plan)) => plan::run(&plan, json),
        Some(Command::Predict(predict)) => predict::run(&predict, json),
        Some(Command::Learn(learn)) => learn::run(&learn, json),
        Some(Command::Register(register)) => register::run(&register, json),
        Some(Command::Calibrate(calibrate)) => calibrate::run(&calibrate, json),
        Some(Command::PlaceCameras(place)) => place_cameras::run(&place, json),
        Some(Command::Ready(ready)) => ready::run(&ready, json),
        Some(Command::Object(object)) => object::run(&object, json),
        Some(Command::Robot(robot)) => robot::run(&robot, json),
        Some(Command::Replay(replay)) => replay::run(&replay, json),
        Some(Command::Export(export)) => export::run(&export, json),
        Some(Command::View(view)) => view::run(&view, json),
        Some(Command::GripperLatency(latency)) => gripper_latency::run(&latency, json),
        Some(Command::New(new)) => new::run(&new, json),
        Some(Command::Check(check)) => check::run(&check, json),
        Some(Command::Drive(drive)) => drive::run(&drive, json),
        Some(Command::Doctor(doctor)) => doctor::run(&doctor, json),
    }
}
