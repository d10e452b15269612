//! Built-in arms beside the descriptions that their makers publish: capsules that enclose the links, and
//! surfaces below the capsules.

use std::{env, fmt::Write, fs, path::Path};

use catch_body::{Pose, Robot, TriangleMesh, ray_cast::RayCaster, shape::Capsule};
use catch_lab::scenario::setup::{Choice, Setup};
use nalgebra::Point3;

use crate::{catchingbot, stderr};

/// Built-in arms.
const ARMS: [&str; 7] = ["fr3", "iiwa14", "iiwa7", "panda", "ur10e", "ur5e", "xarm7"];
/// The distance by which a point may be outside of its link's capsules.
const MOST_OUTSIDE_MM: f64 = 1.0;
/// Distance of points from a link's surface: median and 95 %.
const MOST_OFF_MM: [f64; 2] = [3.0, 8.0];
/// Points of a link that are compared.
const POINTS: usize = 2_000;
/// Distance between rings of depths in metres, as long as there are no more than a file may have.
const SPACING_M: f64 = 0.010;
/// Columns of depths around a capsule.
const COLUMNS: usize = 32;

/// An arm and, by link, what its maker publishes of it: the pose of the maker's frame, capsules, the mesh.
struct Pair {
    ours: Robot,
    theirs: Robot,
    X_OT: Vec<Pose>,
}

fn robot(name: &str) -> Setup {
    Setup::load(&Choice { robot: Some(name), ..Choice::default() }).unwrap()
}

impl Pair {
    fn new(public: &Path, name: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let urdf = public.join(format!("{name}.urdf"));
        let out = folder.path().join("arm").to_str().unwrap().to_owned();
        let output = catchingbot(&["robot", "import", urdf.to_str().unwrap(), "--out", &out, "--no-ready"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let [theirs, ours] = [&out, name].map(|it| robot(it).robot);
        // The same rotations of all joints move both; frames of links differ, and where a base faces.
        let frames = |robot: &Robot, q: f64| robot.link_poses(&robot.joint_vector(&vec![q; robot.dof()]).unwrap());
        let half_turn = Pose::rotation(nalgebra::Vector3::z() * std::f64::consts::PI);
        let found = [Pose::identity(), half_turn].into_iter().find_map(|X_WT| {
            let between = |q: f64| -> Vec<Pose> {
                let [ours, theirs] = [frames(&ours, q), frames(&theirs, q)];
                ours.iter().zip(&theirs).map(|(ours, theirs)| ours.inverse() * X_WT * theirs).collect()
            };
            let (one, other) = (between(0.3), between(-0.4));
            let is_same = |(one, other): (&Pose, &Pose)| {
                (one.translation.vector - other.translation.vector).norm() < 2e-3
                    && one.rotation.angle_to(&other.rotation) < 2e-3
            };
            one.iter().zip(&other).all(is_same).then_some(one)
        });
        let X_OT = found.unwrap_or_else(|| panic!("{name}: other kinematics than its maker's"));
        Self { ours, theirs, X_OT }
    }

    /// The maker's mesh of a link, in the frame of the built-in one.
    fn mesh(&self, link: usize) -> TriangleMesh {
        let visual = self.theirs.visuals.get(&link).unwrap_or_else(|| panic!("no mesh of link {link}"));
        (*visual.surface).clone().transformed(&self.X_OT[link])
    }

    /// `[[collision.capsules]]` of a robot's file: the importer's capsules in the frames of the built-in arm.
    fn capsules(&self) -> String {
        let mut text = String::new();
        for link in 0..=self.ours.dof() {
            let name = if link == 0 { &self.ours.base_link } else { &self.ours.joints[link - 1].link_name };
            let caster = RayCaster::new(&self.mesh(link));
            for (_, capsule) in self.theirs.capsules.iter().filter(|(of, _)| *of == link) {
                let moved = capsule.transformed(&self.X_OT[link]);
                let round = |point: Point3<f64>| point.map(|it| (it * 1e4).round() / 1e4 + 0.0);
                let (from, to) = (round(moved.from), round(moved.to));
                let shift = (from - moved.from).norm().max((to - moved.to).norm());
                let capsule = Capsule { from, to, radius: ((moved.radius + shift) * 1e4).ceil() / 1e4 };
                let [from, to] = [from, to].map(|it| format!("{:?}", <[f64; 3]>::from(it)));
                let radius = capsule.radius;
                writeln!(text, "\n[[collision.capsules]]\nlink = \"{name}\"\nfrom_m = {from}\nto_m = {to}").unwrap();
                writeln!(text, "radius_m = {radius}\ndepths_mm = [").unwrap();
                depths_mm(&capsule, &caster).iter().for_each(|ring| writeln!(text, "    {ring:?},").unwrap());
                writeln!(text, "]").unwrap();
            }
        }
        text
    }
}

/// Depths of a mesh below a capsule in whole millimetres.
fn depths_mm(capsule: &Capsule, mesh: &RayCaster) -> Vec<Vec<u32>> {
    let way = (capsule.to - capsule.from).norm() + std::f64::consts::PI * capsule.radius;
    let rings = ((way / SPACING_M).ceil() as usize).clamp(12, 47);
    let most = capsule.radius * 1e3 - 1.0;
    let X_LC = capsule.frame();
    let depth = |i: usize, k: usize| {
        let (axis, outwards) = capsule.surface_point([i as f64 / rings as f64, k as f64 / COLUMNS as f64]);
        let (from, inwards) = (X_LC * (axis + outwards * (capsule.radius + 2e-3)), X_LC * -outwards);
        let found = mesh.cast(&from, &inwards).map_or(most, |it| it * 1e3 - 2.0);
        found.clamp(0.0, most).round() as u32
    };
    let ring = |i: usize| {
        let count = if i == 0 || i == rings { 1 } else { COLUMNS };
        (0..count).map(|k| depth(i, k)).collect()
    };
    (0..=rings).map(ring).collect()
}

/// Distances of a link's points from its capsules and from its surface, in millimetres and in order.
fn distances_mm(pair: &Pair, link: usize) -> [Vec<f64>; 2] {
    let points = spread(&pair.mesh(link));
    let capsules: Vec<_> = pair.ours.capsules.iter().filter(|(of, _)| *of == link).collect();
    let surface = pair.ours.link_surface(link, 48);
    let outside = |point: &Point3<f64>| {
        capsules.iter().map(|(_, it)| it.distance_to_point(point) * 1e3).fold(f64::INFINITY, f64::min)
    };
    let off = |point: &Point3<f64>| {
        surface.all_corners().map(|it| to_triangle(point, &it) * 1e3).fold(f64::INFINITY, f64::min)
    };
    let mut both = [points.iter().map(outside).collect::<Vec<_>>(), points.iter().map(off).collect()];
    both.iter_mut().for_each(|it| it.sort_by(f64::total_cmp));
    both
}

/// Points of a surface, spread evenly over its area.
fn spread(mesh: &TriangleMesh) -> Vec<Point3<f64>> {
    let area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
    let each = mesh.all_corners().map(area).sum::<f64>() / POINTS as f64;
    let (mut sum, mut points) = (0.0, Vec::new());
    for corners @ [a, b, c] in mesh.all_corners() {
        sum += area(corners);
        while sum > points.len() as f64 * each {
            // Corners of the golden ratio's lattice, folded into the triangle.
            let [u, v] = [0.754_877_666, 0.569_840_291].map(|it| (points.len() as f64 * it).fract());
            let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
            points.push(a + (b - a) * u + (c - a) * v);
        }
    }
    points
}

/// Distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
fn to_triangle(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> f64 {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let normal = ab.cross(&ac);
    let side = |from: &Point3<f64>, along: nalgebra::Vector3<f64>| normal.cross(&along).dot(&(p - from));
    if side(a, ab) >= 0.0 && side(b, bc) >= 0.0 && side(c, -ac) >= 0.0 && normal.norm_squared() > 0.0 {
        return (p - a).dot(&normal.normalize()).abs();
    }
    let edge =
        |from: &Point3<f64>, to: &Point3<f64>| Capsule { from: *from, to: *to, radius: 0.0 }.distance_to_point(p);
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

/// `PUBLIC_ARMS` names a folder with NAME.urdf of each arm and its packages, as CONTRIBUTING.md says. With
/// `UPDATE=1` the capsules of the built-in arms are written anew.
#[test]
#[ignore = "needs descriptions that are not part of the project: PUBLIC_ARMS=DIR"]
fn built_in_arms_are_those_of_their_makers() {
    let public = env::var("PUBLIC_ARMS").expect("PUBLIC_ARMS names no folder");
    let mut faults = String::new();
    for name in ARMS {
        let pair = Pair::new(Path::new(&public), name);
        if env::var("UPDATE").is_ok() {
            let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/robots/{name}/robot.toml"));
            let text = fs::read_to_string(&file).unwrap();
            let (before, _) = text.split_once("\n[[collision.capsules]]").unwrap();
            fs::write(&file, before.to_owned() + &pair.capsules()).unwrap();
            continue;
        }
        for link in 0..=pair.ours.dof() {
            let [outside, off] = distances_mm(&pair, link);
            let [most, median, late] = [outside[outside.len() - 1], off[off.len() / 2], off[off.len() * 95 / 100]];
            if most > MOST_OUTSIDE_MM || median > MOST_OFF_MM[0] || late > MOST_OFF_MM[1] {
                writeln!(faults, "{name} {link}: {most:.1} mm outside, off {median:.1} and {late:.1} mm").unwrap();
            }
        }
    }
    assert!(faults.is_empty(), "\n{faults}");
}
