//! Oracle of reachability: whether the arm could have been at any catch of a throw in time, computed for the
//! referee alone.
//!
//! The oracle has the true flight, without noise. For every 10 ms of the flight, and for many orientations of
//! the hand around the object, it searches for a posture of the arm that holds the hand there and that can be
//! reached from the waiting pose. The reachable set of a joint in a time T from rest is an interval, exact
//! and in closed form. Inverse kinematics finds the postures in those intervals: in closed form where there
//! is one, for S-R-S arms over the whole null space at once; else by iteration from starts all over the
//! intervals and along the null space from the solutions. The oracle uses neither the grid, the grasps, the
//! map nor the bound on work of the brain's search. The arm may be moving at the catch, if it can stop before
//! its joints' limits afterwards. The torque limits, the gripper and the object's shape are ignored: a throw
//! that the oracle calls out of reach is out of reach between its samples, one that it calls within reach may
//! still be hard. Arms of fewer than six joints may hold a ball with the hand in any rotation.

use std::f64::consts::{FRAC_PI_2, TAU};

use catch_body::{
    Gripper, JointVector, MAX_JOINTS, Pose, Robot, TriangleMesh, Twist,
    clearance::ArmClearance,
    inverse_kinematics::{ParallelAxesArm, Ranges, SrsArm},
    robot::JointLimits,
    shape::Capsule,
    workcell::FLOOR_Z_M,
};
use catch_sim::FreeFlight;
use nalgebra::{Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::{flights::flight_prediction::LONGEST_FLIGHT_S, scenario::setup::Setup};

/// Time from the arrival of the first image to the earliest start of a motion, in seconds: a first estimate
/// needs three frames at 100 Hz. (The paper's needs six.)
const FIRST_ESTIMATE_S: f64 = 0.03;
/// Catch times are this far apart, in seconds: 5 cm of the fastest flights.
const CATCH_INTERVAL_S: f64 = 0.01;
/// Step of the flight in seconds.
const FLIGHT_STEP_S: f64 = 1e-3;
/// Orientations of the hand: from the object passing through the gap to it flying at the palm, and around the
/// flight.
const TILTS: usize = 7;
const ROLLS: usize = 16;
/// Swivels that are tried in each arc of the redundancy.
const SWIVELS: usize = 5;

/// Times at which an object could have been caught, if any.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reach {
    /// A time at which the arm could have caught it, had it begun to move 30 ms after the first image
    /// arrived.
    pub from_first_image_s: Option<f64>,
    /// A time at which the arm could have caught it, had it begun to move at the release.
    pub from_release_s: Option<f64>,
}

/// Knows what an arm could do.
#[derive(Debug)]
pub struct Oracle<'a> {
    pub(super) robot: &'a Robot,
    gripper: &'a Gripper,
    kinematics: Kinematics,
    base: Point3<f64>,
    /// The base's distance from the farthest place at which an object could be held.
    longest_reach_m: f64,
    clearance: ArmClearance,
}

/// The arm's inverse kinematics: in closed form for two families, by iteration from many starts for the
/// others.
#[derive(Debug)]
enum Kinematics {
    Srs(SrsArm),
    ParallelAxes(ParallelAxesArm),
    Numerical,
    /// By iteration, the hand turned about a ball as the arm can turn it.
    Turned,
}

/// Returns whether a surface is that of a ball: all around its centre equally far.
fn is_ball(mesh: &TriangleMesh) -> bool {
    let centre = mesh.aabb().centre;
    let radii = || mesh.vertices.iter().map(|it| (it - centre).norm());
    let (least, most) = (radii().fold(f64::INFINITY, f64::min), radii().fold(0.0, f64::max));
    most - least < 0.02 * most
}

impl<'a> Oracle<'a> {
    /// Creates the oracle for the arm of a setup.
    pub fn of(setup: &'a Setup) -> Self {
        let Setup { robot, gripper, .. } = setup;
        let kinematics = match (SrsArm::of(robot), ParallelAxesArm::of(robot)) {
            (Some(arm), _) => Kinematics::Srs(arm),
            (None, Some(arm)) => Kinematics::ParallelAxes(arm),
            _ if robot.has_few_joints() && is_ball(&setup.object.mesh) => Kinematics::Turned,
            (None, None) => Kinematics::Numerical,
        };
        let links_m = robot.per_joint(|joint| joint.X_PL.translation.vector.norm()).sum();
        Self {
            robot,
            gripper,
            kinematics,
            base: robot.X_WB.translation.vector.into(),
            longest_reach_m: links_m + (robot.X_LG * gripper.grasp_centre()).coords.norm(),
            clearance: ArmClearance::new(robot, gripper),
        }
    }

    /// Finds the times at which the arm could catch in one scene.
    pub fn reach(&self, setup: &Setup, seed: u64, index: u64) -> Reach {
        let flight = Flight::of(setup, seed, index);
        let (ready_q, first_estimate_s) =
            (&self.robot.ready_q, setup.scenario.arena.latency_s.bounds()[0] + FIRST_ESTIMATE_S);
        let from_first_image_s = self.first_catch_s(&flight, ready_q, first_estimate_s, CATCH_INTERVAL_S);
        // Whoever can do it later can do it at once.
        let from_release_s = from_first_image_s.or_else(|| self.first_catch_s(&flight, ready_q, 0.0, CATCH_INTERVAL_S));
        Reach { from_first_image_s, from_release_s }
    }

    /// The first time at which some catch is possible for an arm that begins to move from rest in `from` at
    /// `start_s`, among times that are `interval_s` apart.
    pub fn first_catch_s(&self, flight: &Flight, from: &JointVector, start_s: f64, interval_s: f64) -> Option<f64> {
        let stride = ((interval_s / FLIGHT_STEP_S) as usize).max(1);
        let mut samples = flight.samples.iter().step_by(stride).filter(|sample| sample.time_s > start_s);
        samples.find(|sample| self.is_possible(sample, from, sample.time_s - start_s)).map(|sample| sample.time_s)
    }

    /// Returns whether the hand can be at the object after moving from rest in `from` for `time_s`, in any
    /// orientation.
    fn is_possible(&self, sample: &FlightSample, from: &JointVector, time_s: f64) -> bool {
        if (sample.p_WO - self.base).norm() > self.longest_reach_m {
            return false;
        }
        let mut ranges = [[0.0; 2]; MAX_JOINTS];
        for (i, joint) in self.robot.joints.iter().enumerate() {
            let way = farthest(&joint.limits, time_s);
            ranges[i] = [(from[i] - way).max(joint.limits.lower), (from[i] + way).min(joint.limits.upper)];
        }
        hands(&sample.v_WO).any(|R_WG| {
            let X_WG = Pose::from_parts(
                (sample.p_WO - R_WG * self.gripper.grasp_centre().coords).coords.into(),
                UnitQuaternion::from_rotation_matrix(&R_WG),
            );
            let holds = |q: &JointVector| self.can_stop_after(from, q, time_s) && self.clearance_m(q) > 0.0;
            match &self.kinematics {
                Kinematics::Srs(arm) => swivelled(arm, &X_WG, &ranges).any(|q| holds(&q)),
                Kinematics::ParallelAxes(arm) => arm.solutions(&X_WG, from, &ranges).iter().any(holds),
                Kinematics::Turned => {
                    let centre_G = self.gripper.grasp_centre();
                    self.robot.turned_solutions(&X_WG, &centre_G, from, &ranges).iter().any(holds)
                }
                Kinematics::Numerical => self.robot.solutions_within(&X_WG, from, &ranges).iter().any(holds),
            }
        })
    }

    /// Returns whether every joint that has moved from rest in `from` to `q` in `time_s` can be slow enough
    /// there to stop before its limit.
    fn can_stop_after(&self, from: &JointVector, q: &JointVector, time_s: f64) -> bool {
        self.robot.joints.iter().enumerate().all(|(i, joint)| {
            let way = q[i] - from[i];
            let speed = least_terminal_speed(way.abs(), time_s, joint.limits.velocity, joint.limits.acceleration);
            let stop = q[i] + way.signum() * speed * speed / (2.0 * joint.limits.acceleration);
            (joint.limits.lower..=joint.limits.upper).contains(&stop)
        })
    }

    /// Distance of the arm at `q`, its gripper open, from itself and its surroundings.
    pub(super) fn clearance_m(&self, q: &JointVector) -> f64 {
        self.clearance.least(&self.robot.link_poses(q), self.gripper.max_width_m)
    }
}

/// Joint positions of an S-R-S arm within `ranges`, all over its redundancy.
fn swivelled(srs: &SrsArm, X_WG: &Pose, ranges: &Ranges) -> impl Iterator<Item = JointVector> {
    srs.elbow_circle(X_WG).into_iter().flat_map(move |circle| {
        let arcs = srs.swivels(&circle, ranges);
        arcs.into_iter().flat_map(move |(branch, [low, high])| {
            (0..SWIVELS).map(move |i| {
                let fraction = (i as f64 + 0.5) / SWIVELS as f64;
                srs.solve_branch(&circle, low + (high - low) * fraction, branch)
            })
        })
    })
}

/// Farthest distance of a joint from rest after `time_s`, with acceleration all the way up to V: s = A·T²/2
/// for T < V/A, else V·T − V²/2A.
fn farthest(limits: &JointLimits, time_s: f64) -> f64 {
    let JointLimits { velocity, acceleration, .. } = *limits;
    if acceleration * time_s < velocity {
        acceleration * time_s * time_s / 2.0
    } else {
        velocity * time_s - velocity * velocity / (2.0 * acceleration)
    }
}

/// The least speed at the end of a way from rest that takes `time_s`, `way` being within what is possible.
///
/// With the end's speed e, the longest way goes up to the peak p = min(V, (A·T + e)/2), coasts and brakes to
/// e: s(e) = p²/2A + (p² − e²)/2A + p·(T − (2p − e)/A), which rises with e. Bisection finds where it is the
/// way.
fn least_terminal_speed(way: f64, time_s: f64, velocity: f64, acceleration: f64) -> f64 {
    let longest = |end: f64| {
        let peak = velocity.min(f64::midpoint(acceleration * time_s, end));
        let ramps = (2.0 * peak * peak - end * end) / (2.0 * acceleration);
        ramps + peak * (time_s - (2.0 * peak - end) / acceleration)
    };
    if longest(0.0) >= way {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, velocity.min(acceleration * time_s));
    for _ in 0..30 {
        let middle = f64::midpoint(low, high);
        if longest(middle) < way { low = middle } else { high = middle }
    }
    high
}

/// Orientations of a hand that an object may fly into with `v_WO`: its approach y_G at every angle from
/// against the flight (at the palm) to across it (through the gap), around the flight in all directions; the
/// closing direction x_G is always across the flight.
fn hands(v_WO: &Vector3<f64>) -> impl Iterator<Item = Rotation3<f64>> {
    let along = Unit::new_normalize(*v_WO);
    let across = along.cross(&if along.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() }).normalize();
    (0..TILTS * ROLLS).map(move |i| {
        let tilt = ((i % TILTS) as f64 / (TILTS - 1) as f64 - 0.5) * 2.0 * FRAC_PI_2;
        let outwards = Rotation3::from_axis_angle(&along, (i / TILTS) as f64 / ROLLS as f64 * TAU) * across;
        let y = outwards * libm::sin(tilt) - along.into_inner() * libm::cos(tilt);
        let z = outwards * libm::cos(tilt) + along.into_inner() * libm::sin(tilt);
        Rotation3::from_basis_unchecked(&[y.cross(&z), y, z])
    })
}

/// The true flight, undisturbed.
#[derive(Debug)]
pub struct Flight {
    /// Every millisecond from the release on until the object meets the floor or an obstacle.
    samples: Vec<FlightSample>,
}

#[derive(Debug)]
struct FlightSample {
    time_s: f64,
    p_WO: Point3<f64>,
    v_WO: Vector3<f64>,
}

impl Flight {
    /// Computes the flight of throw number `index`.
    pub fn of(setup: &Setup, seed: u64, index: u64) -> Self {
        let (release, conditions) = (setup.release(seed, index), setup.conditions(seed, index));
        let flight = FreeFlight::new(&setup.object, &release, &conditions, FLIGHT_STEP_S);
        let longest = (LONGEST_FLIGHT_S / FLIGHT_STEP_S) as usize;
        let is_free = |X_WO: &Pose| {
            let at = Point3::from(X_WO.translation.vector);
            let middle = Capsule { from: at, to: at, radius: 0.0 };
            let mut solids = setup.robot.obstacles.iter().chain(&setup.room);
            at.z > FLOOR_Z_M && solids.all(|solid| solid.distance_to_capsule(&middle) > 0.0)
        };
        let in_flight = flight.take(longest).take_while(|(X_WO, _)| is_free(X_WO));
        // The hand goes where the object's middle is, the origin of O.
        let sample = |(i, (X_WO, V_WO)): (usize, (Pose, Twist))| FlightSample {
            time_s: i as f64 * FLIGHT_STEP_S,
            p_WO: X_WO.translation.vector.into(),
            v_WO: V_WO.linear,
        };
        Self { samples: in_flight.enumerate().map(sample).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::Choice;

    #[test]
    fn arrival_speeds_lie_between_standing_and_the_fastest() {
        let limits = JointLimits { lower: -3.0, upper: 3.0, velocity: 1.5, acceleration: 9.0, torque: 1.0, jerk: None };
        for time_s in [0.05, 0.2, 0.7] {
            let most = farthest(&limits, time_s);
            let speed = least_terminal_speed(most, time_s, 1.5, 9.0);
            assert!((speed - (9.0 * time_s).min(1.5)).abs() < 1e-3, "{speed} after {time_s} s");
            assert_eq!(least_terminal_speed(0.2 * most, time_s, 1.5, 9.0), 0.0);
            // Up, coast, down, simulated: no way of arriving slower gets there.
            let speed = least_terminal_speed(0.9 * most, time_s, 1.5, 9.0);
            let (step, mut v, mut s) = (time_s * 1e-5, 0.0_f64, 0.0);
            for i in 0..100_000 {
                let left = time_s - f64::from(i) * step;
                let must_brake = v > speed + 9.0 * left;
                v = if must_brake { v - 9.0 * step } else { (v + 9.0 * step).min(1.5) };
                s += v * step;
            }
            assert!((s - 0.9 * most).abs() < 2e-3 * most, "{s} instead of {} in {time_s} s", 0.9 * most);
        }
    }

    #[test]
    fn hands_never_close_along_the_flight() {
        let v_WO = Vector3::new(-1.0, -2.0, 0.5);
        assert_eq!(hands(&v_WO).count(), TILTS * ROLLS);
        for R_WG in hands(&v_WO) {
            assert!((R_WG.matrix().determinant() - 1.0).abs() < 1e-9);
            assert!((R_WG * Vector3::x()).dot(&v_WO).abs() < 1e-9);
            assert!((R_WG * Vector3::y()).dot(&v_WO) < 1e-9, "from behind");
        }
    }

    /// The paper's near throw can be caught from the scenario's pose; from the paper's own only by who knows
    /// it at the release.
    #[test]
    fn the_near_throw_is_out_of_reach_from_the_pose_of_the_paper() {
        let mut setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
        let reach = Oracle::of(&setup).reach(&setup, 1, 0);
        assert!(reach.from_first_image_s.is_some() && reach.from_release_s.is_some(), "{reach:?}");
        setup.robot.ready_q = setup.robot.joint_vector(&[1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57]).unwrap();
        let reach = Oracle::of(&setup).reach(&setup, 1, 0);
        assert_eq!(reach.from_first_image_s, None);
        assert!(reach.from_release_s.is_some_and(|time_s| time_s > 0.55), "{reach:?}");
    }

    #[test]
    fn nobody_reaches_a_throw_that_passes_far_away() {
        let mut setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
        let aside = include_str!("../../../../assets/throws/near.toml")
            .replace("[1.66613, 1.63277, 0.3]", "[3.66613, 3.63277, 0.3]");
        setup.throw = catch_sim::Throw::from_toml("aside.toml", &aside).unwrap();
        let reach = Oracle::of(&setup).reach(&setup, 1, 0);
        assert_eq!(reach.from_release_s, None);
    }
}
