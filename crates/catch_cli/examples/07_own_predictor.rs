//! A flight predictor of one's own, evaluated and refereed beside ours:
//! `cargo run --release --example 07_own_predictor`.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use std::sync::Arc;

use catch_body::dynamics::gravity;
use catch_bot::{
    CatchingBot,
    perception::ObjectPose,
    trajectory_prediction::{FlightPredictor, FlightTrajectory, PredictionStatus},
};
use catch_lab::{
    evaluation::{BrainFactory, Cell, Evaluation},
    scenario::setup::{Choice, Setup},
};
use nalgebra::{Point3, Vector3};

/// The parabola p + v·t + g·t²/2 through all positions by least squares; the object keeps its orientation.
struct Parabola;

impl FlightPredictor for Parabola {
    fn predict(
        &mut self,
        poses: &[ObjectPose],
        _: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let newest = poses.last().filter(|_| poses.len() >= 6).ok_or(PredictionStatus::TooFewPoses)?;
        let (mut sum_t, mut sum_tt, mut sum_p, mut sum_tp) = (0.0, 0.0, Vector3::zeros(), Vector3::zeros());
        for pose in poses {
            let t = pose.capture_s - newest.capture_s;
            let straight = pose.X_WO.translation.vector - gravity() * (t * t / 2.0);
            (sum_t, sum_tt, sum_p, sum_tp) = (sum_t + t, sum_tt + t * t, sum_p + straight, sum_tp + straight * t);
        }
        let n = poses.len() as f64;
        let v_WOcm = (sum_tp * n - sum_p * sum_t) / (n * sum_tt - sum_t * sum_t);
        let p_WOcm = Point3::from((sum_p - v_WOcm * sum_t) / n);
        Ok(FlightTrajectory {
            time_s: newest.capture_s,
            p_WOcm,
            v_WOcm,
            R_WO: newest.X_WO.rotation,
            ..Default::default()
        })
    }
}

fn main() -> anyhow::Result<()> {
    let own: BrainFactory = Arc::new(|setup, _, _| {
        let known = setup.known().clone();
        let (estimator, planner) = (Box::new(known.pose_estimator()), Box::new(known.catch_planner()));
        Box::new(CatchingBot::with_stages(known, estimator, Box::new(Parabola), planner))
    });
    println!("{:14} {:14} caught", "throw", "prediction");
    for throw in ["near_sampled", "far_sampled"] {
        let setup = Setup::load(&Choice { throw: Some(throw), ..Choice::default() })?;
        let ours = Cell::new(setup.clone());
        for (name, cell) in [("ours", ours), ("parabola", Cell { setup, brain: own.clone() })] {
            let evaluation = Evaluation { cells: vec![cell], seed: 1, first: 0, trials: 5 };
            let mut caught = 0;
            evaluation.run(0, 2, &mut |row, _| {
                caught += u32::from(row.verdict.caught);
                Ok(())
            })?;
            println!("{throw:14} {name:14} {caught} of 5");
        }
    }
    Ok(())
}
