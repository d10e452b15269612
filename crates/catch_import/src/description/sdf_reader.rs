//! Reads the links of SDF files, as simulators describe objects.

use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::{Description, EXTENT_M, Geometry, Link, MESH_SCALE, Shape};
use catch_body::{
    InputError, Pose,
    document::{Document, Harmless, Node},
    quantity,
    quantity::Quantity,
    robot::Inertia,
    urdf,
};

/// Kind of file that is expected.
const EXPECTED: &str = "a model in the Simulation Description Format (SDF)";
/// Offsets in metres, and angles in radians or degrees.
const POSE: Quantity = Quantity { least: -1000.0, most: 1000.0, unit: "m or rad" };
/// Masses and moments of whatever a file describes.
const MASS_KG: Quantity = Quantity { least: 0.0, most: 1e9, unit: "kg" };
const MOMENT_KGM2: Quantity = Quantity { least: -1e9, most: 1e9, unit: "kg·m²" };
/// Densities that are stated, and the one that SDF means where none is.
const DENSITY_KGPM3: Quantity = Quantity { least: 0.0, most: 1e5, unit: "kg/m³" };
const WATER_KGPM3: f64 = 1000.0;

/// Names that only place, move, draw or sense; friction and bounce are found within `<surface>`.
const HARMLESS: Harmless = &[
    ("sdf", "@version light"),
    (
        "world",
        "@name physics scene light gravity magnetic_field atmosphere wind plugin gui audio \
         spherical_coordinates state road population joint frame",
    ),
    (
        "model",
        "static self_collide allow_auto_disable enable_wind pose joint frame plugin gripper @canonical_link \
         @placement_frame drake:joint drake:collision_filter_group",
    ),
    (
        "link",
        "gravity enable_wind self_collide kinematic must_be_base_link velocity_decay pose sensor light \
         audio_source audio_sink battery projector particle_emitter plugin",
    ),
    ("visual", "@name material cast_shadows laser_retro transparency visibility_flags meta plugin lod"),
    ("collision", "@name @concave laser_retro max_contacts surface"),
    ("mesh", "@optimization convex_decomposition drake:declare_convex"),
    (
        "*",
        "drake:proximity_properties drake:perception_properties drake:illustration_properties \
         drake:accepting_renderer",
    ),
];

impl Description {
    /// Reads the links of the model in an SDF file, each in its own frame, those of models within it as
    /// `model::link`. Joints, and where links stand, are not read.
    ///
    /// # Errors
    /// If it is no SDF, has not one model with a link, a number out of its range, or an element that is not
    /// known.
    pub fn from_sdf(file: &str, text: &str) -> Result<Self, InputError> {
        let document = Document::from_xml(file, text, EXPECTED)?;
        let fault = |found: String| InputError::new(file, "sdf", found, EXPECTED);
        let root = document.root();
        if root.name() != "sdf" {
            return Err(fault(format!("<{}>", root.name())));
        }
        let in_worlds = root.children("world").flat_map(|it| it.children("model"));
        let models: Vec<Node> = root.children("model").chain(in_worlds).collect();
        if models.len() > 1 {
            let names: Vec<&str> = models.iter().map(|it| it.attribute("name").unwrap_or_default()).collect();
            let found = format!("{} models: {}", models.len(), names.join(", "));
            return Err(InputError::new(file, "sdf", found, "a file with one of them"));
        }
        let mut description = Self { file: file.to_owned(), ..Self::default() };
        if let Some(model) = models.first() {
            description.name = model.attribute("name").unwrap_or_default().to_owned();
            description.add_model(*model, "")?;
        }
        document.finish(&[HARMLESS])?;
        match models[..] {
            [] => Err(fault("no <model>".into())),
            _ if description.links.is_empty() => Err(fault("no <link>".into())),
            _ => Ok(description),
        }
    }

    fn add_model(&mut self, model: Node, prefix: &str) -> Result<(), InputError> {
        for node in model.children("link") {
            let own = node.attribute("name").unwrap_or_default();
            let name = format!("{prefix}{own}");
            let link = link(node, own)?;
            if self.root.is_empty() {
                self.root.clone_from(&name);
            }
            if self.links.insert(name.clone(), link).is_some() {
                let field = format!("link {name}");
                return Err(InputError::new(&self.file, field, "the name twice", "one link of each name"));
            }
        }
        for inner in model.children("model") {
            let name = inner.attribute("name").unwrap_or_default();
            self.add_model(inner, &format!("{prefix}{name}::"))?;
        }
        Ok(())
    }
}

/// `name` is what poses may call the link.
fn link(node: Node, name: &str) -> Result<Link, InputError> {
    let mut collisions = Vec::new();
    let mut parts = Vec::new();
    for collision in node.children("collision") {
        let density = collision.child("density").map(|it| it.number(DENSITY_KGPM3)).transpose()?;
        let shape = geometry(collision, name)?;
        parts.extend(shape.iter().map(|it| (it.clone(), density)));
        collisions.extend(shape);
    }
    let visuals = node.children("visual").filter_map(|it| geometry(it, name).transpose()).collect::<Result<_, _>>()?;
    let inertial = node.child("inertial");
    let inertia = inertial.map(|it| inertia(it, name, &parts)).transpose()?.flatten();
    let bounces = node.children("collision").flat_map(Node::descendants);
    let bounces = bounces.filter(|it| it.name() == "restitution_coefficient").map(|it| it.number(quantity::FRACTION));
    let restitution = bounces.collect::<Result<Vec<_>, _>>()?.into_iter().reduce(f64::min);
    let (friction, unused) = friction(node)?;
    Ok(Link { inertia, friction, restitution, unused, collisions, visuals })
}

/// The least friction coefficient of a link's collisions, as Drake has it or, without that, as ODE has it, or
/// Bullet; and those that are others.
fn friction(link: Node<'_>) -> Result<(Option<f64>, Vec<String>), InputError> {
    let (mut least, mut all) = (None, Vec::new());
    for collision in link.children("collision") {
        let mut used = None;
        for names in [&["drake:mu_dynamic"][..], &["mu", "mu2"], &["friction", "friction2"]] {
            let stated = collision.descendants().filter(|it| names.contains(&it.name()) && !it.text().is_empty());
            // Some of them are none of a surface: of some simulators -1 is that nothing slips.
            let stated: Vec<_> =
                stated.map(|it| Ok((it.name(), it.number(quantity::FINITE)?))).collect::<Result<_, InputError>>()?;
            used = used.or(stated.iter().map(|it| it.1).reduce(f64::min));
            all.extend(stated);
        }
        least = [least, used].into_iter().flatten().reduce(f64::min);
    }
    let unused = all.into_iter().filter(|it| Some(it.1) != least).map(|(name, value)| format!("{name} = {value}"));
    Ok((least, unused.collect()))
}

/// The shapes of collisions, each with its density if it states one.
type Parts = [(Geometry, Option<f64>)];

fn inertia(node: Node, link: &str, parts: &Parts) -> Result<Option<Inertia>, InputError> {
    let density = node.child("density").map(|it| it.number(DENSITY_KGPM3)).transpose()?;
    let mass = node.child("mass").map(|it| it.number(MASS_KG)).transpose()?;
    let X_LC = pose(node, link)?;
    if is_true(node, "auto")? {
        for stated in node.children("inertia") {
            // As the format says, what is worked out takes its place.
            stated.leave_out();
        }
        return filled(node, parts, density.unwrap_or(WATER_KGPM3), mass).map(Some);
    }
    let Some(mass) = mass else { return Ok(None) };
    let moments = node.child("inertia");
    let moment = |name| moments.and_then(|it| it.child(name)).map_or(Ok(0.0), |it| it.number(MOMENT_KGM2));
    Ok(Some(Inertia { mass, com: Point3::origin(), about_com: urdf::moments(moment)? }.transformed(&X_LC)))
}

/// The mass properties of a link's collisions, each filled with its density, all together as heavy as is
/// stated.
fn filled(node: Node, parts: &Parts, density: f64, mass: Option<f64>) -> Result<Inertia, InputError> {
    let fault = |of: &str| {
        let expected = "the mass and the moments, or simple shapes for collisions";
        node.fault(format!("auto=\"true\" {of}"), expected)
    };
    let mut whole: Option<Inertia> = None;
    for (shape, own) in parts {
        let part = shape.filled(own.unwrap_or(density)).ok_or_else(|| fault("with a mesh"))?;
        whole = Some(whole.map_or(part, |it| it.joined(&part)));
    }
    let it = whole.ok_or_else(|| fault("without collisions"))?;
    let factor = mass.filter(|_| it.mass > 0.0).map_or(1.0, |mass| mass / it.mass);
    Ok(Inertia { mass: it.mass * factor, about_com: it.about_com * factor, ..it })
}

/// The shape of a visual or a collision; `None` for planes that are only seen, and where there is nothing.
fn geometry(node: Node, link: &str) -> Result<Option<Geometry>, InputError> {
    let Some(geometry) = node.child("geometry") else { return Ok(None) };
    let X_LS = pose(node, link)?;
    let length = |of: Node, name| of.required(name)?.number(EXTENT_M);
    let three = |of: Node, name, range| of.required(name)?.numbers::<3>(range).map(Vector3::from);
    let shape = if let Some(it) = geometry.child("box") {
        Shape::Cuboid(three(it, "size", EXTENT_M)?)
    } else if let Some(it) = geometry.child("cylinder") {
        Shape::Cylinder { radius_m: length(it, "radius")?, length_m: length(it, "length")? }
    } else if let Some(it) = geometry.child("capsule") {
        Shape::Capsule { radius_m: length(it, "radius")?, length_m: length(it, "length")? }
    } else if let Some(it) = geometry.child("sphere") {
        Shape::Sphere(length(it, "radius")?)
    } else if let Some(it) = geometry.child("ellipsoid") {
        Shape::Ellipsoid(three(it, "radii", EXTENT_M)?)
    } else if let Some(it) = geometry.child("mesh") {
        let uri = it.child("uri").map_or("", Node::text);
        if uri.is_empty() {
            return Err(it.fault("a mesh without <uri>", "the file of the mesh"));
        }
        let scale = if it.child("scale").is_some() { three(it, "scale", MESH_SCALE)? } else { Vector3::repeat(1.0) };
        Shape::Mesh { file: uri.to_owned(), scale }
    } else {
        for nothing in geometry.children("plane").chain(geometry.children("empty")) {
            if node.name() == "collision" && nothing.name() == "plane" {
                return Err(nothing.fault("a plane, which has no end", "the shape of a body"));
            }
            nothing.leave_out();
        }
        return Ok(None);
    };
    Ok(Some(Geometry { X_LS, shape }))
}

/// The pose in the child `<pose>`; the identity where there is none.
fn pose(node: Node, link: &str) -> Result<Pose, InputError> {
    let Some(pose) = node.child("pose") else { return Ok(Pose::identity()) };
    for name in ["relative_to", "frame"] {
        let frame = pose.attribute(name).unwrap_or_default();
        if !frame.is_empty() && frame != link {
            let expected = format!("poses in the link's frame: without `{name}`, or with the link's name");
            return Err(pose.fault(format!("{name}=\"{frame}\""), expected));
        }
    }
    let in_degrees = is_true(pose, "degrees")?;
    let per = if in_degrees { 1f64.to_radians() } else { 1.0 };
    let (p, rotation) = match pose.attribute("rotation_format") {
        None | Some("euler_rpy") => {
            let [x, y, z, roll, pitch, yaw] = if pose.text().is_empty() { [0.0; 6] } else { pose.numbers::<6>(POSE)? };
            let rotation = UnitQuaternion::from_euler_angles(roll * per, pitch * per, yaw * per);
            (Vector3::new(x, y, z), Some(rotation))
        }
        Some("quat_xyzw") if in_degrees => {
            return Err(pose.fault("a quaternion with degrees=\"true\"", "a quaternion without it"));
        }
        Some("quat_xyzw") => {
            let [x, y, z, i, j, k, w] = pose.numbers::<7>(POSE)?;
            (Vector3::new(x, y, z), UnitQuaternion::try_new(Quaternion::new(w, i, j, k), 1e-6))
        }
        Some(other) => return Err(pose.fault(format!("rotation_format=\"{other}\""), "euler_rpy or quat_xyzw")),
    };
    let rotation = rotation.ok_or_else(|| pose.fault("a quaternion of length 0", "a unit quaternion"))?;
    Ok(Pose::from_parts(Translation3::from(p), rotation))
}

/// Returns whether an attribute is there and true.
fn is_true(node: Node, name: &'static str) -> Result<bool, InputError> {
    let stated = node.attribute(name).unwrap_or("false");
    match &*stated.trim().to_ascii_lowercase() {
        "true" | "1" => Ok(true),
        "false" | "0" => Ok(false),
        _ => Err(node.fault(format!("{name}=\"{stated}\""), "true or false")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAN: &str = r#"<sdf version="1.7"><model name="can"><link name="can">
        <inertial><pose>0 0 0.01 0 0 0</pose><mass>0.3</mass><inertia><ixx>1e-3</ixx><iyy>1e-3</iyy><izz>2e-3</izz></inertia></inertial>
        <visual name="v"><pose>0 0 0.1 1.5707963 0 0</pose><geometry><mesh><uri>package://a/can.gltf</uri></mesh></geometry></visual>
        <collision name="c"><geometry><cylinder><radius>0.03</radius><length>0.1</length></cylinder></geometry>
        <surface><bounce><restitution_coefficient>0.9</restitution_coefficient></bounce>
        <friction><ode><mu>0.4</mu></ode></friction></surface></collision></link></model></sdf>"#;

    #[test]
    fn a_link_is_read_with_its_mass_shapes_and_surface() {
        let description = Description::from_sdf("can.sdf", CAN).unwrap();
        let can = &description.links["can"];
        let inertia = can.inertia.unwrap();
        assert_eq!((inertia.mass, inertia.com, inertia.about_com[(2, 2)]), (0.3, Point3::new(0.0, 0.0, 0.01), 2e-3));
        assert_eq!((can.friction, can.restitution, can.unused.len()), (Some(0.4), Some(0.9), 0));
        let friction = |stated: &str| {
            let text = CAN.replace("<ode><mu>0.4</mu></ode>", stated);
            let can = &Description::from_sdf("can.sdf", &text).unwrap().links["can"];
            (can.friction, can.unused.join(", "))
        };
        let bullet = "<bullet><friction>0.7</friction><friction2>0.8</friction2></bullet>";
        assert_eq!(friction(bullet), (Some(0.7), "friction2 = 0.8".into()));
        let ode = "<ode><mu>0.9</mu><mu2>0.4</mu2></ode>";
        let others = "mu = 0.9, friction = 0.7, friction2 = 0.8";
        assert_eq!(friction(&format!("{ode}{bullet}")), (Some(0.4), others.into()));
        assert_eq!(can.collisions[0].shape, Shape::Cylinder { radius_m: 0.03, length_m: 0.1 });
        let mesh = Shape::Mesh { file: "package://a/can.gltf".into(), scale: Vector3::repeat(1.0) };
        assert_eq!(can.visuals[0].shape, mesh);
        assert!((can.visuals[0].X_LS * Vector3::y() - Vector3::z()).norm() < 1e-6);
    }

    #[test]
    fn faults_are_told() {
        for (from, to, expected) in [
            ("sdf", "urdf", "found <urdf>"),
            ("<mass>0.3", "<mass>heavy", "link can.inertial.mass: found `heavy`"),
            (">0.9<", ">9<", "bounce.restitution_coefficient: found `9`"),
            ("<radius>0.03</radius>", "", "geometry.cylinder.radius: found nothing, expected an element <radius>"),
            ("<pose>0 0 0.1 1.5707963 0 0", "<pose>0 0 0.1", "visual v.pose: found `0 0 0.1`"),
            ("package://a/can.gltf", "", "a mesh without <uri>"),
        ] {
            let fault = Description::from_sdf("can.sdf", &CAN.replace(from, to)).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    /// Values of SDFormat 1.11: what has no mass of its own weighs what its collisions weigh.
    #[test]
    fn masses_are_worked_out_from_densities() {
        let text = r#"<sdf><model name="m"><link name="l"><inertial auto="true"><density>400</density></inertial>
            <collision name="c"><geometry><box><size>0.06 0.05 0.09</size></box></geometry></collision></link></model></sdf>"#;
        let of = |text: &str| Description::from_sdf("a.sdf", text).unwrap().links["l"].inertia.unwrap();
        assert!((of(text).mass - 0.108).abs() < 1e-12);
        assert!((of(text).about_com[(2, 2)] - 0.108 * (0.0036 + 0.0025) / 12.0).abs() < 1e-12);
        let own = text.replace("</geometry>", "</geometry><density>200</density>");
        assert!((of(&own).mass - 0.054).abs() < 1e-12);
        let mesh = text.replace("<box><size>0.06 0.05 0.09</size></box>", "<mesh><uri>a.stl</uri></mesh>");
        assert!(Description::from_sdf("a.sdf", &mesh).unwrap_err().to_string().contains("auto="));
    }

    #[test]
    fn whatever_changes_a_shape_is_read_or_refused() {
        let of = |visual: &str| {
            let text = format!(
                "<sdf><model name=\"m\"><link name=\"l\"><visual name=\"v\">{visual}</visual></link></model></sdf>"
            );
            Description::from_sdf("a.sdf", &text).map(|it| it.links["l"].visuals[0].clone())
        };
        let ball = "<geometry><sphere><radius>0.1</radius></sphere></geometry>";
        let ellipsoid = of("<geometry><ellipsoid><radii>0.02 0.03 0.06</radii></ellipsoid></geometry>").unwrap();
        assert_eq!(ellipsoid.shape, Shape::Ellipsoid(Vector3::new(0.02, 0.03, 0.06)));
        let at = of(&format!("<pose relative_to=\"l\" rotation_format=\"quat_xyzw\">0 0 0.1  0 0 1 0</pose>{ball}"))
            .unwrap();
        assert!((at.X_LS.rotation.angle() - std::f64::consts::PI).abs() < 1e-12);
        for (visual, expected) in [
            (
                ball.replace("</sphere>", "</sphere><ellipsoid/>"),
                "geometry.ellipsoid: found <ellipsoid>, which is not read",
            ),
            (ball.replace("sphere>", "cone>"), "found <cone>"),
            (
                "<geometry><mesh><uri>a.obj</uri><submesh><name>a</name></submesh></mesh></geometry>".into(),
                "found <submesh>",
            ),
            (format!("<pose relative_to=\"k\">0 0 0 0 0 0</pose>{ball}"), "relative_to=\"k\""),
        ] {
            let fault = of(&visual).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
        let model =
            |inner: &str| Description::from_sdf("a.sdf", &format!("<sdf><model name=\"m\">{inner}</model></sdf>"));
        let link = format!("<link name=\"l\"><visual name=\"v\">{ball}</visual></link>");
        assert!(model(&format!("<model name=\"n\">{link}</model>")).unwrap().links.contains_key("n::l"));
        let include = model(&format!("{link}<include><uri>model://a</uri></include>")).unwrap_err().to_string();
        assert!(include.contains("<include>"), "{include}");
        let two = format!("<sdf><model name=\"a\">{link}</model><model name=\"b\">{link}</model></sdf>");
        let two = two.replacen("\"l\"", "\"k\"", 1);
        assert!(Description::from_sdf("a.sdf", &two).unwrap_err().to_string().contains("2 models: a, b"));
    }
}
