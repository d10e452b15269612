//! An arm of five joints catches balls with the hand turned as it can turn it.

use std::{fmt::Write, fs, path::Path};

use catch_lab::{
    evaluation::{Cell, Evaluation},
    scenario::setup::{Choice, Setup},
};

/// Joints of an arm like the SO-100, three times as large: name and axis, and the height above the joint
/// before in metres, the range in radians, the highest speed in rad/s and torque in N·m.
const JOINTS: [(&str, &str, [f64; 4]); 5] = [
    ("pan", "0 0 1", [0.15, 2.9, 3.5, 200.0]),
    ("lift", "0 1 0", [0.2, 1.9, 3.5, 200.0]),
    ("elbow", "0 1 0", [0.42, 2.6, 4.0, 120.0]),
    ("wrist", "0 1 0", [0.36, 2.1, 5.0, 60.0]),
    ("roll", "0 0 1", [0.08, 2.9, 6.0, 40.0]),
];

fn write_arm(folder: &Path) {
    let (mut urdf, mut joints, mut capsules) = (String::from("<robot name=\"five\">\n"), String::new(), String::new());
    for (i, mass) in [4.0, 3.0, 3.0, 2.0, 1.0, 0.5].into_iter().enumerate() {
        let _ = writeln!(
            urdf,
            "<link name=\"l{i}\"><inertial><origin xyz=\"0 0 0.05\"/><mass value=\"{mass}\"/><inertia ixx=\"0.02\" ixy=\"0\" \
             ixz=\"0\" iyy=\"0.02\" iyz=\"0\" izz=\"0.01\"/></inertial></link>"
        );
    }
    for (i, (name, axis, [z, range, speed, torque])) in JOINTS.into_iter().enumerate() {
        let _ = writeln!(
            urdf,
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"l{i}\"/><child link=\"l{}\"/><origin xyz=\"0 0 {z}\"/>\
             <axis xyz=\"{axis}\"/><limit lower=\"-{range}\" upper=\"{range}\" velocity=\"{speed}\" effort=\"{torque}\"/></joint>",
            i + 1
        );
        let _ = writeln!(joints, "[joints.{name}]\nmax_acceleration_radps2 = 25.0\nrotor_inertia_kgm2 = 0.05");
        let _ = writeln!(
            capsules,
            "[[collision.capsules]]\nlink = \"l{i}\"\nfrom_m = [0.0, 0.0, 0.0]\nto_m = [0.0, 0.0, {z}]\nradius_m = 0.05"
        );
    }
    let toml = format!(
        "[base]\nposition_m = [0.0, 0.0, 0.0]\nrpy_rad = [0.0, 0.0, 0.0]\n\
         [flange]\nposition_m = [0.0, 0.0, 0.04375]\nrpy_rad = [1.5707963267948966, 0.0, 1.5707963267948966]\n\
         [poses]\ncomfortable_rad = [0.0, 0.2, 1.4, 0.0, 0.0]\nready_rad = [0.0, 0.2, 1.4, 0.0, 0.0]\n{joints}\
         [collision]\nignored_neighbours = 2\n{capsules}"
    );
    fs::write(folder.join("robot.urdf"), urdf + "</robot>\n").unwrap();
    fs::write(folder.join("robot.toml"), toml).unwrap();
}

#[test]
fn an_arm_of_five_joints_catches_balls() {
    let folder = tempfile::tempdir().unwrap();
    write_arm(folder.path());
    let cell = |scenario| {
        let choice = Choice {
            scenario: Some(scenario),
            robot: folder.path().to_str(),
            object: Some("tennis_ball"),
            throw: Some("random_by_reach"),
            ..Choice::default()
        };
        Cell::new(Setup::load(&choice).unwrap())
    };
    let evaluation = Evaluation { cells: ["paper", "honest"].map(cell).into(), seed: 5, first: 0, trials: 6 };
    let mut caught = 0;
    let ran = evaluation.run(0, 2, &mut |row, _| {
        caught += usize::from(row.verdict.caught);
        Ok(())
    });
    ran.unwrap();
    assert!(caught >= 10, "{caught} of 12 caught");
}
