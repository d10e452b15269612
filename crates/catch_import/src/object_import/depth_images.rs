//! An object of which there are depth images, and a rig file with the cameras that took them.

use std::path::{Path, PathBuf};

use catch_body::{InputError, statistics::median_in_place};
use catch_bot::perception::ReferenceModel;
use catch_cell::{CameraModel, DepthFrame, ReferenceScan, rig_from_toml};
use nalgebra::Point3;

use super::scan::{self, Scanned};
use catch_lab::png;
use catch_recording::bounded_file::{FileKind, paths_in};

/// The file that makes a folder of images a scan: poses in the frame R, whose origin is in or near the
/// object.
pub(super) const RIG: &str = "rig.toml";
/// A millimetre is what a depth of 1 means, unless the scale is given.
const UNIT_M: f64 = 1e-3;
/// Distance from the origin of R beyond which a point is behind the object.
const OBJECT_WITHIN_M: f64 = 0.3;
/// Pixels to either side over which depths are smoothed.
const SMOOTHING_PX: isize = 2;
/// Distance of the mean of two depths from that of the pixel between beyond which they are on another
/// surface.
const SMOOTH_M: f64 = 0.002;
/// Pixels of an image that are compared with the other images.
const COMPARED: usize = 2_000;
/// A camera that sees something this much farther looks through what another one sees.
const THROUGH_M: f64 = 0.01;
/// Greatest fraction of the pixels that may look through what another camera sees, at edges and by wrong
/// depths; and of those of one image that others look through, or see nothing of, beyond what is usual.
const MOST_CONTRADICTING: f64 = 0.15;
/// Where this fraction is usual, no pose is right.
const MOST_USUAL: f64 = 0.5;
/// An image, by its extension.
const IMAGE: FileKind = FileKind::geometry("a depth image: a PNG file with 16 bits of gray");

/// The surface that the images of a folder show, in units of `scale` metres if that is given, else in metres.
///
/// # Errors
/// A fault of the rig or an image, another number of images than of cameras, no object at the origin.
pub(super) fn surface(folder: &Path, scale: Option<f64>) -> Result<Scanned, InputError> {
    let named = folder.display().to_string();
    let rig = folder.join(RIG);
    let text = FileKind::toml("the cameras of the scan").read_text(&rig)?;
    let cameras = rig_from_toml(&rig.display().to_string(), &text)?;
    let images = images(folder)?;
    if images.len() != cameras.len() {
        let expected = format!("{}: one for each camera of {RIG}, in the order of their names", cameras.len());
        return Err(InputError::new(&named, "images", format!("{} PNG files", images.len()), expected));
    }
    let mut frames = Vec::new();
    for (index, (camera, path)) in cameras.iter().zip(&images).enumerate() {
        let (file, size) = (path.display().to_string(), [camera.width_px, camera.height_px]);
        let depths = png::gray16_values(&file, &IMAGE.read(path)?, size)?;
        frames.push(frame(index, camera, &depths, scale.unwrap_or(UNIT_M)));
    }
    check_depths(&named, &cameras, &frames)?;
    let files: Vec<_> = images.iter().map(|it| it.file_name().unwrap_or_default().to_string_lossy()).collect();
    check_poses(&cameras, &frames, &files)
        .map_err(|(found, expected)| InputError::new(rig.display(), "cameras", found, expected))?;
    let scan = ReferenceScan { cameras, frames };
    let reference = ReferenceModel::from_scan(&scan);
    let findings = vec![format!("{named}: {} depth images", images.len())];
    scan::between(&named, &reference, scale.unwrap_or(1.0), findings)
}

/// Depths of a camera. What is behind the object shows where it is not; a depth of 0 shows nothing.
fn frame(index: usize, camera: &CameraModel, depths: &[u16], unit_m: f64) -> DepthFrame {
    let window = camera.full_window();
    let depth_m = smoothed(depths, camera.width_px as usize, unit_m);
    let is_object = |(i, depth_m): (usize, &f32)| {
        let p_R = camera.X_WC * camera.back_project(&window.pixel_centre(i), f64::from(*depth_m));
        // Whatever is not measured is not behind it.
        depth_m.is_nan() || nalgebra::distance(&p_R, &Point3::origin()) <= OBJECT_WITHIN_M
    };
    let mask = Some(depth_m.iter().enumerate().map(is_object).collect());
    DepthFrame { camera: index, capture_s: 0.0, window, depth_m, mask }
}

/// Checks that there is something around the origin.
fn check_depths(folder: &str, cameras: &[CameraModel], frames: &[DepthFrame]) -> Result<(), InputError> {
    if cameras.iter().zip(frames).any(|(camera, frame)| object_points(camera, frame).next().is_some()) {
        return Ok(());
    }
    let mut depths_m: Vec<f64> =
        frames.iter().flat_map(|it| &it.depth_m).filter(|it| !it.is_nan()).map(|it| f64::from(*it)).collect();
    let mut away_m: Vec<f64> = cameras.iter().map(|it| it.X_WC.translation.vector.norm()).collect();
    let found = format!(
        "none within {OBJECT_WITHIN_M} m of the origin of R: {:.3} m (median) from cameras that are {:.3} m away from it",
        median_in_place(&mut depths_m),
        median_in_place(&mut away_m)
    );
    let expected = "depths in millimetres, or `--scale METRES` per unit (0.0001 for tenths of a millimetre)";
    Err(InputError::new(folder, "depths", found, expected))
}

/// Checks that images show the same thing at the same place, and names those that do not.
///
/// # Errors
/// What was found, and what was expected.
fn check_poses(
    cameras: &[CameraModel],
    frames: &[DepthFrame],
    files: &[impl std::fmt::Display],
) -> Result<(), (String, &'static str)> {
    let views = || cameras.iter().zip(frames).enumerate();
    let (mut measured, mut through, mut off) = (0, 0, Vec::new());
    for (i, (camera, frame)) in views() {
        let points: Vec<Point3<f64>> = object_points(camera, frame).collect();
        let mut by_others = Vec::new();
        for (_, (other, image)) in views().filter(|it| it.0 != i) {
            let seen = Seen::of(&points, other, image);
            measured += seen.nearer + seen.farther;
            through += seen.farther;
            let all = seen.nearer + seen.farther + seen.nothing;
            by_others.extend((all > 0).then(|| (seen.farther + seen.nothing) as f64 / all as f64));
        }
        // One wrong pose among the others changes no median.
        off.push(median_in_place(&mut by_others));
    }
    let usual = median_in_place(&mut off.clone());
    let contradicting = through as f64 / f64::max(measured as f64, 1.0);
    if usual > MOST_USUAL || contradicting > MOST_CONTRADICTING {
        let all = f64::max(usual, contradicting);
        let found = format!("{:.0} % of what some images show where others see nothing", all * 100.0);
        let expected =
            "the poses of the cameras in the frame of the object, X_RC, not their inverses; quaternions as x, y, z, w";
        return Err((found, expected));
    }
    let wrong: Vec<String> = (0..off.len())
        .filter(|i| off[*i] > usual + MOST_CONTRADICTING)
        .map(|i| format!("cameras[{i}] of {}: {:.0} %", files[i], off[i] * 100.0))
        .collect();
    if wrong.is_empty() {
        return Ok(());
    }
    let found = format!(
        "poses of which other images see nothing where these show something: {}, usually {:.0} %",
        wrong.join(", "),
        usual * 100.0
    );
    Err((found, "the pose of that image's camera, X_RC, or the scan without both"))
}

/// What a camera sees where points are: something nearer or there, something farther, or nothing.
#[derive(Default)]
struct Seen {
    nearer: usize,
    farther: usize,
    nothing: usize,
}

impl Seen {
    fn of(points: &[Point3<f64>], camera: &CameraModel, image: &DepthFrame) -> Self {
        let (X_CR, mut seen) = (camera.X_WC.inverse(), Self::default());
        for p_R in points {
            let p_C = X_CR * p_R;
            let pixel = camera.project(&p_C).filter(|uv| uv.x >= 0.0 && uv.y >= 0.0);
            let at = pixel.map(|uv| [uv.x as usize, uv.y as usize]);
            let at = at.filter(|[x, y]| *x < camera.width_px as usize && *y < camera.height_px as usize);
            let Some([x, y]) = at else { continue };
            let there_m = f64::from(image.depth_m[y * camera.width_px as usize + x]);
            match there_m {
                _ if there_m.is_nan() => seen.nothing += 1,
                _ if there_m > p_C.z + THROUGH_M => seen.farther += 1,
                _ => seen.nearer += 1,
            }
        }
        seen
    }
}

/// Some of the points that an image shows of the object, in R.
fn object_points(camera: &CameraModel, frame: &DepthFrame) -> impl Iterator<Item = Point3<f64>> {
    let step = frame.depth_m.len().div_ceil(COMPARED).max(1);
    let pixels = frame.depth_m.iter().enumerate().step_by(step).filter(|it| !it.1.is_nan());
    let points = pixels
        .map(|(i, depth_m)| camera.X_WC * camera.back_project(&frame.window.pixel_centre(i), f64::from(*depth_m)));
    points.filter(|it| it.coords.norm() <= OBJECT_WITHIN_M)
}

/// Depths in metres, NaN where there are none, each the mean of those around it that lie on a line through
/// it: steps and noise would turn the surface. What lies on one side only, as at an edge, would shift it.
fn smoothed(depths: &[u16], width: usize, unit_m: f64) -> Vec<f32> {
    let reach = -SMOOTHING_PX..=SMOOTHING_PX;
    let steps: Vec<(isize, isize)> =
        reach.clone().flat_map(|row| reach.clone().map(move |column| (row, column))).collect();
    // Of two opposite steps one.
    let steps = &steps[steps.len() / 2 + 1..];
    let depth_m = |pixel: usize, (row, column): (isize, isize)| {
        let at = pixel % width;
        let is_inside = at.checked_add_signed(column).is_some_and(|it| it < width);
        let there = pixel.checked_add_signed(row * width as isize + column).filter(|_| is_inside);
        there.and_then(|it| depths.get(it)).filter(|it| **it > 0).map(|it| f64::from(*it) * unit_m)
    };
    let mean = |pixel: usize| {
        let own_m = depth_m(pixel, (0, 0))?;
        let pairs = steps.iter().filter_map(|&(row, column)| {
            let sum_m = depth_m(pixel, (row, column))? + depth_m(pixel, (-row, -column))?;
            ((sum_m / 2.0 - own_m).abs() < SMOOTH_M).then_some(sum_m)
        });
        let (sum_m, count) = pairs.fold((own_m, 1.0), |(sum_m, count), pair_m| (sum_m + pair_m, count + 2.0));
        Some(sum_m / count)
    };
    (0..depths.len()).map(|pixel| mean(pixel).map_or(f32::NAN, |it| it as f32)).collect()
}

/// The images of a folder, by their names; 2 comes before 10.
fn images(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let mut images = paths_in(folder, "a readable folder")?;
    images.retain(|it| it.extension().is_some_and(|it| it.eq_ignore_ascii_case("png")));
    images.sort_by_cached_key(|it| (it.as_os_str().len(), it.clone()));
    Ok(images)
}
