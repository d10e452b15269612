//! Statistical tests of each model of the cameras' errors against its own formula, and of what they may not
//! depend on.

use catch_body::{JointVector, Pose, TriangleMesh, pose::look_at, shape::Cuboid};
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, Vector3};

use crate::{
    depth_noise::{DepthModel, GaussianNoise, StereoNoise},
    drawn::{Between, Drawn},
};

use super::*;

/// A camera that looks at the floor from a height, and its renderer; the object is out of sight, the arm
/// behind it.
struct Wall {
    camera: CameraModel,
    renderer: Renderer,
}

impl Wall {
    /// Image with a depth of `z_m` everywhere, the object and the arm out of sight.
    fn at(z_m: f64) -> Self {
        let X_WC = Pose::from_parts(
            nalgebra::Translation3::new(300.0, 0.0, z_m),
            nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
        );
        Self {
            camera: CameraModel::with_field_of_view(X_WC, 400, 300, 45.0_f64.to_radians()),
            renderer: renderer(&ball(), true),
        }
    }

    /// The images of some exposures.
    fn captured(&self, config: &DepthConfig, exposures: std::ops::Range<u64>) -> Vec<DepthFrame> {
        let cameras = DepthCameras::new(std::slice::from_ref(&self.camera), config, 11, 2);
        let X_WL = iiwa().link_poses(&JointVector::zeros());
        let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::translation(0.0, 0.0, 1.0) };
        let capture = |exposure| captured(&cameras, &self.renderer, &scene, exposure, Readout::Full, false);
        exposures.flat_map(capture).collect()
    }
}

fn config(model: DepthModel) -> DepthConfig {
    DepthConfig { model, ..DepthConfig::default() }
}

/// A small camera with errors of every kind.
fn near_stereo() -> StereoNoise {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/depth_errors/near_stereo.toml");
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Bare stereo.
fn bare() -> DepthModel {
    DepthModel::Stereo(StereoNoise::default())
}

/// Stereo with most of its error common to an image, and pixels that are missing.
fn missing() -> StereoNoise {
    StereoNoise { common_fraction: 0.9, dropout_fraction: 0.1, ..StereoNoise::default() }
}

fn stereo(noise: StereoNoise) -> DepthConfig {
    config(DepthModel::Stereo(noise))
}

/// Standard deviation of a depth, for stereo to first order in the disparity's error.
fn sd_m(model: &DepthModel, z_m: f64, focal_px: f64) -> f64 {
    match model {
        DepthModel::Perfect => 0.0,
        DepthModel::Gaussian(noise) => noise.sd_m,
        DepthModel::Stereo(noise) => noise.inverse_depth_sd_per_m(focal_px) * z_m * z_m,
    }
}

/// Mean and variance of numbers, and how many there are.
fn moments(values: impl Iterator<Item = f64>) -> (f64, f64, f64) {
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for value in values {
        count += 1.0;
        sum += value;
        squares += value * value;
    }
    let mean = sum / count;
    (mean, squares / count - mean * mean, count)
}

/// Models whose pixels are all independent: the variance over an image of a wall has a relative standard
/// error of √(2/n).
#[test]
fn the_spread_of_a_depth_is_that_of_the_formula() {
    let models = [
        DepthModel::Perfect,
        DepthModel::Gaussian(GaussianNoise { sd_m: 0.002 }),
        bare(),
        DepthModel::Stereo(StereoNoise { baseline_m: 0.05, subpixel_px: 0.05, ..StereoNoise::default() }),
    ];
    for model in models {
        for z_m in [0.5, 1.0, 2.0, 4.0, 7.0, 10.0] {
            let wall = Wall::at(z_m);
            let frames = wall.captured(&config(model.clone()), 0..1);
            let depths = || frames[0].depth_m.iter().map(|depth| f64::from(*depth));
            let sd_m = sd_m(&model, z_m, wall.camera.focal_px);
            let (mean, variance, count) = if model.stereo().is_some() {
                // The error of the disparity is the normal one: σ(1/z) = σ(z)/z² exactly, σ(z) itself to
                // first order.
                moments(depths().map(|depth| z_m * z_m * (1.0 / z_m - 1.0 / depth)))
            } else {
                moments(depths().map(|depth| depth - z_m))
            };
            assert_eq!(count, 120_000.0, "{model:?}: no pixel is missing");
            // Single precision rounds depths below 16 m to 0.5 µm at most.
            assert!(mean.abs() < 4.0 * sd_m / count.sqrt() + 1e-6, "{model:?} at {z_m} m: mean {mean}");
            let errors = (variance / (sd_m * sd_m).max(1e-12) - 1.0) / (2.0 / count).sqrt();
            assert!(
                sd_m == 0.0 && variance < 1e-12 || errors.abs() < 4.0,
                "{model:?} at {z_m} m: {variance}, {errors}"
            );
            let (_, plain, _) = moments(depths());
            assert!((plain.sqrt() - sd_m).abs() < 0.01 * sd_m + 1e-6, "{model:?} at {z_m} m: {}", plain.sqrt());
        }
    }
}

/// Images have the fraction `common_fraction` of the variance of the disparity between their means, and the
/// rest within them.
#[test]
fn an_image_has_its_fraction_of_the_error_in_common() {
    const FRAMES: u64 = 4000;
    let z_m = 7.0;
    for common_fraction in [0.0, 0.5, 0.9] {
        let wall = Wall::at(z_m);
        let config = stereo(StereoNoise { common_fraction, ..StereoNoise::default() });
        let cameras = DepthCameras::new(std::slice::from_ref(&wall.camera), &config, 1, 0);
        let X_WL = iiwa().link_poses(&JointVector::zeros());
        let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::translation(0.0, 0.0, 1.0) };
        let window = [PixelWindow { left: 190, top: 140, width: 20, height: 20 }];
        let sd = 0.08 / (wall.camera.focal_px * 0.095);
        let (mut means, mut within) = (Vec::new(), 0.0);
        for exposure in 0..FRAMES {
            let frames = captured(&cameras, &wall.renderer, &scene, exposure, Readout::Windows(&window), false);
            let errors = frames[0].depth_m.iter().map(|depth| (1.0 / f64::from(*depth) - 1.0 / z_m) / sd);
            let (mean, variance, count) = moments(errors);
            means.push(mean);
            within += variance * count / (count - 1.0) / FRAMES as f64;
        }
        let (_, between, count) = moments(means.iter().copied());
        let pixels = window[0].area() as f64;
        let expected = common_fraction + (1.0 - common_fraction) / pixels;
        assert!((between / expected - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{common_fraction}: {between}");
        let own = 1.0 - common_fraction;
        assert!((within / own - 1.0).abs() < 4.0 * (2.0 / (count * pixels)).sqrt(), "{common_fraction}: {within}");
        // One exposure says nothing about the next.
        let serial: f64 = means.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / between / count;
        assert!(serial.abs() < 4.0 / count.sqrt(), "{common_fraction}: {serial}");
    }
}

/// Missing pixels are binomial: their number has the standard deviation √(n·p·(1 − p)).
#[test]
fn the_fraction_of_pixels_is_missing_that_should_be() {
    for dropout_fraction in [0.0, 0.02, 0.1, 1.0] {
        let frames = Wall::at(3.0).captured(&stereo(StereoNoise { dropout_fraction, ..StereoNoise::default() }), 0..5);
        let count = 5.0 * 120_000.0;
        let missing = frames.iter().flat_map(|frame| &frame.depth_m).filter(|depth| depth.is_nan()).count() as f64;
        let sd = f64::sqrt(count * dropout_fraction * (1.0 - dropout_fraction));
        assert!((missing - count * dropout_fraction).abs() <= 4.0 * sd, "{dropout_fraction}: {missing}");
    }
    // A dropped pixel's depth would have been no different from others': noise and dropout are drawn apart.
    let mut noise = StereoNoise { dropout_fraction: 0.5, ..StereoNoise::default() };
    let with = Wall::at(3.0).captured(&stereo(noise.clone()), 0..1);
    noise.dropout_fraction = 0.0;
    let without = Wall::at(3.0).captured(&stereo(noise), 0..1);
    let errors = with[0].depth_m.iter().zip(&without[0].depth_m).filter(|(with, _)| with.is_nan());
    let (mean, variance, count) = moments(errors.map(|(_, without)| f64::from(*without) - 3.0));
    let sd_m = sd_m(&bare(), 3.0, 362.13);
    assert!(mean.abs() < 4.0 * sd_m / count.sqrt() + 1e-4, "{mean}");
    assert!((variance.sqrt() / sd_m - 1.0).abs() < 0.02, "{variance}");
}

/// The missing fraction of a floor seen at an angle rises linearly between the two angles of incidence.
#[test]
fn grazing_surfaces_are_missed() {
    let [from, to] = [60.0_f64.to_radians(), 80.0_f64.to_radians()];
    let noise = StereoNoise { dropout_fraction: 0.1, grazing_rad: Some([from, to]), ..StereoNoise::default() };
    let mut wall = Wall::at(1.0);
    // Looking 70° away from straight down: angles of incidence from 47° to past the horizon.
    let tilt = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 70.0_f64.to_radians());
    wall.camera.X_WC.rotation *= tilt;
    let frames = wall.captured(&stereo(noise), 0..20);
    // Expected and found missing pixels per 5° of incidence.
    let mut bins = [[0.0; 3]; 18];
    for frame in &frames {
        for (pixel, depth) in frame.depth_m.iter().enumerate() {
            let ray_C = wall.camera.back_project(&frame.window.pixel_centre(pixel), 1.0).coords;
            let down = -(wall.camera.X_WC.rotation * ray_C).normalize().z;
            if down <= 0.0 {
                assert!(depth.is_nan());
                continue;
            }
            let incidence = libm::acos(down);
            let fraction = 0.1 + 0.9 * ((incidence - from) / (to - from)).clamp(0.0, 1.0);
            let bin = &mut bins[(incidence.to_degrees() / 5.0) as usize];
            bin[0] += fraction;
            bin[1] += fraction * (1.0 - fraction);
            bin[2] += f64::from(u8::from(depth.is_nan()));
        }
    }
    for (bin, [expected, variance, found]) in bins.iter().enumerate().filter(|(_, bin)| bin[0] > 0.0) {
        assert!((found - expected).abs() <= 4.0 * variance.sqrt() + 0.1, "{}°: {found} of {expected}", bin * 5);
    }
    assert!(bins.iter().filter(|bin| bin[1] > 100.0).count() >= 6);
}

/// Changes of pixels around the contour of a box that faces the camera before a floor: which pixels, how many
/// of them, and into what.
#[test]
fn edges_bleed_and_pixels_fly() {
    const EXPOSURES: u64 = 400;
    let wall = Wall::at(2.0);
    let (bleed_fraction, flying_fraction) = (0.3, 0.2);
    let noise = StereoNoise { subpixel_px: 0.0, edge_px: 2, bleed_fraction, flying_fraction, ..StereoNoise::default() };
    let X_WL = iiwa().link_poses(&JointVector::zeros());
    let X_WO = Pose::translation(300.0, 0.0, 1.2);
    let cuboid = Cuboid { centre: Point3::origin(), size: Vector3::new(0.1, 0.07, 0.02) };
    let renderer = renderer(&TriangleMesh::cuboid(&cuboid), true);
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO };
    let rig = std::slice::from_ref(&wall.camera);
    let exact = exact_images(&renderer, rig, &scene, Readout::Full, true).swap_remove(0);
    let (wide, high) = (400_i64, 300_i64);
    let depth = |x: i64, y: i64| f64::from(exact.depth_m[(y * wide + x) as usize]);
    let cameras = DepthCameras::new(rig, &stereo(noise), 2, 3);
    let window = [PixelWindow { left: 150, top: 90, width: 120, height: 120 }];
    // Of pixels behind an edge and before one: how many there are, how many show the box, how many something
    // between.
    let (mut behind, mut before, mut between) = ([0.0; 3], [0.0; 3], Vec::new());
    for exposure in 0..EXPOSURES {
        let frame = captured(&cameras, &renderer, &scene, exposure, Readout::Windows(&window), true).swap_remove(0);
        for (i, found) in frame.depth_m.iter().map(|depth| f64::from(*depth)).enumerate() {
            let (x, y) = (150 + i as i64 % 120, 90 + i as i64 / 120);
            let around = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
            let around = around.filter(|(x, y)| (0..wide).contains(x) && (0..high).contains(y));
            let (near, far) =
                around.fold((f64::MAX, 0.0_f64), |(near, far), (x, y)| (near.min(depth(x, y)), far.max(depth(x, y))));
            let truth = depth(x, y);
            assert_eq!(frame.mask.as_ref().unwrap()[i], truth < 1.9, "labels tell the truth");
            let unchanged = (found - truth).abs() < 1e-5;
            if near > 1.9 || far < 1.9 {
                assert!(unchanged, "away from edges nothing happens: {found} for {truth}");
                continue;
            }
            let counts = if truth > 1.9 { &mut behind } else { &mut before };
            counts[0] += 1.0;
            let other = if truth > 1.9 { near } else { far };
            if !unchanged && (found - other).abs() < 1e-5 {
                counts[1] += 1.0;
            } else if !unchanged {
                counts[2] += 1.0;
                between.push((1.0 / found - 1.0 / truth) / (1.0 / other - 1.0 / truth));
            }
        }
    }
    let check = |count: f64, fraction: f64, found: f64| {
        let sd = f64::sqrt(count * fraction * (1.0 - fraction));
        assert!((found - count * fraction).abs() <= 4.0 * sd, "{found} of {count}, expected {}", count * fraction);
    };
    assert!(behind[0] > 1e4 && before[0] > 1e4);
    check(behind[0], bleed_fraction, behind[1]);
    check(behind[0], flying_fraction, behind[2]);
    check(before[0], 0.0, before[1]);
    check(before[0], flying_fraction, before[2]);
    // Evenly between: the mean is 1/2 and the variance 1/12, with standard errors of √(1/12n) and √(1/180n).
    let (mean, variance, count) = moments(between.into_iter());
    assert!((mean - 0.5).abs() < 4.0 * (1.0 / 12.0 / count).sqrt(), "{mean}");
    assert!((variance - 1.0 / 12.0).abs() < 4.0 * (1.0 / 180.0 / count).sqrt(), "{variance}");
}

#[test]
fn nothing_is_measured_out_of_range() {
    let noise = StereoNoise { range_m: Some([0.5, 5.0]), ..StereoNoise::default() };
    for (z_m, seen) in [(0.4, 0.0), (2.0, 1.0), (5.0, 0.5), (7.0, 0.0)] {
        let frames = Wall::at(z_m).captured(&stereo(noise.clone()), 0..1);
        let found = frames[0].depth_m.iter().filter(|depth| depth.is_finite()).count() as f64 / 120_000.0;
        assert!((found - seen).abs() < 0.01, "{z_m} m: {found}");
        assert!(frames[0].depth_m.iter().all(|depth| depth.is_nan() || (0.5..=5.0).contains(depth)));
    }
}

/// Images are lost independently: their number is binomial, and so is that of two cameras losing the same
/// exposure.
#[test]
fn the_fraction_of_images_is_lost_that_should_be() {
    const EXPOSURES: u64 = 5000;
    let (fraction, cameras) = (0.05, flight_rig());
    let config = DepthConfig { lost_frame_fraction: fraction, ..DepthConfig::default() };
    let cameras = DepthCameras::new(&cameras, &config, 0, 9);
    let (X_WL, renderer) = (iiwa().link_poses(&JointVector::zeros()), renderer(&ball(), false));
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::translation(0.0, 0.0, 1.0) };
    let nothing = [PixelWindow::default(); 20];
    let (mut lost, mut pairs, mut by_camera) = (0.0, 0.0, [0.0; 20]);
    for exposure in 0..EXPOSURES {
        let frames = captured(&cameras, &renderer, &scene, exposure, Readout::Windows(&nothing), false);
        let missing = 20.0 - frames.len() as f64;
        lost += missing;
        pairs += missing * (missing - 1.0) / 2.0;
        for (camera, count) in by_camera.iter_mut().enumerate() {
            *count += f64::from(u8::from(frames.iter().all(|frame| frame.camera != camera)));
        }
    }
    let check = |count: f64, fraction: f64, found: f64| {
        let sd = f64::sqrt(count * fraction * (1.0 - fraction));
        assert!((found - count * fraction).abs() < 4.0 * sd, "{found} of {count}, expected {}", count * fraction);
    };
    check(EXPOSURES as f64 * 20.0, fraction, lost);
    check(EXPOSURES as f64 * 190.0, fraction * fraction, pairs);
    by_camera.iter().for_each(|found| check(EXPOSURES as f64, fraction, *found));
}

/// Images are lost in bursts: a run of lost ones has the length 1/((1 − p)·(1 − f)) on average, and as many
/// are lost as without.
#[test]
fn images_are_lost_in_bursts() {
    const EXPOSURES: u64 = 4000;
    let rig = flight_rig();
    let (X_WL, renderer) = (iiwa().link_poses(&JointVector::zeros()), renderer(&ball(), false));
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::translation(0.0, 0.0, 1.0) };
    let nothing = [PixelWindow::default(); 20];
    let (fraction, persistence) = (0.1, 0.75);
    let config =
        DepthConfig { lost_frame_fraction: fraction, lost_frame_persistence: persistence, ..DepthConfig::default() };
    let cameras = DepthCameras::new(&rig, &config, 3, 1);
    let (mut lost, mut runs, mut lost_before) = (0.0, 0.0, [false; 20]);
    for exposure in 0..EXPOSURES {
        let frames = captured(&cameras, &renderer, &scene, exposure, Readout::Windows(&nothing), false);
        for (camera, before) in lost_before.iter_mut().enumerate() {
            let is_lost = frames.iter().all(|frame| frame.camera != camera);
            lost += f64::from(u8::from(is_lost));
            runs += f64::from(u8::from(is_lost && !*before));
            *before = is_lost;
        }
    }
    // An image is worth (1 − p)/(1 + p) independent ones.
    let count = EXPOSURES as f64 * 20.0 * (1.0 - persistence) / (1.0 + persistence);
    let found = lost / (EXPOSURES as f64 * 20.0);
    assert!((found - fraction).abs() < 4.0 * (fraction * (1.0 - fraction) / count).sqrt(), "{found}");
    let expected = 1.0 / ((1.0 - persistence) * (1.0 - fraction));
    // The length of a run is geometric, and so has about its mean as standard deviation.
    assert!((lost / runs - expected).abs() < 4.0 * expected / f64::sqrt(runs), "{} {expected}", lost / runs);
}

#[test]
fn depths_have_steps() {
    let depths = DepthConfig { step_m: 0.001, ..config(bare()) };
    let wall = Wall::at(3.0);
    let exact = wall.captured(&config(bare()), 0..1);
    for (stepped, exact) in wall.captured(&depths, 0..1)[0].depth_m.iter().zip(&exact[0].depth_m) {
        let (stepped, exact) = (f64::from(*stepped), f64::from(*exact));
        let steps = stepped / 0.001;
        assert!((steps - steps.round()).abs() < 1e-3, "{stepped}");
        assert!((stepped - exact).abs() < 0.0005, "{stepped} {exact}");
    }
}

/// Over many throws the fraction of the object's pixels that is missing is the one asked for; in one throw
/// the same part of the object is missing in every exposure, and a neighbour of what is missing is mostly
/// missing, too.
#[test]
fn patches_of_the_object_give_no_depth() {
    const THROWS: u64 = 150;
    let fraction = 0.3;
    let centre = Point3::new(1.2, 1.0, 0.8);
    let rig = [Vector3::x(), Vector3::y(), Vector3::new(0.3, 0.2, 1.0)]
        .map(|away| CameraModel::with_field_of_view(look_at(&(centre + away), &centre), 120, 120, 0.1));
    let (X_WL, renderer) = (iiwa().link_poses(&JointVector::zeros()), renderer(&long_object(), false));
    let X_WO = Pose::translation(centre.x, centre.y, centre.z);
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO };
    let config = |fraction| DepthConfig { hole_fraction: fraction, ..DepthConfig::default() };
    let images = |config: &DepthConfig, index, exposure| {
        let cameras = DepthCameras::new(&rig, config, 8, index);
        captured(&cameras, &renderer, &scene, exposure, Readout::Object, true)
    };
    let (mut fractions, mut pairs, mut same) = (Vec::new(), 0.0, 0.0);
    for index in 0..THROWS {
        let frames = images(&config(Drawn::Always(fraction)), index, 0);
        let again = images(&config(Drawn::Always(fraction)), index, 7);
        assert!(frames.iter().zip(&again).all(|(one, two)| bits(one) == bits(two)));
        let (mut shown, mut missing) = (0.0, 0.0);
        for frame in &frames {
            let mask = frame.mask.as_ref().unwrap();
            let is_missing: Vec<bool> = frame.depth_m.iter().map(|it| it.is_nan()).collect();
            shown += mask.iter().filter(|it| **it).count() as f64;
            missing += mask.iter().zip(&is_missing).filter(|(shown, missing)| **shown && **missing).count() as f64;
            for (mask, is_missing) in mask.windows(2).zip(is_missing.windows(2)) {
                if mask[0] && mask[1] && is_missing[0] {
                    pairs += 1.0;
                    same += f64::from(u8::from(is_missing[1]));
                }
            }
        }
        assert!(shown > 1000.0, "{shown}");
        fractions.push(missing / shown);
    }
    let (mean, variance, count) = moments(fractions.iter().copied());
    assert!((mean - fraction).abs() < 4.0 * (variance / count).sqrt(), "{mean} ± {}", variance.sqrt());
    // A patch is some twelve pixels wide; neighbours that are drawn apart would be missing together in 0.3 of
    // all cases.
    assert!(same / pairs > 0.8, "patches are coherent: {}", same / pairs);
    // Without labels the same is missing, and nothing tells.
    let cameras = DepthCameras::new(&rig, &config(Drawn::Always(fraction)), 8, 0);
    let unlabelled = captured(&cameras, &renderer, &scene, 0, Readout::Object, false);
    for (with, without) in images(&config(Drawn::Always(fraction)), 0, 0).iter().zip(&unlabelled) {
        assert_eq!((bits(with), &without.mask), (bits(without), &None));
    }
    // A fraction that is drawn is uniform between its bounds.
    let drawn = config(Drawn::Between(Between { min: 0.0, max: 0.6 }));
    let drawn: Vec<f64> = (0..THROWS)
        .map(|index| {
            let frames = images(&drawn, index, 0);
            let shown = frames.iter().flat_map(|frame| frame.mask.iter().flatten()).filter(|it| **it).count();
            let pixels = frames.iter().flat_map(|frame| frame.depth_m.iter().zip(frame.mask.iter().flatten()));
            pixels.filter(|(depth, shown)| **shown && depth.is_nan()).count() as f64 / shown as f64
        })
        .collect();
    let (mean, drawn_variance, count) = moments(drawn.into_iter());
    assert!((mean - 0.3).abs() < 4.0 * (drawn_variance / count).sqrt(), "{mean}");
    assert!(drawn_variance > variance + 0.5 * 0.36 / 12.0, "{drawn_variance} {variance}");
}

/// Over many scenes each component of a camera's error is normal with the standard deviation asked for.
#[test]
fn calibration_is_off_as_much_as_it_should_be() {
    let (sd_m, sd_rad) = (0.002, 0.05_f64.to_radians());
    let config = DepthConfig { calibration_sd_m: sd_m, calibration_sd_rad: sd_rad, ..DepthConfig::default() };
    let rig = flight_rig();
    let mut components = vec![[0.0; 6]; 0];
    for index in 0..500 {
        let cameras = DepthCameras::new(&rig, &config, 4, index);
        for (calibrated, camera) in rig.iter().zip(cameras.cameras()) {
            let X_CT = calibrated.X_WC.inv_mul(&camera.X_WC);
            let (p, r) = (X_CT.translation.vector / sd_m, X_CT.rotation.scaled_axis() / sd_rad);
            components.push([p.x, p.y, p.z, r.x, r.y, r.z]);
            assert_eq!(CameraModel { X_WC: calibrated.X_WC, ..camera.clone() }, *calibrated, "nothing else differs");
        }
    }
    let count = components.len() as f64;
    for i in 0..6 {
        for j in 0..=i {
            // E[xᵢ·xⱼ] is δᵢⱼ, with a standard error of √2 on the diagonal and 1 beside it.
            let covariance = components.iter().map(|x| x[i] * x[j]).sum::<f64>() / count;
            let (expected, spread) = if i == j { (1.0, f64::sqrt(2.0)) } else { (0.0, 1.0) };
            assert!((covariance - expected).abs() < 4.0 * spread / count.sqrt(), "{i} {j}: {covariance}");
        }
        let within = components.iter().filter(|x| x[i].abs() < 1.0).count() as f64 / count;
        assert!((within - 0.6827).abs() < 4.0 * f64::sqrt(0.6827 * 0.3173 / count), "{i}: {within}");
    }
    let none = DepthCameras::new(&rig, &DepthConfig::default(), 4, 0);
    assert_eq!(none.cameras(), rig);
}

/// All that a scenario can switch on.
fn every_model() -> Vec<DepthConfig> {
    let wild = StereoNoise {
        edge_px: 3,
        bleed_fraction: 0.3,
        flying_fraction: 0.3,
        grazing_rad: Some([0.7, 1.2]),
        range_m: Some([0.3, 7.2]),
        ..StereoNoise::default()
    };
    let models = [
        DepthModel::Perfect,
        DepthModel::Gaussian(GaussianNoise { sd_m: 0.002 }),
        bare(),
        DepthModel::Stereo(missing()),
        DepthModel::Stereo(near_stereo()),
        DepthModel::Stereo(wild),
    ];
    let with_losses = |model| DepthConfig {
        model,
        lost_frame_fraction: 0.05,
        lost_frame_persistence: 0.5,
        hole_fraction: Drawn::Always(0.2),
        step_m: 0.001,
        calibration_sd_m: 0.002,
        calibration_sd_rad: 0.001,
        ..DepthConfig::default()
    };
    models.into_iter().map(with_losses).collect()
}

#[test]
fn with_any_model_a_window_equals_that_part_of_the_full_image_bit_for_bit() {
    let robot = iiwa();
    let rig = flight_rig();
    for config in every_model() {
        for floor_visible in [false, true] {
            let renderer = renderer(&long_object(), floor_visible);
            let (q, width_m, X_WO) = &scenes()[3];
            let scene = Scene { capture_s: 0.3, X_WL: robot.link_poses(q), width_m: *width_m, X_WO: *X_WO };
            let cameras = DepthCameras::new(&rig, &config, 5, 6);
            let full = captured(&cameras, &renderer, &scene, 17, Readout::Full, true);
            let windows: Vec<PixelWindow> = (0..20)
                .map(|i| PixelWindow { left: 20 * i, top: 15 * i, width: 60 + i, height: 80 })
                .chain([PixelWindow { left: 170, top: 130, width: 1, height: 1 }])
                .collect();
            let off_the_object: Vec<PixelWindow> =
                windows.iter().map(|window| PixelWindow { top: 90, ..*window }).collect();
            let single = vec![PixelWindow { left: 195, top: 120, width: 1, height: 1 }; 20];
            // Asked of a copy, after other exposures and other windows.
            let again = DepthCameras::new(&rig, &config, 5, 6);
            for readout in [
                Readout::Windows(&single),
                Readout::Object,
                Readout::Windows(&windows),
                Readout::Windows(&off_the_object),
            ] {
                captured(&again, &renderer, &scene, 3, readout, false);
                let part = captured(&again, &renderer, &scene, 17, readout, true);
                assert_eq!(part.len(), full.len(), "the same images are lost");
                for (frame, full) in part.iter().zip(&full) {
                    let expected = cut(full, frame.window);
                    assert_eq!(bits(frame), bits(&expected), "{config:?}");
                    assert_eq!((&frame.mask, frame.camera), (&expected.mask, expected.camera));
                }
            }
        }
    }
}

/// Neither another seed, index, camera nor exposure shows the same noise.
#[test]
fn every_camera_exposure_and_scene_has_noise_of_its_own() {
    let wall = Wall::at(2.0);
    let rig = vec![wall.camera.clone(); 2];
    let X_WL = iiwa().link_poses(&JointVector::zeros());
    let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: Pose::translation(0.0, 0.0, 1.0) };
    let window = [PixelWindow { left: 0, top: 0, width: 50, height: 50 }; 2];
    let errors = |seed, index, exposure| {
        let cameras = DepthCameras::new(&rig, &stereo(missing()), seed, index);
        captured(&cameras, &wall.renderer, &scene, exposure, Readout::Windows(&window), false)
    };
    let mut all = Vec::new();
    for (seed, index, exposure) in [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)] {
        all.extend(errors(seed, index, exposure));
    }
    for (i, one) in all.iter().enumerate() {
        for two in &all[..i] {
            let same = one.depth_m.iter().zip(&two.depth_m).filter(|(a, b)| a == b).count();
            assert!(same < 3, "{same} of 2500 pixels are the same");
        }
    }
}
