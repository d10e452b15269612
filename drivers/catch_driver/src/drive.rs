//! One throw after the other with a brain, each recorded; and without a motion, as a dry run.

use std::{io, ops::ControlFlow, path::Path, sync::Arc, time::Duration};

use anyhow::Context;
use catch_body::{InputError, Robot as Arm, robot::LimitScale};
use catch_bot::CatchingBot;
use catch_cell::{Brain, CellFault, Observation, RunError, cell_file::CellFile};
use catch_recording::{
    RecordedCell,
    cell_recorder::CellRecorder,
    drive_job::DriveJob,
    replay::{RECORDED, brain_of},
    sources::Sources,
};

use crate::{
    camera_socket::{self, ImageFaults},
    cell::DrivenCell,
    checker::Bounds,
    clock::Clock,
    control::Control,
    dry_run::{DryCell, NextState},
    enabling_key::{EnablingKey, restore_terminal},
    hand::{Fingers, Hand},
};

/// Time in seconds from the start of a throw's recording until its end, at most.
const THROW_S: f64 = 30.0;
/// Time in seconds for which a recording goes on after the last plan has ended.
const AFTERWARDS_S: f64 = 2.0;

/// How a hand is connected with; the error says why it is not.
pub type ConnectFingers = fn(&str) -> Result<Arc<dyn Fingers>, String>;

/// An arm's protocol.
pub trait Driver {
    /// Hands by the names that a cell's file has for them. Where the file names none it is the first.
    const HANDS: &'static [(&'static str, ConnectFingers)];

    /// Fraction of the acceleration limit that plans may use on a link that loses up to so many answers in a
    /// row. None: no plan may be executed over such a link.
    fn margin(longest_run: u64) -> Option<f64>;

    /// Connects with the arm, and begins to hold it where it stands.
    ///
    /// # Errors
    /// If it does not answer.
    fn hold(job: &DriveJob, arm: &Arm, key: &EnablingKey) -> anyhow::Result<Control>;

    /// Connects with the arm, and moves nothing.
    ///
    /// # Errors
    /// If it does not answer.
    fn watch(job: &DriveJob, arm: &Arm) -> anyhow::Result<NextState>;
}

/// The arm of a task with its gripper and its maker's limits, and what bounds it.
///
/// # Errors
/// A text in the task that describes no arm.
pub fn bounds<D: Driver>(job: &DriveJob) -> anyhow::Result<Bounds> {
    let unscaled = Sources { limit_scale: LimitScale::default(), ..job.cell.sources.clone() };
    let (arm, gripper) = unscaled.parse(&RECORDED)?;
    let CellFile { speed_scaling, safe_box, .. } = job.links;
    Ok(Bounds { arm: arm.carrying(&gripper), speed_scaling, safe_box, margin: D::margin })
}

/// How the task's hand is connected with, and its address; none where it has no hand.
///
/// # Errors
/// A protocol that the driver does not speak.
pub fn hand<D: Driver>(job: &DriveJob) -> anyhow::Result<Option<(ConnectFingers, &str)>> {
    let Some(link) = &job.links.hand else {
        return Ok(None);
    };
    let named = |name: &str| link.driver.as_deref().is_none_or(|it| it == name);
    let found = D::HANDS.iter().find(|it| named(it.0)).map(|it| (it.1, link.address.as_str()));
    let expected = || D::HANDS.iter().map(|it| it.0).collect::<Vec<_>>().join(" or ");
    let name = || format!("{:?}", link.driver.as_deref().unwrap_or_default());
    Ok(Some(found.ok_or_else(|| InputError::new(job.file.clone(), "hand.driver", name(), expected()))?))
}

/// Drives until the cell fails for good: a stop is told, and ends when the key is held again.
///
/// # Errors
/// A device that does not answer; a recording that cannot be written.
pub fn run<D: Driver>(job: &DriveJob) -> anyhow::Result<()> {
    let bounds = bounds::<D>(job)?;
    let hand = hand::<D>(job)?;
    // The brain plans within what the checks allow.
    let limit_scale = bounds.limit_scale(0).context("no motion is allowed")?;
    let mut known = job.cell.clone();
    known.sources.limit_scale = limit_scale;
    let mut brain = brain_of(&known)?;
    let ready_q = bounds.arm.checked_pose("the task", "ready_rad", &known.ready_rad)?;
    if job.dry_run {
        let next_state = D::watch(job, &bounds.arm)?;
        let images = camera_socket::listen(Path::new(&job.links.cameras.socket), &known.cameras, &Clock::Host)?;
        let mut cell = DryCell::new(next_state, &bounds, ready_q, images)?;
        println!("dry run: nothing moves; Ctrl-C ends it");
        while throw(&mut cell, &mut brain, &known, &job.out)? {
            brain.reset();
            cell.begin_again()?;
        }
        println!("no throw for {THROW_S} s");
        return Ok(());
    }
    let key = EnablingKey::of_terminal()?;
    let driven = drive::<D>(job, (&bounds, hand), (&mut brain, &known), &key);
    restore_terminal();
    driven
}

fn drive<D: Driver>(
    job: &DriveJob,
    (bounds, hand): (&Bounds, Option<(ConnectFingers, &str)>),
    (brain, known): (&mut CatchingBot, &RecordedCell),
    key: &EnablingKey,
) -> anyhow::Result<()> {
    let ready_q = bounds.arm.checked_pose("the task", "ready_rad", &known.ready_rad)?;
    loop {
        println!("hold a key to move: the arm goes straight to its waiting pose; released, it stops");
        while !key.is_held() {
            std::thread::sleep(Duration::from_millis(20));
        }
        // A socket of its own for each motion: images of before are none of its clock.
        let images = camera_socket::listen(Path::new(&job.links.cameras.socket), &known.cameras, &Clock::Host)?;
        let connected = hand.map(|(connect, address)| connect(address).and_then(|it| Hand::new(it, Clock::Host)));
        let hand = connected.transpose().map_err(anyhow::Error::msg).context("the gripper")?;
        let begun = DrivenCell::begin(D::hold(job, &bounds.arm, key)?, bounds, (hand, images));
        let stopped = begun.and_then(|mut cell| {
            cell.go_to(ready_q, 1)?;
            println!("ready");
            brain.reset();
            let ended = throw(&mut cell, brain, known, &job.out);
            for (camera, faults) in cell.image_faults.iter().filter(|it| *it.1 != ImageFaults::default()) {
                println!("camera {camera}: {faults}");
            }
            match ended {
                Ok(_) => Ok(()),
                Err(Stopped::Cell(fault)) => Err(fault.error),
                Err(Stopped::Recording(fault)) => Err(CellFault::ProtectiveStop { cause: fault.to_string() }),
            }
        });
        if let Err(fault) = stopped {
            println!("stopped: {fault}");
        }
    }
}

/// What ends throws.
#[derive(Debug, thiserror::Error)]
pub enum Stopped {
    /// The cell failed.
    #[error(transparent)]
    Cell(RunError<CellFault>),
    /// The recording could not be written.
    #[error("the recording: {0}")]
    Recording(#[from] io::Error),
}

/// Lets the brain act until a throw is over, and records it in the folder `out`. Returns whether there was a
/// throw: whether a plan was made.
///
/// # Errors
/// A cell that fails; a recording that cannot be written.
pub fn throw<C>(cell: &mut C, brain: &mut CatchingBot, known: &RecordedCell, out: &Path) -> Result<bool, Stopped>
where
    C: catch_cell::Cell<Error = CellFault>,
{
    let began = Clock::Host.now_s() as u64;
    let mut recorder = CellRecorder::create(out, &format!("drive_{began}"), known.clone())?;
    let mut end_s = None;
    let ended = catch_cell::run(cell, brain, |_, brain, observation, command| {
        if let Err(fault) = recorder.tick(observation, command, Some(brain.report())) {
            return ControlFlow::Break(Err(fault));
        }
        if let Some(plan) = &command.arm {
            end_s = Some(plan.end_s());
        }
        if is_over(observation, end_s) { ControlFlow::Break(Ok(())) } else { ControlFlow::Continue(()) }
    });
    println!("recorded: {}", recorder.finish()?.display());
    match ended {
        Ok(written) => {
            written?;
            Ok(end_s.is_some())
        }
        Err(fault) => Err(Stopped::Cell(fault)),
    }
}

fn is_over(observation: &Observation, end_s: Option<f64>) -> bool {
    end_s.is_some_and(|end_s| observation.time_s > end_s + AFTERWARDS_S) || observation.time_s > THROW_S
}
