//! Check of an arm's reach map against poses that are known to be reached.

use catch_body::{JointVector, Robot, robot_file::RobotFiles};
use catch_bot::trajectory_optimization::{
    Start,
    reach_map::{CHUNKS, ReachMap, ReachSamples, SLACK_S},
    reachability::ReachableSet,
};
use catch_cell::Setpoint;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn arm() -> Robot {
    let [urdf, toml] = [
        include_str!("../../../../assets/robots/panda/robot.urdf"),
        include_str!("../../../../assets/robots/panda/robot.toml"),
    ];
    let files = RobotFiles { urdf_file: "robot.urdf", urdf, toml_file: "robot.toml", toml };
    Robot::from_files(&files).unwrap()
}

#[test]
fn hardly_a_pose_is_reached_sooner_than_the_map_tells() {
    let robot = arm();
    let map = ReachMap::new(&robot);
    let mut rng = Pcg64::seed_from_u64(7);
    let (mut late, mut never, count) = (0, 0, 20_000);
    for _ in 0..count {
        // As far as each joint comes in some time between 0.3 and 0.9 s.
        let within_s = rng.random_range(0.3..0.9);
        let mut q = JointVector::zeros();
        for (i, joint) in robot.joints.iter().enumerate() {
            let (limits, from) = (&joint.limits, robot.ready_q[i]);
            let (velocity, acceleration) = (limits.velocity, limits.acceleration);
            let reach = ReachableSet { start_velocity: 0.0, velocity, acceleration, time_s: within_s };
            let far = reach.displacements().high;
            q[i] = rng.random_range((from - far).max(limits.lower)..(from + far).min(limits.upper));
        }
        let X_WG = robot.gripper_pose(&q);
        if X_WG.translation.z > 0.0 {
            late += usize::from(!map.is_in_time(&X_WG, within_s));
            never += usize::from(map.least_time_s(&X_WG) > within_s + 2.0 * SLACK_S);
        }
    }
    assert!(late * 500 <= count, "{late} of {count} are called late");
    assert!(never * 2000 <= count, "{never} of {count} are called much too late");
    // The map is not trivial: hardly any pose is reached at once.
    let q = robot.joint_vector(&[1.5, -1.0, 1.0, -2.5, 1.0, 1.0, -1.0]).unwrap();
    assert!(map.least_time_s(&robot.gripper_pose(&q)) > 0.3);
    assert!(!map.is_in_time(&robot.gripper_pose(&q), 0.2));

    let start = |q, dq| Start { time_s: 1.0, state: Setpoint { q, dq, ddq: JointVector::zeros() } };
    let moving = JointVector::repeat(0.1);
    assert!(map.departs_at(&start(robot.ready_q, JointVector::zeros())));
    assert!(!map.departs_at(&start(robot.ready_q, moving)) && !map.departs_at(&start(q, JointVector::zeros())));
    assert!(ReachMap::from_bytes(&robot, &map.to_bytes()).is_some_and(|it| it == map));
}

/// The map is the same whichever thread draws which samples.
#[test]
fn the_map_is_the_same_for_any_number_of_threads() {
    let robot = arm();
    let chunks = CHUNKS / 100;
    let drawn = |chunks: &mut dyn Iterator<Item = u64>| {
        let mut samples = ReachSamples::new(&robot);
        chunks.for_each(|chunk| samples.draw(chunk));
        samples
    };
    let alone = drawn(&mut (0..chunks)).map();
    let [even, odd] = [0, 1].map(|first| drawn(&mut (first..chunks).step_by(2).collect::<Vec<_>>().into_iter().rev()));
    assert_eq!(alone, odd.merged(&even).map());
}
