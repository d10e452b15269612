//! Stages of the brain that are written in Python: a flight predictor, a catch planner.

use std::sync::{Arc, Mutex};

use catch_body::{JointVector, Pose};
use catch_bot::{
    CatchingBot, Status,
    control::{self, CatchPlanner, Decision, GripperPlan, Progress},
    grasp_selection::Grasp,
    perception::ObjectPose as FoundPose,
    trajectory_optimization::{CatchPlan, Start},
    trajectory_prediction::{FlightPredictor, FlightTrajectory, PredictionStatus},
};
use catch_lab::{evaluation::BrainFactory, scenario::setup::Setup};
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;

use crate::{
    arguments::{fault, locked, number},
    cell_state::joint_array,
    command::Trajectory,
    flight::Flight,
    plan::Plan,
    python_brain::{Made, Maker},
};

/// Brains of the scenario, but for stages that are made in Python.
pub fn factory(predictor: Option<Maker>, planner: Option<Maker>) -> BrainFactory {
    Arc::new(move |setup, seed, index| {
        let (known, settings) = (setup.known_for(seed), setup.brain_config(seed));
        let (estimator, ours, planning) = settings.stages(&known, setup.brain_seed(seed, index));
        let predictor: Box<dyn FlightPredictor> = match &predictor {
            None => ours,
            Some(maker) => Box::new(PythonPredictor(maker.make(seed, index))),
        };
        let planner: Box<dyn CatchPlanner> = match &planner {
            None => planning,
            Some(maker) => {
                let made = maker.make(seed, index);
                Box::new(PythonPlanner { made, setup: Arc::new(setup.clone()), ours: Arc::new(Mutex::new(planning)) })
            }
        };
        Box::new(CatchingBot::with_stages(known, estimator, predictor, planner))
    })
}

/// Predicts flights by `predict(poses, previous)`.
struct PythonPredictor(Made);

impl FlightPredictor for PythonPredictor {
    fn predict(
        &mut self,
        poses: &[FoundPose],
        previous: Option<&FlightTrajectory>,
    ) -> Result<FlightTrajectory, PredictionStatus> {
        let arguments = |_: Python<'_>| {
            let poses: Vec<ObjectPose> = poses.iter().copied().map(|found| ObjectPose { found }).collect();
            Ok((poses, previous.cloned().map(Flight::of_brain)))
        };
        let read = |answer: &Bound<'_, PyAny>| answer.cast::<Flight>().ok()?.get().trajectory().ok().cloned();
        let expected = "a Flight with z up and isotropic drag";
        self.0.ask(arguments, read, expected).ok_or(PredictionStatus::NoAgreement)
    }
}

/// Plans catches by `plan(situation)`.
struct PythonPlanner {
    made: Made,
    setup: Arc<Setup>,
    ours: Arc<Mutex<Planner>>,
}

type Planner = Box<dyn CatchPlanner>;

impl CatchPlanner for PythonPlanner {
    fn plan(&mut self, situation: &control::Situation<'_>) -> Decision {
        let (running, progress) = (situation.running.cloned(), situation.progress);
        let shown = |_: Python<'_>| Ok((Situation::new(&self.setup, &self.ours, situation),));
        let read = |answer: &Bound<'_, PyAny>| Some(answer.cast::<Plan>().ok()?.get().decision.clone());
        self.made.ask(shown, read, "a Plan").unwrap_or_else(|| kept(running, progress))
    }

    fn reset(&mut self) {
        locked(&self.ours).reset();
    }
}

/// The running plan goes on, if there is one.
fn kept(running: Option<CatchPlan>, progress: Progress) -> Decision {
    let status = if running.is_some() { Status::PlanKept } else { Status::NoPlan };
    Decision { status, plan: running, progress }
}

/// The object as it was found in a set of images.
#[pyclass(frozen, module = "catchingbot")]
pub struct ObjectPose {
    found: FoundPose,
}

#[pymethods]
impl ObjectPose {
    /// Capture time of the images, in seconds.
    #[getter]
    fn capture_s(&self) -> f64 {
        self.found.capture_s
    }

    /// Pose of the object in the world, 4×4; its origin is the centre of mass.
    #[getter]
    #[allow(non_snake_case)]
    fn X_WO<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.found.X_WO.to_homogeneous().to_pyarray(py)
    }

    /// Inverse covariance of (rotation vector, position) in the world, 6×6.
    #[getter]
    fn information<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.found.information.to_pyarray(py)
    }

    /// Root mean square distance of the measured points from the object's surface, in metres.
    #[getter]
    fn residual_m(&self) -> f64 {
        self.found.residual_m
    }
}

/// Situation from which a catch is planned.
#[pyclass(frozen, module = "catchingbot")]
pub struct Situation {
    setup: Arc<Setup>,
    ours: Arc<Mutex<Planner>>,
    observed_s: (f64, Option<f64>),
    first_seen_s: f64,
    start: Start,
    sensed: (JointVector, JointVector),
    flight: FlightTrajectory,
    running: Option<CatchPlan>,
    closing: Option<GripperPlan>,
    progress: Progress,
}

impl Situation {
    fn new(setup: &Arc<Setup>, ours: &Arc<Mutex<Planner>>, situation: &control::Situation<'_>) -> Self {
        let control::Situation { observed_s, first_seen_s, start, sensed, flight, running, closing, progress } =
            *situation;
        let (flight, running) = (flight.clone(), running.cloned());
        let (setup, ours) = (setup.clone(), ours.clone());
        Self { setup, ours, observed_s, first_seen_s, start, sensed, flight, running, closing, progress }
    }

    fn shown(&self) -> control::Situation<'_> {
        let Self { observed_s, first_seen_s, start, sensed, closing, progress, .. } = *self;
        let (flight, running) = (&self.flight, self.running.as_ref());
        control::Situation { observed_s, first_seen_s, start, sensed, flight, running, closing, progress }
    }

    fn dof(&self) -> usize {
        self.setup.robot.dof()
    }

    /// The grasp candidate that is nearest to the gripper at `X_WG`, moved there.
    #[allow(non_snake_case)]
    fn grasp_at(&self, X_WG: &Pose, catch_s: f64) -> Option<Grasp> {
        let X_OG = self.flight.pose_at(catch_s).inverse() * X_WG;
        let centre = self.setup.gripper.grasp_centre();
        // A radian counts as much as 10 cm.
        let distance =
            |it: &&Grasp| (it.X_OG * centre - X_OG * centre).norm() + 0.1 * it.X_OG.rotation.angle_to(&X_OG.rotation);
        let grasps = &self.setup.known().grasps.grasps;
        let nearest = grasps.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        Some(Grasp { X_OG, ..nearest.clone() })
    }
}

#[pymethods]
impl Situation {
    /// Start of a motion that is planned now, in seconds.
    #[getter]
    fn start_s(&self) -> f64 {
        self.start.time_s
    }

    /// Joint positions then, in radians.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.start.state.q, self.dof())
    }

    /// Joint velocities then, in rad/s.
    #[getter]
    fn dq<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.start.state.dq, self.dof())
    }

    /// Joint accelerations then, in rad/s².
    #[getter]
    fn ddq<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.start.state.ddq, self.dof())
    }

    /// The flight as it is predicted now.
    #[getter]
    fn flight(&self) -> Flight {
        Flight::of_brain(self.flight.clone())
    }

    /// The plan that is being executed, if there is one.
    #[getter]
    fn running(&self) -> Option<Plan> {
        let running = self.running.clone()?;
        Some(Plan { decision: kept(Some(running), self.progress), dof: self.dof() })
    }

    /// True if the fingers begin to close before a motion that is planned now could take over.
    #[getter]
    fn is_closing(&self) -> bool {
        self.shown().is_closing()
    }

    /// Decision of the scenario's planner.
    fn ours(&self, py: Python<'_>) -> Plan {
        let decision = py.detach(|| locked(&self.ours).plan(&self.shown()));
        Plan { decision, dof: self.dof() }
    }

    /// A catch by a motion of one's own, the fingers as far apart before as they wait or as `aperture_m`
    /// says. The grasp is where the gripper is at `catch_s`.
    #[pyo3(signature = (trajectory, catch_s, aperture_m=None))]
    #[allow(non_snake_case)]
    fn catch(
        &self,
        trajectory: &Trajectory,
        catch_s: &Bound<'_, PyAny>,
        aperture_m: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Plan> {
        let catch_s = number("catch_s", catch_s)?;
        let (spline, robot) = (&trajectory.sent.spline, &self.setup.robot);
        if catch_s < spline.start_s() || catch_s > spline.end_s() {
            return Err(fault("catch_s", catch_s, format!("{} to {}", spline.start_s(), spline.end_s())));
        }
        let widest_m = self.setup.gripper.max_width_m;
        let aperture_m = aperture_m.map_or(Ok(self.setup.waiting_width_m()), |it| number("aperture_m", it))?;
        if !(0.0..=widest_m).contains(&aperture_m) {
            return Err(fault("aperture_m", aperture_m, format!("0 to {widest_m}")));
        }
        let grasp = self.grasp_at(&robot.gripper_pose(&spline.evaluate(catch_s)[0]), catch_s);
        let grasp =
            grasp.ok_or_else(|| fault("trajectory", "an object without a grasp", "one that the gripper can hold"))?;
        let plan = CatchPlan::of_motion(robot, spline.clone(), &self.flight, catch_s, grasp);
        let plan = CatchPlan { aperture_m, ..plan };
        let decision = Decision { status: Status::Planned, plan: Some(plan), progress: self.progress };
        Ok(Plan { decision, dof: self.dof() })
    }
}
