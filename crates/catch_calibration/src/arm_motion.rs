//! Motion of the arm during a session.

use catch_body::JointVector;

/// An arm that rests does so for this long before and after, in seconds.
const AROUND_S: f64 = 0.1;
/// Joints that moved by less than this rest, in radians.
pub(crate) const STILL_RAD: f64 = 1e-3;

/// The arm as its encoders saw it at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSample {
    /// Time of the sample in seconds, on the cell's clock.
    pub time_s: f64,
    /// Joint positions in radians.
    pub q: JointVector,
    /// Joint velocities in rad/s.
    pub dq: JointVector,
    /// Opening of the gripper in metres.
    pub width_m: f64,
}

/// The arm at `time_s`, between samples in the order of their times: cubic Hermite interpolation, and at
/// constant velocity beyond the first and the last. `None` without samples.
pub fn arm_at(samples: &[ArmSample], time_s: f64) -> Option<ArmSample> {
    let after = samples.partition_point(|it| it.time_s <= time_s);
    let Some((from, to)) = after.checked_sub(1).and_then(|before| Some((samples.get(before)?, samples.get(after)?)))
    else {
        let nearest = if after == 0 { samples.first()? } else { samples.last()? };
        return Some(ArmSample { time_s, q: nearest.q + nearest.dq * (time_s - nearest.time_s), ..*nearest });
    };
    let span_s = to.time_s - from.time_s;
    let u = (time_s - from.time_s) / span_s;
    let (u2, u3) = (u * u, u * u * u);
    let blend = 3.0 * u2 - 2.0 * u3;
    let q = from.q * (1.0 - blend) + to.q * blend + (from.dq * (u3 - 2.0 * u2 + u) + to.dq * (u3 - u2)) * span_s;
    let dq = (to.q - from.q) * (6.0 * (u - u2) / span_s)
        + from.dq * (3.0 * u2 - 4.0 * u + 1.0)
        + to.dq * (3.0 * u2 - 2.0 * u);
    Some(ArmSample { time_s, q, dq, width_m: from.width_m + (to.width_m - from.width_m) * u })
}

/// The arm around `time_s`, at which it rests: the mean of the samples within a tenth of a second, which the
/// encoders' noise leaves less uncertain than one of them.
pub fn arm_at_rest(samples: &[ArmSample], time_s: f64) -> Option<ArmSample> {
    let at = arm_at(samples, time_s)?;
    let from = samples.partition_point(|it| it.time_s < time_s - AROUND_S);
    let around = samples[from..].iter().take_while(|it| it.time_s <= time_s + AROUND_S);
    let around: Vec<&ArmSample> = around.filter(|it| (it.q - at.q).amax() < STILL_RAD).collect();
    let count = around.len().max(1) as f64;
    let (q, dq) =
        around.iter().fold((JointVector::zeros(), JointVector::zeros()), |(q, dq), it| (q + it.q, dq + it.dq));
    if around.is_empty() { Some(at) } else { Some(ArmSample { q: q / count, dq: dq / count, ..at }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cubic interpolation of three samples of q = t³ is exact.
    #[test]
    fn a_cubic_motion_is_interpolated_exactly() {
        let sample = |time_s: f64| ArmSample {
            time_s,
            q: JointVector::repeat(time_s.powi(3)),
            dq: JointVector::repeat(3.0 * time_s * time_s),
            width_m: time_s,
        };
        let samples = [sample(0.0), sample(0.4), sample(1.0)];
        for time_s in [0.0, 0.1, 0.4, 0.77, 0.999] {
            let at = arm_at(&samples, time_s).unwrap();
            assert!((at.q - sample(time_s).q).amax() < 1e-12 && (at.dq - sample(time_s).dq).amax() < 1e-12);
            assert!((at.width_m - time_s).abs() < 1e-12);
        }
        assert!((arm_at(&samples, 1.1).unwrap().q[0] - 1.3).abs() < 1e-12);
        assert!(arm_at(&[], 0.0).is_none());
    }
}
