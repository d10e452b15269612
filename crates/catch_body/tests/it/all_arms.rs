//! Kinematics and inverse dynamics of every built-in arm against Pinocchio; `tests/golden/README.md` says how
//! the numbers were made.

use std::{collections::BTreeMap, fs, path::PathBuf};

use catch_body::{Robot, robot_file::RobotFiles};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    torque: Vec<f64>,
    p_WG: [f64; 3],
    R_WG_rows: [[f64; 3]; 3],
    jacobian_rows: Vec<Vec<f64>>,
}

/// Agreement with the goldens, relative to the largest number of a kind.
const TOLERANCE: f64 = 1e-9;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../assets/robots")
}

fn robot(name: &str) -> Robot {
    let read = |file: &str| fs::read_to_string(folder().join(name).join(file)).unwrap();
    let (urdf, toml) = (read("robot.urdf"), read("robot.toml"));
    let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
    Robot::from_files(&files).unwrap()
}

#[test]
fn every_arm_agrees() {
    let golden: BTreeMap<String, Vec<Case>> = serde_json::from_str(include_str!("../golden/all_arms.json")).unwrap();
    let mut built_in: Vec<String> =
        fs::read_dir(folder()).unwrap().map(|it| it.unwrap().file_name().into_string().unwrap()).collect();
    built_in.sort_unstable();
    assert_eq!(golden.keys().cloned().collect::<Vec<_>>(), built_in, "every built-in arm has goldens");
    for (name, cases) in golden {
        let robot = robot(&name);
        for case in cases {
            let [q, dq, ddq, torque] =
                [&case.q, &case.dq, &case.ddq, &case.torque].map(|values| robot.joint_vector(values).unwrap());
            let X_WL = robot.link_poses(&q);
            let X_WG = robot.gripper_in(&X_WL);
            let off_m = (X_WG.translation.vector - Vector3::from(case.p_WG)).amax();
            let R_WG = Matrix3::from_fn(|row, column| case.R_WG_rows[row][column]);
            let turned = (X_WG.rotation.to_rotation_matrix().matrix() - R_WG).amax();
            assert!(off_m < TOLERANCE && turned < TOLERANCE, "{name}: {off_m} m, {turned}");

            let jacobian = robot.jacobian(&X_WL, &X_WG.translation.vector.into());
            for (row, expected) in case.jacobian_rows.iter().enumerate() {
                for (joint, expected) in expected.iter().enumerate() {
                    assert!((jacobian[(row, joint)] - expected).abs() < TOLERANCE, "{name}: row {row}, joint {joint}");
                }
            }
            let error = (robot.inverse_dynamics(&q, &dq, &ddq) - torque).amax();
            assert!(error < TOLERANCE * torque.amax(), "{name}: {error} of {torque}");
        }
    }
}
