//! Controls that must fail: what cannot be caught is not caught, and eyes are needed for it.

use catch_bot::Report;
use catch_cell::{Brain, Cell, Command, Observation, Probe};
use catch_lab::{
    referee,
    scenario::setup::{Choice, Setup},
    trial,
};
use catch_recording::brain::ObservedBrain;
use catch_sim::Arena;

const SEED: u64 = 5;
const THROWS: u64 = 4;

/// What the eyes of a brain see.
enum Eyes {
    /// Its own throw.
    Open,
    /// Nothing.
    Shut,
    /// Another throw of the same object, whose arm obeys the same commands.
    Elsewhere(Box<Arena>),
}

/// A brain whose images may not be its own.
struct Deceived<B> {
    brain: B,
    eyes: Eyes,
}

impl<B: Brain> Brain for Deceived<B> {
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let mut observation = observation.clone();
        match &mut self.eyes {
            Eyes::Open => {}
            Eyes::Shut => observation.frames.clear(),
            Eyes::Elsewhere(arena) => {
                let Ok(other) = arena.sense();
                observation.frames = other.frames;
            }
        }
        let command = self.brain.tick(&observation, probe);
        if let Eyes::Elsewhere(arena) = &mut self.eyes {
            let Ok(()) = arena.act(&command);
        }
        command
    }

    fn reset(&mut self) {
        self.brain.reset();
    }
}

impl<B: ObservedBrain> ObservedBrain for Deceived<B> {
    fn report(&self) -> Option<&Report> {
        self.brain.report()
    }
}

/// How many of a few throws are caught.
fn caught(setup: &Setup, eyes: impl Fn(u64) -> Eyes) -> usize {
    let is_caught = |&index: &u64| {
        let mut brain = Deceived { brain: setup.brain(SEED, index), eyes: eyes(index) };
        referee::judge(setup, &trial::run_unobserved(&mut brain, setup, SEED, index)).caught
    };
    (0..THROWS).filter(is_caught).count()
}

/// Random throws, which differ by more than the hand is wide.
fn random() -> Setup {
    Setup::load(&Choice { throw: Some("random"), ..Choice::default() }).unwrap()
}

#[test]
fn who_sees_nothing_or_another_throw_catches_nothing() {
    let setup = random();
    let open = caught(&setup, |_| Eyes::Open);
    assert!(2 * open >= THROWS as usize, "{open} of {THROWS} with open eyes");
    assert_eq!(caught(&setup, |_| Eyes::Shut), 0);
    assert_eq!(caught(&setup, |index| Eyes::Elsewhere(Box::new(setup.arena(SEED, index + THROWS)))), 0);
}

#[test]
fn without_friction_nothing_is_held() {
    for object in ["tennis_ball", "pill_bottle"] {
        let caught_with = |friction: &str| {
            let settings = [format!("arena.friction={friction}")];
            let setup =
                Setup::load(&Choice { object: Some(object), settings: &settings, ..Choice::default() }).unwrap();
            referee::judge(&setup, &trial::run_unobserved(&mut setup.brain(SEED, 0), &setup, SEED, 0)).caught
        };
        assert!(caught_with("0.667"), "{object}");
        assert!(!caught_with("0.0"), "{object}");
    }
}

/// With half the step of the arena.
#[test]
fn half_a_step_changes_few_verdicts() {
    let with = |step_s: &str| {
        let settings = [format!("arena.step_s={step_s}")];
        let setup = Setup::load(&Choice { throw: Some("random"), settings: &settings, ..Choice::default() }).unwrap();
        let verdict = |index| {
            referee::judge(&setup, &trial::run_unobserved(&mut setup.brain(SEED, index), &setup, SEED, index)).caught
        };
        (0..2 * THROWS).map(verdict).collect::<Vec<_>>()
    };
    let (whole, half) = (with("0.001"), with("0.0005"));
    let changed = whole.iter().zip(&half).filter(|(whole, half)| whole != half).count();
    assert!(changed <= 1, "{whole:?} with whole steps, {half:?} with half ones");
    assert!(whole.contains(&true));
}
