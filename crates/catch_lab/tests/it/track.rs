//! Flights fitted to tracks of one's own.

use catch_bot::trajectory_prediction::Config;
use catch_lab::flights::track::{Track, TrackSample};
use nalgebra::{Point3, Unit, Vector3};

#[test]
fn tracks_in_any_axes_with_gaps_and_rows_of_nothing_are_fitted() {
    let config = Config { drag_prior_per_m: Some(0.05), drag_prior_sd_per_m: Some(0.05), ..Config::default() };
    for up in
        [Vector3::y_axis(), Vector3::z_axis(), -Vector3::z_axis(), Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0))]
    {
        let forward = up.cross(&Vector3::new(0.3, 0.1, -0.9)).normalize();
        let at = |t: f64| Point3::from(forward * (5.0 * t) + up.into_inner() * (4.0 * t - 0.5 * 9.81 * t * t));
        let mut samples: Vec<TrackSample> = (0..40)
            .filter(|i| !(10..20).contains(i))
            .map(|i| TrackSample {
                time_s: 0.01 * f64::from(i),
                position: at(0.01 * f64::from(i)),
                orientation: None,
                position_sd_m: 0.001,
                orientation_sd_rad: 1.0,
            })
            .collect();
        samples[3].position.x = f64::NAN;
        let track = Track::fit(&samples, &up, &config, 1).unwrap();
        assert!((track.position_at(0.6) - at(0.6)).norm() < 0.01, "{up:?}");
        assert!((track.velocity_at(0.6).dot(&up) - (4.0 - 9.81 * 0.6)).abs() < 0.05);
        assert!(track.drag_per_m().abs() < 0.01);
    }
}
