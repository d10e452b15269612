//! Random descriptions of the whole of URDF, as Pinocchio and yourdfpy read them: poses, masses, limits and
//! shapes.
//!
//! Each is made from a seed. What the others read of the first 200 is kept in `descriptions.json`, which
//! `UPDATE=1 cargo test --release -p catch_cli --test it descriptions` writes anew where both can be had; as
//! many as one likes are compared by
//!
//! ```sh
//! CATCHINGBOT_DESCRIPTIONS=10000 cargo test --release -p catch_cli --test it descriptions -- --ignored
//! ```

use std::{env, fs, path::Path};

use catch_body::{Pose, robot::Inertia};
use catch_import::description::{Description, JointKind, Shape};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_pcg::Pcg64;

use super::python;

/// Descriptions of which the numbers are kept.
const KEPT: u64 = 200;
/// Numbers are kept with six decimals, of sums with weights up to some hundred.
const TOLERANCE: f64 = 2e-5;
/// A point in the frame of each link and each shape, which shows where the frame is.
const POINT: Point3<f64> = Point3::new(0.1, 0.2, 0.3);

/// Script that prints the numbers that Pinocchio and yourdfpy read, as [`numbers`] has them.
const SCRIPT: &str = r#"
import io, json, math, sys
import numpy, pinocchio, yourdfpy
POINT = numpy.array([0.1, 0.2, 0.3])
number = lambda name: int(name[1:])
def read(text):
    model = pinocchio.buildModelFromXML(text)
    data, q = model.createData(), pinocchio.neutral(model)
    limits = numpy.zeros(4)
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:]):
        at = 0.5 * math.sin(number(name) + 1)
        q[joint.idx_q:joint.idx_q + joint.nq] = [at] if joint.nq == 1 else [math.cos(at), math.sin(at)]
        ends = [model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]] if joint.nq == 1 else [0, 0]
        limits += (number(name) + 1) * numpy.array(ends + [model.velocityLimit[joint.idx_v], model.effortLimit[joint.idx_v]])
    pinocchio.forwardKinematics(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    points = numpy.zeros(3)
    for i, frame in enumerate(model.frames):
        if frame.type == pinocchio.FrameType.BODY and frame.name != "universe":
            points += (number(frame.name) + 1) * data.oMf[i].act(POINT)
    whole = pinocchio.Inertia.Zero()
    for i in range(model.njoints):
        if model.inertias[i].mass > 0:
            whole = whole + data.oMi[i].act(model.inertias[i])
    robot = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False, build_scene_graph=False).robot
    shapes = numpy.zeros(6)
    for link in robot.links:
        for weight, it in enumerate(link.visuals + link.collisions, 1):
            origin = numpy.eye(4) if it.origin is None else it.origin
            shape = it.geometry
            size = (list(shape.box.size) if shape.box is not None else
                    [shape.cylinder.radius, shape.cylinder.length, 0] if shape.cylinder is not None else [shape.sphere.radius, 0, 0])
            shapes += (number(link.name) + 1) * weight * numpy.concatenate([origin[:3, :3] @ POINT + origin[:3, 3], size])
    moments = whole.inertia[numpy.triu_indices(3)]
    return [round(float(it), 6) for it in [*points, whole.mass, *whole.lever, *moments, *limits, *shapes]]
print("[" + ",\n".join(json.dumps(read(text)) for text in json.load(sys.stdin)) + "]")
"#;

/// A description from its seed.
fn text(seed: u64) -> String {
    let mut rng = Pcg64::seed_from_u64(seed);
    let number = |rng: &mut Pcg64, least: f64, most: f64| {
        let value: f64 = rng.random_range(least..most);
        match rng.random_range(0..3) {
            0 => format!("{value:.3}"),
            1 => format!("{value:.4e}"),
            _ => format!("{value:.2}"),
        }
    };
    let vector = |rng: &mut Pcg64, most: f64| {
        // urdfdom parts at blanks alone.
        let gap = [" ", "  "][rng.random_range(0..2)];
        [(); 3].map(|()| number(rng, -most, most)).join(gap)
    };
    let origin = |rng: &mut Pcg64| match rng.random_range(0..4) {
        0 => String::new(),
        1 => format!("<origin xyz=\"{}\"/>", vector(rng, 1.0)),
        2 => format!("<origin rpy=\"{}\"/>", vector(rng, 3.0)),
        _ => format!("<origin rpy='{}' xyz='{}'/>", vector(rng, 3.0), vector(rng, 1.0)),
    };
    let noise = |rng: &mut Pcg64| ["", "", "<!-- <limit lower=\"9\"/> ${x} -->", "\n\t"][rng.random_range(0..4)];
    let shape = |rng: &mut Pcg64, kind: &str| {
        let size = |rng: &mut Pcg64| number(rng, 0.01, 1.0);
        let geometry = match rng.random_range(0..3) {
            0 => format!("<box size=\"{} {} {}\"/>", size(rng), size(rng), size(rng)),
            1 => format!("<cylinder length=\"{}\" radius=\"{}\"/>", size(rng), size(rng)),
            _ => format!("<sphere radius=\"{}\"></sphere>", size(rng)),
        };
        let material = if kind == "visual" { "<material name=\"m\"><color rgba=\"1 0 0 1\"/></material>" } else { "" };
        format!("<{kind}>{}<geometry>{geometry}</geometry>{}{material}</{kind}>", origin(rng), noise(rng))
    };
    let links = rng.random_range(2..9_usize);
    let mut parts = Vec::new();
    for i in 0..links {
        let mut inside = Vec::new();
        if rng.random_bool(0.7) {
            // Moments of a box, so that some body has them.
            let mass = number(&mut rng, 0.1, 5.0);
            let [a, b, c] = [(); 3].map(|()| rng.random_range(0.01..0.2));
            inside.push(format!(
                "<inertial>{}<mass value=\"{mass}\"/><inertia ixx=\"{:.5}\" ixy=\"0\" ixz=\"0\" iyy=\"{:.5}\" iyz=\"0\" izz=\"{:.5}\"/></inertial>",
                origin(&mut rng), b + c, a + c, a + b
            ));
        }
        for kind in ["visual", "collision"] {
            let shapes: Vec<String> = (0..rng.random_range(0..3)).map(|_| shape(&mut rng, kind)).collect();
            inside.extend(shapes);
        }
        parts.push(format!("<link name=\"l{i}\">{}{}</link>", noise(&mut rng), inside.concat()));
    }
    for i in 1..links {
        let parent = rng.random_range(0..i);
        let kind = ["fixed", "revolute", "continuous", "prismatic"][rng.random_range(0..4)];
        let mut inside =
            vec![format!("<parent link=\"l{parent}\"/>"), format!("<child link=\"l{i}\"/>"), origin(&mut rng)];
        if kind != "fixed" && rng.random_bool(0.8) {
            inside.push(format!(
                "<axis xyz=\"{} {} {}\"/>",
                number(&mut rng, 0.2, 2.0),
                number(&mut rng, -2.0, 2.0),
                number(&mut rng, -2.0, 2.0)
            ));
        }
        let ends = [
            (rng.random_bool(0.8)).then(|| format!(" lower=\"{}\"", number(&mut rng, -3.0, -0.1))),
            (rng.random_bool(0.8)).then(|| format!(" upper=\"{}\"", number(&mut rng, 0.1, 3.0))),
        ];
        let ends = if kind == "continuous" { String::new() } else { ends.into_iter().flatten().collect() };
        if kind != "fixed" {
            inside.push(format!(
                "<limit{ends} velocity=\"{}\" effort=\"{}\"/>",
                number(&mut rng, 0.1, 9.0),
                number(&mut rng, 1.0, 99.0)
            ));
        }
        inside.shuffle(&mut rng);
        parts.push(format!("<joint type=\"{kind}\" name=\"j{i}\">{}{}</joint>", noise(&mut rng), inside.concat()));
    }
    parts.push("<gazebo reference=\"l0\"><gravity>1</gravity></gazebo>".to_owned());
    parts.shuffle(&mut rng);
    format!("<?xml version=\"1.0\"?>\n<robot name=\"r{seed}\">\n{}\n</robot>\n", parts.join("\n"))
}

/// Sums over all links, joints and shapes, each weighted by its number: the point in the frame of each link;
/// mass, centre of mass and moments of all; ends of the range, speed and effort of each joint; the point in
/// the frame of each shape, and its size.
fn numbers(text: &str) -> Vec<f64> {
    let description = Description::from_urdf("a.urdf", text).unwrap_or_else(|fault| panic!("{fault}\n{text}"));
    let number = |name: &str| name[1..].parse::<f64>().unwrap() + 1.0;
    let (mut points, mut limits, mut shapes) = (Vector3::zeros(), [0.0; 4], [0.0; 6]);
    let mut whole: Option<Inertia> = None;
    let mut waiting = vec![(description.root.clone(), Pose::identity())];
    while let Some((name, X_WL)) = waiting.pop() {
        let link = &description.links[&name];
        points += number(&name) * (X_WL * POINT).coords;
        if let Some(inertia) = link.inertia.map(|it| it.transformed(&X_WL)) {
            whole = Some(whole.map_or(inertia, |whole| whole.joined(&inertia)));
        }
        for (i, it) in link.visuals.iter().chain(&link.collisions).enumerate() {
            let size = match it.shape {
                Shape::Cuboid(size) => size,
                Shape::Cylinder { radius_m, length_m } => Vector3::new(radius_m, length_m, 0.0),
                Shape::Sphere(radius_m) => Vector3::new(radius_m, 0.0, 0.0),
                ref other => panic!("{other:?}"),
            };
            let weight = number(&name) * (i as f64 + 1.0);
            let of_shape = (it.X_LS * POINT).coords.iter().chain(size.iter()).map(|it| weight * it).collect::<Vec<_>>();
            shapes.iter_mut().zip(of_shape).for_each(|(sum, it)| *sum += it);
        }
        for joint in description.joints_of(&name) {
            let at = 0.5 * libm::sin(number(&joint.name));
            let motion = match joint.kind {
                JointKind::Revolute => {
                    Pose::from_parts(Default::default(), UnitQuaternion::from_axis_angle(&joint.axis, at))
                }
                JointKind::Prismatic => Translation3::from(joint.axis.into_inner() * at).into(),
                _ => Pose::identity(),
            };
            if joint.kind != JointKind::Fixed {
                let its = &joint.limits;
                let [lower, upper] = [its.lower, its.upper].map(Option::unwrap_or_default);
                let stated = [lower, upper, its.velocity.unwrap(), its.effort.unwrap()];
                limits.iter_mut().zip(stated).for_each(|(sum, it)| *sum += number(&joint.name) * it);
            }
            let X_WP = X_WL;
            waiting.push((joint.child.clone(), X_WP * joint.X_PL * motion));
        }
    }
    let whole = whole.map_or([0.0; 10], |Inertia { mass, com, about_com: it }| {
        [mass, com.x, com.y, com.z, it.m11, it.m12, it.m13, it.m22, it.m23, it.m33]
    });
    points.iter().copied().chain(whole).chain(limits).chain(shapes).collect()
}

fn compared(expected: &[Vec<f64>]) {
    for (seed, expected) in expected.iter().enumerate() {
        let text = text(seed as u64);
        let found = numbers(&text);
        assert_eq!(found.len(), expected.len());
        let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
        assert!(off < TOLERANCE, "seed {seed}: {found:?} instead of {expected:?}\n{text}");
    }
}

/// Returns the numbers that the other programs read of the first descriptions; `None` where they cannot be
/// had.
fn read_by_others(count: u64) -> Option<String> {
    let texts: Vec<String> = (0..count).map(text).collect();
    python("pin yourdfpy", SCRIPT, &serde_json::to_string(&texts).unwrap())
}

#[test]
fn descriptions_are_read_as_others_read_them() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/other_readers/descriptions.json");
    if env::var_os("UPDATE").is_some()
        && let Some(read) = read_by_others(KEPT)
    {
        fs::write(&path, read).unwrap();
    }
    let expected: Vec<Vec<f64>> = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(expected.len() as u64, KEPT);
    compared(&expected);
}

#[test]
#[ignore = "takes as long as one likes"]
fn as_many_descriptions_as_one_likes() {
    let count = env::var("CATCHINGBOT_DESCRIPTIONS").ok().and_then(|it| it.parse().ok()).unwrap_or(1000);
    let Some(read) = read_by_others(count) else { return };
    compared(&serde_json::from_str::<Vec<Vec<f64>>>(&read).unwrap());
}
