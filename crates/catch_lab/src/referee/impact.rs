//! The impact of the object on the gripper, from the change of the object's momentum.

use catch_body::{
    JointVector, Robot,
    dynamics::gravity,
    robot::{ContactStop, Joint},
};
use catch_sim::{ThrownObject, Truth, TruthSample};
use nalgebra::{Vector3, Vector6};

/// Time from the first contact to the object at rest in the hand, in seconds. An impact itself is over in one
/// step.
const IMPACT_S: f64 = 0.02;
/// Duration over which a contact is averaged, in seconds. It is assumed: a real hand with fingers that yield
/// takes about so long to stop an object, and the arena's rigid ones do it in one step.
const CONTACT_S: f64 = 5e-3;

/// Impulse of the object on the gripper and the arm in the first 20 ms after the first contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Impact {
    /// Magnitude of the impulse, in N·s. Fingers that squeeze cancel out.
    pub impulse_ns: f64,
    /// Joint impulse Jᵀ·(impulse and its moment), the largest of any joint, in N·m·s.
    pub joint_impulse_nms: f64,
    /// The part nearest to its threshold, where the robot states at which contact its controller stops.
    pub stop: Option<Stop>,
}

/// The part of an arm at which a contact is nearest to the one that stops the maker's controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stop {
    /// Ratio of the contact to that threshold.
    pub ratio: f64,
    /// The joint, from 1 on; `None` for the hand.
    pub joint: Option<usize>,
}

/// Impulse of the object in one step: on the joints in N·m·s, and on the hand, its moment about the origin of
/// G first, along the axes of the arm's base.
struct Push {
    time_s: f64,
    joints: JointVector,
    hand_B: Vector6<f64>,
}

impl Stop {
    /// The largest ratio of the `pushes`, averaged over [`CONTACT_S`].
    fn of(pushes: &[Push], robot: &Robot) -> Option<Self> {
        let ContactStop { force_n, moment_nm } = robot.contact_stop?;
        let ratios = pushes.iter().flat_map(|last| {
            let recent = pushes.iter().filter(|it| (0.0..CONTACT_S - 1e-9).contains(&(last.time_s - it.time_s)));
            let (joints, hand_B) = recent.fold((JointVector::zeros(), Vector6::zeros()), |(joints, hand), it| {
                (joints + it.joints / CONTACT_S, hand + it.hand_B / CONTACT_S)
            });
            let hand = (hand_B.fixed_rows::<3>(0).amax() / moment_nm).max(hand_B.fixed_rows::<3>(3).amax() / force_n);
            let of_joint = move |(i, joint): (usize, &Joint)| (joints[i].abs() / joint.limits.torque, Some(i + 1));
            robot.joints.iter().enumerate().map(of_joint).chain([(hand, None)])
        });
        ratios.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(ratio, joint)| Self { ratio, joint })
    }
}

/// Computes the impact of the object that first touched the gripper at `contact_s`. The air is left out.
pub(super) fn impact(truth: &Truth, contact_s: f64, object: &ThrownObject, robot: &Robot) -> Impact {
    let (mut impulse, mut joint_impulse, mut pushes) = (Vector3::zeros(), JointVector::zeros(), Vec::new());
    let momenta = |sample: &TruthSample| {
        let R_WO = sample.X_WO.rotation;
        let angular = R_WO * (object.inertia_kgm2 * (R_WO.inverse() * sample.V_WO.angular));
        (sample.V_WO.velocity_at(&(R_WO * object.com_O.coords)) * object.mass_kg, angular)
    };
    let first = truth.samples.partition_point(|sample| sample.time_s < contact_s).max(1);
    let after = truth.samples.partition_point(|sample| sample.time_s < contact_s + IMPACT_S);
    for pair in truth.samples[first - 1..after].windows(2) {
        let (before, after) = (momenta(&pair[0]), momenta(&pair[1]));
        let weight = gravity() * (object.mass_kg * (pair[1].time_s - pair[0].time_s));
        // On the object; on the gripper the opposite.
        let (linear, angular) = (after.0 - before.0 - weight, after.1 - before.1);
        impulse += linear;
        let X_WL = robot.link_poses(&pair[1].q);
        let com_W = pair[1].X_WO * object.com_O;
        let joints = robot.jacobian(&X_WL, &com_W).transpose() * -stacked(&angular, &linear);
        joint_impulse += joints;
        let moment = angular + (com_W.coords - pair[1].X_WG.translation.vector).cross(&linear);
        let R_BW = robot.X_WB.rotation.inverse();
        let hand_B = -stacked(&(R_BW * moment), &(R_BW * linear));
        pushes.push(Push { time_s: pair[1].time_s, joints, hand_B });
    }
    Impact { impulse_ns: impulse.norm(), joint_impulse_nms: joint_impulse.amax(), stop: Stop::of(&pushes, robot) }
}

fn stacked(angular: &Vector3<f64>, linear: &Vector3<f64>) -> Vector6<f64> {
    Vector6::from_iterator(angular.iter().chain(linear).copied())
}

#[cfg(test)]
mod tests {
    use catch_body::Twist;
    use catch_sim::free_flight::coasted;

    use super::*;
    use crate::scenario::setup::{Choice, Setup};

    /// A bottle that tumbles about a centre of mass 87 mm from the origin of its frame pushes nothing.
    #[test]
    fn what_flies_freely_has_no_impact() {
        let choice = Choice { scenario: Some("as-published"), object: Some("pill_bottle"), ..Choice::default() };
        let Setup { object, mut robot, .. } = Setup::load(&choice).unwrap();
        assert!(object.com_O.coords.norm() > 0.08);
        let start = Setup::load(&choice).unwrap().arena(1, 0).truth().samples[0];
        let spin = Twist { angular: Vector3::new(9.0, -14.0, 5.0), linear: start.V_WO.linear };
        let mut truth = Truth { samples: vec![start; 40], ..Truth::default() };
        for (step, sample) in truth.samples.iter_mut().enumerate() {
            sample.time_s = step as f64 * 1e-3;
            (sample.X_WO, sample.V_WO) = coasted(&object, (&start.X_WO, &spin), sample.time_s);
        }
        let Impact { impulse_ns, joint_impulse_nms, .. } = impact(&truth, 5e-3, &object, &robot);
        assert!(impulse_ns < 1e-9 && joint_impulse_nms < 1e-9, "{impulse_ns} N·s, {joint_impulse_nms} N·m·s");
        // A push at the centre of mass has no moment about it.
        let mut pushed = truth.clone();
        pushed.samples[10..].iter_mut().for_each(|it| it.V_WO.linear.x += 1.0);
        let Impact { impulse_ns, joint_impulse_nms, .. } = impact(&pushed, 5e-3, &object, &robot);
        let (X_WL, com_W) = (robot.link_poses(&start.q), pushed.samples[10].X_WO * object.com_O);
        let force = Vector6::new(0.0, 0.0, 0.0, object.mass_kg, 0.0, 0.0);
        let expected = (robot.jacobian(&X_WL, &com_W).transpose() * force).amax();
        assert!((impulse_ns - object.mass_kg).abs() < 1e-9);
        assert!((joint_impulse_nms - expected).abs() < 1e-9, "{joint_impulse_nms} instead of {expected}");

        // The same push takes a hand 5 ms; an arm that states no threshold has none to compare it with.
        let mut stop_at = |force_n, moment_nm| {
            robot.contact_stop = Some(ContactStop { force_n, moment_nm });
            impact(&pushed, 5e-3, &object, &robot).stop.unwrap()
        };
        let weak = stop_at(object.mass_kg / CONTACT_S / 2.0, 1e3);
        assert!((weak.ratio - 2.0).abs() < 1e-9 && weak.joint.is_none(), "{weak:?}");
        let strong = stop_at(1e5, 1e5);
        let torques = robot.jacobian(&X_WL, &com_W).transpose() * force / CONTACT_S;
        let joint = strong.joint.unwrap() - 1;
        let ratio = torques[joint].abs() / robot.joints[joint].limits.torque;
        assert!((strong.ratio - ratio).abs() < 1e-9, "{strong:?}, {ratio}");
    }
}
