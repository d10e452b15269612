//! `robot import`: from a description that somebody else published to a robot of this project, with one
//! command.

use std::{
    fs,
    path::{Path, PathBuf},
};

use catch_body::{JointVector, Robot, robot_file::RobotFiles};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

/// A link with a mass and a mesh.
fn link(name: &str, mass: &str) -> String {
    format!(
        "<link name=\"{name}\"><inertial><origin xyz=\"0 0 0.1\"/><mass value=\"{mass}\"/>\
         <inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" izz=\"0.01\"/></inertial>\
         <collision><geometry><mesh filename=\"package://arm_support/meshes/tube.obj\"/></geometry></collision></link>\n"
    )
}

fn joint(name: &str, kind: &str, [parent, child]: [&str; 2], xyz: &str, rest: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
         <origin xyz=\"{xyz}\" rpy=\"0 0 0.5\"/>{rest}</joint>\n"
    )
}

const TURNS: &str =
    "<axis xyz=\"0 0 1\"/><limit lower=\"-2\" upper=\"2\" velocity=\"3\" effort=\"80\"/><dynamics friction=\"0.5\"/>";
const BENDS: &str = "<axis xyz=\"0 1 0\"/><limit lower=\"-2\" upper=\"2\" velocity=\"3\" effort=\"80\"/>";

/// An arm on a stand, with a sensor in a fixed joint, a joint without end, one without torque, and a hand
/// with two fingers.
fn description() -> String {
    let mut text = "<robot name=\"arm\">\n<link name=\"world\"/>\n".to_owned();
    for (name, mass) in
        [("base", "5"), ("one", "4"), ("two", "3"), ("three", "2"), ("four", "2"), ("five", "1"), ("six", "1")]
    {
        text += &link(name, mass);
    }
    text += &link("sensor", "0.5");
    text += &link("hand", "0.7");
    text += "<link name=\"flange\"/><link name=\"left\"/><link name=\"right\"/>\n";
    text += &joint("stand", "fixed", ["world", "base"], "0 0 0.1", "");
    text += &joint(
        "j1",
        "continuous",
        ["base", "one"],
        "0 0 0.3",
        "<axis xyz=\"0 0 1\"/><limit velocity=\"3\" effort=\"80\"/>",
    );
    text += &joint("j2", "revolute", ["one", "two"], "0 0.1 0", BENDS);
    text += &joint("j3", "revolute", ["two", "three"], "0 0 0.4", BENDS);
    text += &joint("on_two", "fixed", ["two", "sensor"], "0.1 0 0.2", "");
    text += &joint("j4", "revolute", ["three", "four"], "0 0 0.3", &TURNS.replace(" effort=\"80\"", ""));
    text += &joint("j5", "revolute", ["four", "five"], "0 0 0.1", BENDS);
    text += &joint("j6", "revolute", ["five", "six"], "0 0 0.1", TURNS);
    text += &joint("at_six", "fixed", ["six", "flange"], "0 0 0.25", "");
    text += &joint("on_flange", "fixed", ["flange", "hand"], "0 0 0.01", "");
    let slides =
        |y: &str| format!("<axis xyz=\"0 {y} 0\"/><limit lower=\"0\" upper=\"0.04\" velocity=\"0.2\" effort=\"20\"/>");
    text += &joint("f1", "prismatic", ["hand", "left"], "0 0 0.06", &slides("1"));
    text += &joint("f2", "prismatic", ["hand", "right"], "0 0 0.06", &(slides("-1") + "<mimic joint=\"f1\"/>"));
    text += "<ros2_control name=\"c\" type=\"system\"><joint name=\"j1\"><command_interface name=\"position\">\
             <param name=\"min\">-1</param></command_interface></joint></ros2_control>\n";
    text + "</robot>\n"
}

/// A tube along z with 16 sides.
fn tube() -> String {
    let mut text = String::new();
    for z in [0.0, 0.25] {
        for i in 0..16 {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(i) / 16.0);
            text += &format!("v {} {} {z}\n", 0.04 * cos, 0.04 * sin);
        }
    }
    for i in 0..16 {
        let (a, b) = (i + 1, (i + 1) % 16 + 1);
        text += &format!("f {a} {b} {}\nf {a} {} {}\n", b + 16, b + 16, a + 16);
    }
    text
}

/// The description with its mesh, in the folders of a package.
pub fn package(folder: &Path) -> PathBuf {
    let root = folder.join("arm_support");
    fs::create_dir_all(root.join("urdf")).unwrap();
    fs::create_dir_all(root.join("meshes")).unwrap();
    fs::write(root.join("meshes/tube.obj"), tube()).unwrap();
    fs::write(
        root.join("urdf/joint_limits.yaml"),
        "joint_limits:\n  j2:\n    max_acceleration: 9.5\n    max_velocity: 2.5\n",
    )
    .unwrap();
    let file = root.join("urdf/arm.urdf");
    fs::write(&file, description()).unwrap();
    file
}

fn robot(folder: &Path) -> Robot {
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let (urdf, toml) = (read("robot.urdf"), read("robot.toml"));
    let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
    Robot::from_files(&files).unwrap()
}

#[test]
fn a_description_becomes_a_robot() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(folder.path());
    let out = folder.path().join("arm");
    let [file, out_text] = [&file, &out].map(|it| it.to_str().unwrap());
    let output =
        catchingbot(&["robot", "import", file, "--out", out_text, "--no-ready", "--json", "--rotor-inertia", "0.2"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let said: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!((&said["flange"], &said["reach"]), (&Value::from("flange"), &Value::Null));
    assert_eq!(said["taken_off"], serde_json::json!(["hand", "left", "right"]));
    assert!(said["unread"].as_array().unwrap().is_empty(), "{}", said["unread"]);
    let ignored = ["<ros2_control> in <robot>", "friction of <dynamics>", "min and max of <ros2_control>"];
    assert_eq!(said["ignored"], serde_json::json!(ignored));

    let robot = robot(&out);
    assert_eq!(robot.dof(), 6);
    assert_eq!(robot.joints[1].limits.velocity, 2.5, "joint_limits.yaml goes before the description");
    assert_eq!((robot.joints[1].limits.acceleration, robot.joints[2].limits.acceleration), (9.5, 15.0));
    assert_eq!(robot.joints[0].limits.upper, std::f64::consts::TAU);
    assert!(robot.joints[3].limits.torque > 1.0 && robot.joints[3].limits.torque < 500.0);
    assert!(robot.joints.iter().all(|joint| joint.rotor_inertia == 0.2));
    // The sensor's mass is the second link's; the hand's is nobody's.
    let masses: Vec<f64> = robot.joints.iter().map(|joint| joint.inertia.mass).collect();
    assert_eq!(masses, [4.0, 3.5, 2.0, 2.0, 1.0, 1.0]);

    // The flange at zero: all joints and fixed joints in a row, each half a radian further about z.
    let steps = [0.1, 0.3, 0.0, 0.4, 0.3, 0.1, 0.1, 0.25, 0.01];
    // The fingers slide along axes of their own frames, one joint further.
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5 * (steps.len() + 1) as f64);
    let X_WG = robot.gripper_pose(&JointVector::zeros());
    let aside = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.0) * Vector3::new(0.0, 0.1, 0.0);
    let expected = aside + Vector3::z() * steps.iter().sum::<f64>();
    assert!((X_WG.translation.vector - expected).norm() < 1e-9, "{X_WG}");
    let [approach, closing] = [Vector3::y(), Vector3::x()].map(|axis| X_WG.rotation * axis);
    assert!((approach - Vector3::z()).norm() < 1e-9 && (closing - turned * Vector3::y()).norm() < 1e-9, "{X_WG}");

    // The capsules hold the tube of every link.
    for link in 0..7 {
        let of_link: Vec<_> = robot.capsules.iter().filter(|(of, _)| *of == link).collect();
        for corner in [Point3::new(0.04, 0.0, 0.25), Point3::new(0.0, -0.04, 0.0)] {
            let corner = if link == 0 { turned_half(corner) } else { corner };
            assert!(of_link.iter().any(|(_, it)| it.distance_to_point(&corner) <= 0.0), "link {link}");
        }
    }

    let assumed: Vec<&str> = said["assumed"].as_array().unwrap().iter().filter_map(|it| it["field"].as_str()).collect();
    assert!(assumed.contains(&"joints.j1.range_rad") && assumed.contains(&"joints.j4.max_torque_nm"), "{assumed:?}");
    assert!(!assumed.contains(&"joints.j2.max_acceleration_radps2"), "{assumed:?}");
    let check = catchingbot(&["check", out_text]);
    assert!(check.status.success() && stdout(&check).contains("assumed: joints.j1.range_rad"), "{}", stdout(&check));
    assert!(fs::read_to_string(out.join("capsules.html")).unwrap().contains("every shape is inside"));
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|it| it.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

/// A point of the base in the frame of the stand.
/// An arm whose masses nobody states is not heavier than its motors can hold.
#[test]
fn masses_that_are_assumed_are_held() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(folder.path());
    let mut rest = description().replace("effort=\"80\"", "effort=\"45\"");
    let mut massless = String::new();
    while let Some((before, after)) = rest.split_once("<inertial>") {
        massless += before;
        rest = after.split_once("</inertial>").unwrap().1.to_owned();
    }
    fs::write(&file, massless + &rest).unwrap();
    let out = folder.path().join("arm");
    let output =
        catchingbot(&["robot", "import", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-ready"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(fs::read_to_string(out.join("robot.toml")).unwrap().contains("half of the torque limits holds the arm"));
    let arm = robot(&out).carrying(&catch_lab::scenario::setup::Setup::load(&Default::default()).unwrap().gripper);
    let (mut most, still) = ([0.0_f64; 6], JointVector::zeros());
    for i in 0..4096 {
        let angle = |joint: i32| f64::from(i / 4_i32.pow(joint as u32) % 4) - 1.5;
        let q = JointVector::from_fn(|joint, _| if joint < 6 { angle(joint as i32) } else { 0.0 });
        let torque = arm.inverse_dynamics(&q, &still, &still);
        (0..6).for_each(|joint| most[joint] = most[joint].max(torque[joint].abs()));
    }
    assert!((15.0..23.0).contains(&most[1]), "half of 45 N·m: {most:?}");
}

fn turned_half(point: Point3<f64>) -> Point3<f64> {
    Point3::new(0.0, 0.0, 0.1) + UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5) * point.coords
}

#[test]
fn what_cannot_be_imported_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = package(folder.path());
    let file = file.to_str().unwrap();
    let text = description();
    let out = folder.path().join("out");
    let out_text = out.to_str().unwrap();
    let xacro = folder.path().join("arm.urdf.xacro");
    fs::write(&xacro, "<robot xmlns:xacro=\"x\"><xacro:include filename=\"a\"/></robot>").unwrap();
    let sliding = folder.path().join("sliding.urdf");
    fs::write(&sliding, text.replace("name=\"j2\" type=\"revolute\"", "name=\"j2\" type=\"prismatic\"")).unwrap();
    let [child, parent] = ["child", "parent"].map(|end| {
        let path = folder.path().join(format!("{end}.urdf"));
        fs::write(&path, text.replace(&format!("<{end} link=\"three\"/>"), &format!("<{end} link=\"tree\"/>")))
            .unwrap();
        path
    });
    let [xacro, sliding, child, parent] = [&xacro, &sliding, &child, &parent].map(|it| it.to_str().unwrap());
    for (arguments, expected) in [
        (vec![xacro], "arm.urdf.xacro > robot.urdf` expands it"),
        (vec![sliding], "`--base two` begins behind it"),
        (vec![child], "joint j3.child: found the link `tree`, which is not there"),
        (vec![parent], "joint j4.parent: found the link `tree`, which is not there"),
        (vec![file, "--base", "four"], "found 2 from four on that move an arm, expected 3 or more revolute joints"),
        (vec![file, "--tip", "nose"], "--tip: found `nose`, expected one of the links base, five"),
        (
            vec![file, "--max-acceleration", "1,2"],
            "found 2 values, expected one for all joints or one for each of the 6",
        ),
        (vec![file, "--max-jerk=-1"], "--max-jerk: found -1, expected 0.001 to"),
        (vec!["none.urdf"], "none.urdf: the file"),
    ] {
        let output = catchingbot(&[&["robot", "import", "--no-ready", "--out", out_text], &arguments[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
        assert!(!out.exists());
    }
    fs::create_dir(&out).unwrap();
    let output = catchingbot(&["robot", "import", file, "--out", out_text]);
    assert!(
        stderr(&output).contains("which is already there, expected another place: nothing is overwritten"),
        "{}",
        stderr(&output)
    );
    let output = catchingbot(&["--robot", file]);
    assert!(stderr(&output).contains("catchingbot robot import"), "{}", stderr(&output));
}
