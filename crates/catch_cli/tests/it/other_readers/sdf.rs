//! Random descriptions of the whole of SDF, as Drake reads them: masses, frictions, and poses and sizes of
//! shapes, all in the frames of their links.
//!
//! Links are placed, framed, jointed and nested in every manner, which must change nothing. A third has
//! something that is not read, and must be refused with its name. What Drake reads of the first 400 is kept
//! in `sdf.json`, which `UPDATE=1 cargo test --release -p catch_cli --test it sdf` writes anew by
//! `sdf_in_drake.py` where Drake can be had; as many as one likes are compared by
//!
//! ```sh
//! CATCHINGBOT_DESCRIPTIONS=10000 cargo test --release -p catch_cli --test it as_many_sdf -- --ignored
//! ```

use std::{env, fs, path::Path};

use catch_body::robot::Inertia;
use catch_import::description::{Description, Shape};
use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_pcg::Pcg64;

use super::python;

/// Descriptions of which the numbers are kept.
const KEPT: u64 = 400;
/// Numbers are kept with six decimals, of sums with weights up to some hundred.
const TOLERANCE: f64 = 2e-5;
/// A point in the frame of each shape, which shows where the frame is.
const POINT: Point3<f64> = Point3::new(0.1, 0.2, 0.3);

/// Texts that make a description one that must be refused: what they replace, and what the error says.
const FAULTS: [(&str, &str, &str); 22] = [
    ("</geometry>", "<polyline/></geometry>", "found <polyline>"),
    ("</box>", "</box><sphere><radius>1</radius></sphere>", "found <sphere>"),
    ("<visual name=\"v0\">", "<visual name=\"v0\"><pose relative_to=\"f0\"/>", "relative_to=\"f0\""),
    ("<collision name=\"c0\">", "<collision name=\"c0\"><pose relative_to=\"__model__\"/>", "\"__model__\""),
    ("<collision name=\"c0\">", "<collision name=\"c0\"><pose frame=\"f0\"/>", "\"f0\""),
    ("degrees=\"true\"", "degrees=\"yes\"", "degrees=\"yes\""),
    ("rotation_format=\"euler_rpy\"", "rotation_format=\"axis\"", "rotation_format=\"axis\""),
    ("rotation_format=\"quat_xyzw\">", "rotation_format=\"quat_xyzw\">1 ", "7 numbers"),
    ("rotation_format=\"quat_xyzw\"", "rotation_format=\"quat_xyzw\" degrees=\"true\"", "degrees"),
    ("</link>", "<collision name=\"p\"><geometry><plane/></geometry></collision></link>", "plane"),
    ("<radius>", "<radius>-", "found `-"),
    ("<length>", "<length>inf ", "found `inf"),
    ("</uri>", "</uri><submesh><name>a</name></submesh>", "found <submesh>"),
    ("<link name=\"l0\">", "<include><uri>model://a</uri></include><link name=\"l0\">", "found <include>"),
    ("<link name=\"l0\">", "<link name=\"l0\"/><link name=\"l0\">", "the name twice"),
    ("</mass>", "</mass><fluid_added_mass/>", "found <fluid_added_mass>"),
    ("<mass>", "<mass>-", "found `-"),
    ("<inertial>", "<inertial><masss>1</masss>", "found <masss>"),
    ("auto=\"true\"", "auto=\"maybe\"", "auto=\"maybe\""),
    ("</model>", "<link name=\"k\"><inertial auto=\"1\"/></link></model>", "without collisions"),
    ("</mu2><mu>", "</mu2><mu>x", "found `x"),
    ("</sdf>", "<model name=\"k\"><link name=\"k\"/></model></sdf>", "2 models"),
];

/// A description in the making.
struct Writer {
    rng: Pcg64,
    /// True for versions of SDF without frames.
    is_old: bool,
}

impl Writer {
    fn one_of<'a>(&mut self, texts: &[&'a str]) -> &'a str {
        texts[self.rng.random_range(0..texts.len())]
    }

    fn number(&mut self, least: f64, most: f64) -> String {
        let value: f64 = self.rng.random_range(least..most);
        match self.rng.random_range(0..3) {
            0 => format!("{value:.3}"),
            1 => format!("{value:.4e}"),
            _ => format!("{value:.2}"),
        }
    }

    fn numbers(&mut self, count: usize, least: f64, most: f64) -> String {
        let gap = self.one_of(&[" ", "  ", "\n\t"]);
        (0..count).map(|_| self.number(least, most)).collect::<Vec<_>>().join(gap)
    }

    /// A comment that must not be read, or none.
    fn noise(&mut self) -> &'static str {
        self.one_of(&["", "", "", "<!-- 1 2 3 <k/> -->", "\n"])
    }

    /// A pose in the frame of a link, which it may name by `relative_to`.
    fn pose(&mut self, relative_to: &str) -> String {
        let (p, noise) = (self.numbers(3, -1.0, 1.0), self.noise());
        let is = self.one_of(&["true", "True", "TRUE", "1"]);
        let is_not = self.one_of(&["false", "False", "0"]);
        match self.rng.random_range(0..7) {
            0 => String::new(),
            1 => self.one_of(&["<pose/>", "<pose></pose>"]).to_owned(),
            2 => format!("<pose>{noise}{p} {}{noise}</pose>", self.numbers(3, -3.0, 3.0)),
            3 => format!("<pose degrees=\"{is}\">{p} {}{noise}</pose>", self.numbers(3, -180.0, 180.0)),
            4 => format!("<pose rotation_format=\"quat_xyzw\">{p} {}</pose>", self.numbers(4, 0.1, 1.5)),
            5 => {
                let rpy = self.numbers(3, -3.0, 3.0);
                format!("<pose{relative_to} rotation_format=\"euler_rpy\">{p} {rpy}</pose>")
            }
            _ => format!("<pose degrees=\"{is_not}\">{p} {}</pose>", self.numbers(3, -3.0, 3.0)),
        }
    }

    /// A pose of something that may be anywhere.
    fn placement(&mut self, relative_to: &[&str]) -> String {
        let numbers = self.numbers(6, -3.0, 3.0);
        match self.rng.random_range(0..3) {
            0 => String::new(),
            1 if !self.is_old => {
                format!("<pose relative_to=\"{}\">{numbers}</pose>", self.one_of(relative_to))
            }
            _ => format!("<pose>{numbers}</pose>"),
        }
    }

    fn shape(&mut self, kinds: u32) -> String {
        let (of, radius, length) = (self.numbers(3, 0.01, 1.0), self.number(0.01, 1.0), self.number(0.01, 1.0));
        let round = format!("<length>{length}</length><radius>{radius}</radius>");
        match self.rng.random_range(0..kinds) {
            0 => format!("<box><size>{of}</size></box>"),
            1 => format!("<cylinder>{round}</cylinder>"),
            2 => format!("<capsule>{round}</capsule>"),
            3 => format!("<sphere><radius>{radius}</radius></sphere>"),
            4 => format!("<ellipsoid><radii>{of}</radii></ellipsoid>"),
            _ => {
                let scale = self.one_of(&["", "<scale>1 1 1</scale>", "<scale>0.5 2 -0.25</scale>"]);
                let convex = self.one_of(&["", "<drake:declare_convex/>"]);
                format!("<mesh><uri>package://p/a.obj</uri>{scale}{convex}</mesh>")
            }
        }
    }

    fn visuals(&mut self, relative_to: &str) -> String {
        let visual = |writer: &mut Self, i| {
            let (pose, geometry) = (writer.pose(relative_to), format!("<geometry>{}</geometry>", writer.shape(6)));
            let material = writer.one_of(&["", "<material><diffuse>1 0 0 1</diffuse></material>"]);
            let mut parts = [pose.as_str(), &geometry, material];
            parts.shuffle(&mut writer.rng);
            format!("<visual name=\"v{i}\">{}</visual>", parts.concat())
        };
        let mut all: String = (0..self.rng.random_range(0..4)).map(|i| visual(self, i)).collect();
        // Nothing, and something without a volume.
        let flat = self.one_of(&["", "", "empty", "plane"]);
        if !flat.is_empty() {
            all += &format!("<visual name=\"v9\"><geometry><{flat}/></geometry></visual>");
        }
        all
    }

    /// `kinds` is the number of kinds of shapes, with each its density where `has_density`.
    fn collisions(&mut self, relative_to: &str, least: usize, kinds: u32, has_density: bool) -> String {
        let collision = |writer: &mut Self, i| {
            let (pose, geometry) = (writer.pose(relative_to), format!("<geometry>{}</geometry>", writer.shape(kinds)));
            let [mu, mu2] = [(); 2].map(|()| writer.number(0.1, 0.9));
            let friction = match writer.rng.random_range(0..4) {
                0 => {
                    format!("<surface><friction><ode><mu2>{mu}</mu2><mu>{mu}</mu></ode></friction><contact/></surface>")
                }
                1 => format!(
                    "<surface><friction><ode><mu>{mu}</mu></ode></friction></surface><drake:proximity_properties>\
                     <drake:mu_dynamic>{mu2}</drake:mu_dynamic></drake:proximity_properties>"
                ),
                _ => String::new(),
            };
            let density = match has_density && writer.rng.random_bool(0.5) {
                true => format!("<density>{}</density>", writer.number(10.0, 900.0)),
                false => String::new(),
            };
            let mut parts = [pose, geometry, friction, density];
            parts.shuffle(&mut writer.rng);
            format!("<collision name=\"c{i}\">{}</collision>", parts.concat())
        };
        (0..self.rng.random_range(least..3)).map(|i| collision(self, i)).collect()
    }

    /// Masses that are stated, moments of a turned box.
    fn inertial(&mut self) -> String {
        let mass = format!("<mass>{}{}</mass>", self.number(0.1, 5.0), self.noise());
        let [a, b, c] = [(); 3].map(|()| self.rng.random_range(0.01..0.2));
        let turn = UnitQuaternion::from_euler_angles(10.0 * a, 10.0 * b, 10.0 * c).to_rotation_matrix();
        let about_com = turn * Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * turn.inverse();
        let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
        let at = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        let moments = names.iter().zip(at).map(|(name, at)| format!("<{name}>{:.6}</{name}>", about_com[at]));
        let mut moments: Vec<String> = moments.collect();
        moments.shuffle(&mut self.rng);
        let inertia = match self.rng.random_range(0..5) {
            0 => String::new(),
            1 => "<inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz></inertia>".to_owned(),
            _ => format!("<inertia>{}</inertia>", moments.concat()),
        };
        let mut parts = [self.pose(""), mass, inertia];
        parts.shuffle(&mut self.rng);
        format!("<inertial>{}</inertial>", parts.concat())
    }

    /// Masses that are those of the collisions.
    fn auto_inertial(&mut self) -> String {
        let is = self.one_of(&["true", "True", "1"]);
        let [density, mass] = [self.number(10.0, 900.0), self.number(0.1, 5.0)];
        let density = [String::new(), format!("<density>{density}</density>")];
        let mass = [String::new(), format!("<mass>{mass}</mass>")];
        let pick = self.rng.random_range(0..4);
        format!("<inertial auto=\"{is}\">{}{}</inertial>", density[pick % 2], mass[pick / 2])
    }

    fn link(&mut self, name: &str) -> String {
        // Frames are where the first link is.
        let frames: &[&str] = if name == "l0" { &["__model__"] } else { &["f0", "f1", "__model__"] };
        let attribute = if self.is_old { "frame" } else { "relative_to" };
        let own = format!(" {attribute}=\"{}\"", self.one_of(&[name, ""]));
        let mut parts = vec![self.placement(frames), self.noise().to_owned(), self.visuals(&own)];
        match self.rng.random_range(0..4) {
            0 => parts.push(self.collisions(&own, 0, 6, true)),
            1 => parts.extend([self.collisions(&own, 1, 5, true), self.auto_inertial()]),
            _ => parts.extend([self.collisions(&own, 0, 6, true), self.inertial()]),
        }
        parts.push(self.one_of(&["", "<gravity>0</gravity>", "<kinematic>0</kinematic>"]).to_owned());
        parts.shuffle(&mut self.rng);
        format!("<link name=\"{name}\">{}</link>", parts.concat())
    }

    /// A joint of any kind, its limits one-sided, without end or left out.
    fn joint(&mut self, number: usize, parent: &str, child: &str) -> String {
        let kind = self.one_of(&["fixed", "revolute", "continuous", "prismatic", "ball", "universal", "screw"]);
        let limit = match self.rng.random_range(0..5) {
            0 => String::new(),
            1 => format!("<lower>{}</lower>", self.number(-3.0, -0.1)),
            2 => format!("<upper>{}</upper>", self.number(0.1, 3.0)),
            3 => "<lower>-inf</lower><upper>inf</upper>".to_owned(),
            _ => format!("<lower>-1</lower><upper>1</upper><effort>{}</effort>", self.number(1.0, 99.0)),
        };
        let limit = if kind == "continuous" { String::new() } else { format!("<limit>{limit}</limit>") };
        let expressed_in = if self.is_old { "" } else { self.one_of(&["", " expressed_in=\"f0\""]) };
        let axes: &[(&str, &str)] = match kind {
            "fixed" | "ball" => &[],
            "universal" => &[("axis", "1 0 0"), ("axis2", "0 1 0")],
            _ => &[("axis", "0.6 0 0.8")],
        };
        let axis = |(name, xyz): &(&str, &str)| format!("<{name}><xyz{expressed_in}>{xyz}</xyz>{limit}</{name}>");
        let axes: String = axes.iter().map(axis).collect();
        let pose = self.placement(&["f1", "__model__"]);
        format!(
            "<joint name=\"j{number}\" type=\"{kind}\"><parent>{parent}</parent><child>{child}</child>{pose}{axes}</joint>"
        )
    }

    fn sdf(&mut self, version: &str) -> String {
        let count = self.rng.random_range(1..6_usize);
        let mut parts = Vec::new();
        let mut names = vec!["l0".to_owned()];
        let mut inner = String::new();
        parts.push(self.link("l0"));
        for i in 1..count {
            let (name, is_inner) = (format!("l{i}"), !self.is_old && self.rng.random_bool(0.3));
            let link = self.link(&name);
            if is_inner {
                inner += &link.replace("\"f0\"", "\"__model__\"").replace("\"f1\"", "\"__model__\"");
            } else {
                parts.push(link);
            }
            names.push(if is_inner { format!("n::{name}") } else { name });
        }
        for (i, name) in names.iter().enumerate().skip(1) {
            let parent = ["world", &names[self.rng.random_range(0..i)]][self.rng.random_range(0..2)].to_owned();
            if self.rng.random_bool(0.7) {
                parts.push(self.joint(i, &parent, name));
            }
        }
        if !inner.is_empty() {
            parts.push(format!("<model name=\"n\">{}{inner}</model>", self.placement(&["f0", "l0"])));
        }
        let mut attributes = "";
        if !self.is_old {
            let placement = self.placement(&["l0", "f0"]);
            parts.push("<frame name=\"f0\" attached_to=\"l0\"><pose>1 2 3 0.1 0.2 0.3</pose></frame>".to_owned());
            parts.push(format!("<frame name=\"f1\">{placement}</frame>"));
            attributes = self.one_of(&["", " canonical_link=\"l0\"", " placement_frame=\"f0\""]);
        }
        parts.push(format!("<pose>{}</pose>", self.numbers(6, -3.0, 3.0)));
        parts.push(self.one_of(&["", "<self_collide>1</self_collide>"]).to_owned());
        if count == 1 {
            parts.push(self.one_of(&["", "<static>true</static>"]).to_owned());
        }
        parts.shuffle(&mut self.rng);
        let model = format!("<model name=\"m\"{attributes}>\n{}\n</model>", parts.join("\n"));
        let world = self.one_of(&["", "", "<world name=\"w\">"]);
        let end = if world.is_empty() { "" } else { "</world>" };
        let drake = self.one_of(&["", " xmlns:drake=\"http://drake.mit.edu\""]);
        format!("<?xml version=\"1.0\"?>\n<sdf version=\"{version}\"{drake}>{world}{model}{end}</sdf>\n")
    }
}

/// A description from its seed, and what is said of it if it must be refused.
fn text(seed: u64) -> (String, Option<&'static str>) {
    let mut writer = Writer { rng: Pcg64::seed_from_u64(seed), is_old: false };
    let version = writer.one_of(&["1.5", "1.6", "1.7", "1.8", "1.9", "1.10", "1.11"]);
    writer.is_old = matches!(version, "1.5" | "1.6");
    let text = writer.sdf(version);
    let (from, to, expected) = FAULTS[writer.rng.random_range(0..FAULTS.len())];
    if text.contains(from) && writer.rng.random_bool(0.4) {
        return (text.replacen(from, to, 1), Some(expected));
    }
    (text, None)
}

/// Sums over all links and shapes, each weighted by its number: mass, centre of mass, moments about it;
/// friction; the point in the frame of each visual, and its size; those of collisions.
fn numbers(description: &Description) -> Vec<f64> {
    let (mut of_mass, mut friction, mut shapes) = ([0.0; 10], 0.0, [[0.0; 6]; 2]);
    for (name, link) in &description.links {
        let weight = name.rsplit(":l").next().unwrap().trim_start_matches('l').parse::<f64>().unwrap() + 1.0;
        // Where nobody states them, the format has a mass of one and moments of one.
        let nothing = Inertia { mass: 1.0, com: Point3::origin(), about_com: Matrix3::zeros() };
        let Inertia { mass, com, about_com } = link.inertia.unwrap_or(nothing);
        let it = if about_com == Matrix3::zeros() { Matrix3::identity() } else { about_com };
        let stated = [mass, com.x, com.y, com.z, it.m11, it.m12, it.m13, it.m22, it.m23, it.m33];
        of_mass.iter_mut().zip(stated).for_each(|(sum, it)| *sum += weight * it);
        friction += weight * link.friction.unwrap_or(1.0);
        for (sums, geometries) in shapes.iter_mut().zip([&link.visuals, &link.collisions]) {
            for (i, it) in geometries.iter().enumerate() {
                let size = match it.shape {
                    Shape::Cuboid(size) | Shape::Ellipsoid(size) | Shape::Mesh { scale: size, .. } => size,
                    Shape::Cylinder { radius_m, length_m } | Shape::Capsule { radius_m, length_m } => {
                        Vector3::new(radius_m, length_m, 0.0)
                    }
                    Shape::Sphere(radius_m) => Vector3::new(radius_m, 0.0, 0.0),
                };
                let of_shape = (it.X_LS * POINT).coords.iter().chain(size.iter()).copied().collect::<Vec<_>>();
                sums.iter_mut().zip(of_shape).for_each(|(sum, it)| *sum += weight * (i as f64 + 1.0) * it);
            }
        }
    }
    of_mass.into_iter().chain([friction]).chain(shapes.into_iter().flatten()).collect()
}

/// Compares descriptions with what Drake reads of them, and returns how many were refused as they must be.
fn compared(read_by_drake: &[Option<Vec<f64>>]) -> usize {
    let mut refused = 0;
    for (seed, expected) in read_by_drake.iter().enumerate() {
        let (text, said) = text(seed as u64);
        let description = Description::from_sdf("a.sdf", &text);
        if let Some(said) = said {
            let fault = description.map(|_| ()).expect_err(&text).to_string();
            assert!(fault.contains(said), "seed {seed}: {fault} instead of {said}\n{text}");
            refused += 1;
            continue;
        }
        let found = numbers(&description.unwrap_or_else(|fault| panic!("seed {seed}: {fault}\n{text}")));
        let expected = expected.as_ref().unwrap_or_else(|| panic!("seed {seed}: Drake reads nothing\n{text}"));
        assert_eq!(found.len(), expected.len());
        let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
        assert!(off < TOLERANCE, "seed {seed}: {found:?} instead of {expected:?}\n{text}");
    }
    refused
}

/// Returns the numbers that Drake reads of the first descriptions; `None` where it cannot be had.
fn read_by_drake(count: u64) -> Option<String> {
    let readable = |seed| Some(text(seed)).filter(|(_, fault)| fault.is_none()).map(|(text, _)| text);
    let texts: Vec<Option<String>> = (0..count).map(readable).collect();
    python("drake", include_str!("sdf_in_drake.py"), &serde_json::to_string(&texts).unwrap())
}

#[test]
fn sdf_is_read_as_drake_reads_it() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/other_readers/sdf.json");
    if env::var_os("UPDATE").is_some()
        && let Some(read) = read_by_drake(KEPT)
    {
        fs::write(&path, read).unwrap();
    }
    let expected: Vec<Option<Vec<f64>>> = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    assert_eq!(expected.len() as u64, KEPT);
    let refused = compared(&expected) as u64;
    assert!((KEPT / 8..KEPT / 2).contains(&refused), "{refused} were refused");
}

#[test]
#[ignore = "takes as long as one likes, and needs Drake"]
fn as_many_sdf_files_as_one_likes() {
    let count = env::var("CATCHINGBOT_DESCRIPTIONS").ok().and_then(|it| it.parse().ok()).unwrap_or(1000);
    let Some(read) = read_by_drake(count) else { return };
    compared(&serde_json::from_str::<Vec<Option<Vec<f64>>>>(&read).unwrap());
}
