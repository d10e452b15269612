//! The weights that tell how well a catch will hold, and the cost terms that they multiply.

use catch_bot::{Config, Report};
use catch_lab::scenario::setup::Setup;

/// The weights among the settings of a scenario's brain, in the order of [`Terms`].
pub const SETTINGS: [&str; 7] = [
    "grasp_selection.weights.catchability",
    "grasp_selection.weights.pass_through",
    "grasp_selection.weights.overhang",
    "grasp_selection.weights.strength",
    "grasp_selection.weights.width",
    "trajectory_optimization.weights.speed",
    "trajectory_optimization.weights.spin",
];

/// The weights in the order of [`SETTINGS`].
pub type Weights = [f64; SETTINGS.len()];

/// The cost terms in the order of [`SETTINGS`]: the fraction of the relative velocity that points at a
/// finger, one less the fraction that points at the palm, overhang and strength per 30 mm, width per 100 mm,
/// relative speed in m/s, the gripper's angular speed in rad/s.
pub type Terms = [f64; SETTINGS.len()];

/// The weights of a brain.
pub fn of(config: &Config) -> Weights {
    let (grasp, motion) = (&config.grasp_selection.weights, &config.trajectory_optimization.weights);
    [grasp.catchability, grasp.pass_through, grasp.overhang, grasp.strength, grasp.width, motion.speed, motion.spin]
}

/// Returns the same settings with other weights.
pub fn with(mut config: Config, weights: &Weights) -> Config {
    let (grasp, motion) = (&mut config.grasp_selection.weights, &mut config.trajectory_optimization.weights);
    let set = [
        &mut grasp.catchability,
        &mut grasp.pass_through,
        &mut grasp.overhang,
        &mut grasp.strength,
        &mut grasp.width,
        &mut motion.speed,
        &mut motion.spin,
    ];
    set.into_iter().zip(weights).for_each(|(set, weight)| *set = *weight);
    config
}

/// Computes the cost of the terms at these weights.
pub fn cost(weights: &Weights, terms: &Terms) -> f64 {
    weights.iter().zip(terms).map(|(weight, term)| weight * term).sum()
}

/// The terms of a plan for the flight that is known with it; `None` if there is none.
pub fn terms(setup: &Setup, report: &Report) -> Option<Terms> {
    let (plan, flight) = (report.plan.as_ref()?, report.flight.as_ref()?);
    let robot = &setup.robot;
    let [q, dq, _] = plan.trajectory.evaluate(plan.catch_s);
    let X_WG = robot.gripper_pose(&q);
    let V_WG = robot.jacobian(&robot.link_poses(&q), &(X_WG * setup.gripper.grasp_centre())) * dq;
    let v_G = X_WG.rotation.inverse_transform_vector(&(flight.twist_at(plan.catch_s).linear - V_WG.fixed_rows::<3>(3)));
    let direction = v_G.try_normalize(1e-6).unwrap_or_default();
    let grasp = &plan.grasp;
    Some([
        direction.x.abs(),
        1.0 + direction.y,
        grasp.overhang_m / 0.03,
        grasp.strength_m / 0.03,
        grasp.object_width_m / 0.1,
        v_G.norm(),
        V_WG.fixed_rows::<3>(0).norm(),
    ])
}
