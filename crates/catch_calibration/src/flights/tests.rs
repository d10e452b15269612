use catch_body::{Pose, free_flight::ballistic::Motion};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::{
    CameraState, Sighting,
    equations::{FlightState, OF_CAMERA, OF_TILT, Row, Seen, law},
};
use crate::coarse::moved;

const TILT_RAD: [f64; 2] = [0.002, -0.001];

fn cameras() -> Vec<CameraState> {
    let X_WC = |p: [f64; 3], turn: [f64; 3]| {
        Pose::from_parts(Vector3::from(p).into(), UnitQuaternion::from_scaled_axis(Vector3::from(turn)))
    };
    let state =
        |X_WC| CameraState { X_WC, depth_scale: 0.003, time_offset_s: 0.002, offset: Vector3::new(1e-4, 2e-4, 3e-3) };
    vec![state(X_WC([1.5, -1.0, 2.0], [-2.3, 0.4, 0.2])), state(X_WC([-1.0, -0.5, 0.5], [-1.2, 0.9, 0.1]))]
}

fn flight(cameras: &[CameraState]) -> FlightState {
    let law = law(0.03, TILT_RAD);
    let start = Motion::new(Vector3::new(0.2, 2.0, 1.0), Vector3::new(0.5, -3.0, 3.0));
    let seen = (0..20).map(|i| {
        let (camera, time_s) = (i % 2, 0.04 * i as f64);
        let p_W = start.after(time_s, &law, true).p;
        let p_C = cameras[camera].X_WC.inverse_transform_point(&p_W.into()).coords;
        let covariance_C = Matrix3::new(1.0, 0.3, 0.1, 0.3, 2.0, 0.2, 0.1, 0.2, 9.0) * 1e-6;
        Seen::new(Sighting { camera, capture_s: time_s, p_C, covariance_C }).unwrap()
    });
    FlightState::new(seen.collect(), cameras).unwrap()
}

fn check(derivative: &dyn Fn(&Row) -> Vector3<f64>, rows: &[Row], [less, more]: [Vec<Row>; 2], step: f64, about: &str) {
    for ((row, less), more) in rows.iter().zip(&less).zip(&more) {
        let found = -(more.residual - less.residual) / (2.0 * step);
        let expected = derivative(row);
        assert!((found - expected).norm() < 1e-5 * (1.0 + expected.norm()), "{about}: {found} instead of {expected}");
    }
}

/// All derivatives of the residuals are those of finite differences.
#[test]
fn derivatives_of_a_sighting_are_those_of_finite_differences() {
    const STEP: f64 = 1e-6;
    let (cameras, signs) = (cameras(), [-STEP, STEP]);
    let flight = flight(&cameras);
    let rows = flight.rows(&cameras, TILT_RAD);
    for parameter in 0..OF_CAMERA {
        let changed = signs.map(|step| {
            let mut cameras = cameras.clone();
            for camera in &mut cameras {
                let mut by = [0.0; 6];
                match parameter {
                    0..6 => by[parameter] = step,
                    6 => camera.depth_scale += step,
                    7 => camera.time_offset_s += step,
                    _ => camera.offset[parameter - 8] += step,
                }
                camera.X_WC *= moved(&Vector3::new(by[3], by[4], by[5]), &Vector3::new(by[0], by[1], by[2]));
            }
            flight.rows(&cameras, TILT_RAD)
        });
        check(&|it| it.by_common.column(parameter).into(), &rows, changed, STEP, &format!("camera {parameter}"));
    }
    for axis in 0..OF_TILT {
        let changed = signs.map(|step| {
            let mut tilt_rad = TILT_RAD;
            tilt_rad[axis] += step;
            flight.rows(&cameras, tilt_rad)
        });
        check(&|it| it.by_common.column(OF_CAMERA + axis).into(), &rows, changed, STEP, &format!("tilt {axis}"));
    }
    for parameter in 0..7 {
        let changed = signs.map(|step| flight.changed(parameter, step).rows(&cameras, TILT_RAD));
        check(&|it| it.by_own.column(parameter).into(), &rows, changed, STEP, &format!("flight {parameter}"));
    }
}
