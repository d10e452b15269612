//! Whether a track falls as gravity has it.

use catch_lab::own_data::track_file::Sighting;
use nalgebra::{Unit, Vector3};

/// Status of what does not fall.
pub const NO_GRAVITY: &str = "no_gravity";
/// A change of velocity that gravity and air cannot explain, in m/s².
const STRANGE_MPS2: f64 = 8.0;

/// Whether the sightings fall as gravity has it, but for a force against the motion.
pub fn falls(seen: &[Sighting], up: &Unit<Vector3<f64>>) -> Result<(), &'static str> {
    let third = seen.len() / 3;
    let middle = |of: &dyn Fn(&Vector3<f64>) -> f64, all: &[Vector3<f64>]| {
        let mut values: Vec<f64> = all.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (accelerations, velocities): (Vec<_>, Vec<_>) = seen
        .iter()
        .zip(&seen[third..])
        .zip(&seen[2 * third..])
        .map(|((a, b), c)| {
            let (before, after) = ((b.p - a.p) / (b.time_s - a.time_s), (c.p - b.p) / (c.time_s - b.time_s));
            ((after - before) * (2.0 / (c.time_s - a.time_s)), (c.p - a.p) / (c.time_s - a.time_s))
        })
        .unzip();
    let median = |all: &[Vector3<f64>]| Vector3::from_fn(|axis, _| middle(&|it| it[axis], all));
    let acceleration = median(&accelerations);
    let scatter = middle(&|it| (it - acceleration).norm(), &accelerations);
    let mut rest = acceleration + up.into_inner() * 9.81;
    if let Some(along) = median(&velocities).try_normalize(1e-9) {
        rest -= along * along.dot(&rest).min(0.0);
    }
    if rest.norm() > STRANGE_MPS2 + 3.0 * scatter { Err(NO_GRAVITY) } else { Ok(()) }
}
