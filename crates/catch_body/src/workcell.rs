//! Obstacles that stand still in a workcell beside the arm: a table, a fence, camera stands.

use nalgebra::{Point3, Vector3};
use serde::Deserialize;

use crate::{
    InputError, TriangleMesh,
    pose::{Pose, PoseFields},
    quantity,
    shape::{Capsule, Cuboid},
};

/// Height of the floor in W, in metres. W stands on the floor of every cell: an arm on a pedestal says so by
/// where its base is.
pub const FLOOR_Z_M: f64 = 0.0;
/// A cell with more obstacles is refused: each costs time in every clearance.
const MOST_OBSTACLES: usize = 64;
/// Flat strips around a capsule.
const SEGMENTS: u32 = 48;

/// A solid that stands still.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Name, for errors.
    pub name: String,
    solid: Solid,
    /// The ball around the obstacle: centre in W, radius in metres.
    ball: (Point3<f64>, f64),
}

#[derive(Debug, Clone, PartialEq)]
enum Solid {
    /// A box around the origin of its frame S, and the pose of S in W.
    Box(Pose, Cuboid),
    /// A capsule in W.
    Capsule(Capsule),
}

/// Contents of a workcell's file.
#[derive(Debug, Clone, PartialEq)]
pub struct Workcell {
    /// Name.
    pub name: String,
    /// Description of the workcell, in a sentence.
    pub description: String,
    /// Obstacles in the workcell, in W.
    pub obstacles: Vec<Obstacle>,
}

/// Obstacles around the arm: 1 to 64 boxes and capsules in the world.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WorkcellFields {
    /// Name.
    name: String,
    /// Description of the workcell, in a sentence.
    description: String,
    /// Boxes.
    #[serde(default)]
    boxes: Vec<BoxFields>,
    /// Capsules.
    #[serde(default)]
    capsules: Vec<CapsuleFields>,
}

/// A box.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct BoxFields {
    /// Name, for errors.
    name: String,
    /// Full extents along the box's own axes.
    size_m: quantity::obstacle_size_m<[f64; 3]>,
    /// Position of the middle of the box.
    position_m: quantity::place_m<[f64; 3]>,
    /// Rotation: roll, pitch and yaw about the fixed axes x, y and z.
    #[serde(default)]
    rpy_rad: quantity::angle_rad<[f64; 3]>,
}

/// All points within a radius of a segment.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct CapsuleFields {
    /// Name, for errors.
    name: String,
    /// First end of the segment.
    from_m: quantity::place_m<[f64; 3]>,
    /// Second end of the segment.
    to_m: quantity::place_m<[f64; 3]>,
    /// Radius.
    radius_m: quantity::radius_m,
}

impl Workcell {
    /// Reads a workcell's TOML file; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is missing, misspelt or out of range, no obstacle or more than 64.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        let WorkcellFields { name, description, boxes, capsules } = InputError::parse_toml(file, text)?;
        let count = boxes.len() + capsules.len();
        if count == 0 || count > MOST_OBSTACLES {
            let expected = format!("1 to {MOST_OBSTACLES} [[boxes]] and [[capsules]]");
            return Err(InputError::new(file, "boxes", count, expected));
        }
        let boxes = boxes.into_iter().map(|BoxFields { name, size_m, position_m, rpy_rad }| {
            Obstacle::cuboid(name, PoseFields { position_m, rpy_rad }.pose(), size_m.into())
        });
        let capsules = capsules.into_iter().map(|CapsuleFields { name, from_m, to_m, radius_m }| {
            Obstacle::capsule(name, Capsule { from: from_m.into(), to: to_m.into(), radius: radius_m })
        });
        Ok(Self { name, description, obstacles: boxes.chain(capsules).collect() })
    }
}

impl Obstacle {
    /// A box of this size in metres along the axes of its frame S, around that frame's origin.
    pub fn cuboid(name: String, X_WS: Pose, size: Vector3<f64>) -> Self {
        let cuboid = Cuboid { centre: Point3::origin(), size };
        let ball = (X_WS.translation.vector.into(), cuboid.bounding_radius());
        Self { name, solid: Solid::Box(X_WS, cuboid), ball }
    }

    /// A capsule in W.
    pub fn capsule(name: String, capsule: Capsule) -> Self {
        Self { name, ball: (capsule.centre(), capsule.bounding_radius()), solid: Solid::Capsule(capsule) }
    }

    /// Lower bound in metres of the distance from a ball to the obstacle; negative where the ball overlaps
    /// the one around the obstacle.
    pub fn least_distance_to_ball(&self, centre_W: &Point3<f64>, radius: f64) -> f64 {
        (centre_W - self.ball.0).norm() - self.ball.1 - radius
    }

    /// Distance in metres from a capsule in W; negative where they overlap.
    pub fn distance_to_capsule(&self, capsule_W: &Capsule) -> f64 {
        match &self.solid {
            Solid::Box(X_WS, cuboid) => capsule_W.transformed(&X_WS.inverse()).distance_to_cuboid(cuboid),
            Solid::Capsule(capsule) => capsule.distance(capsule_W),
        }
    }

    /// A lower bound of the distance in metres from a box, given in a frame B whose pose in W is `X_WB`; zero
    /// or less exactly where they overlap.
    pub fn distance_to_cuboid(&self, X_WB: &Pose, cuboid_B: &Cuboid) -> f64 {
        match &self.solid {
            Solid::Box(X_WS, cuboid) => cuboid.separation(&X_WS.inv_mul(X_WB), cuboid_B),
            Solid::Capsule(capsule) => capsule.transformed(&X_WB.inverse()).distance_to_cuboid(cuboid_B),
        }
    }

    /// Surface of the obstacle in W.
    pub fn mesh(&self) -> TriangleMesh {
        match &self.solid {
            Solid::Box(X_WS, cuboid) => TriangleMesh::cuboid(cuboid).transformed(X_WS),
            Solid::Capsule(capsule) => TriangleMesh::capsule(capsule, SEGMENTS),
        }
    }

    /// The box and the pose of its frame, if the obstacle is one.
    pub fn as_cuboid(&self) -> Option<(&Pose, &Cuboid)> {
        if let Solid::Box(X_WS, cuboid) = &self.solid { Some((X_WS, cuboid)) } else { None }
    }

    /// The capsule in W, if the obstacle is one.
    pub fn as_capsule(&self) -> Option<&Capsule> {
        if let Solid::Capsule(capsule) = &self.solid { Some(capsule) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    const TOML: &str = r#"
name = "table"
description = "a table and a stand"

[[boxes]]
name = "table"
size_m = [1.0, 0.6, 0.04]
position_m = [0.8, 0.0, 0.4]

[[capsules]]
name = "stand"
from_m = [-1.0, 1.0, 0.0]
to_m = [-1.0, 1.0, 1.5]
radius_m = 0.03
"#;

    #[test]
    fn obstacles_are_where_the_file_says() {
        let obstacles = Workcell::from_toml("workcell.toml", TOML).unwrap().obstacles;
        let names: Vec<&str> = obstacles.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["table", "stand"]);
        let point = |x, y, z| Capsule { from: Point3::new(x, y, z), to: Point3::new(x, y, z), radius: 0.0 };
        assert!((obstacles[0].distance_to_capsule(&point(0.8, 0.0, 0.5)) - 0.08).abs() < 1e-12);
        assert!((obstacles[1].distance_to_capsule(&point(-1.0, 0.5, 0.7)) - 0.47).abs() < 1e-12);
    }

    #[test]
    fn faults_name_the_obstacle() {
        for (from, to, expected) in [
            ("radius_m = 0.03", "radius_m = 3.0", "workcell.toml: capsules[0].radius_m: found 3"),
            ("size_m = [1.0, 0.6, 0.04]", "size_m = [1.0, 0.6]", "workcell.toml: boxes[0].size_m: found [1, 0.6]"),
            ("position_m", "place_m", "workcell.toml: boxes[0].place_m"),
            ("[[boxes]]", "[[boxs]]", "workcell.toml: boxs"),
        ] {
            let fault = Workcell::from_toml("workcell.toml", &TOML.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(fault.starts_with(expected), "{fault}");
        }
        let empty = "name = \"a\"\ndescription = \"b\"";
        assert!(Workcell::from_toml("workcell.toml", empty).unwrap_err().to_string().contains("1 to 64"));
    }

    proptest! {
        /// Against points all over both surfaces.
        #[test]
        fn distances_to_a_box_match_brute_force(
            place in prop::array::uniform3(-0.6f64..0.6),
            turn in prop::array::uniform3(-3.0f64..3.0),
            size in prop::array::uniform3(0.02f64..0.5),
        ) {
            let X_WS = Pose::from_parts(Vector3::from(place).into(), UnitQuaternion::from_scaled_axis(turn.into()));
            let held = Cuboid { centre: Point3::new(0.05, -0.02, 0.0), size: Vector3::new(0.1, 0.2, 0.06) };
            let X_WB = Pose::translation(0.1, 0.05, -0.1);
            let samples = |cuboid: &Cuboid, X_WC: &Pose| {
                let step = |i: usize| i as f64 / 8.0 - 0.5;
                let points = (0..729).map(|i| Vector3::new(step(i % 9), step(i / 9 % 9), step(i / 81)));
                points.map(|it| X_WC * (cuboid.centre + it.component_mul(&cuboid.size))).collect::<Vec<_>>()
            };
            let other = Obstacle::cuboid(String::new(), X_WS, size.into());
            let (_, cuboid) = other.as_cuboid().unwrap();
            let of_obstacle = samples(cuboid, &X_WS);
            let nearest = samples(&held, &X_WB).iter()
                .flat_map(|one| of_obstacle.iter().map(move |two| (one - two).norm()))
                .fold(f64::INFINITY, f64::min);
            let found = other.distance_to_cuboid(&X_WB, &held);
            prop_assert!(found <= nearest + 1e-9, "{found} is above the sampled {nearest}");
            // Of bodies side by side the widest gap is at least 1/√3 of the distance; samples are up to 7 cm
            // from the nearest point.
            prop_assert!(nearest < 0.1 || found > 0.57 * (nearest - 0.1), "{found} is far below the sampled {nearest}");

            let capsule = Obstacle::capsule(
                String::new(),
                Capsule { from: X_WS * Point3::origin(), to: X_WS * Point3::new(0.2, 0.0, 0.1), radius: 0.05 },
            );
            let nearest = samples(&held, &X_WB).iter()
                .map(|point| capsule.as_capsule().unwrap().distance_to_point(point))
                .fold(f64::INFINITY, f64::min);
            let found = capsule.distance_to_cuboid(&X_WB, &held);
            prop_assert!(found <= nearest + 1e-9 && (nearest < 0.0 || found > nearest - 0.03), "{found} for {nearest}");
        }
    }
}
