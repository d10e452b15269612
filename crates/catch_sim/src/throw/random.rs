//! Throws from anywhere in front of a robot that all pass within its reach, on one side.

use catch_body::{InputError, dynamics, quantity};
use nalgebra::{Point3, Vector3};
use serde::Deserialize;

use crate::{conditions::Conditions, drawn::Span, random_streams::Draws};

/// A distribution of throws. Every one passes the base's axis (x = y = 0) at a drawn distance and height;
/// where it comes from and how long it takes are drawn too. With that the throw is determined.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct RandomMotion {
    /// Direction of the thrower, seen from the base: counterclockwise from x, in degrees.
    azimuth_deg: quantity::angle_deg<Span>,
    /// Distance of the release from the base's axis, in metres.
    distance_m: quantity::distance_m<Span>,
    /// Height of the release, in metres.
    height_m: quantity::place_m<Span>,
    /// Side on which the flight passes.
    side: Side,
    /// Smallest distance of the flight from the base's axis, in metres.
    passage_distance_m: quantity::distance_m<Span>,
    /// Height of the flight there, in metres.
    passage_height_m: quantity::place_m<Span>,
    /// Time of the passage after the release, in seconds.
    passage_s: quantity::flight_s<Span>,
    /// The length of the arm for which the passage is given; for a shorter arm it is nearer and lower in
    /// proportion. Without it the passage is the same for all arms.
    arm_length_m: quantity::distance_m<Option<f64>>,
}

/// Sense in which a flight passes around the base's axis, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Side {
    Clockwise,
    Counterclockwise,
}

impl RandomMotion {
    pub fn check(&self, file: &str) -> Result<(), InputError> {
        let Self { distance_m: Span(distance_m), passage_s: Span(passage_s), .. } = self;
        if distance_m[0] <= self.passage_distance_m.0[1] {
            let expected = "a release that is farther away than the passage";
            return Err(InputError::new(file, "motion.distance_m", format!("{distance_m:?}"), expected));
        }
        let [fastest_mps, most_mps] = [distance_m[1] / passage_s[0], quantity::VELOCITY_MPS.most];
        if fastest_mps > most_mps {
            let expected = format!("a time in which the farthest release needs at most {most_mps} m/s");
            return Err(InputError::new(file, "motion.passage_s", format!("{passage_s:?}"), expected));
        }
        Ok(())
    }

    /// Adapts the passage of the throws to an arm of this length: nearer where it is shorter.
    pub fn for_arm(&self, length_m: f64) -> Self {
        let scale = self.arm_length_m.map_or(1.0, |it| (length_m / it).min(1.0));
        let [passage_distance_m, passage_height_m] =
            [self.passage_distance_m, self.passage_height_m].map(|range| range.scaled(scale));
        Self { passage_distance_m, passage_height_m, ..*self }
    }

    /// Position and velocity of a release.
    ///
    /// Without wind the flight is in a vertical plane. It touches the cylinder of radius r about the axis
    /// where it is nearest: seen from above, at the point of the circle whose tangent goes through the
    /// release, acos(r/d) away from it. That point, its height and the time are drawn, so drag is met by
    /// aiming; wind blows the flight off that point, and so do other aerodynamic forces.
    pub fn draw(&self, conditions: &Conditions, draws: &mut Draws) -> (Point3<f64>, Vector3<f64>) {
        let azimuth = draws.between(self.azimuth_deg.0).to_radians();
        let distance = draws.between(self.distance_m.0);
        let at = |radius: f64, azimuth: f64, height: f64| {
            Point3::new(radius * libm::cos(azimuth), radius * libm::sin(azimuth), height)
        };
        let p_WO = at(distance, azimuth, draws.between(self.height_m.0));
        let radius = draws.between(self.passage_distance_m.0);
        let turn = libm::acos(radius / distance);
        let passage_azimuth = match self.side {
            Side::Clockwise => azimuth - turn,
            Side::Counterclockwise => azimuth + turn,
        };
        let target_W = at(radius, passage_azimuth, draws.between(self.passage_height_m.0));
        let mut calm = conditions.clone();
        calm.wind_mps = Vector3::zeros();
        (p_WO, aimed(p_WO, target_W, draws.between(self.passage_s.0), &calm))
    }
}

/// No throw is faster.
const MOST_SPEED_MPS: f64 = 200.0;

/// The velocity with which a flight that begins at `p_WO` is at `target_W` after `time_s`: that of a
/// parabola, corrected by what the flight with drag misses the target by until it does not. A target that no
/// throw reaches through the air leaves the parabola.
fn aimed(p_WO: Point3<f64>, target_W: Point3<f64>, time_s: f64, conditions: &Conditions) -> Vector3<f64> {
    let parabola = (target_W - p_WO) / time_s - dynamics::gravity() * (time_s / 2.0);
    let mut v_WO = parabola;
    for _ in 0..20 {
        let miss = target_W - flown(p_WO, v_WO, time_s, conditions).0;
        v_WO += miss / time_s;
        let speed_mps = v_WO.norm();
        if speed_mps > MOST_SPEED_MPS || speed_mps.is_nan() {
            return parabola;
        }
        if miss.norm() < 1e-9 {
            break;
        }
    }
    v_WO
}

/// Position and velocity of a flight after `time_s`, by steps of the midpoint rule.
pub(super) fn flown(
    mut p_WO: Point3<f64>,
    mut v_WO: Vector3<f64>,
    time_s: f64,
    conditions: &Conditions,
) -> (Point3<f64>, Vector3<f64>) {
    const STEPS: u32 = 200;
    let step_s = time_s / f64::from(STEPS);
    let acceleration = |v_WO: &Vector3<f64>| dynamics::gravity() + conditions.drag_mps2(v_WO);
    for _ in 0..STEPS {
        let middle = v_WO + acceleration(&v_WO) * (step_s / 2.0);
        p_WO += middle * step_s;
        v_WO += acceleration(&middle) * step_s;
    }
    (p_WO, v_WO)
}
