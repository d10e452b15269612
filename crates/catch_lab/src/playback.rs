//! A recording, read whole: what pictures of a throw are made from.

use std::{collections::HashSet, path::Path, sync::Arc};

use catch_body::{Gripper, InputError, JointVector, Robot};
use catch_bot::Preparation;
use catch_cell::{ArmTrajectory, Setpoint, TrajectoryId};
use catch_sim::TruthSample;
use nalgebra::Point3;

use crate::{
    recording::{Ending, Header, Part, RecordedTick, RecordingReader},
    referee::{sample_at, undisturbed_position},
    replay::brain_of,
    throw_times::ThrowTimes,
};

/// Everything that is known of one throw.
#[derive(Debug)]
pub struct Playback {
    /// What was known before the throw.
    pub header: Header,
    /// The brain's ticks.
    pub ticks: Vec<RecordedTick>,
    /// What is known afterwards.
    pub ending: Ending,
    /// The arm.
    pub robot: Robot,
    /// The gripper.
    pub gripper: Gripper,
    /// What the recorded brain knew before the throw.
    pub known: Arc<Preparation>,
    /// Wall times, if their file still lies beside the recording.
    pub times: Option<ThrowTimes>,
}

/// How far off one prediction was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionError {
    /// When it was made.
    pub time_s: f64,
    /// How far the object's position at the catch was off, in metres.
    pub error_m: f64,
    /// What the prediction claimed: one standard deviation in the worst direction, in metres.
    pub claimed_sd_m: f64,
}

impl Playback {
    /// Reads a recording to its end.
    ///
    /// # Errors
    /// A file that is no recording, or not a complete one.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let mut reader = RecordingReader::open(path)?;
        let mut ticks = Vec::new();
        let ending = loop {
            match reader.next_part()? {
                Part::Tick(tick) => ticks.push(*tick),
                Part::Ending(ending) => break *ending,
            }
        };
        let header = reader.header;
        let known = brain_of(&header)?.known().clone();
        let (robot, gripper) = header.sources.parse(&crate::replay::RECORDED)?;
        Ok(Self { header, ticks, ending, robot, gripper, known, times: ThrowTimes::read(path) })
    }

    /// The true state nearest to `time_s`.
    pub fn truth_at(&self, time_s: f64) -> Option<&TruthSample> {
        sample_at(&self.ending.truth, time_s)
    }

    /// The time of the last true sample.
    pub fn end_s(&self) -> f64 {
        self.ending.truth.samples.last().map_or(0.0, |sample| sample.time_s)
    }

    /// When the flight is over: at the first contact with the gripper, else at the last planned catch, else at the end.
    pub fn flight_end_s(&self) -> f64 {
        let verdict = &self.ending.verdict;
        verdict.contact_s.or(verdict.catch_time_s).unwrap_or_else(|| self.end_s()).min(self.end_s())
    }

    /// How each prediction fared at the last planned catch, or at the end of the flight if there was no plan.
    pub fn prediction_errors(&self) -> Vec<PredictionError> {
        let at_s = self.ending.verdict.catch_time_s.unwrap_or_else(|| self.flight_end_s());
        let Some(truth_O) = undisturbed_position(&self.ending.truth, at_s) else { return Vec::new() };
        let of_tick = |tick: &RecordedTick| {
            let flight = tick.report.flight.as_ref().filter(|_| tick.observation.time_s <= at_s)?;
            let p_WO = Point3::from(flight.pose_at(at_s).translation.vector);
            let (error_m, claimed_sd_m) = ((p_WO - truth_O).norm(), flight.position_sd_at(at_s));
            Some(PredictionError { time_s: tick.observation.time_s, error_m, claimed_sd_m })
        };
        self.ticks.iter().filter_map(of_tick).filter(|it| it.error_m.is_finite()).collect()
    }

    /// Joint accelerations in rad/s² that the executing trajectory asks for at each of some rising times.
    pub fn commanded_accelerations(&self, times_s: &[f64]) -> Vec<JointVector> {
        let rejected: HashSet<TrajectoryId> =
            self.ticks.iter().flat_map(|tick| &tick.observation.arm.rejected).map(|it| it.id).collect();
        let mut pending =
            self.ticks.iter().filter_map(|tick| tick.command.arm.as_ref()).filter(|it| !rejected.contains(&it.id));
        let mut next = pending.next();
        let mut executing: Option<&ArmTrajectory> = None;
        let mut at = |time_s: f64| {
            while let Some(trajectory) = next.filter(|it| it.start_s() <= time_s) {
                executing = Some(trajectory);
                next = pending.next();
            }
            executing.map_or(Setpoint::at_rest(JointVector::zeros()), |it| it.setpoint(time_s)).ddq
        };
        times_s.iter().map(|&time_s| at(time_s)).collect()
    }
}
