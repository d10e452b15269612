//! Robot, gripper and objects from the project's files, and hands that are fixed in the world.

use catch_body::{Gripper, InputError, JointVector, Pose, Robot, robot_file::RobotFiles};
use catch_sim::{
    Arena, ArenaConfig, Conditions, Equipment, GripperDriveKind, Release, ThrownObject,
    gripper_drive::GripperDrive,
    physics::{Loads, World, WorldSettings},
    random_streams::{Draws, Stream},
};
use nalgebra::{Point3, UnitQuaternion, Vector3};

pub fn robot() -> Robot {
    Robot::from_files(&RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    })
    .unwrap()
    .with_mount_of(&gripper())
}

pub fn gripper() -> Gripper {
    Gripper::from_toml("wsg50.toml", include_str!("../../../../assets/grippers/wsg50.toml")).unwrap()
}

pub fn object(name: &str) -> ThrownObject {
    let text = match name {
        "tennis_ball" => include_str!("../../../../assets/objects/tennis_ball/truth.toml"),
        "banana" => include_str!("../../../../assets/objects/banana/truth.toml"),
        "pill_bottle" => include_str!("../../../../assets/objects/pill_bottle/truth.toml"),
        _ => panic!("{name}"),
    };
    ThrownObject::from_toml(name, text, &|file| Err(InputError::new(file, "file", "nothing", "a file"))).unwrap()
}

/// A hollow ball like the tennis ball, of any radius.
pub fn ball(radius_m: f64) -> ThrownObject {
    let text = include_str!("../../../../assets/objects/tennis_ball/truth.toml");
    let text = text.replace("diameter_m = 0.0672", &format!("diameter_m = {}", 2.0 * radius_m));
    ThrownObject::from_toml("ball", &text, &|file| Err(InputError::new(file, "file", "nothing", "a file"))).unwrap()
}

/// A release without spin.
pub fn release(p_WO: [f64; 3], v_WO: [f64; 3]) -> Release {
    Release {
        p_WO: p_WO.into(),
        v_WO: v_WO.into(),
        q_WO: UnitQuaternion::identity(),
        omega_WO: Vector3::zeros(),
        path: None,
    }
}

pub fn settings(friction: f64, restitution: f64) -> WorldSettings {
    WorldSettings { step_s: 1e-3, substeps: 4, friction, restitution, drive_mass_kg: 0.0 }
}

pub fn no_loads() -> Loads {
    Loads {
        torque: JointVector::zeros(),
        finger_force_n: [0.0; 2],
        object_force_n: Vector3::zeros(),
        object_torque_nm: Vector3::zeros(),
        gravity: Vector3::new(0.0, 0.0, -9.81),
    }
}

/// An arm without links and joints, at whose end frame G is at `p_WG`, its axes along the world's.
pub fn fixed_mount(p_WG: Point3<f64>) -> Robot {
    let robot = robot();
    let (joints, capsules) = (Vec::new(), Vec::new());
    Robot { joints, capsules, X_WB: Pose::translation(p_WG.x, p_WG.y, p_WG.z), X_LG: Pose::identity(), ..robot }
}

/// A hand fixed in the world, frame G at `p_WG`, its axes along the world's.
pub fn fixed_hand(
    settings: WorldSettings,
    p_WG: Point3<f64>,
    gripper: &Gripper,
    width_m: f64,
    object: &ThrownObject,
    release: &Release,
) -> World {
    let mount = (&fixed_mount(p_WG), &JointVector::zeros());
    World::new(settings, mount, gripper, width_m, (object, release))
}

/// Distance between the fingers of the waiting hand, in metres: wide open.
pub const WIDTH_M: f64 = 0.11;

/// An arena without cameras.
pub fn arena(config: &ArenaConfig, object: &str, release: &Release, ready_q: &JointVector) -> Arena {
    let equipment = Equipment::new(config.clone(), robot(), gripper(), self::object(object), Vec::new());
    Arena::new(&equipment, release, (ready_q, WIDTH_M), 0, 0)
}

/// An ideal drive of a gripper that is this wide open.
pub fn ideal_drive(gripper: &Gripper, width_m: f64) -> GripperDrive {
    GripperDrive::new(GripperDriveKind::Ideal, gripper, width_m, &mut Draws::new(Stream::Gripper, 0, 0))
}

/// Conditions without any effect besides the throw itself.
pub fn calm(object: &str) -> Conditions {
    Conditions::draw(&ArenaConfig::default(), &self::object(object), 0, 0)
}
