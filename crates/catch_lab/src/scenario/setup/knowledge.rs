//! All that a brain is made of: what the owner of a cell knows of it.

use std::sync::Arc;

use catch_body::{Gripper, Robot};
use catch_bot::{CatchingBot, Preparation};
use catch_cell::{CameraModel, KnownObject};
use catch_sim::random_streams::{Draws, Stream};

use super::{
    CHECKED, Setup,
    calibration::{self, CalibratedCameras, of_seed},
};
use catch_recording::{brain::BrainSettings, reach_map};

/// Knowledge of a cell's owner about it. Neither the truth nor any setting of the arena is within reach of
/// what is made from this.
#[derive(Debug, Clone, Copy)]
pub struct Knowledge<'a> {
    /// The brain's settings, of the scenario.
    pub settings: &'a BrainSettings,
    /// The arm, by its file.
    pub robot: &'a Robot,
    /// The gripper, by its file.
    pub gripper: &'a Gripper,
    /// The cameras, by their rig's file and their data sheet.
    pub cameras: &'a [CameraModel],
    /// The object, by a scan and its file.
    pub object: &'a KnownObject,
}

impl Knowledge<'_> {
    /// The brain's settings, complete, with what a calibration found where there was one.
    pub(crate) fn config(&self, calibrated: Option<&CalibratedCameras>) -> BrainSettings {
        let mut config = self.settings.clone();
        if let Some(calibrated) = calibrated {
            let p_WG = self.robot.gripper_pose(&self.robot.ready_q).translation.vector.into();
            let perception = &mut config.perception;
            perception.uncalibrated_cameras = calibration::left_out(&calibrated.found);
            // An alignment may turn a camera as far as its calibration leaves the arm's place open.
            perception.camera_sd_rad = perception.camera_sd_rad.max(calibrated.direction_sd_rad(&p_WG));
            let prediction = &mut config.trajectory_prediction;
            prediction.systematic_sd_m = prediction.systematic_sd_m.max(calibrated.position_sd_m(&p_WG));
        }
        config.given(&self.object.figures, self.cameras)
    }

    /// Preparation of the brain before anything flies, with the cameras where they are believed to stand.
    ///
    /// # Panics
    /// If settings were changed in code to values out of their ranges.
    pub(crate) fn preparation(&self, config: &BrainSettings, cameras: Vec<CameraModel>) -> Preparation {
        let robot = (self.robot.clone(), reach_map::of(self.robot));
        let prepared = Preparation::new(config.config(), robot, self.gripper.clone(), cameras, &self.object.scan);
        prepared.expect(CHECKED)
    }
}

impl Setup {
    /// Returns the knowledge of this cell's owner.
    pub fn knowledge(&self) -> Knowledge<'_> {
        let Self { scenario, robot, gripper, cameras, known_object, .. } = self;
        Knowledge { settings: &scenario.brain, robot, gripper, cameras, object: known_object }
    }

    /// The brain's settings, but for what a calibration says.
    pub fn uncalibrated_config(&self) -> BrainSettings {
        self.knowledge().config(None)
    }

    /// The brain's settings in scenes of `seed`: those of the scenario, what is known of object and cameras
    /// beforehand, and what a calibration claims.
    pub fn brain_config(&self, seed: u64) -> BrainSettings {
        self.knowledge().config(self.calibrated(seed).as_deref())
    }

    /// Seed of what the brain draws at random in one scene.
    pub fn brain_seed(&self, seed: u64, index: u64) -> u64 {
        Draws::new(Stream::Brain, seed, index).bits()
    }

    /// Preparation of the brain before anything flies, with the cameras as they are in the rig's file.
    ///
    /// # Panics
    /// If settings were changed in code to values out of their ranges.
    pub fn known(&self) -> &Arc<Preparation> {
        let make = || self.knowledge().preparation(&self.uncalibrated_config(), self.cameras.clone());
        self.known.get_or_init(|| Arc::new(make()))
    }

    /// Preparation of the brain before anything flies, with the cameras as it believes them to stand in
    /// scenes of `seed`.
    ///
    /// # Panics
    /// As [`known`](Self::known).
    pub fn known_for(&self, seed: u64) -> Arc<Preparation> {
        match self.calibrated(seed) {
            None => self.known().clone(),
            Some(calibrated) => {
                let make = || self.knowledge().preparation(&self.brain_config(seed), calibrated.cameras.clone());
                of_seed(&self.known_calibrated, seed, make)
            }
        }
    }

    /// A brain that has seen nothing yet.
    ///
    /// # Panics
    /// As [`known`](Self::known).
    pub fn brain(&self, seed: u64, index: u64) -> CatchingBot {
        self.brain_config(seed).brain(self.known_for(seed), self.brain_seed(seed, index))
    }
}
