//! Observations for learned policies: arrays of one shape.

use catch_body::{JointVector, Pose, Twist};
use catch_bot::Report;
use catch_cell::Observation;
use catch_lab::scenario::setup::Setup;
use catch_view::points::points_of;

/// Points of a cloud.
const CLOUD_POINTS: usize = 512;

/// Content of an observation besides the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// The object as it truly is.
    State,
    /// The object as it is seen.
    Pose,
    /// The depth images.
    Depth,
    /// Points in W.
    Cloud,
}

/// An array: its name, its shape and its values.
pub type SeenArray = (&'static str, Vec<usize>, Vec<f32>);

/// An array of one axis.
pub fn row(name: &'static str, values: impl IntoIterator<Item = f64>) -> SeenArray {
    let values: Vec<f32> = values.into_iter().map(|it| it as f32).collect();
    (name, vec![values.len()], values)
}

/// Positions and velocities of the joints, gripper width and time.
pub fn arm(setup: &Setup, sensed: &Observation) -> SeenArray {
    let joints = |values: &JointVector| values.as_slice()[..setup.robot.dof()].to_vec();
    row("arm", [joints(&sensed.arm.q), joints(&sensed.arm.dq), vec![sensed.gripper.width_m, sensed.time_s]].concat())
}

/// The object in the state `truth`, or as it is seen and predicted in `report` at `time_s`.
pub fn object(truth: Option<(Pose, Twist)>, report: Option<&Report>, time_s: f64) -> SeenArray {
    let flight = report.and_then(|it| it.flight.as_ref()).map(|it| it.local_flight_at(time_s));
    let pose = report.and_then(|it| it.pose.as_ref()).map(|it| (it.X_WO, Twist::default()));
    let state = truth.or(flight.map(|it| (it.X_WO, it.V_WO))).or(pose);
    row("object", state.map_or([0.0; 14], |(X_WO, V_WO)| of_object(&X_WO, &V_WO)))
}

/// The depth images, 0 where nothing was measured.
pub fn depth(setup: &Setup, sensed: &Observation) -> SeenArray {
    let [width, height] = setup.cameras.first().map_or([0, 0], |it| [it.width_px as usize, it.height_px as usize]);
    let mut depth = vec![0.0_f32; setup.cameras.len() * width * height];
    for frame in &sensed.frames {
        let window = &frame.window;
        for (i, value) in frame.depth_m.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let (row, column) = (i / window.width as usize, i % window.width as usize);
            let at = (window.top as usize + row) * width + window.left as usize + column;
            depth[frame.camera * width * height + at] = *value;
        }
    }
    ("depth", vec![setup.cameras.len(), height, width], depth)
}

/// Some of the points that the cameras measured.
pub fn cloud(setup: &Setup, sensed: &Observation) -> SeenArray {
    let points = points_of(&sensed.frames, &setup.cameras);
    let step = points.len().div_ceil(CLOUD_POINTS).max(1);
    let mut values: Vec<f32> =
        points.iter().step_by(step).flat_map(|p| p.coords.data.0[0].map(|it| it as f32)).collect();
    values.resize(3 * CLOUD_POINTS, 0.0);
    ("cloud", vec![CLOUD_POINTS, 3], values)
}

/// Position, orientation (x, y, z, w), velocity and angular velocity in W, and 1 for an object that is seen.
fn of_object(X_WO: &Pose, V_WO: &Twist) -> [f64; 14] {
    let mut values = [1.0; 14];
    let parts = [
        X_WO.translation.vector.as_slice(),
        X_WO.rotation.coords.as_slice(),
        V_WO.linear.as_slice(),
        V_WO.angular.as_slice(),
    ];
    values.iter_mut().zip(parts.concat()).for_each(|(value, part)| *value = part);
    values
}
