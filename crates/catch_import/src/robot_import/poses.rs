//! Properties that follow from the whole arm: poses to begin with, which links are compared, torques that
//! suffice.

use catch_body::{Gripper, JointVector, Robot, clearance::ArmClearance, robot::Inertia};
use nalgebra::{Matrix3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Random poses of each search.
const POSES: usize = 6_000;
/// Least fraction of random poses that have to be clear of the arm itself, as a waiting arm is.
const LEAST_FREE: f64 = 0.15;
/// An arm that waits keeps this far from itself and from the floor.
const CLEARANCE_M: f64 = 0.06;
/// Angles of the first joint that are looked at.
const TURNS: u32 = 32;
/// Torque limits that are worked out exceed what motions need by this factor.
const TORQUE_MARGIN: f64 = 1.2;
/// Fraction of its torque limits by which an arm is held in any pose: what is left moves it, and its load.
const HELD_BY: f64 = 0.5;
/// Links keep this fraction of their masses, whatever the torque limits are.
const LEAST_FRACTION: f64 = 0.05;

/// The least number of neighbours along the chain that are not compared with each other, so that an arm can
/// wait in many poses.
pub fn ignored_neighbours(robot: &Robot, gripper: &Gripper) -> usize {
    let mut robot = robot.clone();
    let is_enough = |robot: &Robot| {
        let clearance = ArmClearance::new(robot, gripper);
        let free = random_poses(robot, POSES / 20)
            .filter(|q| clearance.self_clearance(&robot.link_poses(q), gripper.max_width_m) > CLEARANCE_M);
        free.count() as f64 > LEAST_FREE * (POSES / 20) as f64
    };
    let found = (1..=robot.dof()).find(|&neighbours| {
        robot.ignored_neighbours = neighbours;
        is_enough(&robot)
    });
    found.unwrap_or(robot.dof())
}

/// Least height of the base with which the first moved link is clear of the floor wherever it rotates, in
/// metres, rounded up to centimetres.
pub fn base_height_m(robot: &Robot) -> f64 {
    let lowest = |turned: u32| {
        let mut q = JointVector::zeros();
        q[0] = std::f64::consts::TAU * f64::from(turned) / f64::from(TURNS);
        let X_WL = robot.link_poses(&q);
        let first = robot.capsules.iter().filter(|(link, _)| *link == 1).map(|(_, it)| it.transformed(&X_WL[1]));
        first.map(|it| it.from.z.min(it.to.z) - it.radius).fold(f64::INFINITY, f64::min)
    };
    let lowest_m = (0..TURNS).map(lowest).fold(f64::INFINITY, f64::min);
    ((CLEARANCE_M - lowest_m).max(0.0) * 100.0).ceil() / 100.0
}

/// Poses to begin a search for the waiting pose with, the best first: free, easy to move in all directions,
/// far from the ends of the ranges, the gripper between the floor and the shoulder's reach and not facing
/// down.
pub fn good_poses(robot: &Robot, gripper: &Gripper, most: usize) -> Vec<JointVector> {
    let clearance = ArmClearance::new(robot, gripper);
    let rate = |q: JointVector| {
        let X_WL = robot.link_poses(&q);
        let free = clearance.least(&X_WL, gripper.max_width_m);
        let X_WG = robot.gripper_in(&X_WL);
        let approach = X_WG * Vector3::y();
        let outwards = Vector3::new(X_WG.translation.x, X_WG.translation.y, 0.0).try_normalize(1e-6)?;
        if free < CLEARANCE_M || approach.dot(&outwards) < 0.5 {
            return None;
        }
        let jacobian = robot.jacobian(&X_WL, &Point3::from(X_WG.translation.vector));
        // Yoshikawa, Manipulability of robotic mechanisms, 1985.
        let manipulability = (jacobian * jacobian.transpose()).determinant().max(0.0).sqrt();
        Some((manipulability * centred(robot, &q), q))
    };
    let mut rated: Vec<(f64, JointVector)> = random_poses(robot, POSES).filter_map(rate).collect();
    rated.sort_by(|one, other| other.0.total_cmp(&one.0));
    rated.into_iter().take(most).map(|(_, q)| q).collect()
}

/// 1 in the middle of all ranges, 0 at an end; a joint with much more than a turn is in the middle everywhere
/// near zero.
fn centred(robot: &Robot, q: &JointVector) -> f64 {
    let of_joint = |(i, joint): (usize, &catch_body::robot::Joint)| {
        let (lower, upper) = (joint.limits.lower, joint.limits.upper);
        let from_middle = 2.0 * (q[i] - f64::midpoint(lower, upper)) / (upper - lower);
        1.0 - from_middle.powi(4)
    };
    robot.joints.iter().enumerate().map(of_joint).product()
}

/// Torques, one for each joint, with which the arm and a gripper can be moved in any pose at the highest
/// acceleration of all joints.
pub fn sufficient_torques(robot: &Robot, gripper: &Gripper) -> JointVector {
    let robot = robot.clone().carrying(gripper);
    let mut rng = Pcg64::seed_from_u64(2);
    let mut most = JointVector::zeros();
    for q in random_poses(&robot, POSES / 6) {
        let ddq =
            robot.per_joint(|joint| joint.limits.acceleration).map(|it| if rng.random_bool(0.5) { it } else { -it });
        most = most.sup(&robot.inverse_dynamics(&q, &JointVector::zeros(), &ddq).abs());
    }
    most * TORQUE_MARGIN
}

/// The fraction of their masses that the links `of` may have so that a part of the torque limits holds the
/// arm and a gripper in any pose, as motors are made for more than that; 1 if they may have all.
pub fn fraction_that_is_held(robot: &Robot, of: &[bool], gripper: &Gripper) -> f64 {
    let (whole, mut rest) = (robot.clone().carrying(gripper), robot.clone());
    for (joint, _) in rest.joints.iter_mut().zip(of).filter(|(_, is_of)| **is_of) {
        joint.inertia = Inertia { mass: 0.0, about_com: Matrix3::zeros(), ..joint.inertia };
    }
    let (rest, still) = (rest.carrying(gripper), JointVector::zeros());
    let mut fraction: f64 = 1.0;
    for q in random_poses(&whole, POSES / 6) {
        let of_rest = rest.inverse_dynamics(&q, &still, &still);
        let of_links = whole.inverse_dynamics(&q, &still, &still) - of_rest;
        for (i, joint) in whole.joints.iter().enumerate().filter(|(i, _)| of_links[*i] != 0.0) {
            let room = HELD_BY * joint.limits.torque - of_rest[i].abs();
            fraction = fraction.min(room / of_links[i].abs());
        }
    }
    fraction.max(LEAST_FRACTION)
}

/// Poses uniform within the ranges, of endless joints within a turn.
fn random_poses(robot: &Robot, count: usize) -> impl Iterator<Item = JointVector> {
    let mut rng = Pcg64::seed_from_u64(1);
    let half_turn = std::f64::consts::PI;
    let ends: Vec<[f64; 2]> = robot
        .joints
        .iter()
        .map(|it| {
            let (lower, upper) = (it.limits.lower, it.limits.upper);
            let middle = f64::midpoint(lower, upper);
            [lower.max(middle - half_turn), upper.min(middle + half_turn)]
        })
        .collect();
    (0..count).map(move |_| {
        JointVector::from_fn(|i, _| ends.get(i).map_or(0.0, |[low, high]| rng.random_range(*low..=*high)))
    })
}
