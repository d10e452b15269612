//! The outcome of 63 catches by a fixed hand, against MuJoCo.
//!
//! The fingers start to close at t = 0 at a speed s each; a ball flies in along −y and would reach the middle
//! of the fingers at t = (gap left beside it)/s + δ. Whether it is caught depends on when and how fast the
//! fingers meet it: the table is the finest sieve for contact settings that we know.

use catch_body::Gripper;
use catch_cell::GripperMove;
use catch_sim::{gripper_drive::Gains, physics::WorldSettings};
use nalgebra::Point3;

use crate::setting;

/// MuJoCo with steps of 0.25 ms, by finger speed: C is a catch; δ goes from −20 to 20 ms in columns of 2 ms.
const MUJOCO: [(f64, &str); 3] =
    [(0.2, "CCCCCCCCCCCCCCCCCCC.."), (0.3, "CCCCCCCCCCCCCCCCCC..C"), (0.4, "CCCCCCCCCCCCCCCCC.CCC")];

const FAR_FROM_THE_FLOOR_M: f64 = 2.0;
const OPEN_M: f64 = 0.121;
const BALL_RADIUS_M: f64 = 0.0335;

fn is_caught(finger_mps: f64, delta_s: f64, step_s: f64) -> bool {
    let gripper = Gripper { max_width_m: OPEN_M, ..setting::gripper() };
    let speed = -3.0;
    let reach_s = (OPEN_M / 2.0 - BALL_RADIUS_M) / finger_mps + delta_s;
    // At its apex in (0, 94 mm, 0) at `reach_s`.
    let g = 9.81;
    let height = FAR_FROM_THE_FLOOR_M - 0.5 * g * reach_s * reach_s;
    let release = setting::release([0.0, 0.094 - speed * reach_s, height], [0.0, speed, g * reach_s]);
    let p_WG = Point3::new(0.0, 0.0, FAR_FROM_THE_FLOOR_M);
    let ball = setting::ball(BALL_RADIUS_M);
    let settings = WorldSettings { step_s, ..setting::settings(0.6, 0.0) };
    let mut world = setting::fixed_hand(settings, p_WG, &gripper, OPEN_M, &ball, &release);
    // The table was made with this controller.
    let gains = Gains { stiffness_npm: 2500.0, damping_nspm: 20.0 };
    let mut drive = setting::ideal_drive(&gripper, OPEN_M);
    drive.gains = gains;
    drive.receive(&[GripperMove { start_s: 0.0, width_m: 0.0, speed_mps: 2.0 * finger_mps, force_n: 80.0 }], 0.0);
    for step in 0..(0.6 / step_s).round() as u32 {
        let state = world.state();
        let mut loads = setting::no_loads();
        loads.finger_force_n = drive.forces(f64::from(step) * step_s, state.finger_m, state.finger_mps);
        world.step(&loads);
    }
    let state = world.state();
    let p_GO = Point3::from(state.X_WO.translation.vector) - p_WG;
    p_GO.y > 0.03 && p_GO.y < 0.145 && p_GO.x.abs() < 0.05 && p_GO.z.abs() < 0.04 && state.V_WO.linear.norm() < 0.05
}

#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn at_least_60_of_63_outcomes_agree_with_mujoco() {
    let mut agreeing = 0;
    let mut table = String::new();
    for (speed, expected) in MUJOCO {
        let row: String =
            (0..21).map(|i| if is_caught(speed, f64::from(2 * i - 20) * 1e-3, 1e-3) { 'C' } else { '.' }).collect();
        agreeing += row.chars().zip(expected.chars()).filter(|(ours, theirs)| ours == theirs).count();
        table += &format!("{speed}: {row}, MuJoCo {expected}\n");
    }
    println!("{agreeing} of 63 catches as in MuJoCo");
    assert!(agreeing >= 60, "{agreeing} of 63\n{table}");
}

/// Every third of these catches with half the step.
#[test]
fn half_a_step_changes_few_outcomes() {
    let cases =
        [0.2, 0.3, 0.4].into_iter().flat_map(|speed| (0..7).map(move |i| (speed, f64::from(6 * i - 20) * 1e-3)));
    let changed: Vec<(f64, f64)> =
        cases.filter(|&(speed, delta_s)| is_caught(speed, delta_s, 1e-3) != is_caught(speed, delta_s, 5e-4)).collect();
    assert!(changed.len() <= 1, "{changed:?}");
}
