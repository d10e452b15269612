//! `catchingbot predict`: fits a flight to a recorded track and predicts it.

use std::{path::PathBuf, sync::Arc};

use catch_body::{InputError, quantity};
use catch_lab::flights::{
    flight::{Flight, FlightState},
    flight_prediction::{self, FlightStatus, LEAST_SIGHTINGS},
    flight_prior::FlightPrior,
    stretches::axis,
    track_file,
};
use catch_recording::{name_of, whole_file::COMMAND_LINE};
use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use nalgebra::{Unit, Vector3};
use serde::Serialize;

use crate::{number, screen};

/// Fits a flight to a recorded track, and predicts where it goes on
///
/// The track is a CSV file of t,x,y,z or t,x,y,z,qx,qy,qz,qw in seconds and metres; a header may
/// name them in any order; rows with gaps or NaN are left out. `end` is the last time in the
/// file, also if --until hides it. Gravity is 9.81 m/s² against the axis named by --up. The results are
/// in the track's own axes and clock; covariances are of (position, velocity).
///
/// The flight has drag, a Magnus force and, with orientations, drag by direction, decay of the spin and
/// a tracked point beside the centre of mass. What is known of them beforehand is in --object, or in a
/// prior for any object. Rows before the flight, as in a hand, are left out, and so are rows of zeros
/// and rows that repeat the one before. A contact ends the flight: it is reported, and what follows it
/// is not looked at. The status is `predicted`; `implausible` where the rows are far from one flight;
/// `no_gravity` where none of them fall; `too_few_sightings`; or `not_converged`.
///
/// Examples:
///   catchingbot predict --track ball.csv --up y --until 0.4     what was known after 0.4 s?
///   catchingbot predict --track ball.csv --at 0.6 --at 0.7 --json
///   catchingbot learn --tracks throws/ --up y --out gourd.toml
///   catchingbot predict --track new.csv --up y --object gourd.toml
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct PredictArguments {
    /// CSV file of the track
    #[arg(long, value_name = "FILE")]
    track: PathBuf,
    /// Axis of the track that points up
    #[arg(long, value_parser = up(), default_value = "z", allow_hyphen_values = true)]
    up: Unit<Vector3<f64>>,
    /// Use only what was seen until then, in the track's time
    #[arg(long, value_name = "S", value_parser = number)]
    until: Option<f64>,
    /// Also predict for this time; may be given more than once
    #[arg(long, value_name = "S", value_parser = number)]
    at: Vec<f64>,
    /// Prior on the object's flights, a file that `learn` wrote
    #[arg(long, value_name = "FILE")]
    object: Option<PathBuf>,
}

/// Reads the axis that points up.
pub fn up() -> impl TypedValueParser<Value = Unit<Vector3<f64>>> {
    // In the order of `axis`.
    let names = [("x", "+x"), ("-x", "-x"), ("y", "+y"), ("-y", "-y"), ("z", "+z"), ("-z", "-z")];
    let values = names.map(|(name, signed)| PossibleValue::new(name).alias(signed));
    PossibleValuesParser::new(values).map(move |given| {
        let at = names.iter().position(|(name, signed)| [*name, *signed].contains(&given.as_str()));
        Unit::new_unchecked(axis(at.unwrap_or_default()))
    })
}

#[derive(Debug, Serialize)]
struct Prediction {
    time_s: f64,
    position: [f64; 3],
    velocity: [f64; 3],
    covariance: [[f64; 6]; 6],
}

#[derive(Debug, Serialize)]
struct Document {
    /// `predicted`, or what is wrong.
    status: FlightStatus,
    /// Time of the contact that ended the flight.
    contact_s: Option<f64>,
    sightings: usize,
    inliers: Option<usize>,
    noise_m: Option<f64>,
    drag_per_m: Option<f64>,
    drag_sd_per_m: Option<f64>,
    end: Option<Prediction>,
    at: Vec<Prediction>,
}

/// Predicts a track.
///
/// # Errors
/// Faults of the arguments and of the track's file.
pub fn run(arguments: &PredictArguments, json: bool) -> anyhow::Result<()> {
    for &time_s in arguments.at.iter().chain(&arguments.until) {
        quantity::FINITE.check(COMMAND_LINE, "--at and --until", time_s)?;
    }
    let known = arguments.object.as_deref().map(FlightPrior::read).transpose()?.map(Arc::new);
    let (track, end_s) = track_file::read(&arguments.track)?;
    let until_s = arguments.until.unwrap_or(end_s);
    let seen = &track[..track.partition_point(|it| it.time_s <= until_s)];
    if seen.len() < LEAST_SIGHTINGS {
        let file = arguments.track.display().to_string();
        let expected = format!("{LEAST_SIGHTINGS} rows or more");
        return Err(InputError::new(file, "rows", format!("{} until {until_s} s", seen.len()), expected).into());
    }

    let found = flight_prediction::predict(seen, &arguments.up, known);
    let flight = found.flight.as_ref();
    let state = |time_s: f64| flight.map(|flight| (time_s, flight.at(time_s)));
    let times = arguments.at.iter().copied().map(|time_s| (time_s, true)).chain([(end_s, false)]);
    for (time_s, is_asked) in times {
        if state(time_s).is_none_or(|(_, state)| state.is_finite()) {
            continue;
        }
        let expected = format!("a time nearer to the track, which lasts from {} to {until_s} s", seen[0].time_s);
        let (file, field) = (arguments.track.display().to_string(), "the last time");
        let (file, field) = if is_asked { (COMMAND_LINE, "--at") } else { (&*file, field) };
        return Err(InputError::new(file, field, time_s, expected).into());
    }
    let [drag_per_m, drag_sd_per_m] = [0, 1].map(|i| flight.map(|flight| flight.drag_per_m()[i]));
    let document = Document {
        status: found.status,
        contact_s: found.contact_s,
        sightings: seen.len(),
        inliers: flight.map(Flight::inliers),
        noise_m: flight.map(|it| it.noise.position_sd_m),
        drag_per_m,
        drag_sd_per_m,
        end: state(end_s).map(Prediction::of),
        at: arguments.at.iter().filter_map(|&time_s| state(time_s)).map(Prediction::of).collect(),
    };
    if json { screen::document(&document) } else { Ok(print(&document)?) }
}

impl Prediction {
    fn of((time_s, state): (f64, FlightState)) -> Self {
        Self {
            time_s,
            position: state.position.into(),
            velocity: state.velocity.into(),
            covariance: state.covariance.transpose().into(),
        }
    }
}

fn print(document: &Document) -> std::io::Result<()> {
    screen::fact("status", &name_of(document.status))?;
    if let Some(contact_s) = document.contact_s {
        screen::fact(
            "contact",
            &format!("at {contact_s:.4} s, which ended the flight; predicted is how it would have gone on"),
        )?;
    }
    let inliers = document.inliers.map_or(String::new(), |count| format!(", {count} agree"));
    screen::fact("sightings", &format!("{}{inliers}", document.sightings))?;
    if let Some(noise_m) = document.noise_m {
        screen::fact("their noise", &format!("{:.2} mm", noise_m * 1e3))?;
    }
    let wrong = match document.status {
        FlightStatus::Predicted => None,
        FlightStatus::Implausible => Some("they are far from one flight: is --up right, are they metres and seconds?"),
        FlightStatus::NoGravity => Some("none of them accelerate by 9.81 m/s² against --up, nor by that and air"),
        FlightStatus::TooFewSightings => Some("few of them are numbers and differ from the row before"),
        FlightStatus::NotConverged => Some("no flight fits them"),
    };
    if let Some(wrong) = wrong {
        screen::fact("what is wrong", wrong)?;
    }
    if document.end.is_none() {
        screen::fact(
            "what may help",
            "the right --up; metres and seconds; more of the flight, and nothing but the flight",
        )?;
    }
    if let (Some(drag), Some(sd)) = (document.drag_per_m, document.drag_sd_per_m) {
        screen::fact("drag", &format!("{drag:.4} ± {sd:.4} 1/m"))?;
    }
    for (label, it) in document.end.iter().map(|it| ("end", it)).chain(document.at.iter().map(|it| ("at", it))) {
        let [x, y, z] = it.position;
        let sd = |i: usize| it.covariance[i][i].max(0.0).sqrt() * 1e3;
        let [dx, dy, dz] = [sd(0), sd(1), sd(2)];
        let place = format!("({x:.4}, {y:.4}, {z:.4}) m ± ({dx:.1}, {dy:.1}, {dz:.1}) mm");
        let [x, y, z] = it.velocity;
        screen::fact(&format!("{label} {:.4} s", it.time_s), &format!("{place}, ({x:.3}, {y:.3}, {z:.3}) m/s"))?;
    }
    Ok(())
}
