//! Flights: through a track, or as a brain predicts one.

use catch_body::quantity;
use catch_bot::trajectory_prediction::FlightTrajectory;
use catch_lab::flights::{
    flight::{self, FlightState},
    flight_prediction,
    stretches::axis,
    track_file::Sighting,
};
use catch_recording::name_of;
use nalgebra::{Matrix6, Quaternion, Unit, UnitQuaternion, Vector3};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::{create_exception, exceptions::PyValueError, prelude::*};

use crate::arguments::{Numbers, fault, input_fault, number};

create_exception!(catchingbot, NoFlight, PyValueError, "No flight fits the track; the message says why.");

/// Positions, velocities and angular velocities at most, in SI units.
const MOST: f64 = 1e4;

/// A flight that goes on under gravity and drag, in the axes and on the clock of what it was fitted to.
#[pyclass(frozen, module = "catchingbot")]
pub struct Flight {
    kind: Kind,
}

enum Kind {
    /// Flight through a track, and as planners take it where its z points up.
    Track(Box<flight::Flight>, Option<Box<FlightTrajectory>>),
    /// Flight as a brain predicts it, in W.
    Brain(Box<FlightTrajectory>),
}

impl Flight {
    /// Creates the flight that a brain predicts.
    pub fn of_brain(flight: FlightTrajectory) -> Self {
        Self { kind: Kind::Brain(Box::new(flight)) }
    }

    /// Returns the flight as planners take it.
    pub fn trajectory(&self) -> PyResult<&FlightTrajectory> {
        let expected = "one with z up: predict(t, p, q, up='z')";
        match &self.kind {
            Kind::Brain(flight) | Kind::Track(_, Some(flight)) => Ok(flight),
            Kind::Track(_, None) => Err(fault("flight", "one in other axes", expected)),
        }
    }

    fn state(&self, time_s: f64) -> FlightState {
        match &self.kind {
            Kind::Track(flight, _) => flight.at(time_s),
            Kind::Brain(flight) => FlightState {
                position: flight.pose_at(time_s).translation.vector.into(),
                velocity: flight.twist_at(time_s).linear,
                covariance: flight.covariance_at(time_s),
            },
        }
    }

    /// Numbers of the states at one time or at several, `shape` for each.
    fn numbers<'py>(
        &self,
        t: &Bound<'py, PyAny>,
        shape: &[usize],
        of: impl Fn(&FlightState) -> Vec<f64> + Sync,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let py = t.py();
        let times = Numbers::of_any_shape("t", t)?;
        if times.shape.len() > 1 {
            return Err(fault("t", format!("{} axes", times.shape.len()), "a time or a row of times"));
        }
        let values = py.detach(|| {
            let one = |&time_s: &f64| {
                let state = self.state(time_s);
                let expected = "a time to which the flight can be followed";
                if state.is_finite() { Ok(of(&state)) } else { Err(fault("t", time_s, expected)) }
            };
            times.values.iter().map(one).collect::<PyResult<Vec<_>>>()
        })?;
        PyArray1::from_vec(py, values.concat()).reshape([&times.shape, shape].concat())
    }
}

#[pymethods]
impl Flight {
    /// The flight through position `p` with velocity `v` at `time_s`: orientation `q` as x, y, z, w, angular
    /// velocity `w`, `drag_per_m` for the constant of its drag, and the 6×6 covariance of position and
    /// velocity.
    #[new]
    #[pyo3(signature = (time_s, p, v, *, q=None, w=None, drag_per_m=None, covariance=None))]
    fn new(
        time_s: &Bound<'_, PyAny>,
        p: &Bound<'_, PyAny>,
        v: &Bound<'_, PyAny>,
        q: Option<&Bound<'_, PyAny>>,
        w: Option<&Bound<'_, PyAny>>,
        drag_per_m: Option<&Bound<'_, PyAny>>,
        covariance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let vector = |argument: &str, value: &Bound<'_, PyAny>| {
            let vector = Vector3::from_column_slice(&Numbers::read(argument, value, &[3])?.values);
            if vector.amax() > MOST {
                Err(fault(argument, vector.amax(), format!("at most {MOST}")))
            } else {
                Ok(vector)
            }
        };
        let mut flight = FlightTrajectory {
            time_s: number("time_s", time_s)?,
            p_WOcm: vector("p", p)?.into(),
            v_WOcm: vector("v", v)?,
            error_scale: 1.0,
            ..FlightTrajectory::default()
        };
        if let Some(q) = q {
            flight.R_WO = unit_quaternion(&Numbers::read("q", q, &[4])?.values, "")?;
        }
        if let Some(w) = w {
            flight.w_WO = vector("w", w)?;
        }
        if let Some(drag) = drag_per_m {
            let drag = number("drag_per_m", drag)?;
            flight.drag_per_m = quantity::DRAG_PER_M.check("drag_per_m", "k", drag).map_err(input_fault)?;
        }
        if let Some(covariance) = covariance {
            let known = Matrix6::from_row_slice(&Numbers::read("covariance", covariance, &[6, 6])?.values);
            flight.covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&known);
        }
        Ok(Self::of_brain(flight))
    }

    /// Positions in metres at a time or at several.
    fn at<'py>(&self, t: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.numbers(t, &[3], |state| state.position.coords.as_slice().to_vec())
    }

    /// Velocities in m/s at a time or at several.
    fn velocity<'py>(&self, t: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.numbers(t, &[3], |state| state.velocity.as_slice().to_vec())
    }

    /// Covariance of (position, velocity) at a time or at several, 6×6, in m² and m²/s².
    fn covariance<'py>(&self, t: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.numbers(t, &[6, 6], |state| state.covariance.as_slice().to_vec())
    }

    /// Drag constant k of a = −k·|v|·v in 1/m.
    #[getter]
    fn drag_per_m(&self) -> f64 {
        match &self.kind {
            Kind::Track(flight, _) => flight.drag_per_m()[0],
            Kind::Brain(flight) => flight.drag_per_m,
        }
    }

    /// Sightings or poses that agree with it.
    #[getter]
    fn inliers(&self) -> usize {
        match &self.kind {
            Kind::Track(flight, _) => flight.inliers(),
            Kind::Brain(flight) => flight.inliers,
        }
    }
}

/// The flight through a track: `t` in seconds, `p` in metres (n×3), orientations `q` as x, y, z, w (n×4).
/// `up` is the axis that points up.
#[pyfunction]
#[pyo3(signature = (t, p, q=None, up="z"))]
pub fn predict(
    py: Python<'_>,
    t: &Bound<'_, PyAny>,
    p: &Bound<'_, PyAny>,
    q: Option<&Bound<'_, PyAny>>,
    up: &str,
) -> PyResult<Flight> {
    let seen = sightings(t, p, q)?;
    let axes = ["x", "-x", "y", "-y", "z", "-z"];
    let named = axes.iter().position(|it| *it == up);
    let direction = named.ok_or_else(|| fault("up", format!("'{up}'"), "one of 'x', 'y', 'z', '-x', '-y', '-z'"))?;
    let found = py.detach(|| flight_prediction::predict(&seen, &Unit::new_unchecked(axis(direction)), None));
    let Some(flight) = found.flight else {
        let why = name_of(found.status);
        return Err(NoFlight::new_err(format!(
            "p: no flight fits it ({why}); is `up` right, are they metres and seconds, and nothing but the flight?"
        )));
    };
    let trajectory = (up == "z").then(|| Box::new(flight.trajectory()));
    Ok(Flight { kind: Kind::Track(Box::new(flight), trajectory) })
}

/// A track's samples.
fn sightings(t: &Bound<'_, PyAny>, p: &Bound<'_, PyAny>, q: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Sighting>> {
    let times = Numbers::read("t", t, &[0])?.values;
    let count = times.len();
    let rows = |argument: &str, value: &Bound<'_, PyAny>, columns: usize| {
        let numbers = Numbers::read(argument, value, &[0, columns])?;
        let found = numbers.shape[0];
        if found == count {
            Ok(numbers)
        } else {
            Err(fault(argument, format!("{found} rows"), format!("{count}, as in t")))
        }
    };
    let positions = rows("p", p, 3)?.points();
    let orientations = q.map(|q| rows("q", q, 4)).transpose()?.map(|it| it.values);
    if count < flight_prediction::LEAST_SIGHTINGS {
        return Err(fault("t", format!("{count} times"), format!("{} or more", flight_prediction::LEAST_SIGHTINGS)));
    }
    if let Some(at) = (1..count).find(|&i| times[i] <= times[i - 1]) {
        return Err(fault("t", format!("{} at index {at}", times[at]), format!("a time after {}", times[at - 1])));
    }
    if let Some(far) = positions.iter().find(|it| it.coords.amax() > MOST) {
        return Err(fault("p", far.coords.amax(), format!("at most {MOST}: lengths are in metres")));
    }
    let rotation = |i: usize| -> PyResult<Option<UnitQuaternion<f64>>> {
        let Some(values) = &orientations else { return Ok(None) };
        let row = &values[4 * i..4 * i + 4];
        unit_quaternion(row, &format!(" in row {i}")).map(Some)
    };
    let sighting = |i: usize| Ok(Sighting { time_s: times[i], p: positions[i], rotation: rotation(i)? });
    (0..count).map(sighting).collect()
}

/// An orientation from x, y, z, w; `place` says where they stand.
fn unit_quaternion(values: &[f64], place: &str) -> PyResult<UnitQuaternion<f64>> {
    let quaternion = Quaternion::new(values[3], values[0], values[1], values[2]);
    if (quaternion.norm() - 1.0).abs() > 0.05 {
        let found = format!("a quaternion of length {:.3}{place}", quaternion.norm());
        return Err(fault("q", found, "length 1, in the order x, y, z, w"));
    }
    Ok(UnitQuaternion::from_quaternion(quaternion))
}
