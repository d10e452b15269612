//! Setups: a scenario, and what is different from its file.

use std::sync::Arc;

use catch_body::JointVector;
use catch_bot::trajectory_optimization::Start;
use catch_cell::Setpoint;
use catch_lab::{
    evaluation::{Cell, Evaluation},
    parallel,
    scenario::{
        catch_plan,
        setup::{Choice, DEFAULT_SCENARIO, Setup as LabSetup},
    },
};
use catch_recording::{brain::Method, whole_file::COMMAND_LINE};
use catch_view::export::mjcf;
use numpy::{PyArray1, PyArray2};
use pyo3::{
    exceptions::PyTypeError,
    prelude::*,
    types::{PyDict, PyTuple},
};

use crate::{
    arguments::{
        MOST, Named, Numbers, Whole, fault, input_fault, instance, interruptible, joints, json_dict, number, settings,
    },
    brain::Brain,
    camera::Camera,
    cell_state::joint_array,
    equipment::{Gripper, Robot, object_dict},
    evaluation::evaluate,
    flight::Flight,
    plan::Plan,
    policy_actor::Action,
    policy_view::View,
    python_brain::{self, Ending, Maker},
    python_stages,
    steered_arena::SteeredArena,
    stepping::Arena,
    trial::Trial,
};

/// A scenario by name or file, with another robot, gripper, workcell, object, throw or method ('ours' or
/// 'paper'), and with single fields changed: `settings={"arena.drag": False}`.
#[pyclass(frozen, module = "catchingbot")]
pub struct Setup {
    /// The setup as the lab has it.
    pub lab: Arc<LabSetup>,
    /// Callable by which another process makes the setup again, unless it is of a recording.
    pub made_by: Option<Py<PyAny>>,
}

/// Throws of an evaluation at most, as on the command line.
const MOST_TRIALS: u64 = 10_000_000;
const MOST_THREADS: u64 = catch_lab::evaluation::MOST_THREADS as u64;

#[pymethods]
impl Setup {
    #[new]
    #[pyo3(signature = (scenario=None, *, robot=None, gripper=None, workcell=None, object=None, throw=None, method=None, settings=None),
           text_signature = "(scenario='honest', *, robot=None, gripper=None, workcell=None, object=None, throw=None, method=None, settings=None)")]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        scenario: Option<Named>,
        robot: Option<Named>,
        gripper: Option<Named>,
        workcell: Option<Named>,
        object: Option<Named>,
        throw: Option<Named>,
        method: Option<&str>,
        settings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let arguments = PyDict::new(py);
        let text = |argument: &str, given: Option<Named>| {
            let text = given.map(|it| it.text(py, argument)).transpose()?;
            arguments.set_item(argument, &text)?;
            Ok::<_, PyErr>(text)
        };
        let scenario = text("scenario", scenario)?.unwrap_or_else(|| DEFAULT_SCENARIO.to_owned());
        let [robot, gripper, workcell] =
            [text("robot", robot)?, text("gripper", gripper)?, text("workcell", workcell)?];
        let [object, throw] = [text("object", object)?, text("throw", throw)?];
        arguments.set_item("scenario", &scenario)?;
        arguments.set_item("method", method)?;
        arguments.set_item("settings", settings)?;
        let method = match method {
            None => None,
            Some("ours") => Some(Method::Ours),
            Some("paper") => Some(Method::Paper),
            Some(other) => return Err(fault("method", format!("'{other}'"), "'ours' or 'paper'")),
        };
        let settings = self::settings(settings)?;
        let lab = py.detach(|| {
            let choice = Choice {
                scenario: Some(&scenario),
                robot: robot.as_deref(),
                gripper: gripper.as_deref(),
                workcell: workcell.as_deref(),
                object: object.as_deref(),
                throw: throw.as_deref(),
                method,
                settings: &settings,
            };
            LabSetup::load(&choice)
        });
        let lab = Arc::new(lab.map_err(input_fault)?);
        let make = py.import("functools")?.call_method("partial", (py.get_type::<Self>(),), Some(&arguments))?;
        Ok(Self { lab, made_by: Some(make.unbind()) })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Py<PyAny>, Bound<'py, PyTuple>)> {
        let make = self.made_by.as_ref().ok_or_else(|| PyTypeError::new_err("the setup of a recording stays here: send the path of its file, and open `Recording(path).setup` there"))?;
        Ok((make.clone_ref(py), PyTuple::empty(py)))
    }

    /// Name of the scenario, with what is different from its file.
    #[getter]
    fn name(&self) -> &str {
        &self.lab.scenario.name
    }

    /// The scenario, all choices made.
    #[getter]
    fn scenario<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        json_dict(py, &self.lab.scenario)
    }

    /// Number of the arm's joints.
    #[getter]
    pub fn dof(&self) -> usize {
        self.lab.robot.dof()
    }

    /// Joint positions in radians where the arm waits.
    #[getter]
    fn ready_q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.lab.robot.ready_q, self.dof())
    }

    /// Lowest and highest positions, highest velocities, accelerations and torques of the joints, one a row.
    #[getter]
    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.robot().limits(py)
    }

    /// The arm, with what stands around it; it waits at `ready_q`.
    #[getter]
    fn robot(&self) -> Robot {
        Robot { model: self.lab.robot.clone(), sources: self.lab.sources.clone() }
    }

    /// The gripper.
    #[getter]
    fn gripper(&self) -> Gripper {
        let (toml, meshes) = (self.lab.sources.gripper_toml.clone(), self.lab.sources.gripper_meshes.clone());
        Gripper { model: self.lab.gripper.clone(), toml, meshes }
    }

    /// Distance between the fingers of the waiting hand, in metres: as wide as the grasps of the object need.
    #[getter]
    fn waiting_width_m(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.lab.waiting_width_m())
    }

    /// The object as it truly is: `name`, `mass`, `com`, `inertia` about it, `restitution`, `stiffness_npm`,
    /// its surface (`vertices`, `faces`) and the convex `parts` as which it collides, each a `hull` of points
    /// or a `ball` with `centre` and `radius_m`.
    #[getter]
    fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        object_dict(py, &self.lab)
    }

    /// The cameras that watch the flight, as the brain believes them to be.
    #[getter]
    fn cameras(&self) -> Vec<Camera> {
        self.lab.cameras.iter().map(Camera::from).collect()
    }

    /// Throws once.
    #[pyo3(signature = (seed=Whole::Default(1), index=Whole::Default(0)), text_signature = "($self, seed=1, index=0)")]
    fn run(&self, py: Python<'_>, seed: Whole, index: Whole) -> PyResult<Trial> {
        self.thrown(py, seed, index, |lab, seed, index| Trial::run(lab, seed, index))?
    }

    /// All that is drawn for a throw: release, friction, restitution, air, masses, mount, where the cameras
    /// truly stand. Recordings have it, too.
    #[pyo3(signature = (seed=Whole::Default(1), index=Whole::Default(0)), text_signature = "($self, seed=1, index=0)")]
    fn conditions<'py>(&self, py: Python<'py>, seed: Whole, index: Whole) -> PyResult<Bound<'py, PyDict>> {
        let drawn =
            self.thrown(py, seed, index, |lab, seed, index| lab.arena(seed, index).truth().conditions.clone())?;
        json_dict(py, &drawn)
    }

    /// The scene of a throw as a model of MuJoCo (MJCF), the object just released, with its friction and
    /// restitution. Masses are nominal, and the cameras stand where their rig has them; `conditions` has what
    /// is drawn.
    #[pyo3(signature = (seed=Whole::Default(1), index=Whole::Default(0)), text_signature = "($self, seed=1, index=0)")]
    fn mjcf(&self, py: Python<'_>, seed: Whole, index: Whole) -> PyResult<String> {
        self.thrown(py, seed, index, |lab, seed, index| mjcf::scene(lab, seed, index))
    }

    /// Throws `trials` times on all cores, or on `threads` at a time, from throw number `first` on: a table
    /// with a column for each quantity. `brain(setup, seed, index)` makes a brain with a method
    /// `tick(observation)` that returns a `Command` or `None`. Likewise `predictor` and `planner` make these
    /// stages of the scenario's brain: objects with `predict(poses, previous)`, which returns a `Flight` or
    /// `None`, and with `plan(situation)`, which returns a `Plan` or `None`. `progress(done, trials)` is
    /// called after each throw.
    #[pyo3(
        signature = (trials=Whole::Default(57), *, seed=Whole::Default(1), first=Whole::Default(0), threads=None, brain=None, predictor=None, planner=None, progress=None),
        text_signature = "($self, trials=57, *, seed=1, first=0, threads=None, brain=None, predictor=None, planner=None, progress=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn evaluate<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        trials: Whole,
        seed: Whole,
        first: Whole,
        threads: Option<Whole>,
        brain: Option<Bound<'py, PyAny>>,
        predictor: Option<Bound<'py, PyAny>>,
        planner: Option<Bound<'py, PyAny>>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let callables = [("brain", &brain), ("predictor", &predictor), ("planner", &planner), ("progress", &progress)];
        for (argument, value) in callables {
            if let Some(value) = value.as_ref().filter(|it| !it.is_callable()) {
                let found = value.get_type().name()?;
                return Err(PyTypeError::new_err(format!("{argument}: found {found}, expected a callable or None")));
            }
        }
        if brain.is_some() && (predictor.is_some() || planner.is_some()) {
            return Err(fault(
                "brain",
                "one besides a predictor or a planner",
                "a whole brain, or stages of the scenario's",
            ));
        }
        let trials = trials.checked(py, "trials", 1, MOST_TRIALS)?;
        let seed = seed.checked(py, "seed", 0, MOST)?;
        let first = first.checked(py, "first", 0, MOST - trials)?;
        let threads = threads.map(|it| it.checked(py, "threads", 1, MOST_THREADS)).transpose()?;
        let python = Ending::default();
        let maker = |names, make: Option<Bound<'py, PyAny>>| {
            make.map(|make| Maker::new(names, make.unbind(), slf.clone().into_any().unbind(), python.clone()))
        };
        let (predictor, planner) = (maker(["predictor", "predict"], predictor), maker(["planner", "plan"], planner));
        let lab = &slf.get().lab;
        // Clones keep what has been prepared.
        py.detach(|| lab.prepare());
        let mut cell = Cell::new(lab.as_ref().clone());
        if let Some(maker) = maker(["brain", "tick"], brain) {
            cell.brain = python_brain::factory(maker, lab.robot.dof());
        } else if predictor.is_some() || planner.is_some() {
            cell.brain = python_stages::factory(predictor, planner);
        }
        let evaluation = Evaluation { cells: vec![cell], seed, first, trials };
        let threads = threads.map_or_else(parallel::threads, |it| it as usize);
        evaluate(py, &evaluation, threads, &python, progress.map(Bound::unbind).as_ref())
    }

    /// A catch of `flight` for an arm with joint positions `q` and velocities `dq` at the time `now_s` on the
    /// flight's clock.
    fn plan(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
        flight: &Bound<'_, PyAny>,
        now_s: &Bound<'_, PyAny>,
    ) -> PyResult<Plan> {
        let q = Numbers::read("q", q, &[self.dof()])?.values;
        let q = self.lab.robot.checked_pose(COMMAND_LINE, "--q", &q).map_err(input_fault)?;
        let dq = joints("dq", dq, self.dof())?;
        for (i, joint) in self.lab.robot.joints.iter().enumerate() {
            let [low, high] = joint.velocity_range(q[i]);
            if dq[i] < low || dq[i] > high {
                return Err(fault("dq", dq[i], format!("{low} to {high} for joint {i}")));
            }
        }
        let flight = instance::<Flight>("flight", flight, "a Flight")?.trajectory()?;
        let time_s = number("now_s", now_s)?;
        let start = Start { time_s, state: Setpoint { q, dq, ddq: JointVector::zeros() } };
        let decision = py.detach(|| catch_plan::plan(&self.lab, start, flight));
        Ok(Plan { decision, dof: self.dof() })
    }

    /// The arena with everything in place, the object about to fly.
    #[pyo3(signature = (seed=Whole::Default(1), index=Whole::Default(0)), text_signature = "($self, seed=1, index=0)")]
    fn arena(&self, py: Python<'_>, seed: Whole, index: Whole) -> PyResult<Arena> {
        self.thrown(py, seed, index, Arena::new)
    }

    /// The scenario's brain, which has seen nothing yet.
    #[pyo3(signature = (seed=Whole::Default(1), index=Whole::Default(0)), text_signature = "($self, seed=1, index=0)")]
    fn brain(&self, py: Python<'_>, seed: Whole, index: Whole) -> PyResult<Brain> {
        let ((seed, index), lab) = (scene(py, seed, index)?, self.lab.clone());
        interruptible(py, move || Brain::of_setup(&lab, seed, index))
    }

    /// An arena for learned policies. `obs` is what is seen besides the arm: 'state', 'pose', 'depth' or
    /// 'cloud'; `action` is what the numbers of an action are: 'acceleration' or 'delta'.
    #[pyo3(
        signature = (seed=Whole::Default(1), index=Whole::Default(0), *, obs="state", action="acceleration"),
        text_signature = "($self, seed=1, index=0, *, obs='state', action='acceleration')"
    )]
    fn steered_arena(
        &self,
        py: Python<'_>,
        seed: Whole,
        index: Whole,
        obs: &str,
        action: &str,
    ) -> PyResult<SteeredArena> {
        let view = match obs {
            "state" => View::State,
            "pose" => View::Pose,
            "depth" => View::Depth,
            "cloud" => View::Cloud,
            _ => return Err(fault("obs", format!("'{obs}'"), "'state', 'pose', 'depth' or 'cloud'")),
        };
        let action = match action {
            "acceleration" => Action::Acceleration,
            "delta" => Action::Delta,
            _ => return Err(fault("action", format!("'{action}'"), "'acceleration' or 'delta'")),
        };
        self.thrown(py, seed, index, move |lab, seed, index| SteeredArena::new(lab, seed, index, view, action))?
    }

    fn __repr__(&self) -> String {
        let scenario = &self.lab.scenario;
        format!("<Setup {}: {}, {} throw>", scenario.name, scenario.object, scenario.throw)
    }
}

impl Setup {
    /// Runs `work` on a throw, if it can be thrown.
    fn thrown<T: Send + 'static>(
        &self,
        py: Python<'_>,
        seed: Whole,
        index: Whole,
        work: impl FnOnce(&Arc<LabSetup>, u64, u64) -> T + Send + 'static,
    ) -> PyResult<T> {
        let ((seed, index), lab) = (scene(py, seed, index)?, self.lab.clone());
        let checked = move || lab.check_throw(seed, index).map(|()| work(&lab, seed, index));
        interruptible(py, checked)?.map_err(input_fault)
    }
}

/// Seed and number of a throw.
fn scene(py: Python<'_>, seed: Whole, index: Whole) -> PyResult<(u64, u64)> {
    Ok((seed.checked(py, "seed", 0, MOST)?, index.checked(py, "index", 0, MOST)?))
}
