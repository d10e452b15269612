//! What is worked out before anything flies.

use std::sync::Arc;

use catch_body::{Gripper, Robot, ray_cast::ArmSurface};
use catch_cell::{CameraModel, ReferenceScan};

use crate::{
    Config,
    control::{Controller, TimeGridSearch},
    grasp_selection::GraspSet,
    perception::{self, ReferenceModel, SdfEstimator, Surroundings, camera_alignment::CameraAlignment},
    settings::{SettingError, Settings},
    tracker::Tracker,
    trajectory_optimization::{CatchSearch, MotionPlanner},
    trajectory_prediction::InformationFit,
};

/// What is worked out before anything flies, once for any number of throws: the object's model from its scan, its grasp
/// candidates, the planner for the arm, and what the cameras see of the arm while it waits.
#[derive(Debug)]
pub struct Preparation {
    config: Config,
    cameras: Vec<CameraModel>,
    reference: Arc<ReferenceModel>,
    grasps: Arc<GraspSet>,
    search: Arc<CatchSearch>,
    arm_surface: ArmSurface,
    alignment: CameraAlignment,
    workspace: perception::Workspace,
}

impl Preparation {
    /// For an arm with a gripper, cameras at known places, and an object known from a scan.
    ///
    /// The arm is expected to wait at [`Robot::ready_q`] with its gripper open; if it waits elsewhere, the first images take longer.
    ///
    /// # Errors
    /// A setting that is out of its range.
    pub fn new(
        config: Config,
        robot: Robot,
        gripper: Gripper,
        cameras: Vec<CameraModel>,
        reference_scan: &ReferenceScan,
    ) -> Result<Self, SettingError> {
        config.check()?;
        let reference = Arc::new(ReferenceModel::from_scan(reference_scan, &config.perception));
        let grasps = Arc::new(GraspSet::sample(&reference, &gripper, &config.grasp_selection));
        let arm_surface = ArmSurface::new(&robot, &gripper);
        let X_WL = robot.link_poses(&robot.ready_q);
        let waiting = Surroundings { arm: &arm_surface, X_WL, width_m: gripper.max_width_m };
        let alignment = CameraAlignment::before_flight(&cameras, &waiting, &config.perception);
        let workspace = perception::Workspace::before_flight(&cameras, &waiting, &config.perception);
        let motion = MotionPlanner::new(robot, gripper, config.trajectory_optimization.clone());
        let search = Arc::new(CatchSearch::new(motion));
        Ok(Self { config, cameras, reference, grasps, search, arm_surface, alignment, workspace })
    }

    /// The settings.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The cameras as they are believed to stand.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.cameras
    }

    /// The object as the brain knows it.
    pub fn reference(&self) -> &Arc<ReferenceModel> {
        &self.reference
    }

    /// Its grasp candidates.
    pub fn grasps(&self) -> &Arc<GraspSet> {
        &self.grasps
    }

    /// What finds catches and moves the arm to them.
    pub fn search(&self) -> &Arc<CatchSearch> {
        &self.search
    }

    /// Buffers of perception, with what the cameras see of the waiting arm.
    pub fn workspace(&self) -> &perception::Workspace {
        &self.workspace
    }

    /// Our pose estimator.
    pub fn pose_estimator(&self) -> SdfEstimator {
        SdfEstimator::new(self.config.perception.clone(), self.reference.clone(), self.workspace.clone())
    }

    /// Our flight predictor, which draws at random from `seed`.
    pub fn flight_predictor(&self, seed: u64) -> InformationFit {
        InformationFit::new(self.config.trajectory_prediction.clone(), self.reference.symmetry, seed)
    }

    /// Our catch planner.
    pub fn catch_planner(&self) -> TimeGridSearch {
        let Config { control, grasp_selection, .. } = &self.config;
        TimeGridSearch::new(control.clone(), grasp_selection.clone(), self.grasps.clone(), self.search.clone())
    }

    pub(crate) fn arm_surface(&self) -> &ArmSurface {
        &self.arm_surface
    }

    pub(crate) fn tracker(&self) -> Tracker {
        Tracker::new(self.alignment.clone())
    }

    pub(crate) fn controller(&self) -> Controller {
        let Config { control, grasp_selection, .. } = self.config.clone();
        Controller::new(
            control,
            grasp_selection,
            self.search.motion().robot().clone(),
            self.search.motion().gripper().clone(),
        )
    }
}
