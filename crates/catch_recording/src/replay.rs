//! Replays: the brain of a recording, built again, sees the recorded observations, and its commands are
//! compared with the recorded ones.

use std::sync::Arc;

use catch_body::InputError;
use catch_bot::{CatchingBot, Preparation};
use catch_cell::{Brain, Command};
use serde::Serialize;
use serde_json::Value;

use crate::{
    reach_map,
    reader::{Channel, Part, RecordingReader},
    recording::{Ending, RecordedCell},
    sources::SourceNames,
};

/// Result of a comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared<T> {
    /// Number of ticks that were compared.
    pub ticks: usize,
    /// Time of the first missing image, after which nothing can be compared; `None` where the recording has
    /// all.
    pub images_until_s: Option<f64>,
    /// The first difference; `None` where all commands that were compared are identical.
    pub difference: Option<Difference>,
    /// The recording's ending.
    pub ending: Ending<T>,
}

/// First difference between a replay and its recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Time of the tick.
    pub time_s: f64,
    /// Path of the first value that differs, such as `arm.spline.knots_s[3]`.
    pub field: String,
    /// Value in the recording.
    pub recorded: Value,
    /// Value in the replay.
    pub replayed: Value,
}

/// Reads a recording to its end and compares its commands with those of its brain, built again.
///
/// # Errors
/// If the file cannot be read to its end.
pub fn compare<S: Channel, T: Channel>(reader: &mut RecordingReader<S, T>) -> Result<Compared<T>, InputError> {
    let mut brain = brain_of(&reader.header.cell)?;
    let (mut ticks, mut difference, mut images_until_s) = (0, None, None);
    loop {
        match reader.next_part()? {
            Part::Tick(tick) if tick.images_left_out || images_until_s.is_some() => {
                images_until_s.get_or_insert(tick.observation.time_s);
            }
            Part::Tick(tick) => {
                let command = brain.tick(&tick.observation, &mut ());
                ticks += 1;
                if difference.is_none() {
                    difference = first_difference(tick.observation.time_s, &tick.command, &command);
                }
            }
            Part::Ending(ending) => return Ok(Compared { ticks, images_until_s, difference, ending: *ending }),
        }
    }
}

/// Names of the texts in a recording, for error messages.
pub const RECORDED: SourceNames = SourceNames {
    robot_urdf: "robot.urdf in the recording",
    robot_toml: "robot.toml in the recording",
    gripper_toml: "gripper.toml in the recording",
    workcell_toml: "workcell.toml in the recording",
};

/// The brain as it was before the recorded throw.
///
/// # Errors
/// A recorded text or setting from which no brain can be made.
pub fn brain_of(cell: &RecordedCell) -> Result<CatchingBot, InputError> {
    let (mut robot, gripper) = cell.sources.parse(&RECORDED)?;
    robot.ready_q = robot.checked_pose("the recording", "ready_rad", &cell.ready_rad)?;
    let (config, cameras) = (cell.brain.config(), cell.cameras.clone());
    let fault =
        |it: InputError| InputError { file: "the recording".to_owned(), field: format!("brain.{}", it.field), ..it };
    let reach_map = reach_map::of(&robot);
    let known = Preparation::new(config, (robot, reach_map), gripper, cameras, &cell.reference_scan).map_err(fault)?;
    Ok(cell.brain.brain(Arc::new(known), cell.seed))
}

/// Compares two commands bit for bit: as equal numbers, −0 and 0 would pass.
fn first_difference(time_s: f64, recorded: &Command, replayed: &Command) -> Option<Difference> {
    let bytes = |command: &Command| rmp_serde::to_vec_named(command).unwrap_or_default();
    if bytes(recorded) == bytes(replayed) {
        return None;
    }
    let value = |command: &Command| serde_json::to_value(command).unwrap_or_default();
    let (field, recorded, replayed) = first_differing_value("", &value(recorded), &value(replayed))
        .unwrap_or_else(|| ("the sign of a zero or a NaN".to_owned(), Value::Null, Value::Null));
    Some(Difference { time_s, field, recorded, replayed })
}

/// The first value in which two documents differ, at or below `path`, and what each has there.
pub fn first_differing_value(path: &str, one: &Value, two: &Value) -> Option<(String, Value, Value)> {
    match (one, two) {
        (Value::Object(one), Value::Object(two)) => one.keys().chain(two.keys()).find_map(|key| {
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            let [one, two] = [one, two].map(|it| it.get(key).unwrap_or(&Value::Null));
            first_differing_value(&path, one, two)
        }),
        (Value::Array(one), Value::Array(two)) if one.len() == two.len() => (one.iter().zip(two).enumerate())
            .find_map(|(i, (one, two))| first_differing_value(&format!("{path}[{i}]"), one, two)),
        _ => (one != two).then(|| (path.to_owned(), one.clone(), two.clone())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_cell::GripperMove;

    fn command(width_m: f64) -> Command {
        let closing = GripperMove { start_s: 0.5, width_m, speed_mps: 0.4, force_n: 80.0 };
        Command { gripper: Some(vec![closing; 2]), ..Command::default() }
    }

    #[test]
    fn the_first_difference_is_named() {
        assert_eq!(first_difference(0.1, &command(0.03), &command(0.03)), None);
        let difference = first_difference(0.1, &command(0.03), &command(0.04)).unwrap();
        assert_eq!(difference.field, "gripper[0].width_m");
        assert_eq!((difference.recorded, difference.replayed), (0.03.into(), 0.04.into()));
    }

    #[test]
    fn the_sign_of_zero_is_a_difference() {
        assert!(first_difference(0.1, &command(0.0), &command(-0.0)).is_some());
    }
}
