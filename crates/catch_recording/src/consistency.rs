//! Checks that the parts of a recording are consistent with each other.

use catch_body::InputError;
use catch_cell::{CameraModel, DepthFrame};

use crate::recording::{RecordedCell, RecordedTick};

/// Longest duration of a recording, in seconds.
const MOST_DURATION_S: f64 = 1e5;
/// Longest time from now to the end of a plan, in seconds.
const MOST_AHEAD_S: f64 = 100.0;

/// Checks that the images of the reference scan match its cameras.
pub fn cell(file: &str, cell: &RecordedCell) -> Result<(), InputError> {
    let scan = &cell.reference_scan;
    let mut frames = scan.frames.iter().enumerate();
    frames.try_for_each(|(i, it)| frame(file, &format!("cell.reference_scan.frames[{i}]"), it, &scan.cameras))
}

/// Checks that a tick comes after the last one, its images match the cameras, and its trajectory is valid.
pub fn tick(file: &str, tick: &RecordedTick, last_s: Option<f64>, cameras: &[CameraModel]) -> Result<(), InputError> {
    let time_s = tick.observation.time_s;
    if let Some(last_s) = last_s.filter(|last_s| !(0.0..=MOST_DURATION_S).contains(&(time_s - last_s))) {
        let expected = format!("a time within {MOST_DURATION_S} s after {last_s} s");
        return Err(InputError::new(file, "tick.observation.time_s", time_s, expected));
    }
    for (i, it) in tick.observation.frames.iter().enumerate() {
        frame(file, &format!("tick.observation.frames[{i}]"), it, cameras)?;
    }
    let spline = tick.command.arm.as_ref().map(|it| &it.spline);
    if spline.is_some_and(|spline| !spline.is_valid()) {
        let expected = "rising knots, the first and the last four times, four more than control points";
        return Err(InputError::new(file, "tick.command.arm.spline", "other knots", expected));
    }
    let ahead = tick.report.plan.as_ref().map(|plan| plan.catch_s);
    match ahead.filter(|catch_s| (catch_s - time_s).abs() > MOST_AHEAD_S) {
        None => Ok(()),
        Some(catch_s) => {
            let expected = format!("a time within {MOST_AHEAD_S} s of {time_s} s");
            Err(InputError::new(file, "tick.report.plan.catch_s", catch_s, expected))
        }
    }
}

fn frame(file: &str, path: &str, frame: &DepthFrame, cameras: &[CameraModel]) -> Result<(), InputError> {
    let fault = |field: &str, found: usize, expected: String| {
        Err(InputError::new(file, format!("{path}.{field}"), found, expected))
    };
    let area = frame.window.area();
    let Some(camera) = cameras.get(frame.camera) else {
        return fault("camera", frame.camera, format!("one of {} cameras, the first being 0", cameras.len()));
    };
    let window = frame.window;
    let [right, bottom] =
        [u64::from(window.left) + u64::from(window.width), u64::from(window.top) + u64::from(window.height)];
    if right > u64::from(camera.width_px) || bottom > u64::from(camera.height_px) {
        let expected = format!("a window within {} × {} pixels", camera.width_px, camera.height_px);
        return Err(InputError::new(file, format!("{path}.window"), format!("{right} × {bottom}"), expected));
    }
    if frame.depth_m.len() != area {
        return fault("depth_m", frame.depth_m.len(), format!("{area} depths: one for each pixel of the window"));
    }
    match &frame.mask {
        Some(mask) if mask.len() != area => fault("mask", mask.len(), format!("{area} values: one for each pixel")),
        _ => Ok(()),
    }
}
