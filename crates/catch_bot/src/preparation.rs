//! The settings, and what is worked out from them before anything flies.

use std::sync::Arc;

use catch_body::{Gripper, InputError, Robot, ray_cast::ArmSurface};
use catch_cell::{CameraModel, DataSheet, ObjectFigures, ReferenceScan};
use serde::{Deserialize, Serialize};

use crate::{
    control::{self, TimeGridSearch},
    grasp_selection::{self, GraspSet},
    perception::{
        self, DepthNoise, ReferenceModel, SdfEstimator, Surroundings, camera_alignment::CameraAlignment,
        camera_health::CameraHealth,
    },
    trajectory_optimization::{self, CatchSearch, MotionPlanner, reach_map::ReachMap},
    trajectory_prediction::{self, InformationFit},
};

/// All settings of the brain, stage by stage.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Settings of perception: from images to the object's pose.
    pub perception: perception::Config,
    /// Settings of trajectory prediction: from poses to a flight.
    pub trajectory_prediction: trajectory_prediction::Config,
    /// Settings of grasp selection: from a flight to grasps of the object.
    pub grasp_selection: grasp_selection::Config,
    /// Settings of trajectory optimization: from a grasp to the arm's motion.
    pub trajectory_optimization: trajectory_optimization::Config,
    /// Commands and their timing.
    pub control: control::Config,
}

impl Config {
    /// Checks that every setting is within the range that it has in files.
    ///
    /// # Errors
    /// If a setting is out of its range.
    pub fn check(&self) -> Result<(), InputError> {
        InputError::check_settings("settings of the brain", self)
    }

    /// Completes these settings by prior knowledge wherever they are not set: of the object, its drag, its
    /// restitution, its mass and the uncertainty of its centre of mass; of the cameras, their data sheets.
    /// Where these differ, the worst counts.
    #[must_use]
    pub fn given(mut self, object: &ObjectFigures, cameras: &[CameraModel]) -> Self {
        let prediction = &mut self.trajectory_prediction;
        prediction.drag_prior_per_m.get_or_insert(object.drag_per_m);
        prediction.drag_prior_sd_per_m.get_or_insert(object.drag_sd_per_m);
        prediction.com_sd_m.get_or_insert(object.com_sd_m);
        let grasping = &mut self.grasp_selection;
        grasping.restitution = grasping.restitution.or(object.restitution);
        let planning = &mut self.trajectory_optimization;
        planning.object_mass_kg = planning.object_mass_kg.or(object.mass_kg);
        self.complete_by(cameras);
        self
    }

    /// Completes these settings by what follows from the cameras.
    fn complete_by(&mut self, cameras: &[CameraModel]) {
        let perception = &mut self.perception;
        let sheets = || cameras.iter().filter_map(|it| Some((it.sheet.as_ref()?, it.focal_px)));
        let worst =
            |of: fn(&DataSheet, f64) -> f64| sheets().map(|(it, focal_px)| of(it, focal_px)).fold(0.0, f64::max);
        if sheets().next().is_some() {
            perception.depth_noise.get_or_insert(DepthNoise {
                constant_m: worst(|it, _| it.constant_m),
                quadratic_per_m: worst(DataSheet::quadratic_per_m),
            });
            perception.depth_common_fraction.get_or_insert(worst(|it, _| it.common_fraction));
            perception.depth_dropout.get_or_insert(sheets().any(|(it, _)| it.dropout));
            perception.depth_edge_px.get_or_insert(sheets().map(|(it, _)| it.edge_px).max().unwrap_or_default());
        }
        // Cameras that are aligned on the arm may still be rotated about their lines of sight: at the
        // distance d from the arm such a roll σ moves an object by up to d·σ, along one of the two axes that
        // an image tells of; n cameras that look from all around average it to d·σ/√(2n) along each.
        let rolled = perception.camera_sd_rad / (2.0 * cameras.len().max(1) as f64).sqrt();
        self.trajectory_prediction.correlated_sd_per_m.get_or_insert(rolled);
    }
}

/// Models and tables that are prepared before anything flies, once for any number of throws: the object's
/// model from its scan, its grasp candidates, the planner for the arm, and the cameras' view of the waiting
/// arm.
#[derive(Debug)]
pub struct Preparation {
    /// The settings.
    pub config: Config,
    /// The cameras as they are believed to stand.
    pub cameras: Vec<CameraModel>,
    /// The object as the brain knows it.
    pub reference: Arc<ReferenceModel>,
    /// Grasp candidates of the object.
    pub grasps: Arc<GraspSet>,
    /// Search for catches and for the arm's motions to them.
    pub search: Arc<CatchSearch>,
    /// Surface of the arm and its gripper.
    pub arm_surface: ArmSurface,
    /// The cameras' alignment before anything has been seen.
    pub(crate) alignment: CameraAlignment,
    /// The cameras' health before anything has been seen.
    pub(crate) camera_health: CameraHealth,
    /// Buffers of perception, with what the cameras see of the waiting arm.
    pub workspace: perception::Workspace,
}

impl Preparation {
    /// Prepares catches with an arm and its gripper, cameras at known poses, and an object that is known from
    /// a scan.
    ///
    /// The arm is expected to wait at [`Robot::ready_q`] with its fingers as far apart as the
    /// [grasps](GraspSet::widest_aperture_m) need; if it waits elsewhere, the first images take longer.
    /// `reach_map` is that of this arm and pose, if it is [served](ReachMap::serves) by one.
    ///
    /// # Errors
    /// A setting that is out of its range.
    pub fn new(
        mut config: Config,
        (robot, reach_map): (Robot, Option<Arc<ReachMap>>),
        gripper: Gripper,
        cameras: Vec<CameraModel>,
        reference_scan: &ReferenceScan,
    ) -> Result<Self, InputError> {
        config.check()?;
        config.complete_by(&cameras);
        let robot = robot.with_mount_of(&gripper);
        let reference = Arc::new(ReferenceModel::from_scan(reference_scan));
        let grasps = Arc::new(GraspSet::sample(&reference, &gripper, &config.grasp_selection));
        let arm_surface = ArmSurface::new(&robot, &gripper);
        let X_WL = robot.link_poses(&robot.ready_q);
        let width_m = grasps.waiting_width_m(&gripper);
        let waiting = Surroundings { arm: &arm_surface, X_WL, width_m };
        let alignment = CameraAlignment::before_flight(&cameras, &waiting, &config.perception);
        let camera_health = CameraHealth::before_flight(&cameras, &waiting, &config.perception);
        let workspace = perception::Workspace::before_flight(&cameras, &waiting, &config.perception);
        let motion = MotionPlanner::new(robot, gripper, config.trajectory_optimization.clone());
        let search = Arc::new(CatchSearch::new(motion, reach_map));
        Ok(Self { config, cameras, reference, grasps, search, arm_surface, alignment, camera_health, workspace })
    }

    /// Our pose estimator.
    pub fn pose_estimator(&self) -> SdfEstimator {
        SdfEstimator::new(self.config.perception.clone(), self.reference.clone(), self.workspace.clone())
    }

    /// Our flight predictor, which draws at random from `seed`. A single image may not tell the ends of a
    /// round object apart; all images together do, in the pose estimator.
    pub fn flight_predictor(&self, seed: u64) -> InformationFit {
        let symmetry = self.reference.symmetry.with_ends_alike();
        InformationFit::new(self.config.trajectory_prediction.clone(), symmetry, seed)
    }

    /// Our catch planner.
    pub fn catch_planner(&self) -> TimeGridSearch {
        let Config { control, grasp_selection, .. } = &self.config;
        TimeGridSearch::new(control.clone(), grasp_selection.clone(), self.grasps.clone(), self.search.clone())
    }
}
