//! A recording, read whole: what pictures of a throw are made from.

use std::{collections::HashSet, path::Path, sync::Arc};

use catch_body::{Gripper, InputError, JointVector, Pose, Robot};
use catch_bot::Preparation;
use catch_cell::{ArmState, ArmTrajectory, Observation, Setpoint, TrajectoryId};
use catch_sim::TruthSample;
use nalgebra::Point3;

use catch_lab::{
    recording::{GroundTruth, LabReader, Simulation, throw_times::ThrowTimes},
    referee::sample_at,
};
use catch_recording::{Ending, Header, Part, RecordedTick, replay::brain_of};

/// Everything that is known of one throw.
#[derive(Debug)]
pub struct Playback {
    /// Header of the recording: all that was given before the throw.
    pub header: Header<Simulation>,
    /// The brain's ticks.
    pub ticks: Vec<RecordedTick>,
    /// Ending of the recording: all that is given after the throw.
    pub ending: Ending<GroundTruth>,
    /// The arm.
    pub robot: Robot,
    /// The gripper.
    pub gripper: Gripper,
    /// Preparation of the recorded brain before the throw.
    pub known: Arc<Preparation>,
    /// Wall times, if their file still lies beside the recording.
    pub times: Option<ThrowTimes>,
}

/// Arm, gripper and object at an instant: as they truly were where the recording has ground truth, else as
/// they were sensed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionSample {
    /// Time of the sample.
    pub time_s: f64,
    /// Joint positions in radians.
    pub q: JointVector,
    /// Joint velocities in rad/s.
    pub dq: JointVector,
    /// Joint torques in N·m; not sensed.
    pub torque: Option<JointVector>,
    /// Distance between the fingers' inner faces in metres.
    pub width_m: f64,
    /// Force of each finger in N.
    pub finger_force_n: [f64; 2],
    /// Pose of the gripper.
    pub X_WG: Pose,
    /// True pose of the object.
    pub X_WO: Option<Pose>,
}

impl From<&TruthSample> for MotionSample {
    fn from(sample: &TruthSample) -> Self {
        let TruthSample { time_s, q, dq, torque, width_m, finger_force_n, X_WG, X_WO, .. } = *sample;
        Self { time_s, q, dq, torque: Some(torque), width_m, finger_force_n, X_WG, X_WO: Some(X_WO) }
    }
}

/// Error of one prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictionError {
    /// Time of the prediction.
    pub time_s: f64,
    /// Error of the object's predicted position at the catch, in metres.
    pub error_m: f64,
    /// Standard deviation that the prediction claimed, in the worst direction, in metres.
    pub claimed_sd_m: f64,
}

impl Playback {
    /// Reads a recording to its end.
    ///
    /// # Errors
    /// A file that is no recording, or not a complete one.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let mut reader = LabReader::open(path)?;
        let mut ticks = Vec::new();
        let ending = loop {
            match reader.next_part()? {
                Part::Tick(tick) => ticks.push(*tick),
                Part::Ending(ending) => break *ending,
            }
        };
        let header = reader.header;
        let known = brain_of(&header.cell)?.known.clone();
        let (robot, gripper) = header.cell.sources.parse(&catch_recording::replay::RECORDED)?;
        Ok(Self { header, ticks, ending, robot, gripper, known, times: ThrowTimes::read(path) })
    }

    /// Returns the ground truth of a simulation.
    pub fn ground_truth(&self) -> Option<&GroundTruth> {
        self.ending.ground_truth.as_ref()
    }

    /// The true centre of mass in the brain's O, whose path the true one is; O's origin without ground truth.
    pub fn com_O(&self) -> Point3<f64> {
        self.ground_truth().map_or(Point3::origin(), |it| it.com_O)
    }

    /// The true state nearest to `time_s`.
    pub fn truth_at(&self, time_s: f64) -> Option<&TruthSample> {
        sample_at(&self.ground_truth()?.truth, time_s)
    }

    /// Arm, gripper and object nearest to `time_s`.
    pub fn motion_at(&self, time_s: f64) -> Option<MotionSample> {
        if self.ground_truth().is_some() {
            return self.truth_at(time_s).map(MotionSample::from);
        }
        let after = self.ticks.partition_point(|tick| tick.observation.time_s < time_s);
        let neighbours = &self.ticks[after.saturating_sub(1)..(after + 1).min(self.ticks.len())];
        let distance_s = |tick: &&RecordedTick| (tick.observation.time_s - time_s).abs();
        let nearest = neighbours.iter().min_by(|a, b| distance_s(a).total_cmp(&distance_s(b)))?;
        Some(self.sensed(nearest))
    }

    fn sensed(&self, tick: &RecordedTick) -> MotionSample {
        let Observation { time_s, arm: ArmState { q, dq, .. }, gripper, .. } = &tick.observation;
        MotionSample {
            time_s: *time_s,
            q: *q,
            dq: *dq,
            torque: None,
            width_m: gripper.width_m,
            finger_force_n: [gripper.force_n; 2],
            X_WG: self.robot.gripper_pose(q),
            X_WO: None,
        }
    }

    /// Returns the start of the recording: the release of a simulated throw, else the first observation.
    pub fn start_s(&self) -> f64 {
        let sensed_s = self.ticks.first().filter(|_| self.ground_truth().is_none()).map(|tick| tick.observation.time_s);
        sensed_s.unwrap_or(0.0)
    }

    /// The time of the last true sample, or of the last observation where there is none.
    pub fn end_s(&self) -> f64 {
        let end_s = match self.ground_truth() {
            Some(it) => it.truth.samples.last().map(|sample| sample.time_s),
            None => self.ticks.last().map(|tick| tick.observation.time_s),
        };
        end_s.unwrap_or(0.0)
    }

    /// Returns the end of the flight: the first true contact with the gripper, else the last planned catch,
    /// else where hand and object were nearest, else the end.
    pub fn flight_end_s(&self) -> f64 {
        let flight_end_s = match self.ground_truth() {
            Some(it) => it.verdict.contact_s.or(it.verdict.catch_time_s).or_else(|| self.nearest_s(&it.truth.samples)),
            None => self.ticks.iter().rev().find_map(|tick| tick.report.plan.as_ref()).map(|plan| plan.catch_s),
        };
        flight_end_s.unwrap_or_else(|| self.end_s()).min(self.end_s())
    }

    /// The time at which the object was nearest to where the hand holds.
    fn nearest_s(&self, samples: &[TruthSample]) -> Option<f64> {
        let distance_m = |it: &TruthSample| {
            (it.X_WG * self.gripper.grasp_centre() - Point3::from(it.X_WO.translation.vector)).norm()
        };
        samples.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).map(|it| it.time_s)
    }

    /// Computes the error of each prediction at the last planned catch, or at the end of the flight if there
    /// was no plan; nothing without ground truth.
    pub fn prediction_errors(&self) -> Vec<PredictionError> {
        let Some(GroundTruth { truth, verdict, undisturbed_m, .. }) = self.ground_truth() else { return Vec::new() };
        let at_s = verdict.catch_time_s.unwrap_or_else(|| self.flight_end_s());
        let at_end = || Some(sample_at(truth, at_s)?.X_WO.translation.vector.into());
        let undisturbed = if verdict.catch_time_s.is_some() { *undisturbed_m } else { at_end() };
        let Some(truth_O) = undisturbed else { return Vec::new() };
        let of_tick = |tick: &RecordedTick| {
            let flight = tick.report.flight.as_ref().filter(|_| tick.observation.time_s <= at_s)?;
            let predicted = flight.pose_at(at_s) * self.com_O();
            let (error_m, claimed_sd_m) = ((predicted - truth_O).norm(), flight.position_sd_at(at_s));
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
