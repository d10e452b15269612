//! The brain sees only through its cameras: once they are dark, it does not notice where the object goes.

use std::convert::Infallible;

use catch_cell::{Brain, Cell, Command, DepthFrame, Observation, PixelWindow};
use catch_lab::scenario::setup::{Choice, Setup};
use catch_sim::Arena;
use nalgebra::Vector3;

/// Time before the catch at which the cameras go dark, in seconds.
const DARK_FOR_S: f64 = 0.1;

/// Change of the frames shortly before the catch.
#[derive(Clone, Copy, PartialEq)]
enum Cameras {
    Dark,
    Seeing,
}

/// A cell whose object is suddenly somewhere else: at first everything is sensed in one arena, then in
/// another one where the object was thrown elsewhere. Both receive all commands, so that the arm is in the
/// same state when they change places.
struct MovedObject {
    before: Arena,
    after: Arena,
    moved: bool,
    cameras: Cameras,
}

impl Cell for MovedObject {
    type Error = Infallible;

    fn sense(&mut self) -> Result<Observation, Infallible> {
        let (before, after) = (self.before.sense()?, self.after.sense()?);
        let mut observation = if self.moved { after } else { before };
        if self.moved && self.cameras == Cameras::Dark {
            observation.frames.iter_mut().for_each(darken);
        }
        Ok(observation)
    }

    fn act(&mut self, command: &Command) -> Result<(), Infallible> {
        self.before.act(command)?;
        self.after.act(command)
    }
}

/// Nothing is seen, and no window tells where something might be.
fn darken(frame: &mut DepthFrame) {
    *frame = DepthFrame {
        window: PixelWindow::default(),
        depth_m: Vec::new(),
        mask: frame.mask.as_ref().map(|_| Vec::new()),
        ..frame.clone()
    };
}

/// All commands of a trial in which the object jumps by `offset` shortly before the catch.
fn commands(setup: &Setup, offset: Vector3<f64>, cameras: Cameras) -> Vec<Command> {
    let (seed, index) = (1, 0);
    let elsewhere = || {
        let mut release = setup.release(seed, index);
        release.p_WO += offset;
        Arena::new(setup.equipment(), &release, (&setup.robot.ready_q, setup.waiting_width_m()), seed, index)
    };
    let mut cell = MovedObject { before: setup.arena(seed, index), after: elsewhere(), moved: false, cameras };
    let mut brain = setup.brain(seed, index);
    let mut commands = Vec::new();
    while commands.len() < 120 {
        let plan = brain.report().plan.as_ref();
        cell.moved |= plan.is_some_and(|plan| cell.after.time_s() >= plan.catch_s - DARK_FOR_S);
        let Ok(observation) = cell.sense();
        let command = brain.tick(&observation, &mut ());
        let Ok(()) = cell.act(&command);
        commands.push(command);
    }
    assert!(cell.moved, "there was no plan");
    commands
}

#[test]
fn in_the_dark_the_object_may_go_where_it_likes() {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    let offset = Vector3::new(0.05, -0.03, 0.1);
    let dark = commands(&setup, Vector3::zeros(), Cameras::Dark);
    let dark_and_moved = commands(&setup, offset, Cameras::Dark);
    let first = dark.iter().zip(&dark_and_moved).position(|(one, two)| one != two);
    assert_eq!(first, None, "a command depends on where the object is though nothing was seen of it");

    // The test can fail: with open eyes the brain does notice.
    let seeing = commands(&setup, Vector3::zeros(), Cameras::Seeing);
    let seeing_and_moved = commands(&setup, offset, Cameras::Seeing);
    assert_ne!(seeing, seeing_and_moved);
}

/// The file of an object says what it truly is and what the brain is told; nothing of the former changes the
/// latter.
#[test]
fn the_brain_is_told_nothing_of_what_an_object_truly_is() {
    let folder = tempfile::tempdir().unwrap();
    let told = |truth: &str| {
        let prior = "[known]\nmass_kg = 0.1\ndrag_per_m = 0.05\ndrag_sd_per_m = 0.01\nrestitution = 0.4\n";
        let shape = "[truth.shape]\nkind = \"ball\"\ndiameter_m = 0.06\nhollow = false\n";
        let path = folder.path().join("thing.toml");
        std::fs::write(&path, format!("name = \"thing\"\n{prior}[truth]\n{truth}\n{shape}")).unwrap();
        let choice = Choice { scenario: Some("honest"), object: path.to_str(), ..Choice::default() };
        let setup = Setup::load(&choice).unwrap();
        assert_eq!(setup.known().config.trajectory_optimization.object_mass_kg, Some(0.1));
        setup.brain_config(1)
    };
    let one = told("mass_kg = 0.1\nrestitution = 0.4\ndrag_per_m = 0.05");
    let other = told("mass_kg = 0.3\nrestitution = 0.8\ndrag_per_m = 0.01\nfriction = 0.2\nstiffness_npm = 900");
    assert_eq!(one, other);
}
