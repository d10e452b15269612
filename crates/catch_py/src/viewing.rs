//! What is seen of a recorded throw, for other viewers.

use std::path::PathBuf;

use catch_body::{MAX_JOINTS, Pose};
use catch_view::{
    playback::Playback,
    surfaces::{Part, finger_poses, surfaces},
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arguments::{Named, input_fault},
    camera::Camera,
    equipment::rows_of,
};

/// Interval between poses in seconds.
const STEP_S: f64 = 0.005;
/// Points of a predicted path.
const POINTS: usize = 30;

/// Names of a surface's frames: both fingers have one.
fn frames(of: Part, link: usize) -> Vec<String> {
    match of {
        Part::Link => vec![format!("link_{link}")],
        Part::Housing => vec!["hand".to_owned()],
        Part::Finger => vec!["finger_left".to_owned(), "finger_right".to_owned()],
        Part::Object => vec!["object".to_owned()],
        Part::Obstacle => vec!["surroundings".to_owned()],
    }
}

/// All frames with their poses in W at a time.
fn poses(playback: &Playback, time_s: f64) -> Vec<(String, Pose)> {
    let Some(sample) = playback.motion_at(time_s) else { return Vec::new() };
    let X_WL = playback.robot.link_poses(&sample.q);
    let mut poses: Vec<(String, Pose)> =
        (0..=playback.robot.dof().min(MAX_JOINTS)).map(|link| (format!("link_{link}"), X_WL[link])).collect();
    poses.push(("hand".to_owned(), sample.X_WG));
    let fingers = finger_poses(&playback.gripper, sample.width_m).map(|X_GF| sample.X_WG * X_GF);
    poses.extend(frames(Part::Finger, 0).into_iter().zip(fingers));
    poses.extend(sample.X_WO.map(|X_WO| ("object".to_owned(), X_WO)));
    poses
}

/// What is seen of a recorded throw: surfaces in their frames, the frames' poses over time, predicted paths,
/// cameras, depth images, and the story.
#[pyfunction]
pub fn viewed<'py>(py: Python<'py>, file: Named) -> PyResult<Bound<'py, PyDict>> {
    let file = PathBuf::from(file.text(py, "file")?);
    let playback = py.detach(|| Playback::read(&file)).map_err(input_fault)?;
    let dict = PyDict::new(py);
    dict.set_item("title", &playback.header.title)?;
    dict.set_item("surfaces", of_surfaces(py, &playback)?)?;
    motion(py, &playback, &dict)?;
    let paths = PyList::empty(py);
    for tick in &playback.ticks {
        if let Some((flight, plan)) = tick.report.flight.as_ref().zip(tick.report.plan.as_ref()) {
            let (from_s, until_s) = (tick.observation.time_s, plan.catch_s);
            let at = |i: usize| from_s + (until_s - from_s) * i as f64 / (POINTS - 1) as f64;
            let points = (0..POINTS).flat_map(|i| (flight.pose_at(at(i)) * playback.com_O()).coords.data.0[0]);
            paths.append((from_s, PyArray1::from_vec(py, points.collect()).reshape([POINTS, 3])?))?;
        }
    }
    dict.set_item("predictions", paths)?;
    let cameras: Vec<Camera> = playback.header.cell.cameras.iter().map(Camera::from).collect();
    dict.set_item("cameras", cameras)?;
    let images = PyList::empty(py);
    for frame in playback.ticks.iter().flat_map(|tick| &tick.observation.frames).filter(|it| it.window.area() > 0) {
        let window = frame.window;
        let depth = PyArray1::from_vec(py, frame.depth_m.clone());
        let depth = depth.reshape([window.height as usize, window.width as usize])?;
        images.append((frame.camera, frame.capture_s, (window.left, window.top), depth))?;
    }
    dict.set_item("images", images)?;
    let story = playback.ending.timeline.iter();
    let story: Vec<(f64, String)> =
        story.map(|it| (it.time_s, format!("{}: {}", it.event.label(), it.detail))).collect();
    dict.set_item("story", story)?;
    Ok(dict)
}

fn of_surfaces<'py>(py: Python<'py>, playback: &Playback) -> PyResult<Bound<'py, PyList>> {
    let list = PyList::empty(py);
    let object = playback.ground_truth().map(|it| it.surface.mesh());
    for surface in surfaces(&playback.robot, &playback.gripper, object.as_ref()) {
        let vertices = surface.mesh.vertices.iter().flat_map(|it| it.coords.data.0[0]).collect();
        let vertices = PyArray1::from_vec(py, vertices).reshape([surface.mesh.vertices.len(), 3])?;
        let triangles = surface.mesh.triangles.iter().flatten().copied().collect();
        let triangles = PyArray1::<u32>::from_vec(py, triangles).reshape([surface.mesh.triangles.len(), 3])?;
        list.append((frames(surface.of, surface.link), vertices, triangles, surface.colour))?;
    }
    Ok(list)
}

/// Times, and the pose of each frame at each of them.
fn motion(py: Python<'_>, playback: &Playback, dict: &Bound<'_, PyDict>) -> PyResult<()> {
    let (from_s, until_s) = (playback.start_s(), playback.end_s());
    let count = ((until_s - from_s) / STEP_S).max(0.0) as usize + 1;
    let times_s: Vec<f64> = (0..count).map(|i| from_s + i as f64 * STEP_S).collect();
    let all: Vec<Vec<(String, Pose)>> = times_s.iter().map(|time_s| poses(playback, *time_s)).collect();
    let of_frames = PyDict::new(py);
    for (i, (name, _)) in all.first().into_iter().flatten().enumerate() {
        let values =
            all.iter().filter_map(|poses| poses.get(i)).flat_map(|(_, X)| rows_of(X).into_iter().flatten()).collect();
        of_frames.set_item(name, PyArray1::from_vec(py, values).reshape([count, 4, 4])?)?;
    }
    dict.set_item("time_s", PyArray1::from_vec(py, times_s))?;
    dict.set_item("poses", of_frames)
}
