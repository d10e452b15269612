//! The results of an evaluation as a table: one row per trial, the same columns in CSV and in Parquet.
//!
//! Both are made from the log of the trials when an evaluation is complete; the log stays what is true.

use std::{
    borrow::Cow,
    fmt::Write as _,
    io::{BufWriter, Write},
    path::Path,
};

use catch_body::InputError;
use serde_json::Value;

use crate::{evaluation::Row, referee::LEADS_S};
use catch_recording::whole_file::replace;

#[cfg(feature = "parquet")]
mod parquet_file;

/// Names of the files.
pub const CSV_FILE: &str = "trials.csv";
/// Name of the Parquet file.
pub const PARQUET_FILE: &str = "trials.parquet";

/// Advice where a table cannot be written.
const AGAIN: &str = "a place to write to; --resume writes it again";

/// Number of rows that are converted to columns at a time, so that memory does not grow with the evaluation.
const GROUP_ROWS: usize = 1000;

/// Type of a column's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Texts.
    Text,
    /// Whole numbers that are not negative.
    Count,
    /// Truth values.
    Flag,
    /// Numbers.
    Number,
}

/// Columns, by their names in a [`Row`]. Lengths are in metres, angles in radians, times in seconds, as the
/// names say; ratios are of the arm's limits.
const COLUMNS: &[(&str, Kind)] = &[
    ("scenario", Kind::Text),
    ("object", Kind::Text),
    ("throw", Kind::Text),
    ("seed", Kind::Count),
    ("index", Kind::Count),
    ("caught", Kind::Flag),
    ("caught_paper", Kind::Flag),
    ("caught_paper_code", Kind::Flag),
    ("held_later", Kind::Flag),
    ("caught_beyond_limits", Kind::Flag),
    ("reason", Kind::Text),
    (REACH, Kind::Number),
    ("limit_violations", Kind::Count),
    ("motion_excursions", Kind::Count),
    ("catch_time_s", Kind::Number),
    ("contact_s", Kind::Number),
    ("prediction_error_m", Kind::Number),
    ("prediction_rotation_error_rad", Kind::Number),
    (PREDICTIONS, Kind::Number),
    ("tracking_error_m", Kind::Number),
    ("grasp_offset_m", Kind::Number),
    ("grasp_rotation_error_rad", Kind::Number),
    ("contact_delay_s", Kind::Number),
    ("relative_speed_mps", Kind::Number),
    ("sideways_fraction", Kind::Number),
    ("palm_fraction", Kind::Number),
    ("grasp_width_m", Kind::Number),
    ("grasp_overhang_m", Kind::Number),
    ("grasp_strength_m", Kind::Number),
    ("approach_is_free", Kind::Flag),
    ("joint_travel_rad", Kind::Number),
    ("peak_contact_impulse_ns", Kind::Number),
    ("catch_impulse_ns", Kind::Number),
    ("catch_joint_impulse_nms", Kind::Number),
    ("contact_stop_ratio", Kind::Number),
    ("contact_stop_joint", Kind::Count),
    ("peak_velocity_ratio", Kind::Number),
    ("peak_acceleration_ratio", Kind::Number),
    ("peak_torque_ratio", Kind::Number),
    ("flight_velocity_ratio", Kind::Number),
    ("flight_torque_ratio", Kind::Number),
    ("torque_clamped_s", Kind::Number),
    ("late_trajectories", Kind::Count),
    ("rejected_trajectories", Kind::Count),
    ("discontinuous_trajectories", Kind::Count),
    ("numerical_failures", Kind::Count),
    ("min_self_clearance_m", Kind::Number),
    ("min_floor_clearance_m", Kind::Number),
    ("blinded_cameras", Kind::Count),
    ("frozen_cameras", Kind::Count),
    ("silent_cameras", Kind::Count),
    ("displaced_cameras", Kind::Count),
    ("swapped_cameras", Kind::Count),
    ("uncalibrated_cameras", Kind::Count),
    (CONDITIONS, Kind::Number),
];
/// One column each for how long before the catch a prediction was made.
const PREDICTIONS: &str = "prediction_errors_m";
/// Prefix of the columns of the oracle's result; only misses have it.
const REACH: &str = "reach";
const REACHES: &[&str] = &["from_first_image_s", "from_release_s"];
/// Prefix of the columns of the conditions drawn for the throw; then name and JSON path of each column.
const CONDITIONS: &str = "conditions";
const DRAWN: &[(&str, &str)] = &[
    ("release_x_m", "/release/position_m/0"),
    ("release_y_m", "/release/position_m/1"),
    ("release_z_m", "/release/position_m/2"),
    ("release_vx_mps", "/release/velocity_mps/0"),
    ("release_vy_mps", "/release/velocity_mps/1"),
    ("release_vz_mps", "/release/velocity_mps/2"),
    ("release_spin_x_radps", "/release/spin_radps/0"),
    ("release_spin_y_radps", "/release/spin_radps/1"),
    ("release_spin_z_radps", "/release/spin_radps/2"),
    ("release_qx", "/release/orientation_xyzw/0"),
    ("release_qy", "/release/orientation_xyzw/1"),
    ("release_qz", "/release/orientation_xyzw/2"),
    ("release_qw", "/release/orientation_xyzw/3"),
    ("friction", "/friction"),
    ("restitution", "/restitution"),
    ("drag_per_m", "/drag_per_m"),
    ("mass_kg", "/mass_kg"),
    ("wind_x_mps", "/wind_mps/0"),
    ("wind_y_mps", "/wind_mps/1"),
    ("wind_z_mps", "/wind_mps/2"),
    ("magnus", "/magnus"),
    ("spin_decay_per_s", "/spin_decay_per_s"),
];
/// Fields of a [`Row`] that are no column: a violation is told by its number here, and in full in the log.
#[cfg(test)]
const ELSEWHERE: &[&str] = &["first_violation"];

/// A column with its values, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name of the column.
    pub name: String,
    /// Type of the values.
    pub kind: Kind,
    /// A value for each row, null where there is none.
    pub values: Vec<Value>,
}

/// The columns of the table of these rows.
pub fn columns(rows: &[Row]) -> Vec<Column> {
    let rows: Vec<Value> = rows.iter().map(|row| serde_json::to_value(row).unwrap_or_default()).collect();
    let of = |pick: &dyn Fn(&Value) -> Option<&Value>| -> Vec<Value> {
        rows.iter().map(|row| pick(row).cloned().unwrap_or_default()).collect()
    };
    let mut columns = Vec::new();
    for &(field, kind) in COLUMNS {
        let mut add = |name: String, values: Vec<Value>| columns.push(Column { name, kind, values });
        match field {
            REACH => {
                for part in REACHES {
                    add(format!("{field}_{part}"), of(&|row| row.get(field)?.get(part)));
                }
            }
            CONDITIONS => {
                for (name, at) in DRAWN {
                    add((*name).to_owned(), of(&|row| row.get(field)?.pointer(at)));
                }
            }
            PREDICTIONS => {
                for (i, lead_s) in LEADS_S.iter().enumerate() {
                    let name = format!("prediction_error_{:.0}ms_before_m", lead_s * 1e3);
                    add(name, of(&|row| row.get(field)?.get(i)));
                }
            }
            _ => add(field.to_owned(), of(&|row| row.get(field))),
        }
    }
    columns
}

/// Writes the table into a folder, in Parquet as well where that is compiled in, each file at once or not at
/// all. `identity` says what was evaluated; Parquet keeps it.
///
/// # Errors
/// If they cannot be written; what was there before stays.
pub fn write(folder: &Path, rows: &[Row], identity: &str) -> Result<(), InputError> {
    replace(&folder.join(CSV_FILE), AGAIN, |file| {
        let mut file = BufWriter::new(file);
        file.write_all(names(&columns(&[])).as_bytes())?;
        for rows in rows.chunks(GROUP_ROWS) {
            file.write_all(csv(&columns(rows), rows.len()).as_bytes())?;
        }
        file.flush()
    })?;
    #[cfg(feature = "parquet")]
    replace(&folder.join(PARQUET_FILE), AGAIN, |file| {
        parquet_file::write(file, rows, identity).map_err(std::io::Error::other)
    })?;
    #[cfg(not(feature = "parquet"))]
    let _ = identity;
    Ok(())
}

/// The line of names.
fn names(columns: &[Column]) -> String {
    let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
    names.join(",") + "\n"
}

/// A text as spreadsheets and other readers take it: none that others chose is a formula, and each is one
/// field.
fn csv_text(value: &str) -> Cow<'_, str> {
    let value = match value.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        true => Cow::Owned(format!("'{value}")),
        false => Cow::Borrowed(value),
    };
    match value.contains(['"', ',', '\n', '\r']) {
        true => Cow::Owned(format!("\"{}\"", value.replace('"', "\"\""))),
        false => value,
    }
}

/// A line per trial; numbers as short as they can be read back exactly, nothing where there is none.
fn csv(columns: &[Column], rows: usize) -> String {
    let mut text = String::new();
    for row in 0..rows {
        for (i, column) in columns.iter().enumerate() {
            if i > 0 {
                text.push(',');
            }
            match &column.values[row] {
                Value::Null => {}
                Value::String(value) => text += &csv_text(value),
                value => {
                    let _ = write!(text, "{value}");
                }
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        reachability::oracle::Reach,
        referee::{Measures, Verdict, reason::Reason},
        scenario::setup::{Choice, Scene, Setup},
    };

    fn row(index: u64, reason: Option<Reason>) -> Row {
        Row {
            scene: Scene { scenario: "a, b".into(), object: "x".into(), throw: "y".into(), seed: u64::MAX, index },
            verdict: Verdict {
                caught: reason.is_none(),
                caught_paper: true,
                caught_paper_code: true,
                held_later: false,
                caught_beyond_limits: false,
                reason,
                reach: reason.map(|_| Reach { from_first_image_s: None, from_release_s: Some(0.5) }),
                limit_violations: 0,
                first_violation: None,
                motion_excursions: 0,
                catch_time_s: Some(0.1 + 0.2),
                contact_s: None,
                measures: Measures::default(),
            },
            conditions: Some(Setup::load(&Choice::default()).unwrap().flight_conditions(1, 0)),
        }
    }

    #[test]
    fn every_field_of_a_row_has_its_column() {
        let Value::Object(map) = serde_json::to_value(row(0, Some(Reason::Late))).unwrap() else {
            panic!("a row is an object")
        };
        for field in map.keys() {
            let is_known = COLUMNS.iter().any(|(name, _)| name == field) || ELSEWHERE.contains(&field.as_str());
            assert!(is_known, "{field} has no column");
        }
        assert!(COLUMNS.iter().all(|(name, _)| map.contains_key(*name)));
        assert!(DRAWN.iter().all(|(_, at)| map[CONDITIONS].pointer(at).is_some_and(Value::is_f64)));
        assert!(map[REACH].as_object().unwrap().keys().all(|part| REACHES.contains(&part.as_str())));
    }

    #[test]
    fn csv_gives_numbers_back_exactly_and_quotes_what_must_be() {
        let columns = columns(&[row(3, Some(Reason::Late))]);
        let (names, line) = (names(&columns), csv(&columns, 1));
        assert!(
            line.starts_with(
                "\"a, b\",x,y,18446744073709551615,3,false,true,true,false,false,late,,0.5,0,0,0.30000000000000004,,"
            ),
            "{line}"
        );
        assert_eq!(names.split(',').count(), line.split(',').count() - 1);
    }
}
