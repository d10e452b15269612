//! The cell as a model of MuJoCo (MJCF).
//!
//! Bodies and joints of the arm begin with `arm/`. Geoms begin with their part: `arm:3:0` is a capsule of the
//! third link, `object:0` a convex part of the object. Cameras see geoms of group 1; those of group 3 only
//! collide, as capsules of links with a visual shape do. The object touches everything else, and nothing else
//! touches anything.

use std::fmt::Write;

use catch_body::{
    Gripper, Pose, Robot, TriangleMesh,
    robot::Inertia,
    shape::{Capsule, Cuboid},
};
use catch_cell::CameraModel;
use catch_lab::scenario::setup::Setup;
use catch_sim::{
    Conditions, GripperDriveKind, Release, ThrownObject, gripper_drive::DRIVE_MASS_KG, object::ColliderPart,
};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use crate::pages::packed::text_in_html;

/// Groups of geoms: what cameras see, and what only collides.
const SEEN: u32 = 1;
const COLLIDES: u32 = 3;
/// MuJoCo's time step, and the highest rate of a contact's spring in 1/s for it.
const STEP_S: f64 = 0.0005;
const MOST_PER_S: f64 = 1000.0;
/// Impedances of contacts with a hard object, and with a soft one. Under a constant load a contact of MuJoCo
/// is stiffer than in an impact, by 1/(1 − impedance). A soft object is as stiff as its file says under load.
const HARD_IMPEDANCE: f64 = 0.9;
const SOFT_IMPEDANCE: f64 = 0.5;

/// The scene of a throw as MJCF, its object just released, with its friction and restitution. Masses are
/// nominal, and the cameras stand where their rig has them.
pub fn scene(setup: &Setup, seed: u64, index: u64) -> String {
    let Setup { robot, gripper, object, cameras, .. } = setup;
    let is_real = setup.scenario.arena.gripper == GripperDriveKind::Real;
    let drive_kg = if is_real { DRIVE_MASS_KG } else { 0.0 };
    let cameras: String = cameras.iter().enumerate().map(camera).collect();
    let world = format!(
        "{}{}{cameras}{}",
        "<geom name=\"floor:0\" type=\"plane\" size=\"20 20 1\" group=\"3\"/>\n",
        surroundings(robot),
        arm(robot, gripper, drive_kg),
    );
    let (shapes, body) = thrown(object);
    let contact = contact_attributes(setup, &setup.conditions(seed, index), drive_kg);
    let mut pairs = String::new();
    for part in 0..object.parts.len() {
        for other in world.split("<geom name=\"").skip(1).filter_map(|it| it.split('"').next()) {
            // Writing to a string never fails.
            let _ = writeln!(pairs, "<pair geom1=\"object:{part}\" geom2=\"{other}\" {contact}/>");
        }
    }
    let name = text_in_html(&format!("{} with {}, {}", robot.name, gripper.name, object.name));
    format!(
        "<mujoco model=\"{name}\">\n\
         <compiler angle=\"radian\" autolimits=\"true\"/>\n\
         <option timestep=\"{STEP_S}\" cone=\"elliptic\" impratio=\"100\" gravity=\"0 0 -9.81\"/>\n\
         <default><geom contype=\"0\" conaffinity=\"0\"/></default>\n\
         <asset>\n{shapes}{}</asset>\n\
         <worldbody>\n{world}{body}</worldbody>\n\
         <contact>\n{pairs}</contact>\n\
         <actuator>\n{}</actuator>\n\
         <keyframe>\n{}</keyframe>\n\
         </mujoco>\n",
        visual_assets(robot, gripper),
        motors(robot, gripper),
        released(robot, setup.waiting_width_m(), &setup.release(seed, index)),
    )
}

fn surroundings(robot: &Robot) -> String {
    let obstacle = |(i, it): (usize, &catch_body::workcell::Obstacle)| match (it.as_cuboid(), it.as_capsule()) {
        (Some((X_WS, cuboid)), _) => box_geom(&format!("obstacle:{i}"), cuboid, X_WS, SEEN),
        (None, Some(capsule)) => capsule_geom(&format!("obstacle:{i}"), capsule, SEEN),
        (None, None) => String::new(),
    };
    robot.obstacles.iter().enumerate().map(obstacle).collect()
}

fn camera((i, it): (usize, &CameraModel)) -> String {
    // MuJoCo's cameras look along −z, with y up, and measure the principal point from the middle.
    let X_WC = it.X_WC * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let size = [it.width_px, it.height_px].map(f64::from);
    // A millimetre a pixel: only the ratio to the focal length counts.
    format!(
        "<camera name=\"camera:{i}\" {} resolution=\"{}\" sensorsize=\"{}\" focalpixel=\"{}\" principalpixel=\"{}\"/>\n",
        placed(&X_WC),
        numbers(size),
        numbers(size.map(|it| it / 1000.0)),
        numbers([it.focal_px; 2]),
        numbers([0, 1].map(|i| it.principal_px[i] - size[i] / 2.0)),
    )
}

/// The arm with its gripper. `drive_kg` is the inertia of the gripper's motor at each finger.
fn arm(robot: &Robot, gripper: &Gripper, drive_kg: f64) -> String {
    let shape_of = |link: usize| {
        let is_seen = robot.visuals.contains_key(&link);
        let group = if is_seen { COLLIDES } else { SEEN };
        let capsules = robot.capsules.iter().filter(|(of, _)| *of == link).enumerate();
        let capsules: String =
            capsules.map(|(i, (_, it))| capsule_geom(&format!("arm:{link}:{i}"), it, group)).collect();
        capsules + &if is_seen { mesh_geom(&format!("link{link}"), &Pose::identity()) } else { String::new() }
    };
    let mut text = format!("<body name=\"arm/base\" {}>\n{}", placed(&robot.X_WB), shape_of(0));
    for (i, joint) in robot.joints.iter().enumerate() {
        let _ = write!(
            text,
            "<body name=\"arm/{}\" {}>\n<joint name=\"arm/{}\" axis=\"{}\" range=\"{}\" damping=\"{}\" armature=\"{}\"/>\n{}{}",
            text_in_html(&joint.link_name),
            placed(&joint.X_PL),
            text_in_html(&joint.name),
            numbers(<[f64; 3]>::from(joint.axis.into_inner())),
            numbers([joint.limits.lower, joint.limits.upper]),
            joint.damping,
            joint.rotor_inertia,
            inertial(&joint.inertia),
            shape_of(i + 1),
        );
    }
    // Axes of G: the fingers close along x, y is the approach.
    let group = if gripper.visuals.is_some() { COLLIDES } else { SEEN };
    let seen = |name: &str, X: &Pose| gripper.visuals.as_ref().map_or(String::new(), |_| mesh_geom(name, X));
    let housing = box_geom("palm:0", &gripper.body(), &Pose::identity(), group) + &seen("housing", &Pose::identity());
    let _ =
        write!(text, "<body name=\"gripper\" {}>\n{}{housing}", placed(&robot.X_LG), inertial(&gripper.body_inertia()));
    let fingers = gripper.fingers(0.0).into_iter().zip(gripper.finger_inertias(0.0)).zip(gripper.finger_poses(0.0));
    for ((name, side), ((shape, inertia), X_GF)) in [("left", -1), ("right", 1)].into_iter().zip(fingers) {
        let _ = write!(
            text,
            "<body name=\"{name}\">\n<joint name=\"{name}\" type=\"slide\" axis=\"{side} 0 0\" range=\"{}\" armature=\"{drive_kg}\"/>\n{}{}{}</body>\n",
            numbers([0.0, gripper.max_width_m / 2.0]),
            inertial(&inertia),
            box_geom(&format!("{name}:0"), &shape, &Pose::identity(), group),
            seen("finger", &X_GF),
        );
    }
    text + &"</body>".repeat(robot.dof() + 2) + "\n"
}

/// The object's meshes and its body.
fn thrown(object: &ThrownObject) -> (String, String) {
    let of = |points: &[Point3<f64>]| numbers(points.iter().flat_map(|it| <[f64; 3]>::from(it.coords)));
    let mut meshes = surface_asset("surface", &object.mesh);
    let inertia = Inertia { mass: object.mass_kg, com: object.com_O, about_com: object.inertia_kgm2 };
    let mut body = format!(
        "<body name=\"object\">\n<freejoint name=\"object\"/>\n{}<geom name=\"surface\" type=\"mesh\" mesh=\"surface\" group=\"1\"/>\n",
        inertial(&inertia),
    );
    for (i, part) in object.parts.iter().enumerate() {
        let shape = match part {
            ColliderPart::Ball { centre, radius_m } => format!("size=\"{radius_m}\" pos=\"{}\"", of(&[*centre])),
            ColliderPart::Hull(points) => {
                let _ = writeln!(meshes, "<mesh name=\"part{i}\" vertex=\"{}\"/>", of(points));
                format!("type=\"mesh\" mesh=\"part{i}\"")
            }
        };
        let _ = writeln!(body, "<geom name=\"object:{i}\" group=\"3\" {shape}/>");
    }
    (meshes, body + "</body>\n")
}

/// Contacts of the object in a throw: as stiff as its surface, and with the patch of a finger that presses
/// with all of its force.
fn contact_attributes(setup: &Setup, conditions: &Conditions, drive_kg: f64) -> String {
    let Setup { object, gripper, .. } = setup;
    let finger_kg = gripper.finger_mass_kg + drive_kg;
    let reduced_kg = object.mass_kg * finger_kg / (object.mass_kg + finger_kg);
    // Of a spring in an impact, for each kilogram.
    let (stiffness, impedance) = match object.stiffness_npm {
        Some(it) => (it / reduced_kg * (1.0 - SOFT_IMPEDANCE), SOFT_IMPEDANCE),
        None => (f64::INFINITY, HARD_IMPEDANCE),
    };
    let rate_per_s = stiffness.sqrt().min(MOST_PER_S);
    let friction = conditions.friction.max(1e-5);
    let torsion_m =
        object.spin_friction_nm(friction, gripper.max_force_n, object.mesh.aabb().size.min()) / gripper.max_force_n;
    // Neither restitution nor softness may weaken the friction: it has a time constant of its own, and
    // `impratio`.
    format!(
        "condim=\"4\" friction=\"{}\" solref=\"{}\" solreffriction=\"0.0035 1\" solimp=\"{}\"",
        numbers([friction, friction, torsion_m, 1e-4, 1e-4]),
        numbers([-rate_per_s * rate_per_s, -damping_per_s(conditions.restitution, rate_per_s)]),
        numbers([impedance, impedance, 0.001, 0.5, 2.0]),
    )
}

/// Damping of a contact with this restitution, for each kilogram, by bisection.
fn damping_per_s(restitution: f64, rate_per_s: f64) -> f64 {
    let [mut low, mut high] = [0.0, 2.0 * rate_per_s];
    for _ in 0..20 {
        let middle = f64::midpoint(low, high);
        [low, high] = if rebound(middle, rate_per_s) > restitution { [middle, high] } else { [low, middle] };
    }
    high
}

/// Fraction of its speed with which an object leaves a contact of MuJoCo, whose spring and damper push and
/// never pull: the mean over the instants of a step at which it may begin.
fn rebound(damping_per_s: f64, rate_per_s: f64) -> f64 {
    const INSTANTS: u32 = 16;
    let begun_at = |instant: u32| {
        let (mut gap, mut speed) = (-STEP_S * (f64::from(instant) + 0.5) / f64::from(INSTANTS), -1.0);
        while gap < 0.0 {
            speed += (-rate_per_s * rate_per_s * gap - damping_per_s * speed).max(0.0) * STEP_S;
            gap += speed * STEP_S;
        }
        speed
    };
    (0..INSTANTS).map(begun_at).sum::<f64>() / f64::from(INSTANTS)
}

fn motors(robot: &Robot, gripper: &Gripper) -> String {
    let joints = robot.joints.iter().map(|it| (format!("arm/{}", text_in_html(&it.name)), it.limits.torque));
    let fingers = ["left", "right"].map(|it| (it.to_owned(), gripper.max_force_n));
    let motor = |(name, most): (String, f64)| {
        format!("<motor name=\"{name}\" joint=\"{name}\" ctrlrange=\"{}\"/>\n", numbers([-most, most]))
    };
    joints.chain(fingers).map(motor).collect()
}

/// The arm waits with its fingers `width_m` apart, and the object leaves the thrower's hand.
fn released(robot: &Robot, width_m: f64, release: &Release) -> String {
    let object = release.p_WO.coords.iter().copied().chain(real_first(&release.q_WO));
    let fingers = [width_m / 2.0; 2];
    let qpos = robot.ready_q.iter().copied().take(robot.dof()).chain(fingers).chain(object);
    // The angular velocity of a free body is in its own axes.
    let spin = release.q_WO.inverse() * release.omega_WO;
    let still = std::iter::repeat_n(0.0, robot.dof() + 2);
    let qvel = still.chain(release.v_WO.iter().copied()).chain(spin.iter().copied());
    format!("<key name=\"released\" qpos=\"{}\" qvel=\"{}\"/>\n", numbers(qpos), numbers(qvel))
}

fn inertial(of: &Inertia) -> String {
    let I = &of.about_com;
    let moments = [I[(0, 0)], I[(1, 1)], I[(2, 2)], I[(0, 1)], I[(0, 2)], I[(1, 2)]];
    let com = numbers(<[f64; 3]>::from(of.com.coords));
    format!("<inertial mass=\"{}\" pos=\"{com}\" fullinertia=\"{}\"/>\n", of.mass, numbers(moments))
}

/// A surface that cameras see and nothing touches, of the asset called `mesh`.
fn mesh_geom(mesh: &str, X: &Pose) -> String {
    format!("<geom type=\"mesh\" mesh=\"{mesh}\" group=\"{SEEN}\" {}/>\n", placed(X))
}

/// Assets of the surfaces that cameras see of the arm and its gripper in place of capsules and boxes.
fn visual_assets(robot: &Robot, gripper: &Gripper) -> String {
    let links = robot.visuals.iter().filter_map(|(link, it)| Some((format!("link{link}"), it.mesh()?.clone())));
    let parts = gripper.visuals.iter().flat_map(|_| ["housing", "finger"].into_iter().zip(gripper.surfaces()));
    let all = links.chain(parts.map(|(name, mesh)| (name.to_owned(), mesh)));
    all.map(|(name, mesh)| surface_asset(&name, &mesh)).collect()
}

/// A surface as an asset; it may be open.
fn surface_asset(name: &str, mesh: &TriangleMesh) -> String {
    let faces: Vec<String> = mesh.triangles.iter().flatten().map(u32::to_string).collect();
    let vertices = numbers(mesh.vertices.iter().flat_map(|it| <[f64; 3]>::from(it.coords)));
    format!("<mesh name=\"{name}\" inertia=\"shell\" vertex=\"{vertices}\" face=\"{}\"/>\n", faces.join(" "))
}

fn box_geom(name: &str, of: &Cuboid, X: &Pose, group: u32) -> String {
    let place = placed(&(X * Translation3::from(of.centre.coords)));
    let size = numbers(<[f64; 3]>::from(of.size / 2.0));
    format!("<geom name=\"{name}\" type=\"box\" size=\"{size}\" group=\"{group}\" {place}/>\n")
}

/// A capsule; one without length is a ball.
fn capsule_geom(name: &str, of: &Capsule, group: u32) -> String {
    let [from, to] = [of.from, of.to].map(|end| numbers(<[f64; 3]>::from(end.coords)));
    let shape = if of.from == of.to {
        format!("type=\"sphere\" pos=\"{from}\"")
    } else {
        format!("type=\"capsule\" fromto=\"{from} {to}\"")
    };
    format!("<geom name=\"{name}\" size=\"{}\" group=\"{group}\" {shape}/>\n", of.radius)
}

fn placed(X: &Pose) -> String {
    let position = numbers(<[f64; 3]>::from(X.translation.vector));
    format!("pos=\"{position}\" quat=\"{}\"", numbers(real_first(&X.rotation)))
}

fn real_first(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    let texts: Vec<String> = values.into_iter().map(|it| it.to_string()).collect();
    texts.join(" ")
}
