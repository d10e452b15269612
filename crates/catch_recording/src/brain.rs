//! Settings of a brain: the method of each of its stages.

use std::{
    fmt::{self, Display},
    sync::Arc,
};

use catch_bot::{
    CatchingBot, Config, Preparation, Report, control, control::CatchPlanner, cycle::CatchingCycle, grasp_selection,
    perception, perception::PoseEstimator, trajectory_optimization, trajectory_prediction,
    trajectory_prediction::FlightPredictor,
};
use catch_cell::{Brain, CameraModel, ObjectFigures};
use catch_paper::{IcpEstimator, PaperPlanner, RansacPredictor};
use serde::{Deserialize, Serialize};

/// Method that catches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// This project's version of the paper's method ([`catch_bot`]).
    #[default]
    Ours,
    /// The paper's own, for comparison ([`catch_paper`]).
    Paper,
}

impl Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The table `brain` of a scenario.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BrainSettings {
    /// Estimation of the object's pose from images.
    pub perception: perception::Config,
    /// Prediction of the flight from poses.
    pub trajectory_prediction: trajectory_prediction::Config,
    /// Selection of the grasp.
    pub grasp_selection: grasp_selection::Config,
    /// Trajectory optimization of the arm.
    pub trajectory_optimization: trajectory_optimization::Config,
    /// Commands and their timing.
    pub control: control::Config,
    /// Method of catch planning, and of the other stages that name none of their own.
    pub method: Method,
    /// Method of pose estimation, if not `method`.
    pub pose_estimation: Option<Method>,
    /// Method of flight prediction, if not `method`.
    pub flight_prediction: Option<Method>,
    /// Settings of the paper's method alone.
    pub paper_method: catch_paper::Config,
}

impl BrainSettings {
    /// Settings for the preparation, which every brain needs, whatever the method of its stages.
    pub fn config(&self) -> Config {
        let Self { perception, trajectory_prediction, grasp_selection, trajectory_optimization, control, .. } =
            self.clone();
        Config { perception, trajectory_prediction, grasp_selection, trajectory_optimization, control }
    }

    /// Returns these settings adapted to the given object and cameras ([`Config::given`]).
    #[must_use]
    pub fn given(self, object: &ObjectFigures, cameras: &[CameraModel]) -> Self {
        let config = self.config().given(object, cameras);
        self.with(config)
    }

    /// These settings with other ones for the preparation.
    fn with(self, config: Config) -> Self {
        let Config { perception, trajectory_prediction, grasp_selection, trajectory_optimization, control } = config;
        Self { perception, trajectory_prediction, grasp_selection, trajectory_optimization, control, ..self }
    }

    /// A brain of the stages that the settings choose; it draws at random from `seed`.
    pub fn brain(&self, known: Arc<Preparation>, seed: u64) -> CatchingBot {
        let (estimator, predictor, planner) = self.stages(&known, seed);
        CatchingBot::with_stages(known, estimator, predictor, planner)
    }

    /// Creates the three stages of these methods.
    pub fn stages(&self, known: &Preparation, seed: u64) -> ChosenStages {
        let Config { perception, trajectory_prediction, .. } = known.config.clone();
        let paper = self.paper_method;
        let estimator: Box<dyn PoseEstimator> = match self.pose_estimation.unwrap_or(self.method) {
            Method::Ours => Box::new(known.pose_estimator()),
            Method::Paper => Box::new(IcpEstimator::new(
                paper.registration,
                perception,
                known.reference.clone(),
                known.workspace.clone(),
            )),
        };
        let predictor: Box<dyn FlightPredictor> = match self.flight_prediction.unwrap_or(self.method) {
            Method::Ours => Box::new(known.flight_predictor(seed)),
            Method::Paper => {
                let symmetry = known.reference.symmetry;
                Box::new(RansacPredictor::new(trajectory_prediction, paper.prediction, symmetry, seed))
            }
        };
        (estimator, predictor, self.catch_planner(known, seed))
    }

    /// The planner that the settings choose; it draws at random from `seed`.
    pub fn catch_planner(&self, known: &Preparation, seed: u64) -> Box<dyn CatchPlanner> {
        match self.method {
            Method::Ours => Box::new(known.catch_planner()),
            Method::Paper => Box::new(PaperPlanner::new(self.paper_method, known, seed)),
        }
    }
}

impl From<Config> for BrainSettings {
    /// The settings of a brain that has our stages.
    fn from(config: Config) -> Self {
        Self::default().with(config)
    }
}

/// Stages that were chosen by settings.
pub type ChosenStages = (Box<dyn PoseEstimator>, Box<dyn FlightPredictor>, Box<dyn CatchPlanner>);

/// A brain in a trial.
pub trait ObservedBrain: Brain {
    /// Returns the state and the plan after the last tick, if the brain reports them. Without it the referee
    /// still judges what was caught, but not how well the flight was predicted.
    fn report(&self) -> Option<&Report> {
        None
    }
}

impl ObservedBrain for CatchingCycle {
    fn report(&self) -> Option<&Report> {
        self.report()
    }
}

impl ObservedBrain for CatchingBot {
    fn report(&self) -> Option<&Report> {
        Some(self.report())
    }
}
