//! The latency of a gripper, from commanded moves and sensed widths.
//!
//! It is the time that `brain.control.gripper_latency_s` stands for: from the start of a commanded move until
//! the fingers begin to move, where they then move as the brain expects. A width that was sensed t after the
//! start and d from the width at rest puts the beginning at t − T(d), T being the time in which the brain
//! expects the fingers to travel d. States that were read out a while before they are told, and fingers that
//! something stops, make that too late and never too early; so the earliest one over the sensed widths of a
//! move counts, between the times of two observations. Half a step of the sensor is allowed for.

use std::path::{Path, PathBuf};

use catch_body::{
    InputError,
    gripper::Closing,
    statistics::{quantile, sorted},
};
use catch_cell::{Command, GripperQueue};
use serde::Serialize;

use crate::recording::LabReader;
use catch_recording::{Part, replay::RECORDED, whole_file::COMMAND_LINE};

/// Fingers are at rest while the width changes by no more, in metres.
const REST_M: f64 = 2e-4;
/// Displacement from which the fingers count as moving, in metres.
const MOVED_M: f64 = 1e-3;
/// Moves that should go no further than this tell nothing, in metres.
const LEAST_TRAVEL_M: f64 = 3e-3;
/// Duration after the start of a move in which the fingers are observed, in seconds.
const LONGEST_S: f64 = 0.5;

/// Latency of one move.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MoveLatency {
    /// The recording.
    pub recording: PathBuf,
    /// Commanded start of the move, on the cell's clock.
    pub start_s: f64,
    /// Time from the start to the first motion of the fingers.
    pub latency_s: f64,
}

/// Moves that tell no latency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct UnusedMoves {
    /// Moves whose command arrived after their start: the true start is not recorded.
    pub late: usize,
    /// The fingers did not rest where they had been sent before.
    pub not_at_rest: usize,
    /// Moves without a motion of the fingers, observed or commanded.
    pub not_moved: usize,
}

/// Latency of a gripper over many moves.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GripperLatency {
    /// The value for `brain.control.gripper_latency_s`.
    pub median_s: f64,
    /// The quartiles: half of the moves are between them.
    pub quartiles_s: [f64; 2],
    /// Latency of each measured move.
    pub moves: Vec<MoveLatency>,
    /// Moves that could not be measured.
    pub unused: UnusedMoves,
}

/// Measures the latency of the gripper in recordings.
///
/// # Errors
/// A file that is no complete recording; recordings of several grippers, or without a move that tells a
/// latency, and why.
pub fn measure(recordings: &[PathBuf]) -> Result<GripperLatency, InputError> {
    let (mut moves, mut unused) = (Vec::new(), UnusedMoves::default());
    let mut gripper: Option<String> = None;
    for path in recordings {
        let recorded = RecordedMoves::read(path)?;
        let first = gripper.get_or_insert_with(|| recorded.gripper.clone());
        if *first != recorded.gripper {
            let expected = format!("moves of {first}, as in the recordings before");
            return Err(InputError::new(path.display(), "gripper", &recorded.gripper, expected));
        }
        let measured = recorded.latencies(&mut unused).into_iter();
        moves.extend(measured.map(|(start_s, latency_s)| MoveLatency { recording: path.clone(), start_s, latency_s }));
    }
    let sorted = sorted(moves.iter().map(|it| it.latency_s));
    let [Some(low_s), Some(median_s), Some(high_s)] = [0.25, 0.5, 0.75].map(|part| quantile(&sorted, part)) else {
        let UnusedMoves { late, not_at_rest, not_moved } = unused;
        let found = match late + not_at_rest + not_moved {
            0 => "no gripper move".to_owned(),
            all => format!(
                "none of {all} gripper moves of use: {late} arrived after their start, {not_at_rest} began while the fingers \
                 moved, {not_moved} were not seen to move them"
            ),
        };
        let expected =
            "recordings with moves that are sent before they start, from rest, and sensed widths that follow";
        return Err(InputError::new(COMMAND_LINE, "RECORDING", found, expected));
    };
    Ok(GripperLatency { median_s, quartiles_s: [low_s, high_s], moves, unused })
}

/// A width as it was sensed.
#[derive(Debug, Clone, Copy)]
struct SensedWidth {
    time_s: f64,
    width_m: f64,
}

/// A gripper move that has started, and goes elsewhere than the one before.
#[derive(Debug, Clone, Copy)]
struct StartedMove {
    start_s: f64,
    width_m: f64,
    /// True if the command arrived before its start.
    is_timely: bool,
}

/// Recorded moves and widths of the gripper.
#[derive(Debug)]
struct RecordedMoves {
    /// Name of the gripper.
    gripper: String,
    fingers: Closing,
    widths: Vec<SensedWidth>,
    started: Vec<StartedMove>,
}

impl RecordedMoves {
    fn read(path: &Path) -> Result<Self, InputError> {
        let mut reader = LabReader::open(path)?;
        let cell = &reader.header.cell;
        let (_, gripper) = cell.sources.parse(&RECORDED)?;
        let fingers = cell.brain.grasp_selection.closing(&gripper);
        let mut moves = MoveFollower::new(cell.brain.control.expected_latency_s);
        let mut widths = Vec::new();
        while let Part::Tick(tick) = reader.next_part()? {
            let (time_s, width_m) = (tick.observation.time_s, tick.observation.gripper.width_m);
            widths.push(SensedWidth { time_s, width_m });
            moves.tick(time_s, &tick.command);
        }
        Ok(Self { gripper: gripper.name, fingers, widths, started: moves.started })
    }

    /// Start and latency of the moves that tell one.
    fn latencies(&self, unused: &mut UnusedMoves) -> Vec<(f64, f64)> {
        let step_m = self.width_step_m();
        let mut latencies = Vec::new();
        for (i, it) in self.started.iter().enumerate() {
            let start_s = it.start_s;
            if !it.is_timely {
                unused.late += 1;
                continue;
            }
            let before = i.checked_sub(1).map(|before| self.started[before].width_m);
            let Some(rest_m) = self.width_at_rest(start_s, before) else {
                unused.not_at_rest += 1;
                continue;
            };
            let until_s = self.started.get(i + 1).map_or(f64::INFINITY, |next| next.start_s);
            let until_s = until_s.min(start_s + LONGEST_S);
            let onset_s = self.onset_s([start_s, until_s], rest_m, it.width_m, step_m);
            match onset_s.filter(|_| (it.width_m - rest_m).abs() > LEAST_TRAVEL_M) {
                Some(onset_s) => latencies.push((start_s, onset_s - start_s)),
                None => unused.not_moved += 1,
            }
        }
        latencies
    }

    /// The smallest change of width that was sensed.
    fn width_step_m(&self) -> f64 {
        let changes = self.widths.windows(2).map(|pair| (pair[1].width_m - pair[0].width_m).abs());
        changes.filter(|change| *change > 0.0).fold(f64::INFINITY, f64::min).min(REST_M)
    }

    /// The width at `start_s` if the fingers rest then, and where the move before sent them.
    fn width_at_rest(&self, start_s: f64, sent_to_m: Option<f64>) -> Option<f64> {
        let sensed = self.widths.partition_point(|it| it.time_s <= start_s);
        let [earlier, last] = self.widths[..sensed].last_chunk()?;
        let is_near = |width_m: f64| (width_m - last.width_m).abs() <= REST_M;
        (is_near(earlier.width_m) && sent_to_m.is_none_or(is_near)).then_some(last.width_m)
    }

    /// Finds the time at which the fingers began to move from `rest_m` toward `target_m`.
    fn onset_s(&self, [start_s, until_s]: [f64; 2], rest_m: f64, target_m: f64, step_m: f64) -> Option<f64> {
        let sensed = self.widths.iter().filter(|it| it.time_s > start_s && it.time_s <= until_s);
        let onsets = sensed.filter_map(|it| {
            let travel_m = (it.width_m - rest_m) * (target_m - rest_m).signum();
            (travel_m > MOVED_M).then(|| it.time_s - self.fingers.duration_s(travel_m - step_m / 2.0))
        });
        onsets.min_by(f64::total_cmp)
    }
}

/// Follows which commanded moves start.
#[derive(Debug)]
struct MoveFollower {
    /// Time from an observation to the arrival of the command that answers it.
    command_latency_s: f64,
    queue: GripperQueue,
    arrived_s: f64,
    started: Vec<StartedMove>,
}

impl MoveFollower {
    fn new(command_latency_s: f64) -> Self {
        let queue = GripperQueue::default();
        Self { command_latency_s, queue, arrived_s: f64::NEG_INFINITY, started: Vec::new() }
    }

    fn tick(&mut self, time_s: f64, command: &Command) {
        let arrival_s = time_s + self.command_latency_s;
        while let Some(order) = self.queue.take_due(arrival_s, |start_s| start_s) {
            // A move that had to start before its command arrived would else have been taken out by then.
            let is_timely = order.start_s > self.arrived_s;
            let it = StartedMove { start_s: order.start_s.max(self.arrived_s), width_m: order.width_m, is_timely };
            // The last of the moves that start together wins, and one that is commanded again changes
            // nothing.
            self.started.pop_if(|last| last.start_s >= it.start_s);
            if self.started.last().is_none_or(|last| (last.width_m - it.width_m).abs() > REST_M) {
                self.started.push(it);
            }
        }
        if let Some(moves) = &command.gripper {
            self.queue.receive(moves, arrival_s);
        }
        self.arrived_s = arrival_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_cell::GripperMove;

    const FINGERS: Closing = Closing { speed_mps: 0.42, acceleration_mps2: 5.0 };

    fn step(start_s: f64, width_m: f64) -> GripperMove {
        GripperMove { start_s, width_m, speed_mps: 0.42, force_n: 40.0 }
    }

    /// The width of fingers that begin to close at `onset_s` and are stopped at 50 mm.
    fn width_m(onset_s: f64, time_s: f64) -> f64 {
        let after_s = (time_s - onset_s).max(0.0);
        let ramp_s = FINGERS.speed_mps / FINGERS.acceleration_mps2;
        let travel_m = if after_s < ramp_s {
            FINGERS.acceleration_mps2 * after_s * after_s / 2.0
        } else {
            FINGERS.speed_mps * (after_s - ramp_s / 2.0)
        };
        (0.08 - travel_m).max(0.05)
    }

    fn recorded(state_rate_hz: f64, step_m: f64) -> RecordedMoves {
        let widths = (0..60).map(|i| {
            let time_s = f64::from(i) * 0.01;
            // The newest state, in the sensor's steps.
            let state_s = ((time_s - 0.0007) * state_rate_hz).floor() / state_rate_hz + 0.0007;
            SensedWidth { time_s, width_m: (width_m(0.237, state_s) / step_m).round() * step_m }
        });
        let started = vec![StartedMove { start_s: 0.2, width_m: 0.0, is_timely: true }];
        RecordedMoves { gripper: String::new(), fingers: FINGERS, widths: widths.collect(), started }
    }

    #[test]
    fn the_onset_is_found_between_observations_and_in_states_that_are_old_and_rounded() {
        for (state_rate_hz, step_m) in [(1e6, 1e-9), (140.0, 1e-5), (140.0, 1e-4)] {
            let mut unused = UnusedMoves::default();
            let found = recorded(state_rate_hz, step_m).latencies(&mut unused);
            assert_eq!((found.len(), unused), (1, UnusedMoves::default()));
            let error_s = found[0].1 - 0.037;
            assert!(error_s.abs() < 0.002, "{state_rate_hz} Hz, {step_m} m: off by {error_s} s");
        }
    }

    #[test]
    fn moves_that_tell_nothing_are_counted() {
        let mut unused = UnusedMoves::default();
        let mut it = recorded(140.0, 1e-5);
        it.started = vec![
            StartedMove { start_s: 0.1, width_m: 0.08, is_timely: true },
            StartedMove { start_s: 0.15, width_m: 0.07, is_timely: false },
            StartedMove { start_s: 0.28, width_m: 0.0, is_timely: true },
        ];
        assert_eq!(it.latencies(&mut unused), []);
        assert_eq!(unused, UnusedMoves { late: 1, not_at_rest: 1, not_moved: 1 });
    }

    #[test]
    fn a_move_counts_as_it_was_last_commanded() {
        let mut moves = MoveFollower::new(0.01);
        let command = |orders: &[GripperMove]| Command { gripper: Some(orders.to_vec()), ..Command::default() };
        moves.tick(0.0, &command(&[step(0.0, 0.08), step(0.5, 0.0)]));
        moves.tick(0.1, &command(&[step(0.3, 0.0)]));
        for time_s in [0.2, 0.3, 0.4] {
            moves.tick(time_s, &Command::default());
        }
        moves.tick(0.5, &command(&[step(0.5, 0.08), step(0.5, 0.0)]));
        moves.tick(0.6, &Command::default());
        let started: Vec<(f64, bool)> = moves.started.iter().map(|it| (it.start_s, it.is_timely)).collect();
        assert_eq!(started, [(0.01, false), (0.3, true)]);
    }
}
