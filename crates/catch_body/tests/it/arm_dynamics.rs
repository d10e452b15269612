//! Kinematics and inverse dynamics of the arm against MuJoCo; `tests/golden/README.md` says how the numbers
//! were made.

use catch_body::{Gripper, Robot, robot_file::RobotFiles};
use nalgebra::{Quaternion, Unit, Vector3};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    gripper_width_m: f64,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    torque_without_rotors: Vec<f64>,
    torque: Vec<f64>,
    p_WG: [f64; 3],
    q_WG_xyzw: [f64; 4],
    jacobian_rows: Vec<Vec<f64>>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden/arm_dynamics.json")).unwrap()
}

fn robot() -> Robot {
    Robot::from_files(&RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    })
    .unwrap()
}

fn gripper() -> Gripper {
    Gripper::from_toml("gripper", include_str!("../../../../assets/grippers/wsg50.toml")).unwrap()
}

#[test]
fn gripper_pose_and_jacobian_agree() {
    let robot = robot().with_mount_of(&gripper());
    for case in golden().cases {
        let q = robot.joint_vector(&case.q).unwrap();
        let X_WL = robot.link_poses(&q);
        let X_WG = robot.gripper_in(&X_WL);
        assert!((X_WG.translation.vector - Vector3::from(case.p_WG)).norm() < 1e-9);
        let [x, y, z, w] = case.q_WG_xyzw;
        assert!(X_WG.rotation.angle_to(&Unit::new_normalize(Quaternion::new(w, x, y, z))) < 1e-7);
        let jacobian = robot.jacobian(&X_WL, &X_WG.translation.vector.into());
        for (row, expected) in case.jacobian_rows.iter().enumerate() {
            for (joint, expected) in expected.iter().enumerate() {
                assert!((jacobian[(row, joint)] - expected).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn inverse_dynamics_agree() {
    let gripper = gripper();
    let Golden { gripper_width_m, cases } = golden();
    assert_eq!(gripper_width_m, gripper.max_width_m / 2.0, "the opening at which `carrying` adds the fingers");
    let with_rotors = robot().carrying(&gripper);
    let mut without_rotors = with_rotors.clone();
    for joint in &mut without_rotors.joints {
        (joint.rotor_inertia, joint.damping) = (0.0, 0.0);
    }
    for case in cases {
        for (robot, expected) in [(&with_rotors, &case.torque), (&without_rotors, &case.torque_without_rotors)] {
            let [q, dq, ddq] = [&case.q, &case.dq, &case.ddq].map(|values| robot.joint_vector(values).unwrap());
            let expected = robot.joint_vector(expected).unwrap();
            let error = (robot.inverse_dynamics(&q, &dq, &ddq) - expected).amax();
            assert!(error < 1e-6 * expected.amax(), "{error} of {expected}");
        }
    }
}
