//! The arena for learned policies: actions are accelerations of the joints, observations are arrays of one
//! shape.

use std::sync::{Arc, Mutex, OnceLock};

use catch_bot::{
    CatchingBot,
    control::{CatchPlanner, Decision, Situation, Status},
};
use catch_cell::{Brain as _, Command, Observation, PixelWindow};
use catch_lab::{scenario::setup::Setup, trial::StateSnapshot};
use catch_view::{playback::MotionSample, shading::Shader, viewpoint::overview};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::{
    exceptions::PyRuntimeError,
    prelude::*,
    types::{PyBytes, PyDict},
};

use crate::{
    arguments::{Numbers, fault, json_dict, locked},
    policy_actor::{Action, SteeredArm},
    policy_view::{self, SeenArray, View},
    stepping::{Throw, with},
    trial::line,
};

/// Width and height of a picture.
const PICTURE_PX: [u32; 2] = [480, 360];

/// Plans nothing.
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
    view: View,
    shader: OnceLock<Shader>,
    state: Mutex<Option<State>>,
}

struct State {
    throw: Throw,
    sensed: Observation,
    seen: Vec<SeenArray>,
    eyes: Option<Box<CatchingBot>>,
    /// Windows of the next images, as in [`Command::windows`].
    windows: Option<Vec<PixelWindow>>,
    arm: Box<SteeredArm>,
    /// Where arm and object are.
    last: Option<MotionSample>,
}

impl SteeredArena {
    /// Throw number `index` of `seed`, sensed once.
    pub fn new(setup: &Arc<Setup>, seed: u64, index: u64, view: View, action: Action) -> PyResult<Self> {
        let sizes = setup.cameras.iter().map(|it| (it.width_px, it.height_px));
        if view == View::Depth && sizes.clone().any(|size| Some(size) != sizes.clone().next()) {
            return Err(fault("obs", "'depth' of cameras that differ in size", "another one"));
        }
        let mut throw = Throw::new(setup, seed, index);
        let sensed = throw.flying()?.sense();
        let arm = Box::new(SteeredArm::new(setup, action, sensed.time_s));
        let eyes = (view == View::Pose).then(|| Box::new(eyes(setup, seed, index)));
        // Images that nobody looks at are not taken.
        let windows = (view == View::State).then(|| vec![PixelWindow::default(); setup.cameras.len()]);
        let mut state = State { throw, seen: Vec::new(), eyes, windows, arm, last: None, sensed };
        state.think();
        state.look(setup, view);
        Ok(Self { setup: setup.clone(), view, shader: OnceLock::new(), state: Mutex::new(Some(state)) })
    }
}

/// Creates the perception and prediction of one scene.
fn eyes(setup: &Setup, seed: u64, index: u64) -> CatchingBot {
    let known = setup.known_for(seed);
    let seed = setup.brain_seed(seed, index);
    let (estimator, predictor) = (Box::new(known.pose_estimator()), Box::new(known.flight_predictor(seed)));
    CatchingBot::with_stages(known, estimator, predictor, Box::new(NoPlanner))
}

impl State {
    /// Acts as far as the limits allow; whether the throw is over then.
    fn step(&mut self, setup: &Setup, view: View, action: &[f64]) -> PyResult<bool> {
        let episode = self.throw.flying()?;
        let start_s = self.sensed.time_s + setup.scenario.brain.control.expected_latency_s;
        let snapshot = StateSnapshot { time_s: self.sensed.time_s, report: None, stage_ms: Vec::new() };
        let command = self.arm.command(setup, &self.sensed, start_s, action);
        episode.act(&Command { windows: self.windows.clone(), ..command }, snapshot, 0.0);
        if !episode.is_done() {
            self.sensed = episode.sense();
            self.think();
        }
        self.look(setup, view);
        Ok(self.throw.judge_at_end())
    }

    /// Perception and prediction of what was sensed.
    fn think(&mut self) {
        if let Some(eyes) = &mut self.eyes {
            self.windows = eyes.tick(&self.sensed, &mut ()).windows;
        }
    }

    /// The arrays of what was sensed.
    fn look(&mut self, setup: &Setup, view: View) {
        let Self { sensed, throw, eyes, .. } = self;
        let last = throw.episode.as_ref().and_then(|it| it.truth().samples.last());
        self.last = last.map(MotionSample::from);
        let seen = match view {
            View::State => policy_view::object(last.map(|it| (it.X_WO, it.V_WO)), None, sensed.time_s),
            View::Pose => policy_view::object(None, eyes.as_ref().map(|it| it.report()), sensed.time_s),
            View::Depth => policy_view::depth(setup, sensed),
            View::Cloud => policy_view::cloud(setup, sensed),
        };
        self.seen = vec![policy_view::arm(setup, sensed), seen];
    }
}

#[pymethods]
impl SteeredArena {
    /// Acts until the next image; whether the throw is over then. `action` has a number from -1 to 1 for each
    /// joint and one for the gripper, which closes above 0.
    fn step(&self, py: Python<'_>, action: &Bound<'_, PyAny>) -> PyResult<bool> {
        let action = Numbers::read("action", action, &[self.setup.robot.dof() + 1])?.values;
        with(py, &self.state, |state| state.step(&self.setup, self.view, &action))
    }

    /// Last observation, as arrays of one shape: `arm` (positions, velocities, gripper width, time), and
    /// `object` (position, orientation as x, y, z, w, velocity, angular velocity, and 1 where it is seen),
    /// `depth` or `cloud`.
    #[getter]
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seen = with(py, &self.state, |state| Ok(state.seen.clone()))?;
        let arrays = PyDict::new(py);
        for (name, shape, values) in seen {
            arrays.set_item(name, PyArray1::from_vec(py, values).reshape(shape)?)?;
        }
        Ok(arrays)
    }

    /// A picture of arm and object: rows of red, green and blue.
    #[getter]
    fn picture<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let Setup { robot, gripper, object, .. } = &*self.setup;
        let pixels = with(py, &self.state, |state| {
            let shader = self.shader.get_or_init(|| Shader::new(robot, gripper, Some(&object.mesh)));
            let sample = state.last.as_ref().ok_or_else(|| PyRuntimeError::new_err("arena: nothing moved yet"))?;
            Ok(shader.image(&overview(robot, PICTURE_PX), sample, &[]))
        })?;
        let bytes = pixels.iter().flatten().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        PyArray1::from_vec(py, bytes).reshape([PICTURE_PX[1] as usize, PICTURE_PX[0] as usize, 3])
    }

    /// The row of this throw in an evaluation, once it is done.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        json_dict(py, &with(py, &self.state, |state| state.throw.row().cloned())?)
    }

    /// Result of the throw as the line of JSON that `catchingbot eval` writes.
    #[getter]
    fn jsonl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let line = with(py, &self.state, |state| line(state.throw.row()?))?;
        Ok(PyBytes::new(py, line.as_bytes()))
    }

    /// Frees what the arena holds. It may be closed more than once.
    fn close(&self, py: Python<'_>) {
        py.detach(|| *locked(&self.state) = None);
    }
}
