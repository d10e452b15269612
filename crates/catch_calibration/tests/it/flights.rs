//! Cameras whose errors are drawn as their covariance has them, and sightings of flights.

use catch_body::Pose;
use catch_calibration::{
    CAMERA_PARAMETERS, Calibration, CalibrationStatus, CameraCalibration, Residuals,
    flights::{FLIGHT_OFFSET_SD_M, Flight, FlightStatus, OFFSET_SD_M, Refinement, Sighting, TILT_SD_RAD, refine},
};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

/// Quantile of the squared Mahalanobis distance with six degrees of freedom that covers 95 %.
const COVERS_95: f64 = 12.592;
const SD_RAD: f64 = 5e-4;
const SD_M: f64 = 1e-3;
/// Errors that all cameras have in common: a rotation about each axis of W, and a displacement.
const COMMON_SD_RAD: f64 = 5e-4;
const COMMON_SD_M: f64 = 1.5e-3;
const SCALE_SD: f64 = 1e-3;
const TIME_SD_S: f64 = 2e-4;
/// Standard deviations of sightings across and along the line of sight.
const ACROSS_M: f64 = 1e-3;
const ALONG_M: f64 = 0.01;

struct Random(Pcg64);

impl Random {
    fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// N(0, 1), as the sum of twelve uniform numbers.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.0.random_range(-0.5..0.5)).sum()
    }

    fn vector(&mut self, sd: [f64; 3]) -> Vector3<f64> {
        Vector3::from_fn(|i, _| sd[i] * self.normal())
    }
}

/// True values, and what a calibration states of them.
struct World {
    true_poses: Vec<Pose>,
    calibration: Calibration,
    offsets: Vec<Vector3<f64>>,
    tilt: Vector3<f64>,
}

fn looking(from: [f64; 3]) -> Pose {
    let towards = Vector3::new(0.0, 1.0, 1.0) - Vector3::from(from);
    Pose::from_parts(Vector3::from(from).into(), UnitQuaternion::face_towards(&towards, &Vector3::z()))
}

fn moved(rotation: &Vector3<f64>, p: Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(p), UnitQuaternion::from_scaled_axis(*rotation))
}

impl World {
    fn new(cameras: usize, random: &mut Random) -> Self {
        let places = [[1.6, -1.2, 2.0], [-1.0, -0.4, 0.4], [1.5, 1.5, 1.0], [-1.5, 1.0, 1.8]];
        let true_poses: Vec<Pose> = places[..cameras].iter().map(|it| looking(*it)).collect();
        let size = CAMERA_PARAMETERS * cameras;
        let mut by_common = DMatrix::zeros(size, 6);
        let mut covariance = DMatrix::zeros(size, size);
        for (i, X_WC) in true_poses.iter().enumerate() {
            let R_CW = *X_WC.rotation.inverse().to_rotation_matrix().matrix();
            let first = CAMERA_PARAMETERS * i;
            by_common.view_mut((first, 0), (3, 3)).copy_from(&R_CW);
            by_common.view_mut((first + 3, 0), (3, 3)).copy_from(&(R_CW * -X_WC.translation.vector.cross_matrix()));
            by_common.view_mut((first + 3, 3), (3, 3)).copy_from(&R_CW);
            let sds = [SD_RAD, SD_RAD, SD_RAD, SD_M, SD_M, SD_M, SCALE_SD, TIME_SD_S];
            sds.iter().enumerate().for_each(|(at, sd)| covariance[(first + at, first + at)] = sd * sd);
        }
        let common = [COMMON_SD_RAD, COMMON_SD_RAD, COMMON_SD_RAD, COMMON_SD_M, COMMON_SD_M, COMMON_SD_M];
        let common = DMatrix::from_diagonal(&DVector::from_iterator(6, common.map(|it| it * it)));
        covariance += &by_common * common * by_common.transpose();
        let error = covariance.clone().cholesky().unwrap().l() * DVector::from_fn(size, |_, _| random.normal());
        let camera = |i: usize| {
            let first = CAMERA_PARAMETERS * i;
            let by = error.rows(first, CAMERA_PARAMETERS);
            // The true pose is that of the calibration times exp of the error.
            let off = moved(&by.fixed_rows::<3>(0).into(), by.fixed_rows::<3>(3).into());
            CameraCalibration {
                status: CalibrationStatus::Converged,
                X_WC: true_poses[i] * off.inverse(),
                covariance: Matrix6::from_fn(|j, k| covariance[(first + j, first + k)]),
                depth_scale: -by[6],
                time_offset_s: -by[7],
                time_offset_sd_s: Some(TIME_SD_S),
                residuals: Residuals::default(),
            }
        };
        let calibration = Calibration {
            cameras: (0..cameras).map(camera).collect(),
            covariance,
            joint_zero_rad: Vec::new(),
            link_offset_m: Vec::new(),
        };
        let offsets = (0..cameras).map(|_| random.vector(OFFSET_SD_M)).collect();
        let tilt = random.vector([TILT_SD_RAD, TILT_SD_RAD, 0.0]);
        Self { true_poses, calibration, offsets, tilt }
    }

    /// A flight that the cameras see which `sees` names; scale and time offset of all are zero in truth.
    fn flight(&self, random: &mut Random, noise: f64, sees: impl Fn(usize) -> bool) -> Flight {
        let p = Vector3::new(0.0, 3.0, 1.0) + random.vector([0.3, 0.3, 0.2]);
        let v = Vector3::new(0.0, -4.0, 3.5) + random.vector([0.7, 0.7, 0.5]);
        let g = Vector3::new(0.0, 0.0, -9.81);
        let (g, drag_per_m, step_s) = (g + self.tilt.cross(&g), 0.01 + 0.003 * random.normal(), 1e-3);
        let offsets: Vec<Vector3<f64>> = self.offsets.iter().map(|it| it + random.vector(FLIGHT_OFFSET_SD_M)).collect();
        let (mut p, mut v, mut sightings) = (p, v, Vec::new());
        for step in 0..800 {
            for (camera, X_WC) in self.true_poses.iter().enumerate().filter(|(i, _)| step % 12 == 0 && sees(*i)) {
                let q = X_WC.inverse_transform_point(&p.into()).coords;
                let u = q.normalize();
                let covariance_C =
                    Matrix3::identity() * ACROSS_M.powi(2) + u * u.transpose() * (ALONG_M.powi(2) - ACROSS_M.powi(2));
                let by_noise = covariance_C.cholesky().unwrap().l() * random.vector([noise; 3]);
                let by_offset = Vector3::new(offsets[camera].x, offsets[camera].y, 0.0) + u * offsets[camera].z;
                let (capture_s, p_C) = (10.0 + f64::from(step) * step_s, q + by_noise + by_offset);
                sightings.push(Sighting { camera, capture_s, p_C, covariance_C });
            }
            // The midpoint rule.
            let rate = |v: &Vector3<f64>| g - v * (drag_per_m * v.norm());
            let middle = v + rate(&v) * (step_s / 2.0);
            p += middle * step_s;
            v += rate(&middle) * step_s;
        }
        Flight { sightings }
    }

    fn flights(&self, count: usize, random: &mut Random) -> Vec<Flight> {
        (0..count).map(|_| self.flight(random, 1.0, |_| true)).collect()
    }

    fn refined(&self, flights: &[Flight]) -> Refinement {
        refine(&self.calibration, flights)
    }

    /// Error of a camera: rotation, then translation.
    fn error(&self, calibration: &Calibration, camera: usize) -> Vector6<f64> {
        let off = calibration.cameras[camera].X_WC.inv_mul(&self.true_poses[camera]);
        let (r, p) = (off.rotation.scaled_axis(), off.translation.vector);
        Vector6::new(r.x, r.y, r.z, p.x, p.y, p.z)
    }

    /// Squared Mahalanobis distance of all errors over their number.
    fn distance(&self, calibration: &Calibration) -> f64 {
        let mut errors = Vec::new();
        for (i, camera) in calibration.cameras.iter().enumerate() {
            errors.extend(self.error(calibration, i).iter());
            errors.extend([-camera.depth_scale, -camera.time_offset_s]);
        }
        let errors = DVector::from_vec(errors);
        let factor = calibration.covariance.clone().cholesky().unwrap();
        errors.dot(&factor.solve(&errors)) / errors.len() as f64
    }

    /// Distance of the second camera from where it should be, seen by the first: 1 m in front of it.
    fn apart_m(&self, calibration: &Calibration) -> f64 {
        let p_W = self.true_poses[0] * nalgebra::Point3::new(0.0, 0.0, 1.0);
        let seen = |i: usize| calibration.cameras[i].X_WC * self.true_poses[i].inverse_transform_point(&p_W);
        (seen(0) - seen(1)).norm()
    }
}

/// Standard deviation that is claimed of a displacement of all cameras along an axis of W.
fn common_sd_m(calibration: &Calibration, axis: usize) -> f64 {
    let count = calibration.cameras.len();
    let mut by = DVector::zeros(CAMERA_PARAMETERS * count);
    for (i, camera) in calibration.cameras.iter().enumerate() {
        let along_C = camera.X_WC.rotation.inverse() * Vector3::ith(axis, 1.0 / count as f64);
        by.fixed_rows_mut::<3>(CAMERA_PARAMETERS * i + 3).copy_from(&along_C);
    }
    by.dot(&(&calibration.covariance * &by)).sqrt()
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|it| it * it).sum::<f64>() / values.len() as f64).sqrt()
}

/// Errors that cameras do not have in common shrink, what is claimed covers the errors that are left, and
/// what all have in common is still claimed.
#[test]
fn flights_tell_how_cameras_stand_to_each_other_and_claim_no_more() {
    const DRAWS: u64 = 100;
    for (cameras, least_sd_fraction) in [(2, 0.93), (4, 0.93)] {
        let (mut covered, mut distance, mut apart, mut tilts, mut common) = (0, 0.0, [vec![], vec![]], vec![], vec![]);
        for draw in 0..DRAWS {
            let mut random = Random::new(100 * cameras as u64 + 10_000 * draw);
            let world = World::new(cameras, &mut random);
            let found = world.refined(&world.flights(6, &mut random));
            assert_eq!(found.status, FlightStatus::Refined, "{draw}");
            assert_eq!((found.flights, found.sightings), (6, 6 * 67 * cameras));
            for camera in 0..cameras {
                let error = world.error(&found.calibration, camera);
                let covariance = found.calibration.cameras[camera].covariance;
                let is_covered = error.dot(&covariance.cholesky().unwrap().solve(&error)) < COVERS_95;
                covered += usize::from(is_covered);
            }
            distance += world.distance(&found.calibration) / DRAWS as f64;
            apart[0].push(world.apart_m(&world.calibration));
            apart[1].push(world.apart_m(&found.calibration));
            tilts.push((found.tilt_rad[0] - world.tilt.x) / found.tilt_sd_rad[0]);
            let sd = |axis| common_sd_m(&found.calibration, axis) / common_sd_m(&world.calibration, axis);
            common.push(sd(0).min(sd(1)));
        }
        let coverage = covered as f64 / (DRAWS as usize * cameras) as f64;
        let [before, after] = apart.map(|it| root_mean_square(&it));
        let (tilt, common) = (root_mean_square(&tilts), common.iter().fold(f64::INFINITY, |a, b| a.min(*b)));
        assert!((0.9..=0.99).contains(&coverage) && (0.85..1.1).contains(&distance), "{coverage} {distance}");
        assert!(after < 0.6 * before, "{before} {after}");
        assert!((0.8..1.2).contains(&tilt), "{tilt}");
        assert!(common > least_sd_fraction, "{common}");
    }
}

/// A tenth of the sightings are anywhere: the rest says what it would say by itself.
#[test]
fn outliers_do_not_count() {
    let mut random = Random::new(7);
    let world = World::new(2, &mut random);
    let mut flights = world.flights(8, &mut random);
    let mut rest = flights.clone();
    let is_spoilt = |i: usize| i % 10 == 3;
    for (flight, rest) in flights.iter_mut().zip(&mut rest) {
        let mut i = 0..;
        rest.sightings.retain(|_| !is_spoilt(i.next().unwrap()));
        for (i, it) in flight.sightings.iter_mut().enumerate().filter(|(i, _)| is_spoilt(*i)) {
            it.p_C += Vector3::new(0.1, 0.2 + 1e-3 * i as f64, -0.2);
        }
    }
    let [found, expected] = [flights, rest].map(|it| world.refined(&it));
    assert_eq!(found.status, FlightStatus::Refined);
    let spoilt = (found.sightings - expected.sightings) as f64 / found.sightings as f64;
    assert!((found.outlier_fraction - expected.outlier_fraction - spoilt).abs() < 0.01, "{}", found.outlier_fraction);
    for (found, expected) in found.calibration.cameras.iter().zip(&expected.calibration.cameras) {
        let off = expected.X_WC.inv_mul(&found.X_WC);
        let sd = |first| found.covariance.fixed_view::<3, 3>(first, first).trace().sqrt();
        let off_sd = [off.translation.vector.norm() / sd(3), off.rotation.angle() / sd(0)];
        assert!(off_sd.iter().all(|it| *it < 0.05), "{off_sd:?}");
    }
}

/// Noise, however large, makes no claim less certain than before, nor more certain than less noise does.
#[test]
fn noise_that_nobody_said_makes_claims_larger_but_not_larger_than_before() {
    let mut random = Random::new(8);
    let world = World::new(2, &mut random);
    let flights = |noise: f64| -> Vec<Flight> {
        let mut random = Random::new(9);
        (0..8).map(|_| world.flight(&mut random, noise, |_| true)).collect()
    };
    let [little, much] = [1.0, 5.0].map(|noise| world.refined(&flights(noise)));
    assert!((20.0..40.0).contains(&much.variance_factor), "{}", much.variance_factor);
    for i in 0..2 * CAMERA_PARAMETERS {
        let variance = |it: &Calibration| it.covariance[(i, i)];
        assert!(variance(&little.calibration) <= variance(&much.calibration), "{i}");
        assert!(variance(&much.calibration) <= variance(&world.calibration) * (1.0 + 1e-9), "{i}");
    }
}

/// A single camera determines the vertical in its own images.
#[test]
fn a_single_camera_tells_the_vertical() {
    let mut random = Random::new(10);
    let world = World::new(2, &mut random);
    let flights: Vec<Flight> = (0..20).map(|_| world.flight(&mut random, 1.0, |camera| camera == 1)).collect();
    let found = world.refined(&flights);
    assert_eq!((found.status, found.flights), (FlightStatus::Refined, 20));
    // What the flights tell of it beside what a level does.
    let told_sd_rad = found.tilt_sd_rad.map(|it| (it.powi(-2) - TILT_SD_RAD.powi(-2)).sqrt().recip());
    assert!(told_sd_rad.iter().all(|it| *it < 0.005), "{told_sd_rad:?}");
    // The errors in common to the cameras are known better by the first one's camera, too, and that is all.
    let sd = |it: &Calibration| it.cameras[0].covariance.fixed_view::<3, 3>(3, 3).trace().sqrt();
    assert!(sd(&found.calibration) <= sd(&world.calibration) * (1.0 + 1e-9));
}

#[test]
fn flights_that_tell_nothing_change_nothing() {
    let mut random = Random::new(11);
    let world = World::new(2, &mut random);
    let flight = world.flight(&mut random, 1.0, |_| true);
    let spoilt = |spoil: &dyn Fn(&mut Sighting)| {
        let mut flight = flight.clone();
        flight.sightings.iter_mut().for_each(spoil);
        vec![flight]
    };
    let few = Flight { sightings: flight.sightings[..5].to_vec() };
    let useless = [
        vec![],
        vec![Flight::default()],
        vec![few],
        spoilt(&|it| it.p_C.x = f64::NAN),
        spoilt(&|it| it.capture_s = f64::INFINITY),
        spoilt(&|it| it.covariance_C = Matrix3::zeros()),
        spoilt(&|it| it.covariance_C = Matrix3::repeat(f64::NAN)),
        spoilt(&|it| it.p_C = Vector3::zeros()),
        spoilt(&|it| it.capture_s = 1.0),
        spoilt(&|it| it.camera = 7),
    ];
    for (i, flights) in useless.iter().enumerate() {
        let found = world.refined(flights);
        assert_eq!((found.status, found.flights), (FlightStatus::TooFewSightings, 0), "{i}");
        assert_eq!(found.calibration, world.calibration, "{i}");
    }
    let mut failed = world.calibration.clone();
    failed.cameras.iter_mut().for_each(|it| it.status = CalibrationStatus::PoorFit);
    assert_eq!(refine(&failed, std::slice::from_ref(&flight)).status, FlightStatus::TooFewSightings);
    failed.cameras[1].status = CalibrationStatus::Converged;
    let found = refine(&failed, std::slice::from_ref(&flight));
    assert_eq!((found.status, &found.calibration.cameras[0]), (FlightStatus::Refined, &failed.cameras[0]));
    // A single sighting that is none is left out.
    let mut one = flight.clone();
    one.sightings[3].p_C.y = f64::NAN;
    assert_eq!(world.refined(&[one]).sightings, flight.sightings.len() - 1);
}

/// A camera that stands 30 mm from where it is claimed to stand is not refined but contradicted.
#[test]
fn flights_contradict_a_camera_that_was_pushed() {
    let mut random = Random::new(12);
    let mut world = World::new(2, &mut random);
    world.calibration.cameras[0].X_WC.translation.vector.x += 0.03;
    let found = world.refined(&world.flights(8, &mut random));
    assert_eq!(found.status, FlightStatus::Contradicting, "{}", found.change_sd);
    assert_eq!(found.calibration, world.calibration);
}

/// Against `tests/golden/refined_calibration.json`.
#[test]
fn a_refinement_is_that_of_scipy() {
    let golden: Value = serde_json::from_str(include_str!("../golden/refined_calibration.json")).unwrap();
    let numbers = |it: &Value| -> Vec<f64> { it.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect() };
    let pose = |it: &Value| {
        let ([p, r], [x, y, z]) = (["p", "rotation_vector"].map(|key| numbers(&it[key])), [0, 1, 2]);
        moved(&Vector3::new(r[x], r[y], r[z]), Vector3::new(p[x], p[y], p[z]))
    };
    let cameras = golden["cameras"].as_array().unwrap();
    let size = CAMERA_PARAMETERS * cameras.len();
    let camera = |it: &Value| CameraCalibration {
        status: CalibrationStatus::Converged,
        X_WC: pose(it),
        covariance: Matrix6::identity(),
        depth_scale: 0.0,
        time_offset_s: 0.0,
        time_offset_sd_s: None,
        residuals: Residuals::default(),
    };
    let calibration = Calibration {
        cameras: cameras.iter().map(camera).collect(),
        covariance: DMatrix::from_vec(size, size, numbers(&golden["prior_covariance"])),
        joint_zero_rad: Vec::new(),
        link_offset_m: Vec::new(),
    };
    let sighting = |it: &Value| {
        let row = numbers(it);
        let covariance_C = SMatrix::<f64, 3, 3>::from_column_slice(&row[5..14]);
        Sighting { camera: row[0] as usize, capture_s: row[1], p_C: Vector3::new(row[2], row[3], row[4]), covariance_C }
    };
    let flight = |it: &Value| Flight { sightings: it.as_array().unwrap().iter().map(sighting).collect() };
    let flights: Vec<Flight> = golden["flights"].as_array().unwrap().iter().map(flight).collect();
    let found = refine(&calibration, &flights);
    assert_eq!((found.status, found.variance_factor), (FlightStatus::Refined, 1.0));
    for (i, expected) in golden["refined"].as_array().unwrap().iter().enumerate() {
        let (camera, row) = (&found.calibration.cameras[i], CAMERA_PARAMETERS * i);
        let off = pose(expected).inv_mul(&camera.X_WC);
        let (r, p) = (off.rotation.scaled_axis(), off.translation.vector);
        let [scale, time_s] = ["depth_scale", "time_offset_s"].map(|key| expected[key].as_f64().unwrap());
        let off = [r.x, r.y, r.z, p.x, p.y, p.z, camera.depth_scale - scale, camera.time_offset_s - time_s];
        for (axis, (off, sd)) in off.iter().zip(numbers(&expected["sd"])).enumerate() {
            let claimed = found.calibration.covariance[(row + axis, row + axis)].sqrt();
            assert!(off.abs() < 0.01 * sd, "camera {i}, parameter {axis}: {off} off, {sd}");
            assert!((claimed / sd - 1.0).abs() < 0.005, "camera {i}, parameter {axis}: {claimed} instead of {sd}");
        }
    }
    let (tilt, sd) = (numbers(&golden["tilt_rad"]), numbers(&golden["tilt_sd_rad"]));
    for i in 0..2 {
        assert!(
            (found.tilt_rad[i] - tilt[i]).abs() < 0.01 * sd[i] && (found.tilt_sd_rad[i] / sd[i] - 1.0).abs() < 0.005
        );
    }
}
