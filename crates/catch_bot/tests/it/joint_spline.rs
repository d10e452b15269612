//! Splines of one joint.

use catch_body::{JointVector, quadratic_program::ProgramFailure, robot::JointLimits};
use catch_bot::trajectory_optimization::joint_spline::{End, EndKind, Ends, JointSpline, JointState, Onset};
use catch_cell::BSpline;
use proptest::prelude::*;

const LIMITS: JointLimits =
    JointLimits { lower: -2.0, upper: 2.0, velocity: 1.5, acceleration: 9.0, torque: 100.0, jerk: None };

/// The highest speed shortly before the end of a motion, and the last span of its duration.
const LAST_SPEED: f64 = 1.2;
const LAST_SPAN: f64 = 0.5 / 7.0;

const MOVING: Ends = Ends { start_acceleration: true, end: EndKind::At };

fn as_spline(spline: &JointSpline, points: &[f64], duration_s: f64) -> BSpline {
    BSpline {
        knots_s: spline.knots.iter().map(|knot| knot * duration_s).collect(),
        control_points: points[..spline.control_points].iter().map(|&value| JointVector::from_element(value)).collect(),
    }
}

proptest! {
    #[test]
    fn solved_splines_meet_their_ends_and_keep_their_limits(
        q in -1.5f64..1.5, dq in -1.0f64..1.0, ddq in -5.0f64..5.0,
        to in -1.5f64..1.5, at in -1.0f64..1.0, duration in 0.1f64..0.8,
    ) {
        let start = JointState { q, dq, ddq };
        for (spline, end) in [
            (JointSpline::new(&[0.4, 0.6, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5], MOVING, 0.1, 0.01), End::At { q: to, dq: at, ddq: [-20.0, 3.0], last_speed: LAST_SPEED }),
            (JointSpline::new(&[1.0; 6], Ends { end: EndKind::Rest, ..MOVING }, 0.0, 0.0), End::Rest),
        ] {
            let Ok(points) = spline.solve(&start, &end, duration, &LIMITS, 0.0) else { continue };
            let curve = as_spline(&spline, &points, duration);
            let near = |value: f64, wanted: f64| (value - wanted).abs() < 1e-8 * (1.0 + wanted.abs());
            let [a, b, c] = curve.evaluate(0.0).map(|it| it[0]);
            prop_assert!(near(a, q) && near(b, dq) && near(c, ddq));
            let [a, b, c] = curve.evaluate(duration).map(|it| it[0]);
            match end {
                End::At { q, dq, ddq, .. } => prop_assert!(near(a, q) && near(b, dq) && c <= ddq[1] + 1e-8),
                End::Extreme { .. } => unreachable!(),
                End::Rest => prop_assert!(b.abs() < 1e-8 && c.abs() < 1e-6),
            }
            for i in 0..=400 {
                let [q, dq, ddq] = curve.evaluate(duration * f64::from(i) / 400.0).map(|it| it[0]);
                prop_assert!(q.abs() <= LIMITS.upper * (1.0 + 1e-9));
                let is_last = matches!(end, End::At { .. }) && f64::from(i) >= 400.0 * (1.0 - LAST_SPAN);
                let most = if is_last { LAST_SPEED } else { LIMITS.velocity };
                prop_assert!(dq.abs() <= most * (1.0 + 1e-9));
                prop_assert!(ddq.abs() <= LIMITS.acceleration * (1.0 + 1e-8));
            }
        }
    }
}

proptest! {
    /// With a limit of the jerk every spline keeps it, whatever its ends, and without one it is the same as
    /// if it were high.
    #[test]
    fn solved_splines_keep_a_limit_of_the_jerk(
        q in -1.5f64..1.5, dq in -1.0f64..1.0, ddq in -5.0f64..5.0,
        to in -1.5f64..1.5, at in -1.0f64..1.0, duration in 0.1f64..0.8, most in 50.0f64..5000.0, sign in 0..2,
    ) {
        let start = JointState { q, dq, ddq };
        let limits = JointLimits { jerk: Some(most), ..LIMITS };
        let spans = [0.4, 0.6, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5];
        let free = Ends { end: EndKind::Position, ..MOVING };
        let onset = Some(Onset { duration_s: 0.01, velocity: 1.5 });
        for (spline, end) in [
            (JointSpline::new(&spans, MOVING, 0.1, 0.01), End::At { q: to, dq: at, ddq: [-20.0, 3.0], last_speed: LAST_SPEED }),
            (JointSpline::new(&spans, free, 0.1, 0.0), End::Extreme { q: to, sign: f64::from(2 * sign - 1), last_speed: LAST_SPEED, onset }),
            (JointSpline::new(&[1.0; 6], Ends { end: EndKind::Rest, ..MOVING }, 0.0, 0.0), End::Rest),
        ] {
            let unlimited = spline.solve(&start, &end, duration, &LIMITS, 0.0);
            let lenient = JointLimits { jerk: Some(1e12), ..LIMITS };
            prop_assert_eq!(&unlimited, &spline.solve(&start, &end, duration, &lenient, 0.0));
            let Ok(points) = spline.solve(&start, &end, duration, &limits, 0.0) else { continue };
            let curve = as_spline(&spline, &points, duration);
            for [start_s, end_s] in curve.spans() {
                let [one, two] = [start_s, end_s].map(|time_s| curve.evaluate(time_s)[2][0]);
                let jerk = (two - one) / (end_s - start_s);
                prop_assert!(jerk.abs() <= most * (1.0 + 1e-7), "{} of {}", jerk, most);
            }
        }
    }

    /// The extreme velocity is one that a motion has, and no motion has a higher one.
    #[test]
    fn no_motion_is_faster_than_the_extreme(
        q in -1.0f64..1.0, dq in -1.0f64..1.0, by in -0.5f64..0.5, duration in 0.2f64..0.8, sign in 0..2,
    ) {
        let sign = f64::from(2 * sign - 1);
        let start = JointState { q, dq, ddq: 0.0 };
        let spans = [1.0; 8];
        let free = JointSpline::new(&spans, Ends { start_acceleration: false, end: EndKind::Position }, 0.1, 0.0);
        let given = JointSpline::new(&spans, Ends { start_acceleration: false, end: EndKind::At }, 0.1, 0.0);
        let to = q + by;
        let Ok(points) = free.solve(&start, &End::Extreme { q: to, sign, last_speed: f64::INFINITY, onset: None }, duration, &LIMITS, 0.0) else {
            for step in -15..=15 {
                let end = End::At { q: to, dq: f64::from(step) * 0.1, ddq: [-99.0, 99.0], last_speed: f64::INFINITY };
                prop_assert!(given.solve(&start, &end, duration, &LIMITS, 0.0).is_err());
            }
            return Ok(());
        };
        let extreme = as_spline(&free, &points, duration).evaluate(duration)[1][0];
        let at = |dq: f64| given.solve(&start, &End::At { q: to, dq, ddq: [-99.0, 99.0], last_speed: f64::INFINITY }, duration, &LIMITS, 0.0);
        prop_assert!(at(extreme - sign * 1e-6).is_ok() && at(extreme + sign * 1e-4).is_err(), "{extreme}");
    }
}

#[test]
fn a_gentle_motion_has_a_solution_and_an_impossible_one_has_none() {
    let spline = JointSpline::new(&[1.0; 9], MOVING, 0.1, 0.0);
    let start = JointState { q: 0.0, dq: 0.0, ddq: 0.0 };
    assert!(
        spline
            .solve(&start, &End::At { q: 0.3, dq: 0.2, ddq: [-9.0, 9.0], last_speed: f64::INFINITY }, 0.6, &LIMITS, 0.0)
            .is_ok()
    );
    let impossible = End::At { q: 1.5, dq: 0.2, ddq: [-9.0, 9.0], last_speed: f64::INFINITY };
    assert_eq!(spline.solve(&start, &impossible, 0.6, &LIMITS, 0.0), Err(ProgramFailure::Infeasible));
}

/// Bounds on what the start alone dictates enter no program, and hold all the same.
#[test]
fn a_start_beyond_a_limit_has_no_motion() {
    let spline = JointSpline::new(&[1.0; 6], Ends { end: EndKind::Rest, ..MOVING }, 0.0, 0.0);
    let within = JointState { q: 0.0, dq: 0.5, ddq: 1.0 };
    assert!(spline.solve(&within, &End::Rest, 0.5, &LIMITS, 0.0).is_ok());
    let beyond = [
        JointState { q: 1.01 * LIMITS.upper, ..within },
        JointState { dq: 1.01 * LIMITS.velocity, ..within },
        JointState { ddq: -1.01 * LIMITS.acceleration, ..within },
    ];
    for start in beyond {
        assert_eq!(spline.solve(&start, &End::Rest, 0.5, &LIMITS, 0.0), Err(ProgramFailure::Infeasible), "{start:?}");
    }
}
