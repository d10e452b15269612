//! The arena for learned policies: actions are accelerations of the joints, observations are arrays of one shape.

use std::sync::{Arc, Mutex, PoisonError};

use catch_body::JointVector;
use catch_bot::{
    CatchingBot,
    control::{CatchPlanner, Decision, Situation, Status},
    perception::PoseEstimator,
    trajectory_prediction::FlightPredictor,
};
use catch_cell::{ArmTrajectory, BSpline, Brain as _, Command, GripperMove, Observation, Setpoint, TrajectoryId};
use catch_lab::{
    evaluation::{self, Row},
    referee,
    scenario::setup::Setup,
    trial::{Episode, StateSnapshot, steering::Steering, stopwatch::Stopwatch},
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{
    exceptions::PyRuntimeError,
    prelude::*,
    types::{PyBytes, PyDict},
};

use crate::{
    arguments::{Numbers, fault},
    trial::{dict, line},
};

/// Points of a cloud.
const CLOUD_POINTS: usize = 512;

/// Trajectories that are remembered: more than are sent until one is told to be rejected.
const REMEMBERED: usize = 64;

/// What an observation shows besides the arm.
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

/// What an action means for each joint, as a fraction of a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The acceleration.
    Acceleration,
    /// The change of its position until the next action.
    Delta,
}

/// Sees and predicts, and plans nothing.
type Eyes = CatchingBot<Box<dyn PoseEstimator + Send>, Box<dyn FlightPredictor + Send>, NoPlanner>;

struct NoPlanner;

impl CatchPlanner for NoPlanner {
    fn plan(&mut self, situation: &Situation<'_>) -> Decision {
        Decision { status: Status::NoPlan, plan: None, progress: situation.progress }
    }
}

/// One throw in the arena for a learned policy: each `step(action)` lasts until the next image.
#[pyclass(frozen, module = "catchingbot")]
pub struct SteeredArena {
    setup: Arc<Setup>,
    scene: (u64, u64),
    view: View,
    action: Action,
    state: Mutex<Option<State>>,
}

struct State {
    episode: Option<Box<Episode>>,
    sensed: Observation,
    seen: Vec<(&'static str, Vec<usize>, Vec<f32>)>,
    eyes: Option<Box<Eyes>>,
    steering: Steering,
    /// What holds the arm at the beginning, and the newest trajectories that were sent and not rejected, with their identifiers.
    sent: Vec<(u64, BSpline)>,
    last_id: u64,
    closes: Option<bool>,
    row: Option<Row>,
}

impl SteeredArena {
    /// Throw number `index` of `seed`, sensed once.
    pub fn new(setup: &Arc<Setup>, seed: u64, index: u64, view: View, action: Action) -> PyResult<Self> {
        let sizes = setup.cameras.iter().map(|it| (it.width_px, it.height_px));
        if view == View::Depth && sizes.clone().any(|size| Some(size) != sizes.clone().next()) {
            return Err(fault("obs", "'depth' of cameras that differ in size", "another one"));
        }
        let mut episode = Box::new(Episode::new(setup, seed, index));
        let sensed = episode.sense();
        let period_s = period_s(setup);
        let mut state = State {
            episode: Some(episode),
            seen: Vec::new(),
            eyes: (view == View::Pose).then(|| Box::new(eyes(setup, seed, index))),
            steering: Steering::new(&setup.robot, &setup.gripper, period_s),
            sent: vec![(0, BSpline::at_rest(sensed.time_s, setup.robot.ready_q))],
            last_id: 0,
            closes: None,
            row: None,
            sensed,
        };
        state.look(setup, view);
        Ok(Self { setup: setup.clone(), scene: (seed, index), view, action, state: Mutex::new(Some(state)) })
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut State) -> PyResult<T> + Send) -> PyResult<T> {
        py.detach(|| {
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            work(state.as_mut().ok_or_else(|| PyRuntimeError::new_err("arena: it is closed"))?)
        })
    }

    fn row_of<T: Send>(&self, py: Python<'_>, of: impl FnOnce(&Row) -> PyResult<T> + Send) -> PyResult<T> {
        self.with(py, |state| match &state.row {
            Some(row) => of(row),
            None => Err(PyRuntimeError::new_err("arena: the throw is not done")),
        })
    }
}

/// Time from one action to the next.
fn period_s(setup: &Setup) -> f64 {
    let arena = &setup.scenario.arena;
    arena.steps_per_frame() as f64 * arena.step_s
}

/// What sees and predicts in one scene.
fn eyes(setup: &Setup, seed: u64, index: u64) -> Eyes {
    let known = setup.known().clone();
    let seed = setup.brain_config(seed, index).seed;
    let (estimator, predictor) = (Box::new(known.pose_estimator()), Box::new(known.flight_predictor(seed)));
    CatchingBot::with_stages(known, estimator, predictor, NoPlanner)
}

impl State {
    /// Acts as far as the limits allow; whether the throw is over then.
    fn step(&mut self, setup: &Setup, action: Action, view: View, wanted: &JointVector, closes: bool) -> bool {
        let Some(episode) = &mut self.episode else { return true };
        let start_s = self.sensed.time_s + setup.scenario.brain.control.expected_latency_s;
        let rejected = &self.sensed.arm.rejected;
        self.sent.retain(|(id, _)| rejected.iter().all(|it| it.id.0 != *id));
        let newest = self.sent.last().map(|(_, motion)| motion.setpoint(start_s));
        let start = newest.unwrap_or(Setpoint::at_rest(self.sensed.arm.commanded.q));
        let most = self.steering.max_acceleration();
        let accelerations = match action {
            Action::Acceleration => wanted.component_mul(&most),
            Action::Delta => {
                // Half of what is missing within a period: faster swings.
                let dq = wanted.component_mul(&self.steering.max_velocity());
                (dq - start.dq) * (0.5 / period_s(setup))
            }
        };
        let mut command = Command::default();
        if let Some(motion) = self.steering.motion(start_s, &start, &accelerations) {
            self.last_id += 1;
            self.sent.push((self.last_id, motion.clone()));
            self.sent.drain(..self.sent.len().saturating_sub(REMEMBERED));
            command.arm = Some(ArmTrajectory { id: TrajectoryId(self.last_id), spline: motion });
        }
        if self.closes.replace(closes) != Some(closes) {
            let gripper = &setup.gripper;
            let width_m = if closes { 0.0 } else { gripper.max_width_m };
            let (speed_mps, force_n) = (gripper.max_speed_mps, gripper.max_force_n);
            command.gripper = Some(vec![GripperMove { start_s, width_m, speed_mps, force_n }]);
        }
        let snapshot = StateSnapshot { time_s: self.sensed.time_s, report: None, stage_ms: Vec::new() };
        episode.act(&command, snapshot, 0.0);
        let is_done = episode.is_done();
        if !is_done {
            self.sensed = episode.sense();
        }
        self.look(setup, view);
        is_done
    }

    /// The arrays of what was sensed.
    fn look(&mut self, setup: &Setup, view: View) {
        let Self { sensed, episode, eyes, .. } = self;
        let dof = setup.robot.dof();
        let joints = |values: &JointVector| values.as_slice()[..dof].to_vec();
        let arm = [joints(&sensed.arm.q), joints(&sensed.arm.dq), vec![sensed.gripper.width_m, sensed.time_s]].concat();
        self.seen = vec![("arm", vec![arm.len()], arm.iter().map(|it| *it as f32).collect())];
        let mut object = [0.0; 14];
        match view {
            View::State => {
                let last = episode.as_ref().and_then(|it| it.truth().samples.last());
                if let Some(it) = last {
                    object = of_object(&it.X_WO, &it.V_WO);
                }
            }
            View::Pose => {
                let report = eyes.as_mut().map(|eyes| {
                    eyes.tick(sensed, &mut ());
                    eyes.report()
                });
                let pose = report.and_then(|it| it.pose).map(|it| (it.X_WO, catch_body::Twist::default()));
                let flight = report.and_then(|it| it.flight.as_ref()).map(|it| it.local_flight_at(sensed.time_s));
                if let Some((pose, twist)) = flight.map(|it| (it.X_WO, it.V_WO)).or(pose) {
                    object = of_object(&pose, &twist);
                }
            }
            View::Depth => {
                let [width, height] =
                    setup.cameras.first().map_or([0, 0], |it| [it.width_px as usize, it.height_px as usize]);
                let mut depth = vec![0.0_f32; setup.cameras.len() * width * height];
                for frame in &sensed.frames {
                    let window = &frame.window;
                    for (i, value) in frame.depth_m.iter().enumerate().filter(|(_, value)| value.is_finite()) {
                        let (row, column) = (i / window.width as usize, i % window.width as usize);
                        let at = (window.top as usize + row) * width + window.left as usize + column;
                        depth[frame.camera * width * height + at] = *value;
                    }
                }
                self.seen.push(("depth", vec![setup.cameras.len(), height, width], depth));
                return;
            }
            View::Cloud => {
                let points = cloud(setup, sensed);
                let step = points.len().div_ceil(CLOUD_POINTS).max(1);
                let mut values: Vec<f32> = points.iter().step_by(step).flatten().copied().collect();
                values.resize(3 * CLOUD_POINTS, 0.0);
                self.seen.push(("cloud", vec![CLOUD_POINTS, 3], values));
                return;
            }
        }
        self.seen.push(("object", vec![object.len()], object.iter().map(|it| *it as f32).collect()));
    }
}

/// Position, orientation (x, y, z, w), velocity and angular velocity in W, and 1 for an object that is seen.
fn of_object(X_WO: &catch_body::Pose, V_WO: &catch_body::Twist) -> [f64; 14] {
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

/// Points in W that the cameras measured: those of the object where they can tell.
fn cloud(setup: &Setup, sensed: &Observation) -> Vec<[f32; 3]> {
    let mut points = Vec::new();
    for frame in &sensed.frames {
        let camera = &setup.cameras[frame.camera];
        for (i, depth_m) in frame.depth_m.iter().enumerate().filter(|(_, depth_m)| depth_m.is_finite()) {
            if frame.mask.as_ref().is_none_or(|mask| mask[i]) {
                let p_C = camera.back_project(&frame.window.pixel_centre(i), f64::from(*depth_m));
                let p_W = camera.X_WC * p_C;
                points.push([p_W.x as f32, p_W.y as f32, p_W.z as f32]);
            }
        }
    }
    points
}

#[pymethods]
impl SteeredArena {
    /// Acts until the next image; whether the throw is over then. `action` has a number from -1 to 1 for each joint and one for the gripper,
    /// which closes above 0.
    fn step(&self, py: Python<'_>, action: &Bound<'_, PyAny>) -> PyResult<bool> {
        let dof = self.setup.robot.dof();
        let numbers = Numbers::read("action", action, &[dof + 1])?;
        let closes = numbers.values[dof] > 0.0;
        let mut wanted = JointVector::zeros();
        wanted.iter_mut().zip(&numbers.values[..dof]).for_each(|(joint, value)| *joint = value.clamp(-1.0, 1.0));
        self.with(py, |state| {
            if state.row.is_some() {
                return Err(PyRuntimeError::new_err("arena: the throw is done"));
            }
            let is_done = state.step(&self.setup, self.action, self.view, &wanted, closes);
            if let Some(episode) = state.episode.take_if(|_| is_done) {
                let verdict = referee::judge(&self.setup, &episode.into_trial(Stopwatch::default()));
                state.row = Some(evaluation::row(&self.setup, self.scene.0, self.scene.1, verdict));
            }
            Ok(is_done)
        })
    }

    /// What was sensed last, as arrays of one shape: `arm` (positions, velocities, gripper width, time), and `object` (position, orientation as
    /// x, y, z, w, velocity, angular velocity, and 1 where it is seen), `depth` or `cloud`.
    #[getter]
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seen = self.with(py, |state| Ok(state.seen.clone()))?;
        let arrays = PyDict::new(py);
        for (name, shape, values) in seen {
            arrays.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?;
        }
        Ok(arrays)
    }

    /// The row of this throw in an evaluation, once it is done.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let row = self.row_of(py, |row| Ok(row.clone()))?;
        dict(py, &row)
    }

    /// The same as the line of JSON that `catchingbot eval` writes.
    #[getter]
    fn jsonl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let line = self.row_of(py, line)?;
        Ok(PyBytes::new(py, line.as_bytes()))
    }

    /// Frees what the arena holds. It may be closed more than once.
    fn close(&self, py: Python<'_>) {
        py.detach(|| *self.state.lock().unwrap_or_else(PoisonError::into_inner) = None);
    }
}
