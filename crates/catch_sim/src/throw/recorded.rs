//! Throws as they were recorded, turned about the vertical and moved to where an arm can reach them.

use std::sync::Arc;

use catch_body::{InputError, quantity};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::{Axis, Release, random::Side, random::flown};
use crate::{conditions::Conditions, drawn::Span, random_streams::Draws};

/// State of the centre of mass of a recorded object at one time, in axes whose z points up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedState {
    /// Time since the release, in seconds.
    pub time_s: f64,
    /// Position in metres.
    pub position: Point3<f64>,
    /// Velocity in m/s.
    pub velocity: Vector3<f64>,
    /// Orientation and angular velocity in rad/s, where they were recorded.
    pub rotation: Option<(UnitQuaternion<f64>, Vector3<f64>)>,
}

impl RecordedState {
    /// State rotated by `yaw` about the z axis and moved by `shift` afterwards.
    fn moved(&self, yaw: &UnitQuaternion<f64>, shift: &Vector3<f64>) -> Self {
        Self {
            time_s: self.time_s,
            position: yaw * self.position + shift,
            velocity: yaw * self.velocity,
            rotation: self.rotation.map(|(q, omega)| (yaw * q, yaw * omega)),
        }
    }
}

/// A recorded flight: states whose times rise, the first at the release.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedFlight(Vec<RecordedState>);

impl RecordedFlight {
    /// Creates a flight of one state or more; their times begin with zero and rise. `None` where they do not.
    pub fn new(states: Vec<RecordedState>) -> Option<Self> {
        let begins = states.first().is_some_and(|it| it.time_s == 0.0);
        let rises = states.windows(2).all(|pair| pair[0].time_s < pair[1].time_s);
        (begins && rises).then_some(Self(states))
    }

    /// The states.
    pub fn states(&self) -> &[RecordedState] {
        &self.0
    }

    /// The motion at `time_s` after the release; `None` before it and once the recording has ended. Between
    /// two states the position is the cubic with their velocities, and the orientation follows the shortest
    /// rotation.
    pub fn at(&self, time_s: f64) -> Option<RecordedState> {
        let next = self.0.partition_point(|it| it.time_s <= time_s);
        let (from, to) = (self.0.get(next.checked_sub(1)?)?, self.0.get(next)?);
        let span_s = to.time_s - from.time_s;
        let s = (time_s - from.time_s) / span_s;
        let (way, starts, ends) = (to.position - from.position, from.velocity * span_s, to.velocity * span_s);
        // p(s) = p₀ + a·s + b·s² + c·s³ with the velocities of both ends.
        let (b, c) = (way * 3.0 - starts * 2.0 - ends, starts + ends - way * 2.0);
        let rotation = from.rotation.zip(to.rotation).map(|((q_from, omega_from), (q_to, omega_to))| {
            let q = UnitQuaternion::from_scaled_axis((q_to * q_from.inverse()).scaled_axis() * s) * q_from;
            (q, omega_from.lerp(&omega_to, s))
        });
        Some(RecordedState {
            time_s,
            position: from.position + (starts + (b + c * s) * s) * s,
            velocity: (starts + (b * 2.0 + c * (3.0 * s)) * s) / span_s,
            rotation,
        })
    }

    fn release(&self) -> &RecordedState {
        &self.0[0]
    }
}

/// Flight model of a recorded throw in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightSource {
    /// Flight by the arena's physics, from the recorded release on.
    #[default]
    Released,
    /// Flight along the recorded track until something touches the object or the recording ends, and by the
    /// arena's physics from there on.
    Recorded,
}

/// Recorded throws: the first throw is the first recording, and after the last one they begin anew. Each is
/// turned about the vertical and moved so that it passes the base's axis (x = y = 0) at a drawn distance and
/// height.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct RecordedMotion {
    /// Folder of the recordings, from this file on: CSV files of `t,x,y,z` or `t,x,y,z,qx,qy,qz,qw` in
    /// seconds and metres, in the order of their names. Without orientations every throw draws one, and the
    /// spin of the scenario.
    tracks: String,
    /// Axis of the recordings that points up; the one against which the object accelerates if it is left out.
    up: Option<Axis>,
    /// `"released"`: it flies by the arena's physics from the recorded release on. `"recorded"`: it moves
    /// along the recording until something touches it.
    flight: FlightSource,
    /// Direction of the thrower, seen from the base: counterclockwise from x, in degrees.
    azimuth_deg: quantity::angle_deg<Span>,
    /// Side on which the flight passes.
    side: Side,
    /// Smallest distance of the flight from the base's axis, in metres.
    passage_distance_m: quantity::distance_m<Span>,
    /// Height of the flight there, in metres.
    passage_height_m: quantity::place_m<Span>,
    /// Time of the passage after the release, in seconds; later where the object would have been released
    /// less than 0.2 m above the floor.
    passage_s: quantity::flight_s<Span>,
    /// The length of the arm for which the passage is given; for a shorter arm it is nearer and lower in
    /// proportion.
    arm_length_m: quantity::distance_m,
    /// The recordings.
    #[serde(skip)]
    flights: Vec<RecordedFlight>,
}

impl Default for RecordedMotion {
    /// Passage where an arm of that length can hold a hand in time, as in the throw `random_by_reach`.
    fn default() -> Self {
        Self {
            tracks: ".".to_owned(),
            up: None,
            flight: FlightSource::default(),
            azimuth_deg: Span([15.0, 75.0]),
            side: Side::Clockwise,
            passage_distance_m: Span([0.35, 0.7]),
            passage_height_m: Span([0.3, 1.0]),
            passage_s: Span([0.65, 0.9]),
            arm_length_m: 0.99,
            flights: Vec::new(),
        }
    }
}

/// Reads the recordings that a throw's file names: their folder, and the axis in them that points up if the
/// file names it.
pub type ReadTracks<'a> = &'a dyn Fn(&str, Option<Vector3<f64>>) -> Result<Vec<RecordedFlight>, InputError>;

/// Lowest height of a release, and the latest time of a passage.
const LEAST_RELEASE_M: f64 = 0.2;
const LATEST_PASSAGE_S: f64 = 2.5;
const PASSAGE_STEP_S: f64 = 0.01;

impl RecordedMotion {
    /// Completes the motion by the recordings that `read` finds.
    pub fn with_recordings(self, file: &str, read: ReadTracks) -> Result<Self, InputError> {
        let flights = read(&self.tracks, self.up.map(|it| it.direction().into_inner()))?;
        if flights.is_empty() {
            return Err(InputError::new(file, "motion.tracks", "no recording", "one or more"));
        }
        Ok(Self { flights, ..self })
    }

    /// Adapts the passage of the throws to an arm of this length: nearer where it is shorter.
    pub fn for_arm(&self, length_m: f64) -> Self {
        let scale = (length_m / self.arm_length_m).min(1.0);
        let [passage_distance_m, passage_height_m] =
            [self.passage_distance_m, self.passage_height_m].map(|range| range.scaled(scale));
        Self { passage_distance_m, passage_height_m, ..self.clone() }
    }

    /// The recording number `index`, with the orientation of the object in the axes of the tracked body;
    /// `q_WO` is that of an object whose orientation was not recorded, which then spins as `conditions` say.
    pub fn draw(
        &self,
        conditions: &Conditions,
        draws: &mut Draws,
        index: u64,
        [q_BO, q_WO]: [UnitQuaternion<f64>; 2],
    ) -> Release {
        let count = self.flights.len() as u64;
        let flight = &self.flights[(index % count) as usize];
        let follows = self.flight == FlightSource::Recorded;
        let at = |time_s: f64| {
            if follows && let Some(state) = flight.at(time_s) {
                return (state.position, state.velocity);
            }
            let from = flight.states().last().filter(|_| follows).unwrap_or(flight.release());
            flown(from.position, from.velocity, time_s - from.time_s, conditions)
        };
        let azimuth_rad = draws.between(self.azimuth_deg.0).to_radians();
        let distance_m = draws.between(self.passage_distance_m.0);
        let height_m = draws.between(self.passage_height_m.0);
        let mut time_s = draws.between(self.passage_s.0);
        let release_m = |time_s: f64| height_m + flight.release().position.z - at(time_s).0.z;
        while release_m(time_s) < LEAST_RELEASE_M && time_s < LATEST_PASSAGE_S {
            time_s += PASSAGE_STEP_S;
        }
        // The axis lies beside the passage, at a right angle to the velocity there.
        let (passage, velocity) = at(time_s);
        let along = Vector3::new(velocity.x, velocity.y, 0.0).try_normalize(1e-6).unwrap_or(Vector3::x());
        let outward = match self.side {
            Side::Clockwise => Vector3::new(-along.y, along.x, 0.0),
            Side::Counterclockwise => Vector3::new(along.y, -along.x, 0.0),
        };
        let axis = passage.coords - outward * distance_m;
        let from = flight.release().position.coords - axis;
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth_rad - libm::atan2(from.y, from.x));
        let shift = Vector3::z() * height_m - yaw * Vector3::new(axis.x, axis.y, passage.z);
        let placed = |it: &RecordedState| {
            let state = it.moved(&yaw, &shift);
            RecordedState { rotation: state.rotation.map(|(q_WB, omega)| (q_WB * q_BO, omega)), ..state }
        };
        let first = placed(flight.release());
        let (q_WO, omega_WO) = first.rotation.unwrap_or((q_WO, conditions.spin_radps));
        let path = follows.then(|| Arc::new(RecordedFlight(flight.states().iter().map(placed).collect())));
        Release { p_WO: first.position, v_WO: first.velocity, q_WO, omega_WO, path }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::throw::Throw;
    use approx::assert_relative_eq;
    use catch_body::dynamics::gravity;

    const STEP_S: f64 = 0.02;

    /// A parabola, seen from the release on, the object turning about a fixed axis.
    fn flight(v: Vector3<f64>, duration_s: f64, is_oriented: bool) -> RecordedFlight {
        let omega = Vector3::new(3.0, -5.0, 9.0);
        let state = |i: usize| {
            let t = STEP_S * i as f64;
            RecordedState {
                time_s: t,
                position: (v * t + gravity() * (0.5 * t * t)).into(),
                velocity: v + gravity() * t,
                rotation: is_oriented.then(|| (UnitQuaternion::from_scaled_axis(omega * t), omega)),
            }
        };
        RecordedFlight::new((0..=(duration_s / STEP_S) as usize).map(state).collect()).unwrap()
    }

    fn thrown(settings: &str, is_oriented: bool) -> Throw {
        let text = format!("[motion]\nkind = \"recorded\"\n{settings}");
        let flights =
            [Vector3::new(4.0, 3.0, 4.5), Vector3::new(-6.0, 0.1, 5.5)].map(|v| flight(v, 0.6, is_oriented)).to_vec();
        Throw::from_toml_with("t.toml", &text, &|_, _| Ok(flights.clone())).unwrap()
    }

    fn calm() -> Conditions {
        let text = include_str!("../../../../assets/objects/tennis_ball/truth.toml");
        let object = crate::ThrownObject::from_toml("ball", text, &|_| unreachable!("it names no file")).unwrap();
        Conditions::draw(&crate::ArenaConfig::default(), &object, 0, 0)
    }

    #[test]
    fn between_states_the_motion_is_smooth() {
        let flight = flight(Vector3::new(4.0, 3.0, 4.5), 0.6, true);
        for time_s in [0.0, 0.013, 0.3141, 0.59] {
            let (state, h) = (flight.at(time_s).unwrap(), 1e-6);
            let expected = Vector3::new(4.0, 3.0, 4.5) * time_s + gravity() * (0.5 * time_s * time_s);
            assert_relative_eq!(state.position.coords, expected, epsilon = 1e-9);
            assert_relative_eq!(state.velocity, Vector3::new(4.0, 3.0, 4.5) + gravity() * time_s, epsilon = 1e-9);
            let next = flight.at(time_s + h).unwrap();
            let ((q, omega), (q_next, _)) = (state.rotation.unwrap(), next.rotation.unwrap());
            assert_relative_eq!((q_next * q.inverse()).scaled_axis() / h, omega, epsilon = 1e-4);
        }
        assert!(flight.at(-0.01).is_none() && flight.at(0.6).is_none());
    }

    /// Each passes the axis where it is drawn to, comes from where the thrower stands, and is a rotation of
    /// what was recorded.
    #[test]
    fn throws_pass_within_reach() {
        let conditions = calm();
        for flight in ["released", "recorded"] {
            let throw = thrown(&format!("flight = \"{flight}\""), true);
            for index in 0..40 {
                let release = throw.release("mug", &conditions, 3, index);
                assert_eq!(release, throw.release("mug", &conditions, 3, index));
                assert_eq!(release.path.is_some(), flight == "recorded");
                let nearest = release.p_WO.coords.xy().perp(&release.v_WO.xy().normalize());
                assert!((-0.7..=-0.35).contains(&nearest), "{nearest} m beside the axis, clockwise");
                let azimuth = libm::atan2(release.p_WO.y, release.p_WO.x).to_degrees();
                assert!((15.0..=75.0).contains(&azimuth), "{azimuth}");
                assert!(release.p_WO.z >= LEAST_RELEASE_M - 1e-9);
                let recorded = if index % 2 == 0 { Vector3::new(4.0, 3.0, 4.5) } else { Vector3::new(-6.0, 0.1, 5.5) };
                assert_relative_eq!(release.v_WO.norm(), recorded.norm(), epsilon = 1e-9);
                assert_relative_eq!(release.omega_WO.z, 9.0, epsilon = 1e-9);
            }
        }
        let others = thrown("side = \"counterclockwise\"\npassage_distance_m = [0.2, 0.2]", true);
        let release = others.release("mug", &conditions, 3, 0);
        assert_relative_eq!(release.p_WO.coords.xy().perp(&release.v_WO.xy().normalize()), 0.2, epsilon = 1e-9);
    }

    #[test]
    fn what_was_not_recorded_is_drawn() {
        let conditions = calm();
        let [one, other] = [0, 2].map(|index| thrown("", false).release("mug", &conditions, 3, index));
        assert!(one.q_WO.angle_to(&other.q_WO) > 1e-3);
        assert_eq!(one.omega_WO, conditions.spin_radps);
    }

    #[test]
    fn faults_name_the_field() {
        for (text, field) in [
            ("passage_s = [0.9, 0.6]", "motion.passage_s"),
            ("flight = \"simulated\"", "`released`, `recorded`"),
            ("tracks = \"nowhere\"", "motion.tracks"),
        ] {
            let text = format!("[motion]\nkind = \"recorded\"\n{text}");
            let fault = Throw::from_toml_with("t.toml", &text, &|_, _| Ok(Vec::new())).unwrap_err().to_string();
            assert!(fault.contains(field), "{fault}");
        }
        let fault = Throw::from_toml("t.toml", "[motion]\nkind = \"recorded\"").unwrap_err().to_string();
        assert!(fault.contains("motion.tracks"), "{fault}");
        assert!(RecordedFlight::new(Vec::new()).is_none());
    }
}
