//! Free flight against SciPy and against finite differences; `tests/golden/README.md` says how the numbers
//! were made.

use catch_body::free_flight::{FlyingBody, FreeState, N, PARAMETERS, POINT, ParameterVector, Pushes, V};
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector3};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect()
}

fn state(numbers: &[f64]) -> FreeState {
    let [x, y, z, w] = [6, 7, 8, 9].map(|i| numbers[i]);
    FreeState {
        p: Vector3::from_column_slice(&numbers[..3]),
        v: Vector3::from_column_slice(&numbers[3..6]),
        R: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        w: Vector3::from_column_slice(&numbers[10..13]),
    }
}

fn gravity() -> Pushes {
    Pushes { acceleration: Vector3::z() * -9.81, angular: Vector3::zeros() }
}

/// The midpoint rule's error falls with the square of the step.
#[test]
fn flights_are_those_of_scipy() {
    let golden: Value = serde_json::from_str(include_str!("../golden/free_flight.json")).unwrap();
    for case in golden.as_array().unwrap() {
        let body = FlyingBody::new(&ParameterVector::from_column_slice(&numbers(&case["parameters"])));
        let (start, end) = (state(&numbers(&case["start"])), state(&numbers(&case["end"])));
        let off = |steps: u32| {
            let h = case["duration_s"].as_f64().unwrap() / f64::from(steps);
            let found = (0..steps).fold(start, |state, _| body.step(&gravity(), &state, h));
            found.since(&end)
        };
        let fine = off(14_000);
        assert!(fine.fixed_rows::<6>(0).norm() < 1e-6 && fine.fixed_rows::<6>(6).norm() < 1e-4, "{fine}");
        let (coarse, finer) = (off(350).norm(), off(700).norm());
        assert!((3.0..5.0).contains(&(coarse / finer)), "{coarse} and {finer}");
    }
}

#[test]
fn derivatives_are_those_of_finite_differences() {
    let golden: Value = serde_json::from_str(include_str!("../golden/free_flight.json")).unwrap();
    for case in golden.as_array().unwrap() {
        let parameters = ParameterVector::from_column_slice(&numbers(&case["parameters"]));
        let start = state(&numbers(&case["start"]));
        let (_, analytic) = FlyingBody::new(&parameters).step_with_derivatives(&gravity(), &start, 0.02);
        let points = FlyingBody::new(&parameters).tracked_point_by(&start);
        for i in 0..N {
            let h = 1e-6;
            let at = |sign: f64| {
                let mut change = SVector::<f64, N>::zeros();
                change[i] = sign * h;
                let body = FlyingBody::new(&(parameters + change.fixed_rows::<PARAMETERS>(POINT)));
                let moved = start.moved(&change.fixed_rows::<12>(0).into_owned());
                (body.step(&gravity(), &moved, 0.02), body.tracked_point(&moved))
            };
            let ((more, more_point), (less, less_point)) = (at(1.0), at(-1.0));
            let numeric = more.since(&less) / (2.0 * h);
            assert!((numeric - analytic.column(i)).norm() < 1e-6, "{i}: {numeric} {}", analytic.column(i));
            let position = (more_point.0 - less_point.0) / (2.0 * h) - points.fixed_view::<3, 1>(0, i);
            let velocity = (more_point.1 - less_point.1) / (2.0 * h) - points.fixed_view::<3, 1>(V, i);
            assert!(position.norm() < 1e-7 && velocity.norm() < 1e-6, "{i}: {position} {velocity}");
        }
    }
}

#[test]
fn without_air_momentum_stays_and_positions_follow_a_parabola() {
    let mut parameters = ParameterVector::zeros();
    parameters.fixed_rows_mut::<3>(3).fill(-40.0);
    parameters.fixed_rows_mut::<5>(11).copy_from_slice(&[0.4, -0.6, 0.2, 0.1, -0.3]);
    let body = FlyingBody::new(&parameters);
    let start = FreeState {
        p: Vector3::new(1.0, 2.0, 3.0),
        v: Vector3::new(4.0, 3.0, -5.0),
        R: UnitQuaternion::from_euler_angles(0.3, -0.8, 1.2),
        w: Vector3::new(8.0, -12.0, 5.0),
    };
    let momentum = |state: &FreeState| state.R * (body.inertia * state.w);
    let end = (0..1000).fold(start, |state, _| body.step(&gravity(), &state, 1e-3));
    assert!((momentum(&end) - momentum(&start)).norm() < 1e-2 * momentum(&start).norm());
    assert!((end.p - start.p - start.v + Vector3::z() * 4.905).norm() < 1e-9);
}
