//! The referee's rule for any cell whose truth is known.

use catch_body::Pose;
use catch_lab::referee::cell_samples::{Contact, TruthSample, why_not_held};
use catch_recording::name_of;
use pyo3::{exceptions::PyTypeError, prelude::*, types::PyDict};

use crate::{
    arguments::{Numbers, fault, joint_vector, number},
    camera::pose,
};

/// Reason why an object was not caught and held, by the rule for the arena's throws; `None` if it was.
/// `samples` are the truth at rising times, a row each: `time_s`, `X_WG` and `X_WO` (poses of gripper and
/// object, 4×4), `width_m` and `commanded_width_m` of the fingers, `dq` of the joints, and `contacts` of the
/// object with left finger, right finger, palm, arm, floor and obstacles (n×6, zero for none). The
/// disturbance test begins at `disturbed_since_s`.
#[pyfunction]
#[pyo3(signature = (samples, disturbed_since_s=None))]
pub fn judge(
    py: Python<'_>,
    samples: &Bound<'_, PyAny>,
    disturbed_since_s: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<String>> {
    let samples = samples.cast::<PyDict>().map_err(|_| PyTypeError::new_err("samples: expected a dict of arrays"))?;
    let mut count = 0;
    let mut read = |field: &str, axes: &[usize]| {
        let argument = format!("samples: {field}");
        let value = samples.get_item(field)?.ok_or_else(|| fault(&argument, "nothing", "an array"))?;
        let numbers = Numbers::read(&argument, &value, &[&[count][..], axes].concat())?;
        count = numbers.shape[0];
        Ok::<_, PyErr>(numbers)
    };
    let times = read("time_s", &[])?.values;
    let (grippers, objects) = (read("X_WG", &[4, 4])?.values, read("X_WO", &[4, 4])?.values);
    let (widths, commanded) = (read("width_m", &[])?.values, read("commanded_width_m", &[])?.values);
    let (speeds, contacts) = (read("dq", &[0])?, read("contacts", &[6])?.values);
    if let Some(at) = (1..times.len()).find(|&i| times[i] <= times[i - 1]) {
        return Err(fault("samples: time_s", format!("{} at index {at}", times[at]), "rising times"));
    }
    let dof = speeds.shape[1];
    if dof > catch_body::MAX_JOINTS {
        return Err(fault("samples: dq", format!("{dof} columns"), "one for each joint of the arm"));
    }
    let poses = |field: &str, values: &[f64]| {
        values.chunks_exact(16).map(|it| pose(&format!("samples: {field}"), it)).collect::<PyResult<Vec<Pose>>>()
    };
    let (grippers, objects) = (poses("X_WG", &grippers)?, poses("X_WO", &objects)?);
    let sample = |i: usize| {
        let touches = |part: usize| contacts[6 * i + part] != 0.0;
        let [left_finger, right_finger, palm, arm, floor, obstacle] = std::array::from_fn(touches);
        TruthSample {
            time_s: times[i],
            X_WG: grippers[i],
            X_WO: objects[i],
            width_m: widths[i],
            commanded_width_m: commanded[i],
            dq: joint_vector(&speeds.values[i * dof..(i + 1) * dof]),
            contact: Contact { left_finger, right_finger, palm, arm, floor, obstacle, peak_impulse_ns: 0.0 },
            ..TruthSample::default()
        }
    };
    let samples = (0..times.len()).map(sample).collect();
    let disturbed_since_s = disturbed_since_s.map(|it| number("disturbed_since_s", it)).transpose()?;
    Ok(py.detach(|| why_not_held(samples, disturbed_since_s)).map(name_of))
}
