//! People in the images, one who walks and one who throws: bodies of capsules that no object touches and no
//! brain is told of.

use std::f64::consts::TAU;

use catch_body::{Pose, TriangleMesh, quantity, ray_cast::RayCaster, shape::Capsule};
use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    drawn::Drawn,
    random_streams::{Draws, Stream},
};

/// Distance that the person walks to each side of the point nearest to the arm before turning around, in
/// metres.
const SPAN_M: f64 = 4.0;
/// Length of two steps, in metres.
const STRIDE_M: f64 = 1.4;
/// Angle by which legs and arms swing to each side, in radians.
const SWING_RAD: f64 = 0.45;
/// Flat strips around a capsule.
const SEGMENTS: u32 = 32;

/// Path of a person who walks through the images. Every throw draws a straight line in a direction of its
/// own, and the person's first position on it.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PersonConfig {
    /// Least distance of the line from the base's axis, in metres: a number, or `{ min, max }`.
    pub nearest_m: quantity::distance_m<Drawn>,
    /// Walking speed, in m/s: a number, or `{ min, max }`.
    pub speed_mps: quantity::drive_speed_mps<Drawn>,
}

/// The person of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Person {
    /// Frame P on the floor where the line is nearest to the arm; x along the line.
    X_WP: Pose,
    /// Way that was walked at t = 0, in metres.
    walked_m: f64,
    speed_mps: f64,
    parts: Vec<Part>,
}

/// A person who has thrown the object underarm, and whose arm swings on. All else of the body stands still.
#[derive(Debug, Clone)]
pub(crate) struct Thrower {
    /// The body's frame P below the neck; x is along the throw.
    X_WP: Pose,
    /// Axis in W about which the throwing arm swings.
    axis: Unit<Vector3<f64>>,
    /// Orientation of the arm's frame at the release.
    R_WA: UnitQuaternion<f64>,
    /// Angular speed at the release.
    speed_radps: f64,
    parts: Vec<Part>,
}

/// Part of the body that throws: the right arm.
const THROWING: usize = 4;
/// Length of an arm to its hand, in metres, and radius of the hand that was around the object.
const ARM_M: f64 = 0.6;
const HAND_M: f64 = 0.045;
/// Angle by which the arm swings on, in radians.
const SWINGS_ON_RAD: f64 = 0.8;

impl Thrower {
    /// The person who released an object of this radius at this position and velocity; none where it was not
    /// thrown.
    pub fn new(p_WO: &Point3<f64>, v_WO: Vector3<f64>, radius_m: f64) -> Option<Self> {
        let along = Unit::try_new(v_WO, 0.1)?;
        let facing = Unit::try_new(Vector3::new(along.x, along.y, 0.0), 1e-3)?;
        // The arm hangs behind the object, at a right angle to its velocity.
        let down = Unit::new_normalize(along.into_inner() * along.z - Vector3::z());
        let hand_W = p_WO - along.into_inner() * (radius_m + HAND_M);
        let shoulder_W = hand_W - down.into_inner() * ARM_M;
        let R_WP = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), libm::atan2(facing.y, facing.x));
        let parts = body();
        let p_WP = shoulder_W.coords - R_WP * parts[THROWING].pivot;
        Some(Self {
            X_WP: Pose::from_parts(p_WP.into(), R_WP),
            axis: Unit::new_normalize(down.cross(&along)),
            R_WA: UnitQuaternion::rotation_between(&-Vector3::z(), &down).unwrap_or_default(),
            speed_radps: v_WO.norm() / ARM_M,
            parts,
        })
    }

    /// Surfaces of the person with their poses X_WB so long after the release: before it none, for the
    /// person is not there yet.
    pub fn parts(&self, since_s: f64) -> impl Iterator<Item = (Pose, &RayCaster)> {
        let swung_rad = -SWINGS_ON_RAD * libm::expm1(-self.speed_radps / SWINGS_ON_RAD * since_s);
        let swing = UnitQuaternion::from_axis_angle(&self.axis, swung_rad) * self.R_WA;
        let is_there = self.parts.iter().filter(move |_| since_s >= 0.0);
        is_there.enumerate().map(move |(i, Part { surface, pivot, .. })| {
            let X_WB = self.X_WP * Pose::from_parts((*pivot).into(), UnitQuaternion::identity());
            (if i == THROWING { Pose::from_parts(X_WB.translation, swing) } else { X_WB }, surface)
        })
    }
}

/// A part of the body.
#[derive(Debug, Clone)]
struct Part {
    surface: RayCaster,
    /// Point about which it swings, in the body's frame.
    pivot: Vector3<f64>,
    /// Amplitude of the swing in radians, forward where the left leg swings forward.
    swing_rad: f64,
}

impl Person {
    /// Draws the person of the scene (`seed`, `index`).
    pub fn new(config: &PersonConfig, seed: u64, index: u64) -> Self {
        let mut draws = Draws::new(Stream::Person, seed, index);
        let azimuth = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), TAU * draws.unit());
        let nearest = azimuth * (Vector3::y() * config.nearest_m.at(draws.unit()));
        Self {
            X_WP: Pose::from_parts(nearest.into(), azimuth),
            walked_m: 4.0 * SPAN_M * draws.unit(),
            speed_mps: config.speed_mps.at(draws.unit()),
            parts: body(),
        }
    }

    /// Surfaces of the person with their poses X_WB at a time.
    pub fn parts(&self, time_s: f64) -> impl Iterator<Item = (Pose, &RayCaster)> {
        let walked_m = self.walked_m + self.speed_mps * time_s;
        // There and back.
        let around_m = walked_m.rem_euclid(4.0 * SPAN_M);
        let is_returning = around_m >= 2.0 * SPAN_M;
        let (along_m, facing_rad) =
            if is_returning { (3.0 * SPAN_M - around_m, TAU / 2.0) } else { (around_m - SPAN_M, 0.0) };
        let facing = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), facing_rad);
        let X_WB = self.X_WP * Pose::from_parts(Vector3::new(along_m, 0.0, 0.0).into(), facing);
        let swing = libm::sin(TAU * walked_m / STRIDE_M);
        self.parts.iter().map(move |Part { surface, pivot, swing_rad }| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -swing * swing_rad);
            (X_WB * Pose::from_parts((*pivot).into(), turn), surface)
        })
    }
}

/// A body 1.74 m tall that walks along x; its parts' frames are at their pivots.
fn body() -> Vec<Part> {
    let part = |[x, y, z]: [f64; 3], length_m: f64, radius: f64, swing_rad: f64| {
        let capsule = Capsule { from: Point3::origin(), to: Point3::new(0.0, 0.0, -length_m), radius };
        let surface = RayCaster::new(&TriangleMesh::capsule(&capsule, SEGMENTS));
        Part { surface, pivot: Vector3::new(x, y, z), swing_rad }
    };
    let mut parts = vec![
        part([0.0, 0.0, 1.63], 0.0, 0.11, 0.0),
        part([0.0, 0.0, 1.55], 0.15, 0.06, 0.0),
        part([0.0, 0.0, 1.28], 0.3, 0.17, 0.0),
    ];
    for side in [-1.0, 1.0] {
        parts.push(part([0.0, 0.1 * side, 0.9], 0.82, 0.08, side * SWING_RAD));
        parts.push(part([0.0, 0.22 * side, 1.38], ARM_M, HAND_M, -side * SWING_RAD));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(index: u64) -> Person {
        let config = PersonConfig {
            nearest_m: Drawn::Between(crate::drawn::Between { min: 1.0, max: 2.0 }),
            speed_mps: Drawn::Always(1.2),
        };
        Person::new(&config, 3, index)
    }

    /// The head is where the body is; the line keeps its distance, and the person its speed.
    #[test]
    fn a_person_walks_along_a_line_that_keeps_its_distance() {
        for index in 0..20 {
            let person = person(index);
            let head = |time_s: f64| {
                let p = person.parts(time_s).next().unwrap().0.translation.vector;
                assert!((p.z - 1.63).abs() < 1e-12);
                p.xy()
            };
            let places: Vec<_> = (0..4000).map(|step| head(0.01 * f64::from(step))).collect();
            let nearest = places.iter().map(nalgebra::Matrix::norm).fold(f64::INFINITY, f64::min);
            let farthest = places.iter().map(nalgebra::Matrix::norm).fold(0.0, f64::max);
            assert!((1.0 - 1e-9..2.0 + 1e-3).contains(&nearest), "{nearest}");
            assert!((4.0..4.6).contains(&farthest), "there and back: {farthest}");
            let steps = places.windows(2).map(|pair| (pair[1] - pair[0]).norm());
            assert!(steps.filter(|step| (step - 0.012).abs() > 1e-9).count() <= 6, "it turns around at once");
        }
        assert_ne!(person(0).X_WP, person(1).X_WP);
    }

    /// The hand is behind the object when that leaves it, as fast as it is, and then falls behind.
    #[test]
    fn a_thrower_s_hand_moves_with_the_object_and_lets_go() {
        let (p_WO, v_WO) = (Point3::new(1.5, 2.0, 0.9), Vector3::new(-2.0, -2.5, 2.0));
        let thrower = Thrower::new(&p_WO, v_WO, 0.035).unwrap();
        let hand_W = |since_s: f64| {
            let (X_WB, _) = thrower.parts(since_s).nth(THROWING).unwrap();
            X_WB * Point3::new(0.0, 0.0, -ARM_M)
        };
        let behind_m = |since_s: f64| (p_WO + v_WO * since_s - hand_W(since_s)).norm();
        assert!((behind_m(0.0) - 0.08).abs() < 1e-9);
        let speed = (hand_W(1e-6) - hand_W(0.0)) / 1e-6;
        assert!((speed - v_WO).norm() < 1e-3, "{speed}");
        assert!(behind_m(0.05) > 0.1 && behind_m(0.1) > 0.17);
        // Upright, and before the throw nowhere.
        let heights = thrower.parts(0.0).map(|(X_WB, _)| X_WB.translation.z);
        assert!(heights.fold(0.0, f64::max) < p_WO.z + 1.1);
        assert_eq!(thrower.parts(-0.01).count(), 0);
        assert!(Thrower::new(&p_WO, Vector3::zeros(), 0.035).is_none());
    }

    #[test]
    fn feet_reach_the_floor_and_swing_against_each_other() {
        let person = person(0);
        let lowest = |part: usize, time_s: f64| {
            let (X_WB, surface) = person.parts(time_s).nth(part).unwrap();
            let foot = X_WB * Point3::new(0.0, 0.0, surface.centre.z - surface.half_size.z + 0.08);
            (person.X_WP.inverse() * foot).coords
        };
        let mut apart = Vec::new();
        for step in 0..120 {
            let [one, other] = [3, 5].map(|leg| lowest(leg, 0.01 * f64::from(step)));
            assert!(one.z - 0.08 > -1e-6 && one.z < 0.2, "{one}");
            apart.push((one - other).x);
        }
        assert!(apart.iter().any(|it| *it > 0.5) && apart.iter().any(|it| *it < -0.5));
    }
}
