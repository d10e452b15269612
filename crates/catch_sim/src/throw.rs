//! Throws: the release of an object from the thrower's hand.

mod random;
mod recorded;

use std::{collections::BTreeMap, sync::Arc};

use catch_body::{InputError, quantity};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::{
    conditions::Conditions,
    drawn::Span,
    random_streams::{Draws, Stream},
};
use random::RandomMotion;
use recorded::RecordedMotion;
pub use recorded::{FlightSource, ReadTracks, RecordedFlight, RecordedState};

/// An object's state at t = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Release {
    /// The origin of O in W, in metres.
    pub p_WO: Point3<f64>,
    /// The velocity of that point in W, in m/s.
    pub v_WO: Vector3<f64>,
    /// Orientation of the object.
    pub q_WO: UnitQuaternion<f64>,
    /// Angular velocity of the object in W, in rad/s.
    pub omega_WO: Vector3<f64>,
    /// Recorded flight in W along which the object moves until something touches it; by the arena's physics
    /// if there is none.
    pub path: Option<Arc<RecordedFlight>>,
}

impl Release {
    /// An object that rests where neither cameras nor arm are: nothing flies.
    pub fn out_of_sight() -> Self {
        Self {
            p_WO: Point3::new(45.0, 45.0, 0.3),
            v_WO: Vector3::zeros(),
            q_WO: UnitQuaternion::identity(),
            omega_WO: Vector3::zeros(),
            path: None,
        }
    }
}

/// A throw or a distribution of throws, as its file gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct Throw {
    motion: Motion,
    orientations: BTreeMap<String, UnitQuaternion<f64>>,
}

/// A throw, or a distribution of throws.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct ThrowFile {
    /// Motion of the object.
    motion: Motion,
    /// Orientations per object: intrinsic rotations from left to right, an axis and an angle in degrees each.
    #[serde(default)]
    orientations_deg: BTreeMap<String, Vec<AxisAngle>>,
}

/// An axis, and an angle in degrees.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
struct AxisAngle(Axis, quantity::angle_deg);

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Axis {
    X,
    Y,
    Z,
}

/// Motion of a throw, by its `kind`. Positions and velocities are in the world.
#[quantity::checked(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
enum Motion {
    /// Motion that is the same every time.
    Fixed {
        /// Position of the object at the release.
        position_m: quantity::place_m<[f64; 3]>,
        /// Velocity at the release.
        velocity_mps: quantity::velocity_mps<[f64; 3]>,
        /// Angular velocity at the release.
        spin_radps: quantity::spin_radps<[f64; 3]>,
    },
    /// The sampler of the paper's code. The horizontal velocity is that speed times (−x, −y)/√(x² + y²) +
    /// a·(1, −1): aimed at the base's axis, then sheared aside by `a`, the same in both directions.
    Sampled {
        /// Range of x at the release.
        x_m: quantity::place_m<Span>,
        /// Range of y at the release.
        y_m: quantity::place_m<Span>,
        /// Height of the release.
        z_m: quantity::place_m,
        /// Range of the horizontal speed toward the base's axis.
        horizontal_speed_mps: quantity::velocity_mps<Span>,
        /// Range of the shear `a`.
        aside: quantity::shear<Span>,
        /// Range of the vertical speed, upwards.
        vertical_speed_mps: quantity::velocity_mps<Span>,
    },
    /// Throws from anywhere in a sector, past the robot's base on one side.
    Random(RandomMotion),
    /// Recorded throws.
    Recorded(RecordedMotion),
}

impl Throw {
    /// Reads a throw's TOML file; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is missing, misspelt or not finite, or a range whose end lies below its start.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        Self::from_toml_with(file, text, &|tracks, _| {
            let expected = "a throw without recordings: nothing reads them here";
            Err(InputError::new(file, "motion.tracks", format!("`{tracks}`"), expected))
        })
    }

    /// Reads a throw, also one of recorded throws: `read` finds their recordings.
    ///
    /// # Errors
    /// As [`from_toml`](Self::from_toml), or faults of the recordings.
    pub fn from_toml_with(file: &str, text: &str, read: ReadTracks) -> Result<Self, InputError> {
        let mut fields: ThrowFile = InputError::parse_toml(file, text)?;
        if let Motion::Recorded(motion) = fields.motion {
            fields.motion = Motion::Recorded(motion.with_recordings(file, read)?);
        }
        match &fields.motion {
            Motion::Sampled { x_m: Span(x_m), y_m: Span(y_m), .. } => {
                let contains_zero = |[low, high]: &[f64; 2]| *low < LEAST_DISTANCE_M && *high > -LEAST_DISTANCE_M;
                if contains_zero(x_m) && contains_zero(y_m) {
                    let expected = "releases beside the base's axis, at which they are aimed";
                    return Err(InputError::new(file, "motion.x_m", format!("{x_m:?} with y_m {y_m:?}"), expected));
                }
            }
            Motion::Random(motion) => motion.check(file)?,
            Motion::Fixed { .. } | Motion::Recorded(_) => {}
        }
        let mut orientations = BTreeMap::new();
        for (object, rotations) in &fields.orientations_deg {
            let mut q_WO = UnitQuaternion::identity();
            for AxisAngle(axis, angle_deg) in rotations {
                q_WO *= UnitQuaternion::from_axis_angle(&axis.direction(), angle_deg.to_radians());
            }
            orientations.insert(object.clone(), q_WO);
        }
        Ok(Self { motion: fields.motion, orientations })
    }

    /// Adapts the throw to an arm of this [length](catch_body::Robot::length_m): where the file gives the
    /// passage for an arm of some length, it is nearer and lower for a shorter one.
    pub fn for_arm(mut self, length_m: f64) -> Self {
        match &mut self.motion {
            Motion::Random(motion) => *motion = motion.for_arm(length_m),
            Motion::Recorded(motion) => *motion = motion.for_arm(length_m),
            Motion::Fixed { .. } | Motion::Sampled { .. } => {}
        }
        self
    }

    /// The throw number `index` of `seed`. Where the file does not give the object's orientation, a fixed
    /// throw has the axes of the object's file along those of W; of all others every orientation is as likely
    /// as any other. A recorded orientation is that of the tracked body, in which the file gives the
    /// object's. `conditions` are those of the same throw.
    pub fn release(&self, object_name: &str, conditions: &Conditions, seed: u64, index: u64) -> Release {
        let given = self.orientations.get(object_name).copied();
        let is_fixed = matches!(self.motion, Motion::Fixed { .. });
        let drawn = || Draws::new(Stream::Orientation, seed, index).orientation();
        let mut release = Release {
            p_WO: Point3::origin(),
            v_WO: Vector3::zeros(),
            q_WO: given.unwrap_or_else(|| if is_fixed { UnitQuaternion::identity() } else { drawn() }),
            omega_WO: conditions.spin_radps,
            path: None,
        };
        match &self.motion {
            Motion::Fixed { position_m, velocity_mps, spin_radps } => {
                release.p_WO = (*position_m).into();
                release.v_WO = (*velocity_mps).into();
                release.omega_WO += Vector3::from(*spin_radps);
            }
            Motion::Sampled { x_m, y_m, z_m, horizontal_speed_mps, aside, vertical_speed_mps } => {
                let mut draws = Draws::new(Stream::Throw, seed, index);
                let p_WO = Point3::new(draws.between(x_m.0), draws.between(y_m.0), *z_m);
                let speed = draws.between(horizontal_speed_mps.0);
                let aside = draws.between(aside.0);
                let distance = libm::hypot(p_WO.x, p_WO.y);
                release.p_WO = p_WO;
                release.v_WO = Vector3::new(
                    speed * (aside - p_WO.x / distance),
                    speed * (-aside - p_WO.y / distance),
                    draws.between(vertical_speed_mps.0),
                );
            }
            Motion::Random(motion) => {
                (release.p_WO, release.v_WO) = motion.draw(conditions, &mut Draws::new(Stream::Throw, seed, index));
            }
            Motion::Recorded(motion) => {
                let orientations = [given.unwrap_or_default(), release.q_WO];
                return motion.draw(conditions, &mut Draws::new(Stream::Throw, seed, index), index, orientations);
            }
        }
        release
    }
}

/// Least distance from the base's axis of a release that is aimed at it, in metres.
const LEAST_DISTANCE_M: f64 = 0.01;

impl Axis {
    fn direction(self) -> nalgebra::Unit<Vector3<f64>> {
        match self {
            Self::X => Vector3::x_axis(),
            Self::Y => Vector3::y_axis(),
            Self::Z => Vector3::z_axis(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    const FILES: [(&str, &str); 4] = [
        ("near", include_str!("../../../assets/throws/near.toml")),
        ("near_sampled", include_str!("../../../assets/throws/near_sampled.toml")),
        ("far", include_str!("../../../assets/throws/far.toml")),
        ("far_sampled", include_str!("../../../assets/throws/far_sampled.toml")),
    ];

    fn calm() -> Conditions {
        let text = include_str!("../../../assets/objects/tennis_ball/truth.toml");
        let object = crate::ThrownObject::from_toml("ball", text, &|_| unreachable!("it names no file")).unwrap();
        Conditions::draw(&crate::ArenaConfig::default(), &object, 0, 0)
    }

    fn throw(name: &str) -> Throw {
        let (_, text) = FILES.iter().find(|(file, _)| *file == name).unwrap();
        Throw::from_toml(name, text).unwrap()
    }

    /// Speed towards the axis and shear, recovered from a release.
    fn speed_and_shear(release: &Release) -> (f64, f64) {
        let towards = -release.p_WO.coords.xy().normalize();
        let speed = (release.v_WO.x + release.v_WO.y) / (towards.x + towards.y);
        (speed, release.v_WO.x / speed - towards.x)
    }

    /// The paper's two throws are draws of its samplers: they lie within the ranges of the sampled files.
    #[test]
    fn fixed_throws_lie_within_their_samplers() {
        for (fixed, speeds, shears) in [("near", 3.0..=3.1, 0.18..=0.19), ("far", 4.75..=5.0, 0.11..=0.12)] {
            let (speed, shear) = speed_and_shear(&throw(fixed).release("ball", &calm(), 0, 0));
            assert!(speeds.contains(&speed) && shears.contains(&shear), "{fixed}: {speed} {shear}");
        }
    }

    #[test]
    fn sampled_throws_stay_within_their_ranges_and_differ() {
        let cases = [
            ("near_sampled", 1.6..=1.7, 0.3, 3.0..=3.1, 0.18..=0.19, 3.6..=3.8),
            ("far_sampled", 2.6..=2.7, 0.5, 4.75..=5.0, 0.11..=0.12, 3.3..=4.3),
        ];
        for (name, place, height, speeds, shears, vertical) in cases {
            let throw = throw(name);
            let mut seen = Vec::new();
            for index in 0..500 {
                let release = throw.release("ball", &calm(), 3, index);
                assert_eq!(release, throw.release("ball", &calm(), 3, index));
                assert!(place.contains(&release.p_WO.x) && place.contains(&release.p_WO.y));
                assert_eq!(release.p_WO.z, height);
                let (speed, shear) = speed_and_shear(&release);
                assert!(speed > speeds.start() - 1e-9 && speed < speeds.end() + 1e-9, "{speed}");
                assert!(shear > shears.start() - 1e-9 && shear < shears.end() + 1e-9, "{shear}");
                assert!(vertical.contains(&release.v_WO.z));
                assert_eq!(release.omega_WO, Vector3::zeros());
                seen.push(release.p_WO.x.to_bits());
            }
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), 500);
        }
    }

    #[test]
    fn orientations_are_intrinsic_rotations_from_left_to_right() {
        let release = throw("near").release("banana", &calm(), 0, 0);
        let about = |axis: Axis, degrees: f64| UnitQuaternion::from_axis_angle(&axis.direction(), degrees.to_radians());
        let expected = about(Axis::Z, -45.0) * about(Axis::X, -45.0) * about(Axis::Z, -90.0);
        assert_relative_eq!(release.q_WO, expected, epsilon = 1e-12);
        assert_eq!(throw("near").release("tennis_ball", &calm(), 0, 0).q_WO, UnitQuaternion::identity());
    }

    /// Whatever an object is called, no orientation of its own file is preferred in throws that differ.
    #[test]
    fn objects_that_a_sampled_throw_does_not_name_have_random_orientations() {
        let orientation = |throw: &str, object: &str, index| self::throw(throw).release(object, &calm(), 3, index).q_WO;
        for throw in ["near_sampled", "far_sampled"] {
            assert_eq!(orientation(throw, "mug", 0), orientation(throw, "kettle", 0));
            assert!(orientation(throw, "mug", 0).angle_to(&orientation(throw, "mug", 1)) > 1e-3);
            assert_eq!(orientation(throw, "banana", 0), orientation(throw, "banana", 1));
            assert_eq!(orientation(throw, "tennis_ball", 1), UnitQuaternion::identity());
        }
        assert_eq!(orientation("near", "mug", 1), UnitQuaternion::identity());
    }

    #[test]
    fn a_passage_is_nearer_for_a_shorter_arm() {
        let text = include_str!("../../../assets/throws/random_by_reach.toml");
        let throw = Throw::from_toml("random_by_reach.toml", text).unwrap();
        for (length_m, range) in [(0.99, 0.35..=0.7), (2.0, 0.35..=0.7), (0.495, 0.175..=0.35)] {
            for index in 0..50 {
                let Release { p_WO, v_WO, .. } = throw.clone().for_arm(length_m).release("mug", &calm(), 1, index);
                let passage_m = p_WO.coords.xy().perp(&v_WO.xy().normalize()).abs();
                assert!(range.contains(&passage_m), "{passage_m} m from the axis for an arm of {length_m} m");
            }
        }
    }

    #[test]
    fn faults_name_file_and_field() {
        let text = FILES[1].1.replace("x_m = [1.6, 1.7]", "x_m = [1.7, 1.6]");
        let fault = Throw::from_toml("t.toml", &text).unwrap_err().to_string();
        assert!(fault.contains("t.toml: motion.x_m"), "{fault}");
        assert!(Throw::from_toml("t.toml", "[motion]\nkind = \"lobbed\"").is_err());
    }
}
