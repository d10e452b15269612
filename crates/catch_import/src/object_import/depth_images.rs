//! An object of which there are depth images, and a rig file with the cameras that took them.

use std::{
    fs,
    path::{Path, PathBuf},
};

use catch_body::{InputError, TriangleMesh};
use catch_bot::perception::ReferenceModel;
use catch_cell::{CameraModel, DepthFrame, ReferenceScan, rig_from_toml};
use nalgebra::Point3;

use super::scan;
use catch_lab::png;
use catch_recording::bounded_file::FileKind;

/// The file that makes a folder of images a scan: poses in the frame R, whose origin is in or near the
/// object.
pub(super) const RIG: &str = "rig.toml";
/// Files of a folder that are looked at.
const MOST_FILES: usize = 10_000;
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
/// depths.
const MOST_CONTRADICTING: f64 = 0.15;
/// An image, by its extension.
const IMAGE: FileKind = FileKind::geometry("a depth image: a PNG file with 16 bits of gray");

/// The surface that the images of a folder show, in units of `scale` metres if that is given, else in metres,
/// and what was found on the way.
///
/// # Errors
/// A fault of the rig or an image, another number of images than of cameras, no object at the origin.
pub(super) fn surface(folder: &Path, scale: Option<f64>) -> Result<(TriangleMesh, Vec<String>), InputError> {
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
    let contradicting = contradicting(&cameras, &frames);
    if contradicting > MOST_CONTRADICTING {
        let found = format!("{:.0} % of what some images show where others see nothing", contradicting * 100.0);
        let expected = "the poses of the cameras in the frame of the object, X_RC, not their inverses";
        return Err(InputError::new(rig.display(), "cameras", found, expected));
    }
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

/// The fraction of what cameras see that others look through, where they see anything there.
fn contradicting(cameras: &[CameraModel], frames: &[DepthFrame]) -> f64 {
    let (mut seen, mut through) = (0usize, 0usize);
    for (camera, frame) in cameras.iter().zip(frames) {
        let step = frame.depth_m.len().div_ceil(COMPARED).max(1);
        for (i, depth_m) in frame.depth_m.iter().enumerate().step_by(step) {
            let p_R = camera.X_WC * camera.back_project(&frame.window.pixel_centre(i), f64::from(*depth_m));
            if depth_m.is_nan() || nalgebra::distance(&p_R, &Point3::origin()) > OBJECT_WITHIN_M {
                continue;
            }
            for (other, image) in cameras.iter().zip(frames).filter(|it| !std::ptr::eq(it.0, camera)) {
                let p_C = other.X_WC.inverse() * p_R;
                let pixel = other.project(&p_C).filter(|uv| uv.x >= 0.0 && uv.y >= 0.0);
                let at = pixel.map(|uv| [uv.x as usize, uv.y as usize]);
                let at = at.filter(|[x, y]| *x < other.width_px as usize && *y < other.height_px as usize);
                let Some([x, y]) = at else { continue };
                let there_m = f64::from(image.depth_m[y * other.width_px as usize + x]);
                if !there_m.is_nan() {
                    seen += 1;
                    through += usize::from(there_m > p_C.z + THROUGH_M);
                }
            }
        }
    }
    if seen == 0 { 0.0 } else { through as f64 / seen as f64 }
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
    let unreadable = |it: std::io::Error| InputError::new(folder.display(), "the folder", it, "a readable folder");
    let entries = fs::read_dir(folder).map_err(unreadable)?.take(MOST_FILES);
    let mut images: Vec<PathBuf> = entries.filter_map(|it| it.ok().map(|it| it.path())).collect();
    images.retain(|it| it.extension().is_some_and(|it| it.eq_ignore_ascii_case("png")));
    images.sort_by_cached_key(|it| (it.as_os_str().len(), it.clone()));
    Ok(images)
}
