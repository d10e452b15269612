//! Cubic B-splines of joint positions over time.

use catch_body::{JointVector, quantity};
use serde::{Deserialize, Serialize};

/// Degree of all splines here: position is C², acceleration is piecewise linear.
pub const DEGREE: usize = 3;

/// Position, velocity and acceleration of the joints at one instant.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Setpoint {
    /// Positions in radians.
    pub q: quantity::joint_rad<JointVector>,
    /// Velocities in rad/s.
    pub dq: quantity::joint_radps<JointVector>,
    /// Accelerations in rad/s².
    pub ddq: quantity::joint_radps2<JointVector>,
}

impl Setpoint {
    /// Standing still at `q`.
    pub fn at_rest(q: JointVector) -> Self {
        Self { q, dq: JointVector::zeros(), ddq: JointVector::zeros() }
    }

    /// Distance per joint: the largest difference of positions, velocities or accelerations.
    pub fn distance(&self, other: &Self) -> JointVector {
        (self.q - other.q).abs().sup(&(self.dq - other.dq).abs()).sup(&(self.ddq - other.ddq).abs())
    }
}

/// A clamped cubic B-spline q(t) (de Boor, A Practical Guide to Splines, ch. IX).
///
/// The knots are non-decreasing, the first and the last repeated four times, four more than there are control
/// points. A knot that is repeated three times inside joins two splines.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BSpline {
    /// Knots in seconds on the cell's clock: n + 4 for n control points.
    pub knots_s: quantity::clock_s<Vec<f64>>,
    /// Control points in radians: n, at least four.
    pub control_points: quantity::joint_rad<Vec<JointVector>>,
}

impl BSpline {
    /// First knot.
    pub fn start_s(&self) -> f64 {
        self.knots_s[0]
    }

    /// Last knot.
    pub fn end_s(&self) -> f64 {
        self.knots_s[self.knots_s.len() - 1]
    }

    /// Positions in radians, velocities in rad/s and accelerations in rad/s² at `time_s`, which is clamped to
    /// the spline's domain.
    pub fn evaluate(&self, time_s: f64) -> [JointVector; 3] {
        let (first, weights) = basis(&self.knots_s, time_s);
        weights.map(|row| row.iter().zip(&self.control_points[first..]).map(|(&weight, point)| point * weight).sum())
    }

    /// A spline over one second that stays at `q`.
    pub fn at_rest(start_s: f64, q: JointVector) -> Self {
        let knots_s = [[start_s; 4], [start_s + 1.0; 4]].concat();
        Self { knots_s, control_points: vec![q; 4] }
    }

    /// Set-point of the spline as a motion that ends at rest: the first point before the start; the last one,
    /// standing still, after the end.
    pub fn setpoint(&self, time_s: f64) -> Setpoint {
        if time_s >= self.end_s() {
            return Setpoint::at_rest(self.control_points.last().copied().unwrap_or_default());
        }
        let [q, dq, ddq] = self.evaluate(time_s.max(self.start_s()));
        Setpoint { q, dq, ddq }
    }

    /// The spans between distinct knots: start, end just before the next knot. A knot that is repeated may
    /// let derivatives jump.
    pub fn spans(&self) -> impl Iterator<Item = [f64; 2]> {
        self.knots_s.windows(2).map(|pair| [pair[0], pair[1].next_down()]).filter(|[start_s, end_s]| start_s < end_s)
    }

    /// Returns whether the spline is clamped, its knots and control points fit together, and every number is
    /// finite.
    pub fn is_valid(&self) -> bool {
        let counts = self.control_points.len() > DEGREE && self.knots_s.len() == self.control_points.len() + DEGREE + 1;
        let clamped = |knots_s: &[f64]| knots_s.windows(2).all(|pair| pair[0] == pair[1]);
        counts
            && clamped(&self.knots_s[..=DEGREE])
            && clamped(&self.knots_s[self.control_points.len()..])
            && self.knots_s.iter().all(|knot| knot.is_finite())
            && self.knots_s.windows(2).all(|pair| pair[0] <= pair[1])
            && self.control_points.iter().flat_map(|point| point.iter()).all(|value| value.is_finite())
    }

    /// Appends a spline that begins where this one ends, in time and position.
    pub fn followed_by(mut self, next: &Self) -> Self {
        self.knots_s.pop();
        self.knots_s.extend_from_slice(&next.knots_s[DEGREE + 1..]);
        self.control_points.extend_from_slice(&next.control_points[1..]);
        self
    }
}

/// Values, first and second derivatives at `time` of the four cubic basis functions that do not vanish there,
/// and the index of the first of them.
///
/// Cox–de Boor recursion; derivatives by differences of the lower degrees (Piegl & Tiller, The NURBS Book,
/// A2.2 and eq. 2.9).
pub fn basis(knots: &[f64], time: f64) -> (usize, [[f64; DEGREE + 1]; 3]) {
    let count = knots.len() - DEGREE - 1;
    let time = time.clamp(knots[0], knots[knots.len() - 1]);
    // The last span that begins at or before `time` and is not empty.
    let mut span = knots[..count].partition_point(|&knot| knot <= time).max(DEGREE + 1) - 1;
    while span > DEGREE && knots[span + 1] <= knots[span] {
        span -= 1;
    }

    // Triangles of basis values: `degree[d][j]` is N_{span-d+j, d}(time).
    let mut degree = [[0.0; DEGREE + 1]; DEGREE + 1];
    degree[0][0] = 1.0;
    for d in 1..=DEGREE {
        for j in 0..d {
            let left = knots[span + 1 + j - d];
            let right = knots[span + 1 + j];
            let fraction = degree[d - 1][j] / (right - left);
            degree[d][j] += (right - time) * fraction;
            degree[d][j + 1] += (time - left) * fraction;
        }
    }

    // N'_{i,d} = d·(N_{i,d-1}/(t_{i+d} − t_i) − N_{i+1,d-1}/(t_{i+d+1} − t_{i+1})), here as a map of
    // coefficients.
    let derivative = |lower: &[f64; DEGREE + 1], d: usize| {
        let mut out = [0.0; DEGREE + 1];
        for j in 0..d {
            let width = knots[span + 1 + j] - knots[span + 1 + j - d];
            let fraction = d as f64 * lower[j] / width;
            out[j] -= fraction;
            out[j + 1] += fraction;
        }
        out
    };
    let velocity = derivative(&degree[DEGREE - 1], DEGREE);
    let acceleration = derivative(&derivative(&degree[DEGREE - 2], DEGREE - 1), DEGREE);
    (span - DEGREE, [degree[DEGREE], velocity, acceleration])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spline() -> impl Strategy<Value = BSpline> {
        (prop::collection::vec(0.01f64..0.2, 1..12), prop::collection::vec(-3.0f64..3.0, 15)).prop_map(
            |(spans, values)| {
                let mut knots_s = vec![1.0; 4];
                for span in &spans {
                    knots_s.push(knots_s[knots_s.len() - 1] + span);
                }
                knots_s.extend([knots_s[knots_s.len() - 1]; 3]);
                let control_points = (0..spans.len() + 3).map(|i| JointVector::from_element(values[i])).collect();
                BSpline { knots_s, control_points }
            },
        )
    }

    proptest! {
        #[test]
        fn basis_is_a_partition_of_unity(spline in spline(), at in 0.0f64..=1.0) {
            let time = spline.start_s() + at * (spline.end_s() - spline.start_s());
            let (_, [values, first, second]) = basis(&spline.knots_s, time);
            prop_assert!(values.iter().all(|&value| value >= -1e-15));
            prop_assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(first.iter().sum::<f64>().abs() < 1e-9);
            prop_assert!(second.iter().sum::<f64>().abs() < 1e-6);
        }

        #[test]
        fn derivatives_match_finite_differences(spline in spline(), at in 0.02f64..0.98) {
            let time = spline.start_s() + at * (spline.end_s() - spline.start_s());
            let step = 1e-7;
            let [_, velocity, acceleration] = spline.evaluate(time);
            let [before, before_velocity, _] = spline.evaluate(time - step);
            let [after, after_velocity, _] = spline.evaluate(time + step);
            // Relative to the spline's roughness; a knot within the step bends the acceleration.
            let scale = 1.0 + acceleration.amax();
            prop_assert!(((after - before) / (2.0 * step) - velocity).amax() < 1e-5 * scale);
            prop_assert!(((after_velocity - before_velocity) / (2.0 * step) - acceleration).amax() < 1e-2 * scale);
        }

        #[test]
        fn curve_stays_within_the_hull_of_its_control_points(spline in spline(), at in 0.0f64..=1.0) {
            let time = spline.start_s() + at * (spline.end_s() - spline.start_s());
            let [value, ..] = spline.evaluate(time);
            let bounds = |pick: fn(f64, f64) -> f64| spline.control_points.iter().map(|it| it[0]).reduce(pick).unwrap();
            prop_assert!(value[0] >= bounds(f64::min) - 1e-12 && value[0] <= bounds(f64::max) + 1e-12);
        }
    }

    #[test]
    fn what_does_not_fit_together_is_not_valid() {
        let whole = BSpline::at_rest(1.0, JointVector::from_element(0.5));
        assert!(whole.is_valid());
        let without = |change: &dyn Fn(&mut BSpline)| {
            let mut spline = whole.clone();
            change(&mut spline);
            spline.is_valid()
        };
        assert!(!without(&|it| it.control_points.truncate(3)));
        assert!(!without(&|it| {
            it.control_points.pop();
            it.knots_s.pop();
        }));
        assert!(!without(&|it| it.knots_s.push(2.0)));
        assert!(!without(&|it| it.knots_s[7] = f64::INFINITY));
        assert!(!without(&|it| it.knots_s[4] = 0.9));
        assert!(!without(&|it| it.control_points[3][7] = f64::NAN));
        // The first and the last four knots are the same; others may be repeated.
        assert!(!without(&|it| it.knots_s[3] = 1.1));
        assert!(!without(&|it| it.knots_s[7] = 2.5));
        let with_knots_inside = |inside_s: &[f64]| {
            let knots_s = [&whole.knots_s[..4], inside_s, &whole.knots_s[4..]].concat();
            BSpline { knots_s, control_points: vec![whole.control_points[0]; 6] }.is_valid()
        };
        assert!(with_knots_inside(&[1.5, 1.5]) && !with_knots_inside(&[1.5, 1.4]));
    }

    #[test]
    fn a_motion_stands_still_before_and_after_itself() {
        let point = |value| JointVector::from_element(value);
        let knots_s = vec![1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0];
        let spline = BSpline { knots_s, control_points: [0.0, 0.0, 0.0, 1.0].map(point).to_vec() };
        assert_eq!((spline.start_s(), spline.end_s()), (1.0, 2.0));
        assert_eq!(spline.setpoint(0.0), spline.setpoint(1.0));
        // q = t³: it still moves just before its end, and stands there.
        let last = spline.setpoint(2.0 - 1e-9);
        assert!((last.dq - point(3.0)).amax() < 1e-6 && (last.ddq - point(6.0)).amax() < 1e-6, "{last:?}");
        assert_eq!(spline.setpoint(2.0), Setpoint::at_rest(point(1.0)));
        assert_eq!(spline.setpoint(9.0), Setpoint::at_rest(point(1.0)));
        let resting = BSpline::at_rest(3.0, point(0.7));
        assert_eq!((resting.start_s(), resting.end_s()), (3.0, 4.0));
        assert!((resting.setpoint(3.4).q - point(0.7)).amax() < 1e-15);
    }

    #[test]
    fn spans_lie_between_distinct_knots() {
        let knots_s = vec![0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.0, 1.0];
        let spline = BSpline { knots_s, control_points: vec![JointVector::zeros(); 6] };
        assert_eq!(spline.spans().collect::<Vec<_>>(), [[0.0, 0.5_f64.next_down()], [0.5, 1.0_f64.next_down()]]);
    }

    #[test]
    fn setpoints_differ_by_the_largest_of_all_differences() {
        let zero = Setpoint::at_rest(JointVector::zeros());
        let mut other = zero;
        (other.q[0], other.dq[1], other.ddq[2]) = (-0.1, 0.2, -0.3);
        (other.q[3], other.dq[3]) = (0.5, -0.4);
        for distance in [zero.distance(&other), other.distance(&zero)] {
            assert_eq!(distance.as_slice()[..5], [0.1, 0.2, 0.3, 0.5, 0.0]);
        }
    }

    #[test]
    fn joined_splines_evaluate_like_their_parts() {
        let point = |value| JointVector::from_element(value);
        let first = BSpline {
            knots_s: vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0],
            control_points: [0.0, 0.1, 0.5, 0.9, 1.0].map(point).to_vec(),
        };
        let second = BSpline {
            knots_s: vec![1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0],
            control_points: [1.0, 1.2, 1.4, 1.4].map(point).to_vec(),
        };
        let joined = first.clone().followed_by(&second);
        assert!(joined.is_valid());
        for time in [0.0, 0.3, 0.5, 0.99] {
            assert_eq!(joined.evaluate(time), first.evaluate(time));
        }
        for time in [1.0, 1.5, 2.0] {
            assert_eq!(joined.evaluate(time), second.evaluate(time));
        }
    }
}
