//! The rotation that most poses agree with, among those of a free rigid body through two neighbouring poses.
//!
//! Early poses are often turned the wrong way: a banana seen by one camera fits its silhouette in several
//! orientations. Some of them agree with each other on how the object rotates, and the others do not. A
//! sample is two poses: the shortest turn between them gives ω, the free rotation from there the orientation
//! at all other poses. The best sample has the least sum of truncated squares (MSAC; Torr and Zisserman,
//! 2000).

use catch_body::{free_flight::tumbling::Tumbling, symmetry::Symmetry};
use nalgebra::UnitQuaternion;

use super::{Config, FlightTrajectory};
use crate::perception::ObjectPose;

/// Longest time in seconds between the two poses of a sample: even at 25 rad/s the shortest turn is the one
/// that was made.
const LONGEST_S: f64 = 0.06;
/// Most samples.
const MOST_SAMPLES: usize = 30;
/// An orientation agrees within three standard deviations, at least and at most so many radians.
const AGREES_RAD: [f64; 2] = [0.25, 0.8];

/// The orientation of a pose, and the square of the angle within which it agrees with another.
#[derive(Debug, Clone)]
pub(super) struct Orientation {
    time_s: f64,
    R_WO: UnitQuaternion<f64>,
    reach_square: f64,
}

/// Gives `flight` the rotation that most of the orientations, oldest first, agree with.
pub(super) fn agree_on_rotation(
    orientations: &[Orientation],
    flight: &mut FlightTrajectory,
    symmetry: &Symmetry,
    config: &Config,
) {
    let neighbours = |first: usize| {
        let near = move |later: &usize| orientations[*later].time_s - orientations[first].time_s <= LONGEST_S;
        (first + 1..orientations.len()).take_while(near).map(move |later| (first, later))
    };
    let pairs = || (0..orientations.len()).flat_map(neighbours);
    let stride = pairs().count().div_ceil(MOST_SAMPLES).max(1);
    let mut least = f64::INFINITY;
    for (first, later) in pairs().step_by(stride) {
        let (from, to) = (&orientations[first], &orientations[later]);
        let elapsed_s = to.time_s - from.time_s;
        if elapsed_s <= 1e-6 {
            continue;
        }
        let w_WO = symmetry.turn_between(&from.R_WO, &to.R_WO) / elapsed_s;
        // A fast spin is less likely: three standard deviations are worth as much as a pose.
        let prior = (w_WO / (3.0 * config.spin_prior_sd_radps)).norm_squared();
        let start = Tumbling::new(from.R_WO, &w_WO, flight.inertia_per_kg.as_ref());
        let start = start.decaying(flight.spin_decay_per_s);
        let from = (prior, start, from.time_s);
        let (earlier, later) = (&orientations[..first], &orientations[first + 1..]);
        let found = followed(from, earlier.iter().rev(), symmetry, least)
            .and_then(|(cost, ..)| followed((cost, from.1, from.2), later.iter(), symmetry, least));
        if let Some((cost, last, last_s)) = found {
            least = cost;
            let at_flight = last.after(flight.time_s - last_s, false);
            (flight.R_WO, flight.w_WO) = (at_flight.R_WO, at_flight.w_WO());
        }
    }
}

/// Follows a rotation through `orientations`, from a cost, a state and its time to those at the last of them;
/// `None` once it costs the `least`.
fn followed<'a>(
    from: (f64, Tumbling, f64),
    mut orientations: impl Iterator<Item = &'a Orientation>,
    symmetry: &Symmetry,
    least: f64,
) -> Option<(f64, Tumbling, f64)> {
    orientations.try_fold(from, |(cost, at, time_s), seen| {
        let at = at.after(seen.time_s - time_s, false);
        let square = symmetry.turn_between(&at.R_WO, &seen.R_WO).norm_squared() / seen.reach_square;
        let cost = cost + square.min(1.0);
        (cost < least).then_some((cost, at, seen.time_s))
    })
}

impl Orientation {
    pub fn of(pose: &ObjectPose) -> Self {
        let information: f64 = (0..3).map(|i| pose.information[(i, i)]).sum();
        let sd_rad = if information > 0.0 { (3.0 / information).sqrt() } else { 0.0 };
        let reach_rad = (3.0 * sd_rad).clamp(AGREES_RAD[0], AGREES_RAD[1]);
        Self { time_s: pose.capture_s, R_WO: pose.X_WO.rotation, reach_square: reach_rad * reach_rad }
    }
}
