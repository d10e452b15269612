//! `catchingbot predict`: fits a flight to a recorded track and predicts it.

use std::path::PathBuf;

use catch_body::{InputError, quantity};
use catch_bot::trajectory_prediction::{Config, PredictionStatus, Track, TrackSample};
use catch_lab::{
    VERSION,
    assets::COMMAND_LINE,
    own_data::{
        aerodynamics::{AerodynamicFit, FlightPrior, free_flight},
        flight_learning,
        track_file::{self, Sighting},
    },
};
use clap::{Args, ValueEnum};
use nalgebra::{Unit, Vector3};
use serde::Serialize;

use super::{
    fall::{NO_GRAVITY, falls},
    register::rows,
};
use crate::screen;

/// Arguments of `predict`.
#[derive(Debug, Args)]
#[command(after_help = "\
The track is a CSV file of t,x,y,z or t,x,y,z,qx,qy,qz,qw in seconds and metres; a header may stand
above it, in this order; rows with gaps or NaN are left out. What is called the end is the last time
in the file, seen or not. Gravity is 9.81 m/s² against the axis named by --up.
What is printed is in the track's own axes and clock; covariances are of (position, velocity).

A track with orientations is fitted with drag by direction, Magnus force, decay of the spin and a tracked
point beside the centre of mass; what is known of them beforehand is in --object, or in a prior for
any object. One without orientations is fitted with isotropic drag unless there is an --object.
A contact ends the flight: it is reported, and what follows it is not looked at.

Examples:
  catchingbot predict --track ball.csv --up y --until 0.4     what was known after 0.4 s?
  catchingbot predict --track ball.csv --at 0.6 --at 0.7 --json
  catchingbot learn --tracks throws/ --up y --out gourd.toml
  catchingbot predict --track new.csv --up y --object gourd.toml")]
pub struct PredictArguments {
    /// CSV file of the track
    #[arg(long, value_name = "FILE")]
    track: PathBuf,
    /// Axis of the track that points up
    #[arg(long, value_enum, default_value_t = Up::Z)]
    up: Up,
    /// Use only what was seen until then, in the track's time
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    until: Option<f64>,
    /// Also predict for this time; may be given more than once
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    at: Vec<f64>,
    /// What `learn` found of the object
    #[arg(long, value_name = "FILE", conflicts_with_all = ["drag", "drag_sd"])]
    object: Option<PathBuf>,
    /// Isotropic drag: constant k of a = -k·|v|·v that is expected, in 1/m [default: 0.05]
    #[arg(long, value_name = "K", allow_negative_numbers = true)]
    drag: Option<f64>,
    /// How well that is known, as a standard deviation; 0: exactly [default: 0.1]
    #[arg(long, value_name = "SD", allow_negative_numbers = true)]
    drag_sd: Option<f64>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Drag constant that is expected without another, and its standard deviation.
const DRAG_PER_M: [f64; 2] = [0.05, 0.1];

/// Axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Up {
    Y,
    Z,
}

impl Up {
    /// Its direction.
    pub fn direction(self) -> Unit<Vector3<f64>> {
        match self {
            Self::Y => Vector3::y_axis(),
            Self::Z => Vector3::z_axis(),
        }
    }
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
    version: &'static str,
    /// `predicted`, or what was missing.
    status: serde_json::Value,
    /// `aerodynamic` or `isotropic_drag`.
    model: &'static str,
    /// When a contact ended the flight.
    contact_s: Option<f64>,
    sightings: usize,
    inliers: Option<usize>,
    noise_m: f64,
    drag_per_m: Option<f64>,
    drag_sd_per_m: Option<f64>,
    end: Option<Prediction>,
    at: Vec<Prediction>,
}

/// With more noise than this something is wrong, most likely.
const IMPLAUSIBLE_NOISE_M: f64 = 0.02;
/// Names of the models.
const AERODYNAMIC: &str = "aerodynamic";
const ISOTROPIC_DRAG: &str = "isotropic_drag";
/// Sightings at most that the fit with isotropic drag looks at.
const MOST_SIGHTINGS: usize = 2000;
/// Sightings that a flight needs.
const LEAST_SIGHTINGS: usize = 6;

/// Predicts a track.
///
/// # Errors
/// Faults of the arguments and of the track's file.
pub fn run(arguments: &PredictArguments) -> anyhow::Result<()> {
    let finite = |field: &str, value: f64| InputError::finite(COMMAND_LINE, field, [value]).map(|_| value);
    for &time_s in arguments.at.iter().chain(&arguments.until) {
        finite("--at and --until", time_s)?;
    }
    let [drag, drag_sd] = [
        quantity::DRAG_PER_M.check(COMMAND_LINE, "--drag", arguments.drag.unwrap_or(DRAG_PER_M[0]))?,
        quantity::DRAG_PER_M.check(COMMAND_LINE, "--drag-sd", arguments.drag_sd.unwrap_or(DRAG_PER_M[1]))?,
    ];
    let prior = arguments.object.as_deref().map(flight_learning::read).transpose()?;
    let (track, end_s) = track_file::read(&arguments.track)?;
    let until_s = arguments.until.unwrap_or(end_s);
    let seen = &track[..track.partition_point(|it| it.time_s <= until_s)];
    if seen.len() < LEAST_SIGHTINGS {
        let file = arguments.track.display().to_string();
        let expected = format!("{LEAST_SIGHTINGS} rows or more");
        return Err(InputError::new(file, "rows", format!("{} until {until_s} s", seen.len()), expected).into());
    }

    let up = arguments.up.direction();
    let isotropic = arguments.drag.is_some() || arguments.drag_sd.is_some();
    let oriented = seen.iter().any(|it| it.rotation.is_some());
    let prior = prior.or_else(|| (oriented && !isotropic).then(flight_learning::any_object));
    let asked = (end_s, &*arguments.at);
    let document = match (falls(seen, &up), prior) {
        (Err(status), prior) => {
            let model = if prior.is_some() { AERODYNAMIC } else { ISOTROPIC_DRAG };
            Document { status: status.into(), ..Document::of(seen, model) }
        }
        (Ok(()), Some(prior)) => aerodynamic(seen, &up, prior, asked)?,
        (Ok(()), None) => isotropic_drag(seen, &up, [drag, drag_sd], asked)?,
    };
    // Backward through air a flight soon becomes infinitely fast.
    let is_finite =
        |it: &&Prediction| it.position.iter().chain(it.covariance.iter().flatten()).all(|it| it.is_finite());
    if let Some(lost) = document.at.iter().chain(&document.end).find(|it| !is_finite(it)) {
        let expected = format!("a time to which the flight can be followed from {} to {until_s} s", seen[0].time_s);
        let (file, field) = (arguments.track.display().to_string(), "the last time");
        let (file, field) = if arguments.at.contains(&lost.time_s) { (COMMAND_LINE, "--at") } else { (&*file, field) };
        return Err(InputError::new(file, field, lost.time_s, expected).into());
    }
    if arguments.json { screen::json(&document) } else { Ok(print(&document)?) }
}

fn print(document: &Document) -> std::io::Result<()> {
    screen::fact("status", document.status.as_str().unwrap_or_default())?;
    screen::fact("model", document.model)?;
    if let Some(contact_s) = document.contact_s {
        screen::fact(
            "contact",
            &format!("at {contact_s:.4} s, which ended the flight; predicted is how it would have gone on"),
        )?;
    }
    let inliers = document.inliers.map_or(String::new(), |count| format!(", {count} agree"));
    screen::fact("sightings", &format!("{}{inliers}", document.sightings))?;
    screen::fact("their noise", &format!("{:.2} mm", document.noise_m * 1e3))?;
    if document.noise_m > IMPLAUSIBLE_NOISE_M || document.inliers.is_some_and(|count| 2 * count < document.sightings) {
        screen::fact("implausible", "they are far from one flight: is --up right, are they metres and seconds?")?;
    }
    if document.status == NO_GRAVITY {
        screen::fact("what is wrong", "their acceleration is not 9.81 m/s² against --up, nor that and drag")?;
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

/// Seed of the sampling; any will do.
const SEED: u64 = 1;

/// The times for which a prediction is asked: the end, and others.
type Asked<'a> = (f64, &'a [f64]);

impl Document {
    /// Without a flight.
    fn of(seen: &[Sighting], model: &'static str) -> Self {
        Self {
            version: VERSION,
            status: serde_json::Value::Null,
            model,
            contact_s: None,
            sightings: seen.len(),
            inliers: None,
            noise_m: 0.0,
            drag_per_m: None,
            drag_sd_per_m: None,
            end: None,
            at: Vec::new(),
        }
    }
}

/// The flight by isotropic drag.
fn isotropic_drag(
    seen: &[Sighting],
    up: &Unit<Vector3<f64>>,
    drag: [f64; 2],
    (end_s, at): Asked,
) -> serde_json::Result<Document> {
    // More sightings than these tell nothing more.
    let every = seen.len().div_ceil(MOST_SIGHTINGS).max(1);
    let mut all: Vec<Sighting> = seen.iter().rev().step_by(every).copied().collect();
    all.reverse();
    let samples: Vec<TrackSample> = all.iter().map(|it| sample(it, 1.0)).collect();
    let (flying, contact_s) = free_flight(&samples, up);
    let flown = &all[flying];
    let (noise_m, fitted) = fit(flown, up, drag);
    let found = fitted.as_ref().ok();
    Ok(Document {
        status: fitted.as_ref().map_or_else(serde_json::to_value, |_| Ok("predicted".into()))?,
        contact_s,
        inliers: found.map(|track| track.flight.inliers),
        noise_m,
        drag_per_m: found.map(Track::drag_per_m),
        drag_sd_per_m: found.map(|track| track.flight.covariance[(6, 6)].max(0.0).sqrt()),
        end: found.map(|track| prediction(end_s, track)),
        at: found.map_or_else(Vec::new, |it| at.iter().map(|&time_s| prediction(time_s, it)).collect()),
        ..Document::of(seen, ISOTROPIC_DRAG)
    })
}

/// The flight with aerodynamics.
fn aerodynamic(
    seen: &[Sighting],
    up: &Unit<Vector3<f64>>,
    prior: FlightPrior,
    (end_s, at): Asked,
) -> serde_json::Result<Document> {
    let samples: Vec<TrackSample> = seen.iter().map(|it| sample(it, 1.0)).collect();
    let flight = match AerodynamicFit::new(prior).fit(&samples, up, None) {
        Ok(flight) => flight,
        Err(status) => {
            return Ok(Document { status: serde_json::to_value(status)?, ..Document::of(seen, AERODYNAMIC) });
        }
    };
    let drag = Vector3::from_fn(|i, _| flight.parameters()[3 + i]).mean();
    let variance = flight.parameter_covariance().fixed_view::<3, 3>(3, 3).sum() / 9.0;
    let prediction = |time_s| {
        let point = flight.at(time_s);
        Prediction {
            time_s,
            position: point.position.into(),
            velocity: point.velocity.into(),
            covariance: rows(&point.covariance),
        }
    };
    Ok(Document {
        status: "predicted".into(),
        contact_s: flight.contact_s,
        inliers: Some(flight.inliers),
        noise_m: flight.noise.position_sd_m,
        drag_per_m: Some(drag),
        drag_sd_per_m: Some(variance.max(0.0).sqrt()),
        end: Some(prediction(end_s)),
        at: at.iter().map(|&time_s| prediction(time_s)).collect(),
        ..Document::of(seen, AERODYNAMIC)
    })
}

/// A sighting with the track's noise; its orientation, if there is one, as good as a point 0.1 m off the centre would tell.
fn sample(sighting: &Sighting, noise_m: f64) -> TrackSample {
    const LEVER_M: f64 = 0.1;
    TrackSample {
        time_s: sighting.time_s,
        position: sighting.p,
        orientation: sighting.rotation,
        position_sd_m: noise_m,
        orientation_sd_rad: noise_m / LEVER_M,
    }
}

/// The flight at a time.
fn prediction(time_s: f64, track: &Track) -> Prediction {
    Prediction {
        time_s,
        position: track.position_at(time_s).into(),
        velocity: track.velocity_at(time_s).into(),
        covariance: rows(&track.covariance_at(time_s)),
    }
}

/// Noises that a track may have, in metres along each axis.
const NOISES_M: [f64; 6] = [5e-4, 2e-3, 8e-3, 0.03, 0.1, 0.5];
/// A flight that this fraction of the sightings agrees with is the one, for a noise that is as low as possible.
const AGREEING_FRACTION: f64 = 0.4;
/// How often the noise is then taken anew from how far those that agree are from the flight, at most.
const REFINEMENTS: usize = 4;
/// Noise below this is not believed, in metres.
const LEAST_NOISE_M: f64 = 1e-4;
/// Half of the sightings with normal noise along each axis are nearer than that many standard deviations: the median of χ with 3
/// degrees of freedom.
const MEDIAN: f64 = 1.538;

/// How noisy a track is, and the flight fitted to it, with the drag constant that is expected and its standard deviation.
fn fit(
    seen: &[Sighting],
    up: &Unit<Vector3<f64>>,
    [drag, drag_sd]: [f64; 2],
) -> (f64, Result<Track, PredictionStatus>) {
    let with_noise = |noise_m: f64| {
        let samples: Vec<TrackSample> = seen.iter().map(|it| sample(it, noise_m)).collect();
        let config = Config {
            drag_prior_per_m: Some(drag),
            drag_prior_sd_per_m: Some(drag_sd),
            first_after: LEAST_SIGHTINGS,
            window: samples.len(),
            fit_window: samples.len(),
            inlier_m: Config::default().inlier_m.max(4.0 * noise_m),
            ..Config::default()
        };
        Track::fit(&samples, up, &config, SEED)
    };
    let agreeing = |fitted: &Result<Track, _>| fitted.as_ref().map_or(0, |it: &Track| it.flight.inliers);
    let enough = (seen.len() as f64 * AGREEING_FRACTION) as usize;
    let [mut noise_m, ..] = NOISES_M;
    let mut fitted = with_noise(noise_m);
    for &next_m in &NOISES_M[1..] {
        if agreeing(&fitted) > enough {
            break;
        }
        (noise_m, fitted) = (next_m, with_noise(next_m));
    }
    for _ in 0..REFINEMENTS {
        let Ok(track) = &fitted else { break };
        let mut distances: Vec<f64> = seen.iter().map(|it| (it.p - track.position_at(it.time_s)).norm()).collect();
        distances.sort_by(f64::total_cmp);
        let next_m = (distances[track.flight.inliers / 2] / MEDIAN).max(LEAST_NOISE_M);
        let next = with_noise(next_m);
        // A flight that fewer agree with is another one.
        if !next_m.is_finite() || agreeing(&next) <= enough {
            break;
        }
        (noise_m, fitted) = (next_m, next);
    }
    (noise_m, fitted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_lab::own_data::track_file::parse;
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A flight with 2 mm of noise along each axis, of which a fraction lies elsewhere.
    fn track(outliers: f64, seed: u64) -> Vec<Sighting> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let row = |i: u32| {
            let t = f64::from(i) * 0.01;
            let mut noise = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * 0.002;
            let p = [t + noise(), noise(), t - 4.905 * t * t + noise()];
            let off = if rng.random_bool(outliers) { rng.random_range(0.05..1.0) } else { 0.0 };
            format!("{t},{},{},{}\n", p[0] + off, p[1] - off, p[2] + off)
        };
        parse("t.csv", &(0..60).map(row).collect::<String>()).unwrap().0
    }

    #[test]
    fn outliers_do_not_count() {
        for outliers in [0.0, 0.1, 0.2, 0.3, 0.4] {
            for seed in 0..20 {
                let (noise_m, fitted) = fit(&track(outliers, seed), &Vector3::z_axis(), [0.0, 0.0]);
                assert!(noise_m > 1e-3 && noise_m < 4e-3, "{outliers}: {noise_m}");
                let off = fitted.unwrap().position_at(0.8) - Point3::new(0.8, 0.0, 0.8 - 4.905 * 0.64);
                assert!(off.norm() < 0.02, "{outliers}: {off}");
            }
        }
    }
}
