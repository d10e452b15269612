//! Distances of an arm to itself, the floor and the obstacles of its workcell.

use nalgebra::Point3;

use crate::{
    Gripper,
    kinematics::LinkPoses,
    pose::Pose,
    robot::{MAX_JOINTS, Robot},
    shape::{Capsule, Cuboid},
    workcell::{FLOOR_Z_M, Obstacle},
};

/// Collision geometry of an arm and its gripper, prepared for distance queries that do not allocate.
///
/// The arm is its capsules, the gripper the boxes of housing and fingers. Distances are exact for these, but
/// between two boxes they are lower bounds; where solids overlap they are not above zero and give no depth
/// beyond a capsule's radius.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmClearance {
    parts: Vec<Part>,
    /// Pairs of parts that may meet, by index, the first nearer to the base.
    pairs: Vec<(usize, usize)>,
    /// Parts that may meet the gripper.
    near_gripper: Vec<usize>,
    /// Parts that may meet what the gripper holds: all but those of the last link.
    near_held: Vec<usize>,
    X_LG: Pose,
    gripper: Gripper,
    /// Ball in G that holds the gripper at any opening.
    gripper_ball: (Point3<f64>, f64),
    obstacles: Vec<Obstacle>,
}

/// A capsule of a link and the ball around it.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    link: usize,
    capsule: Capsule,
    centre: Point3<f64>,
    radius: f64,
}

impl ArmClearance {
    /// Prepares the collision geometry of `robot` with `gripper` mounted on its last link.
    pub fn new(robot: &Robot, gripper: &Gripper) -> Self {
        let parts: Vec<Part> = robot
            .capsules
            .iter()
            .map(|&(link, capsule)| Part { link, capsule, centre: capsule.centre(), radius: capsule.bounding_radius() })
            .collect();
        let may_meet = |one: usize, two: usize| one + robot.ignored_neighbours < two;
        let mut pairs = Vec::new();
        for (i, one) in parts.iter().enumerate() {
            pairs.extend((0..parts.len()).filter(|&j| may_meet(one.link, parts[j].link)).map(|j| (i, j)));
        }
        let near_gripper = (0..parts.len()).filter(|&i| may_meet(parts[i].link, robot.dof())).collect();
        let near_held = (0..parts.len()).filter(|&i| parts[i].link < robot.dof()).collect();

        let middle = Point3::new(0.0, f64::midpoint(-gripper.palm_y_m(), gripper.fingertip_y_m()), 0.0);
        let reach = |cuboid: &Cuboid| ((cuboid.centre - middle).abs() + cuboid.size / 2.0).norm();
        let [left, right] = gripper.fingers(gripper.max_width_m);
        let gripper_ball = (middle, [gripper.body(), left, right].iter().map(reach).fold(0.0, f64::max));
        let (X_LG, gripper, obstacles) = (robot.X_LG, gripper.clone(), robot.obstacles.clone());
        Self { parts, pairs, near_gripper, near_held, X_LG, gripper, gripper_ball, obstacles }
    }

    /// The smallest distance in metres between links that are more than the robot's `ignored_neighbours`
    /// apart in the chain, the gripper at an opening of `width_m` counting as part of the last link; infinite
    /// if no two links may meet.
    pub fn self_clearance(&self, X_WL: &LinkPoses, width_m: f64) -> f64 {
        let mut smallest = f64::INFINITY;
        for &(one, two) in &self.pairs {
            let (one, two) = (&self.parts[one], &self.parts[two]);
            let between = (X_WL[one.link] * one.centre - X_WL[two.link] * two.centre).norm();
            // The balls around both bound the distance from below.
            if between - one.radius - two.radius < smallest {
                let one_W = one.capsule.transformed(&X_WL[one.link]);
                smallest = smallest.min(one_W.distance(&two.capsule.transformed(&X_WL[two.link])));
            }
        }
        let X_WG = X_WL[MAX_JOINTS] * self.X_LG;
        let (middle, reach) = self.gripper_ball;
        let middle_W = X_WG * middle;
        for &part in &self.near_gripper {
            let part = &self.parts[part];
            if (X_WL[part.link] * part.centre - middle_W).norm() - part.radius - reach < smallest {
                let X_GL = X_WG.inv_mul(&X_WL[part.link]);
                let capsule_G = part.capsule.transformed(&X_GL);
                for cuboid in self.boxes(width_m) {
                    smallest = smallest.min(capsule_G.distance_to_cuboid(&cuboid));
                }
            }
        }
        smallest
    }

    /// The smallest distance in metres of any link but the base, and of the gripper at an opening of
    /// `width_m`, from its surroundings: the floor and the obstacles.
    pub fn environment_clearance(&self, X_WL: &LinkPoses, width_m: f64) -> f64 {
        let X_WG = X_WL[MAX_JOINTS] * self.X_LG;
        let boxes = self.boxes(width_m);
        let gripper = boxes.iter().map(|cuboid| cuboid.lowest_z(&X_WG) - FLOOR_Z_M).fold(f64::INFINITY, f64::min);
        let (middle, reach) = self.gripper_ball;
        let gripper = self.near((&(X_WG * middle), reach), gripper, |obstacle| {
            boxes.iter().map(|cuboid| obstacle.distance_to_cuboid(&X_WG, cuboid)).fold(f64::INFINITY, f64::min)
        });
        let moving = self.parts.iter().filter(|part| part.link > 0);
        moving.fold(gripper, |smallest, part| {
            let capsule = part.capsule.transformed(&X_WL[part.link]);
            let smallest = smallest.min(capsule.from.z.min(capsule.to.z) - capsule.radius - FLOOR_Z_M);
            let ball = (&(X_WL[part.link] * part.centre), part.radius);
            self.near(ball, smallest, |obstacle| obstacle.distance_to_capsule(&capsule))
        })
    }

    /// The smaller of both clearances: from the arm itself and from its surroundings.
    pub fn least(&self, X_WL: &LinkPoses, width_m: f64) -> f64 {
        self.self_clearance(X_WL, width_m).min(self.environment_clearance(X_WL, width_m))
    }

    /// The smaller of `smallest` and the distances of all obstacles, of which those are asked for that may be
    /// below: what is measured is inside of a ball with this centre in W and this radius.
    fn near(&self, (centre_W, radius): (&Point3<f64>, f64), smallest: f64, distance: impl Fn(&Obstacle) -> f64) -> f64 {
        self.obstacles.iter().fold(smallest, |smallest, obstacle| {
            let may_be_nearer = obstacle.least_distance_to_ball(centre_W, radius) < smallest;
            if may_be_nearer { smallest.min(distance(obstacle)) } else { smallest }
        })
    }

    /// The smallest distance in metres of a box that the gripper holds, given in G, from its surroundings and
    /// from all links but the last, which the gripper is mounted on.
    pub fn held_clearance(&self, X_WL: &LinkPoses, held_G: &Cuboid) -> f64 {
        let X_WG = X_WL[MAX_JOINTS] * self.X_LG;
        let (centre_W, reach) = (X_WG * held_G.centre, held_G.bounding_radius());
        let held = |obstacle: &Obstacle| obstacle.distance_to_cuboid(&X_WG, held_G);
        let mut smallest = self.near((&centre_W, reach), held_G.lowest_z(&X_WG) - FLOOR_Z_M, held);
        for &part in &self.near_held {
            let part = &self.parts[part];
            if (X_WL[part.link] * part.centre - centre_W).norm() - part.radius - reach < smallest {
                let capsule_G = part.capsule.transformed(&X_WG.inv_mul(&X_WL[part.link]));
                smallest = smallest.min(capsule_G.distance_to_cuboid(held_G));
            }
        }
        smallest
    }

    /// Lower bound in metres of the distance from a ball to every part of arm and gripper and to every
    /// obstacle; negative where the ball overlaps the balls around them.
    pub fn least_distance_to_ball(&self, X_WL: &LinkPoses, centre_W: &Point3<f64>, radius: f64) -> f64 {
        let (middle, reach) = self.gripper_ball;
        let from = |X_WP: &Pose, centre: &Point3<f64>, reach: f64| (X_WP * centre - centre_W).norm() - reach - radius;
        let gripper = from(&(X_WL[MAX_JOINTS] * self.X_LG), &middle, reach);
        let parts = self.parts.iter().map(|part| from(&X_WL[part.link], &part.centre, part.radius));
        let obstacles = self.obstacles.iter().map(|obstacle| obstacle.least_distance_to_ball(centre_W, radius));
        parts.chain(obstacles).fold(gripper, f64::min)
    }

    /// Housing and fingers in G.
    fn boxes(&self, width_m: f64) -> [Cuboid; 3] {
        let [left, right] = self.gripper.fingers(width_m);
        [self.gripper.body(), left, right]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriangleMesh, robot_file::tests::iiwa};
    use proptest::prelude::*;

    proptest! {
        /// Against the capsules themselves, which a small ball cannot be nearer to.
        #[test]
        fn the_least_distance_to_a_ball_is_never_too_large(
            q in prop::array::uniform7(-2.0f64..2.0),
            place in prop::array::uniform3(-1.2f64..1.2),
        ) {
            let robot = iiwa();
            let clearance = ArmClearance::new(&robot, &wsg50());
            let X_WL = robot.link_poses(&robot.joint_vector(&q).unwrap());
            let centre_W = Point3::from(place);
            let ball = Capsule { from: centre_W, to: centre_W, radius: 0.03 };
            let exact = robot.capsules.iter().map(|(link, it)| it.transformed(&X_WL[*link]).distance(&ball));
            let exact = exact.fold(f64::INFINITY, f64::min);
            let least = clearance.least_distance_to_ball(&X_WL, &centre_W, 0.03);
            prop_assert!(least <= exact + 1e-12);
            prop_assert!(least >= exact - 0.5, "a bound of no use: {least} for {exact}");
        }
    }

    fn wsg50() -> Gripper {
        Gripper::from_toml("wsg50.toml", include_str!("../../../assets/grippers/wsg50.toml")).unwrap()
    }

    /// Clearances by brute force: all pairs of capsules, and the gripper sampled by points on its boxes.
    fn sampled(robot: &Robot, X_WL: &LinkPoses, width_m: f64) -> (f64, f64) {
        let gripper = wsg50();
        let X_WG = robot.gripper_in(X_WL);
        let [left, right] = gripper.fingers(width_m);
        let mut points = Vec::new();
        for cuboid in [gripper.body(), left, right] {
            for i in 0..=10 {
                for j in 0..=10 {
                    for k in 0..=10 {
                        let grid = nalgebra::Vector3::new(f64::from(i), f64::from(j), f64::from(k)) / 10.0;
                        points.push(X_WG * (cuboid.centre + grid.add_scalar(-0.5).component_mul(&cuboid.size)));
                    }
                }
            }
        }
        let in_world: Vec<(usize, Capsule)> =
            robot.capsules.iter().map(|(link, capsule)| (*link, capsule.transformed(&X_WL[*link]))).collect();
        let mut nearest = f64::INFINITY;
        for (i, one) in &in_world {
            for (_, two) in in_world.iter().filter(|(j, _)| i + robot.ignored_neighbours < *j) {
                nearest = nearest.min(one.distance(two));
            }
            if i + robot.ignored_neighbours < robot.dof() {
                nearest = points.iter().map(|p| one.distance_to_point(p)).fold(nearest, f64::min);
            }
        }
        let moving = in_world.iter().filter(|(link, _)| *link > 0);
        let lowest = moving
            .flat_map(|(_, capsule)| TriangleMesh::capsule(capsule, 64).vertices)
            .chain(points)
            .map(|point| point.z)
            .fold(f64::INFINITY, f64::min);
        (nearest, lowest)
    }

    proptest! {
        #[test]
        fn clearances_match_brute_force(q in prop::array::uniform7(-2.9f64..2.9), width_m in 0.0f64..0.11) {
            let robot = iiwa();
            let clearance = ArmClearance::new(&robot, &wsg50());
            let X_WL = robot.link_poses(&robot.joint_vector(&q).unwrap());
            let (nearest, lowest) = sampled(&robot, &X_WL, width_m);
            let found = clearance.self_clearance(&X_WL, width_m);
            // Samples on the boxes are up to 8 mm from the nearest point, and inside a capsule they see
            // deeper.
            prop_assert!(found <= nearest + 1e-9 || found < 0.0, "{found} is above the sampled {nearest}");
            prop_assert!(found > nearest - 0.008, "{found} is far below the sampled {nearest}");
            let found = clearance.environment_clearance(&X_WL, width_m);
            prop_assert!((found - lowest).abs() < 1e-3, "{found} and sampled {lowest}");
        }
    }

    proptest! {
        /// Against points all over the box.
        #[test]
        fn clearance_of_what_is_held_matches_brute_force(q in prop::array::uniform7(-2.9f64..2.9)) {
            let robot = iiwa();
            let clearance = ArmClearance::new(&robot, &wsg50());
            let X_WL = robot.link_poses(&robot.joint_vector(&q).unwrap());
            let held_G = Cuboid { centre: Point3::new(0.0, 0.09, 0.01), size: nalgebra::Vector3::new(0.03, 0.05, 0.17) };
            let X_WG = robot.gripper_in(&X_WL);
            let met = robot.capsules.iter().filter(|(link, _)| *link < robot.dof());
            let in_world: Vec<Capsule> = met.map(|(link, capsule)| capsule.transformed(&X_WL[*link])).collect();
            let steps = || (0..=12).map(|i| f64::from(i) / 12.0 - 0.5);
            let mut nearest = f64::INFINITY;
            for (x, y, z) in steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| (x, y, z)))) {
                let p = X_WG * (held_G.centre + nalgebra::Vector3::new(x, y, z).component_mul(&held_G.size));
                nearest = in_world.iter().map(|one| one.distance_to_point(&p)).fold(nearest.min(p.z), f64::min);
            }
            let found = clearance.held_clearance(&X_WL, &held_G);
            prop_assert!(found <= nearest + 1e-9 || found < 0.0, "{found} is above the sampled {nearest}");
            prop_assert!(nearest < 0.0 || found > nearest - 0.01, "{found} is far below the sampled {nearest}");
        }
    }

    #[test]
    fn waiting_pose_is_clear_and_a_folded_one_is_not() {
        let robot = iiwa();
        let clearance = ArmClearance::new(&robot, &wsg50());
        let at = |q: &[f64]| {
            let X_WL = robot.link_poses(&robot.joint_vector(q).unwrap());
            (clearance.self_clearance(&X_WL, 0.11), clearance.environment_clearance(&X_WL, 0.11))
        };
        let (itself, floor) = at(&robot.ready_q.as_slice()[..7]);
        assert!(itself > 0.05 && floor > 0.05, "{itself} {floor}");
        let (itself, _) = at(&[0.0, 2.09, 0.0, -2.09, 0.0, -2.09, 0.0]);
        assert!(itself < 0.0, "{itself}");
        let (_, floor) = at(&[0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(floor < 0.0, "{floor}");
    }
}
