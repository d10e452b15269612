//! Predictions of the flight as pages carry them.

use catch_bot::trajectory_prediction::FlightTrajectory;
use catch_recording::RecordedTick;
use nalgebra::Matrix3;
use serde_json::{Value, json};

use crate::{
    pages::packed::Packed,
    playback::{Playback, PredictionError},
};

/// Points along a predicted path.
const PATH_POINTS: usize = 24;
/// Duration of a predicted path while there is no plan, in seconds.
const WITHOUT_PLAN_S: f64 = 0.8;
/// Standard deviations that the ellipsoid holds.
const DEVIATIONS: f64 = 3.0;

/// Predicted paths of what the true path is of, up to the planned catch, of all ticks with a new flight.
pub fn predictions(playback: &Playback) -> Value {
    let (mut time_s, mut values, mut half_axes) = (Vec::new(), Vec::new(), Vec::new());
    let com_O = playback.com_O();
    for tick in playback.ticks.iter().filter(|tick| is_news(tick)) {
        let Some(flight) = &tick.report.flight else { continue };
        let from_s = tick.observation.time_s;
        let catch_s = tick.report.plan.as_ref().map(|plan| plan.catch_s);
        let until_s = catch_s.unwrap_or(from_s + WITHOUT_PLAN_S).max(from_s);
        for i in 0..PATH_POINTS {
            let at_s = from_s + (until_s - from_s) * i as f64 / (PATH_POINTS - 1) as f64;
            values.extend_from_slice((flight.pose_at(at_s) * com_O).coords.as_slice());
        }
        half_axes.extend_from_slice(ellipsoid(flight, until_s).as_slice());
        time_s.push(from_s - playback.start_s());
    }
    json!({
        "time_s": time_s,
        "points": PATH_POINTS,
        "p_WO": Packed::numbers(&values, 3),
        // Half axes of the ellipsoid of three standard deviations around a path's last point, one after the
        // other.
        "half_axes_m": Packed::numbers(&half_axes, 9),
    })
}

/// Half axes of the ellipsoid of a predicted position, column by column.
fn ellipsoid(flight: &FlightTrajectory, at_s: f64) -> Matrix3<f64> {
    let covariance = flight.covariance_at(at_s).fixed_view::<3, 3>(0, 0).into_owned();
    let eigen = covariance.symmetric_eigen();
    let lengths_m = eigen.eigenvalues.map(|variance| DEVIATIONS * variance.max(0.0).sqrt());
    eigen.eigenvectors * Matrix3::from_diagonal(&lengths_m)
}

/// Returns whether the flight of a tick was fitted in it: later ones only repeat it.
pub fn is_news(tick: &RecordedTick) -> bool {
    tick.report.pose.is_some()
}

/// Errors of the predictions, and the standard deviations that they claimed.
pub fn errors(playback: &Playback) -> Value {
    let errors = playback.prediction_errors();
    let all = |of: &dyn Fn(&PredictionError) -> f64| errors.iter().map(of).collect::<Vec<f64>>();
    json!({
        "time_s": all(&|it| it.time_s - playback.start_s()),
        "error_mm": all(&|it| it.error_m * 1e3),
        "claimed_mm": all(&|it| it.claimed_sd_m * 1e3),
    })
}
