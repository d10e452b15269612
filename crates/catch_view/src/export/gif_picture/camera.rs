//! Camera of the picture.

use catch_body::Pose;
use catch_cell::CameraModel;
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::playback::Playback;

/// Vertical field of view.
const VIEW_RAD: f64 = 0.72;
/// Azimuth from the thrower's direction to the camera.
const AZIMUTH_RAD: f64 = 2.0;
/// Elevation above the horizon.
const ELEVATION_RAD: f64 = 0.24;
/// Fraction of the picture that the throw fills.
const FILL: f64 = 0.84;

/// A camera beside the flight and a little behind the arm, as near as shows all of both.
pub fn beside_the_flight(playback: &Playback, width_px: u16, height_px: u16) -> CameraModel {
    let (from_s, until_s) = (playback.start_s(), playback.flight_end_s());
    let samples = || (0..=20).filter_map(|i| playback.motion_at(from_s + (until_s - from_s) * f64::from(i) / 20.0));
    let seen = playback.ticks.iter().filter_map(|tick| tick.report.pose.map(|pose| pose.X_WO));
    let path: Vec<Point3<f64>> = match playback.ground_truth() {
        Some(_) => samples().filter_map(|it| it.X_WO).map(|X_WO| X_WO.translation.vector.into()).collect(),
        None => seen.map(|X_WO| X_WO.translation.vector.into()).collect(),
    };
    let base = Point3::from(playback.robot.X_WB.translation.vector);
    let mut points: Vec<Point3<f64>> =
        [[-0.2, -0.2], [-0.2, 0.2], [0.2, -0.2], [0.2, 0.2]].map(|[x, y]| base + Vector3::new(x, y, 0.0)).to_vec();
    for sample in samples().step_by(10) {
        points.extend(playback.robot.link_poses(&sample.q).iter().map(|X_WL| Point3::from(X_WL.translation.vector)));
    }
    points.extend(&path);
    let back = path.first().zip(path.last()).map_or_else(Vector3::x, |(first, last)| first - last);
    let azimuth = libm::atan2(back.y, back.x) + AZIMUTH_RAD;
    let away = Vector3::new(
        libm::cos(ELEVATION_RAD) * libm::cos(azimuth),
        libm::cos(ELEVATION_RAD) * libm::sin(azimuth),
        libm::sin(ELEVATION_RAD),
    );
    let mut target = Point3::from(points.iter().map(|it| it.coords).sum::<Vector3<f64>>() / points.len() as f64);
    let mut distance_m = 4.0;
    let camera = |target: &Point3<f64>, distance_m: f64| {
        let X_WC = looking(&(target + away * distance_m), &-away);
        CameraModel::with_field_of_view(X_WC, u32::from(width_px), u32::from(height_px), VIEW_RAD)
    };
    for _ in 0..12 {
        let model = camera(&target, distance_m);
        let seen: Vec<_> =
            points.iter().filter_map(|p_W| model.project(&model.X_WC.inverse_transform_point(p_W))).collect();
        let range = |values: &dyn Fn(usize) -> f64| {
            let all = || (0..seen.len()).map(values);
            (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max))
        };
        let (left, right) = range(&|i| seen[i].x);
        let (top, bottom) = range(&|i| seen[i].y);
        let metres = distance_m / model.focal_px;
        let offset_C = Vector3::new(
            (f64::midpoint(left, right) - model.principal_px[0]) * metres,
            (f64::midpoint(top, bottom) - model.principal_px[1]) * metres,
            0.0,
        );
        target += model.X_WC.rotation * offset_C;
        let fill = ((right - left) / f64::from(width_px)).max((bottom - top) / f64::from(height_px)) / FILL;
        distance_m = (distance_m * fill).clamp(0.8, 20.0);
    }
    camera(&target, distance_m)
}

/// A camera's pose: z along `forward`, x to the right, the image upright.
fn looking(from: &Point3<f64>, forward: &Vector3<f64>) -> Pose {
    let right = forward.cross(&Vector3::z()).normalize();
    let R_WC = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, forward.cross(&right), *forward]));
    Pose::from_parts(Translation3::from(from.coords), UnitQuaternion::from_rotation_matrix(&R_WC))
}
