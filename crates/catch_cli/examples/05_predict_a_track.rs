//! A flight fitted to measured poses, and where it leads: `cargo run --release --example 05_predict_a_track`.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use catch_body::Pose;
use catch_bot::{
    perception::{ObjectPose, Symmetry},
    trajectory_prediction::{Config, FlightPredictor, InformationFit},
};
use nalgebra::{Matrix6, Vector3};

fn main() -> anyhow::Result<()> {
    // Twenty positions at 100 Hz, each off by a millimetre or so; orientations are not known.
    let (start, velocity) = (Vector3::new(2.0, 1.5, 0.6), Vector3::new(-2.4, -1.9, 3.6));
    let truth = |t: f64| start + velocity * t + Vector3::new(0.0, 0.0, -9.81) * (t * t / 2.0);
    let poses: Vec<ObjectPose> = (0..20)
        .map(|i| {
            let time_s = f64::from(i) * 0.01;
            let error = Vector3::new(1.0, -0.6, 0.8) * 1e-3 * libm::sin(f64::from(i) * 2.3);
            let p_WO = truth(time_s) + error;
            let mut information = Matrix6::zeros();
            information.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(1e6);
            ObjectPose {
                capture_s: time_s,
                X_WO: Pose::translation(p_WO.x, p_WO.y, p_WO.z),
                information,
                points: 200,
                residual_m: 0.0,
                points_mismatch: None,
                silhouette_mismatch: None,
                iterations: 0,
                registered_globally: false,
            }
        })
        .collect();

    let config = Config { spin_prior_sd_radps: 0.1, ..Config::default() };
    let flight = InformationFit::new(config, Symmetry::Sphere, 1)
        .predict(&poses, None)
        .map_err(|status| anyhow::anyhow!("no flight: {status:?}"))?;
    for time_s in [0.2, 0.4, 0.6] {
        let p_WO = flight.pose_at(time_s).translation.vector;
        let (off_mm, claimed_mm) = ((p_WO - truth(time_s)).norm() * 1e3, flight.position_sd_at(time_s) * 1e3);
        println!("{time_s:.1} s: {:.3?} m, off by {off_mm:.1} mm, claimed ± {claimed_mm:.1} mm", p_WO.as_slice());
    }
    Ok(())
}
