//! Recorded tracks of flying things: CSV files of `t,x,y,z` or `t,x,y,z,qx,qy,qz,qw`, in seconds and metres.

use std::path::{Path, PathBuf};

use catch_body::{InputError, document::Document, statistics::median_in_place};
use nalgebra::{Point3, Quaternion, UnitQuaternion};

use catch_recording::bounded_file::{FileKind, paths_in};

/// Measurement of an object's pose at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Time of the measurement.
    pub time_s: f64,
    /// Position in the track's axes.
    pub p: Point3<f64>,
    /// Orientation, if the track has it.
    pub rotation: Option<UnitQuaternion<f64>>,
}

/// Tracks in a folder at most.
const MOST_TRACKS: usize = 10_000;

/// The CSV files of a folder, a throw each, in the order of their names.
///
/// # Errors
/// A folder that cannot be read, or one with fewer than `least` of them.
pub fn in_folder(folder: &Path, least: usize) -> Result<Vec<PathBuf>, InputError> {
    let mut paths = paths_in(folder, "a folder of CSV files, a throw each")?;
    paths.retain(|path| path.extension().is_some_and(|it| it.eq_ignore_ascii_case("csv")));
    let fault = |expected: String| Err(InputError::new(folder.display(), "CSV files", paths.len(), expected));
    match paths.len() {
        count if count < least => return fault(format!("{least} or more, a throw each")),
        count if count > MOST_TRACKS => return fault(format!("at most {MOST_TRACKS}, a throw each")),
        _ => {}
    }
    Ok(paths)
}

/// Reads a track, oldest sighting first, and the last time in the file. A header may stand above it. Rows in
/// which a number is missing, not a number or beyond all bounds are gaps, as are poses of zeros. A row that
/// stands there twice is read once.
///
/// # Errors
/// A file that cannot be read, rows with another number of columns or with words, times that do not rise or
/// are far apart, or no sighting.
pub fn read(path: &Path) -> Result<(Vec<Sighting>, f64), InputError> {
    let file = path.display().to_string();
    parse(&file, &FileKind::text("a readable CSV file of t,x,y,z").read_text(path)?)
}

/// Reads the text of a track; `file` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &str, text: &str) -> Result<(Vec<Sighting>, f64), InputError> {
    let mut sightings: Vec<Sighting> = Vec::new();
    let (mut columns, mut end_s): (Option<Vec<usize>>, f64) = (None, f64::NEG_INFINITY);
    // The row before, and its line: recorders repeat rows.
    let mut before = (0, "");
    for (number, line) in text.lines().enumerate() {
        let line = line.trim().trim_start_matches('\u{feff}');
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let field = format!("line {}", number + 1);
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let numbers: Vec<Option<f64>> = cells.iter().map(|cell| number_of(cell)).collect();
        if columns.is_none() && numbers.iter().all(Option::is_none) {
            columns = Some(named_columns(file, number + 1, &cells)?);
            continue;
        }
        let columns = columns.get_or_insert_with(|| (0..cells.len()).collect());
        let count = columns.len();
        if !matches!(count, 4 | 8) || count != cells.len() {
            return Err(InputError::new(file, field, format!("{} columns", cells.len()), EXPECTED));
        }
        if let Some(word) = cells.iter().zip(&numbers).find(|(_, number)| number.is_none()) {
            return Err(InputError::new(file, field, format!("`{}`", word.0), "a number"));
        }
        let values: Vec<f64> = columns.iter().filter_map(|at| numbers[*at]).collect();
        let time_s = values[0];
        if !time_s.is_finite() {
            continue;
        }
        if line == before.1 {
            continue;
        }
        if time_s <= end_s {
            let expected = format!("a time after {end_s}, that of line {}, or the same row again", before.0);
            return Err(InputError::new(file, field, format!("t = {time_s}"), expected));
        }
        (end_s, before) = (time_s, (number + 1, line));
        let is_lost = values.len() == 8 && values[1..].iter().all(|it| *it == 0.0);
        if is_lost || !values.iter().all(|value| value.abs() <= FARTHEST) {
            continue;
        }
        let rotation = match &values[4..] {
            [x, y, z, w] => {
                let quaternion = Quaternion::new(*w, *x, *y, *z);
                if (quaternion.norm() - 1.0).abs() > 0.05 {
                    let found = format!("a quaternion of length {:.3}", quaternion.norm());
                    return Err(InputError::new(file, field, found, "length 1, in the order qx,qy,qz,qw"));
                }
                Some(UnitQuaternion::from_quaternion(quaternion))
            }
            _ => None,
        };
        sightings.push(Sighting { time_s, p: Point3::new(values[1], values[2], values[3]), rotation });
    }
    if sightings.is_empty() {
        return Err(InputError::new(file, "rows", "none with numbers in all columns", "rows of t,x,y,z"));
    }
    check_spacing(file, &sightings)?;
    Ok((sightings, end_s))
}

/// Checks that rows are so close to each other that they can show a flight: times may be in milliseconds.
fn check_spacing(file: &str, sightings: &[Sighting]) -> Result<(), InputError> {
    let mut apart_s: Vec<f64> = sightings.windows(2).map(|it| it[1].time_s - it[0].time_s).collect();
    let apart_s = median_in_place(&mut apart_s);
    if apart_s <= MOST_APART_S {
        return Ok(());
    }
    let expected = format!("times in seconds, and rows {MOST_APART_S} s apart or less");
    Err(InputError::new(file, "t", format!("rows {apart_s} apart"), expected))
}

/// Median time between two rows at most.
const MOST_APART_S: f64 = 0.5;

/// What is farther, in whatever unit, is no sighting; its square may be no number.
const FARTHEST: f64 = 1e100;

/// Description of a valid track, for error messages.
const EXPECTED: &str =
    "t,x,y,z or t,x,y,z,qx,qy,qz,qw with commas between, in another order below a header with these names";

/// The columns of the time, the position and the quaternion x, y, z, w that a header names: each is one that
/// is read, under a name that others give it.
fn named_columns(file: &str, line: usize, header: &[&str]) -> Result<Vec<usize>, InputError> {
    let document = Document::from_columns(file, line, header)?;
    let found: Option<Vec<usize>> = PLACES.iter().map(|it| document.column(it)).collect();
    let turned: Vec<Option<usize>> = ROTATION.iter().map(|it| document.column(it)).collect();
    document.finish(&[]).map_err(|fault| InputError { expected: EXPECTED.to_owned(), ..fault })?;
    let wrong = || InputError::new(file, format!("line {line}"), format!("columns {}", header.join(",")), EXPECTED);
    let mut columns = found.ok_or_else(wrong)?;
    match turned.iter().flatten().count() {
        0 => {}
        4 => columns.extend(turned.into_iter().flatten()),
        _ => return Err(wrong()),
    }
    Ok(columns)
}

/// Names of the time and of the place, in seconds and metres.
const PLACES: [&[&str]; 4] = [
    &["t", "time", "time_s", "t_s", "timestamp", "time (s)", "t (s)", "t [s]", "time [s]", "seconds"],
    &["x", "x_m", "px", "pos_x", "position_x", "p_x", "tx", "x (m)", "x [m]", "position.x"],
    &["y", "y_m", "py", "pos_y", "position_y", "p_y", "ty", "y (m)", "y [m]", "position.y"],
    &["z", "z_m", "pz", "pos_z", "position_z", "p_z", "tz", "z (m)", "z [m]", "position.z"],
];
/// Names of a unit quaternion's parts.
const ROTATION: [&[&str]; 4] = [
    &["qx", "q_x", "quat_x", "rot_x", "orientation_x", "orientation.x", "rotation_x"],
    &["qy", "q_y", "quat_y", "rot_y", "orientation_y", "orientation.y", "rotation_y"],
    &["qz", "q_z", "quat_z", "rot_z", "orientation_z", "orientation.z", "rotation_z"],
    &["qw", "q_w", "quat_w", "rot_w", "orientation_w", "orientation.w", "rotation_w"],
];

/// A number; an empty cell is a gap, a word is none.
fn number_of(cell: &str) -> Option<f64> {
    if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_left_out_and_a_header_may_stand_above() {
        let text = "t, x, y, z\n0.0,1,2,3\n0.1,NaN,2,3\n0.2,,2,3\n\n0.3,4,5,6\n0.4,nan,,\n,1,2,3\n";
        let (track, end_s) = parse("t.csv", text).unwrap();
        assert_eq!(end_s, 0.4, "the last time in the file, seen or not");
        assert_eq!(track.iter().map(|it| it.time_s).collect::<Vec<_>>(), [0.0, 0.3]);
        assert_eq!(track[1].p, Point3::new(4.0, 5.0, 6.0));
        assert_eq!(parse("t.csv", &format!("{text}0.5,4,5,6\n0.5,4,5,6\n")).unwrap().0.len(), 3, "a row told twice");
        let lost = "0.0,1,2,3,0,0,0,1\n0.1,0,0,0,0,0,0,0\n0.2,1e155,2,3,0,0,0,1\n";
        let (posed, end_s) = parse("t.csv", lost).unwrap();
        assert_eq!((posed.len(), end_s), (1, 0.2));
        assert_eq!(posed[0].rotation, Some(UnitQuaternion::identity()));
    }

    /// A header says which column is what.
    #[test]
    fn columns_are_read_by_their_names() {
        let expected = parse("t.csv", "0.5,1,2,3,0.1,0.7,0.1,0.7\n").unwrap();
        for text in [
            "time,y,x,z,qw,qx,qy,qz\n0.5,2,1,3,0.7,0.1,0.7,0.1\n",
            "x,y,z,t,qx,qy,qz,qw\n1,2,3,0.5,0.1,0.7,0.1,0.7\n",
            "\u{feff}Time [s],X,Y,Z,qx,qy,qz,qw\n0.5,1,2,3,0.1,0.7,0.1,0.7\n",
        ] {
            assert_eq!(parse("t.csv", text).unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn faults_name_the_line() {
        for (text, line) in [
            ("0,1,2\n", "line 1"),
            ("t,x,y,z,quality\n0,1,2,3,1\n", "line 1: quality: found the column `quality`, which is not read"),
            ("t,x,y,z,qx,qy,qz\n0,1,2,3,0,0,0\n", "line 1"),
            ("frame,x,y,z\n0,1,2,3\n", "line 1"),
            ("t,x,x,z\n0,1,2,3\n", "line 1: found the column `x` twice"),
            (
                "0;1;2;3\n0.1;1;2;3\n",
                "line 1: 0;1;2;3: found the column `0;1;2;3`, which is not read, expected t,x,y,z",
            ),
            ("0,1,2,3\n1,1,2,3,0,0,0,1\n", "line 2"),
            ("0,1,2,3\n1,a,2,3\n", "line 2"),
            ("1,1,2,3\n0.5,1,2,3\n", "line 2"),
            ("0,1,2,3\n\n0,1,2,4\n", "line 3: found t = 0, expected a time after 0, that of line 1"),
            ("0,1,2,3,9,0,0,1\n", "line 1"),
            ("0,1,2,3,0,0,0,0\n", "line 1: found a quaternion of length 0.000"),
            ("t,x,y,z\n", "rows"),
            ("0,1,2,3\n5,1,2,4\n10,1,2,5\n", "t: found rows 5 apart, expected times in seconds"),
        ] {
            let fault = parse("t.csv", text).unwrap_err().to_string();
            assert!(fault.contains(&format!("t.csv: {line}")), "{text:?}: {fault}");
        }
    }
}
