//! The `[arena]` table of a scenario.

use catch_body::{InputError, quantity};
use catch_cell::CameraModel;
use serde::{Deserialize, Serialize};

pub use crate::drawn::{Between, Drawn};

use crate::{
    aerodynamics::AerodynamicsConfig, camera_faults::CameraFault, depth_noise::DepthConfig, person::PersonConfig,
};

/// Settings of the arena. The defaults are the paper's where the paper says something.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArenaConfig {
    /// Drive model of the gripper. `ideal`: as strong as the real one, without limit of speed beyond the
    /// fingers' own inertia and without latency. `real`: within the limits of its file, with the connection
    /// of its table `drive`. `position`: by the paper's controllers, one for each finger, which jump to the
    /// commanded width whatever speed and force the command has.
    pub gripper: GripperDriveKind,
    /// Trigger that makes the fingers close. `command`: the brain's commands. `proximity`: a sensor in the
    /// gripper that sees where the object truly is, as in the paper's simulator; commands are ignored.
    pub gripper_trigger: GripperTrigger,
    /// True for bodies of the paper's simulator: objects have the shapes, the frames and the mass properties
    /// of the table `published` of their files. Off by default: inertias are wrong by factors of 10 to
    /// 10,000.
    pub published_bodies: bool,
    /// True if the gripper has the moments of inertia and the fingertips that it has in the paper's
    /// simulator, if its file gives them.
    pub published_gripper: bool,
    /// Coulomb friction coefficient of all contacts: a number, or `{ min, max }` from which every throw draws
    /// one. Default 0.667, to which the paper's simulator combines its materials; there is no sourced value
    /// for rubber on felt. An object whose own file has a friction coefficient keeps that.
    pub friction: quantity::friction<Drawn>,
    /// Multiplies the object's own restitution.
    pub restitution_scale: quantity::factor,
    /// Every throw draws its restitution uniformly within this fraction around that. None in the paper.
    pub restitution_spread: quantity::spread,
    /// Aerodynamic drag on the object. Off by default, as in the paper.
    pub drag: bool,
    /// Every throw draws its drag uniformly within this fraction around the object's own. None by default.
    pub drag_spread: quantity::spread,
    /// Aerodynamic effects besides the mean drag. Off by default.
    pub aerodynamics: AerodynamicsConfig,
    /// Velocity of the air in W, in m/s; it counts where there is drag.
    pub wind: quantity::wind_mps<[f64; 3]>,
    /// Every throw spins about a random axis at a rate drawn uniformly up to this one, besides what the
    /// throw's own file says. None in the paper; people throw small things with up to 25 rad/s.
    pub max_spin_radps: quantity::speed_radps,
    /// Errors of the robot's encoders and of its model.
    pub robot_errors: RobotErrors,
    /// Deviations of the robot controller from an ideal one.
    pub robot_controller: RobotController,
    /// Labels of the object's pixels in the images. On by default: the paper segments by the renderer's
    /// labels.
    pub labels: bool,
    /// Visibility of the floor, which always collides. Off by default: the paper has none, and its lower
    /// cameras look through where it would be.
    pub floor_visible: bool,
    /// Errors of the depth images. None by default, as in the paper.
    pub depth: DepthConfig,
    /// Cameras that fail, each at its time. None by default.
    pub camera_faults: Vec<CameraFault>,
    /// A person who walks through the images. Nobody by default.
    pub person: Option<PersonConfig>,
    /// True if the person who throws stands in the images: underarm, the hand behind the object. Off by
    /// default.
    pub thrower: bool,
    /// Observations per second, each with an image of every camera unless these run freely. Default 100 Hz
    /// (paper, IV).
    pub frame_rate_hz: quantity::rate_hz,
    /// Free-running cameras: each takes its images at the `rate_hz` of its rig's file, else at
    /// `frame_rate_hz`, and at a phase that every throw draws. An observation has the images that have
    /// arrived since the last one. Off by default.
    pub free_running_cameras: bool,
    /// Latency of an image, in seconds: a number, or `{ min, max }` from which every image draws. The images
    /// of a camera arrive in their order.
    pub latency_s: quantity::latency_s<Drawn>,
    /// Time step of the physics and period of the servo. Default 1 ms.
    pub step_s: quantity::step_s,
}

/// Drive model of the gripper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripperDriveKind {
    /// Drive as strong as the real gripper, but without limit of speed beyond the fingers' own inertia and
    /// without latency: about 5 ms from wide open to a tennis ball. The paper's gripper, less its 1000 N.
    #[default]
    Ideal,
    /// A real one: the limits of speed, acceleration and force in the gripper's file hold, and commands and
    /// states take time, as its table `drive` says.
    Real,
    /// One controller for each finger, which jumps to the commanded width whatever speed and force the
    /// command has: the paper's.
    Position,
}

/// Trigger that makes the fingers close.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripperTrigger {
    /// The brain's commands.
    #[default]
    Command,
    /// A sensor in the gripper that sees where the object truly is, as in the paper's simulator; commands are
    /// ignored. Fingers that have closed stay so.
    Proximity,
}

/// Errors of the robot's encoders and of its model. All zero by default, as in the paper.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RobotErrors {
    /// Standard deviation of what a joint's encoder reads, in radians. Robot controller and brain know the
    /// joints by it: unless this and the step are zero, a reading is one control cycle old, and velocities
    /// are estimated from positions.
    pub encoder_sd_rad: quantity::error_rad,
    /// Step in which an encoder reads, in radians.
    pub encoder_step_rad: quantity::error_rad,
    /// Every link's mass and inertia are drawn uniformly within this fraction around the model that the robot
    /// controller computes with.
    pub link_mass_spread: quantity::spread,
    /// Standard deviation of how far the surface of each link that cameras see is outside of the model, in
    /// metres. Covers, cables and labels on the links rise up to 15 times as far.
    pub link_surface_sd_m: quantity::error_m,
    /// Displacement of the gripper from the mounting in the model, in a random direction, in metres.
    pub tool_position_m: quantity::error_m,
    /// Rotation of the gripper from the mounting in the model, about a random axis, in degrees.
    pub tool_rotation_deg: quantity::error_deg,
}

/// Deviations of the robot controller from an ideal one. None by default.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RobotController {
    /// True for time stamps that are off by up to 0.5 ms, states in single precision, a lag of 2 ms behind
    /// each point of a trajectory, and every tenth trajectory declined, at random.
    pub inexact: bool,
    /// True if the controller takes trajectories that jump at their start or do not end at rest, as the
    /// paper's do.
    pub takes_jumps: bool,
    /// True if the motors give all the torque that the controller asks for, as the paper's do.
    pub unlimited_torque: bool,
    /// Gains of its computed torque.
    pub gains: ControllerGains,
    /// The links, base to tip, of the arm whose dynamics it computes torques by, without gripper and damping.
    /// None: it knows the arm that it moves.
    pub links: Vec<ModelLink>,
}

/// Accelerations that a robot controller asks for by the error of a joint's position.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ControllerGains {
    /// Gain of the error, in 1/s².
    pub proportional_per_s2: quantity::gain,
    /// Gain of the integral of the error, in 1/s³.
    pub integral_per_s3: quantity::gain,
    /// Gain of the rate of the error, in 1/s.
    pub derivative_per_s: quantity::gain,
}

impl Default for ControllerGains {
    /// Critically damped at 50 rad/s, a twentieth of the rate at which the controller runs, so that sampling
    /// costs little phase.
    fn default() -> Self {
        Self { proportional_per_s2: 2500.0, integral_per_s3: 0.0, derivative_per_s: 100.0 }
    }
}

/// A link of a robot controller's model.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModelLink {
    /// Mass in kg.
    pub mass_kg: quantity::part_mass_kg,
    /// Centre of mass in the link's frame.
    pub com_m: quantity::offset_m<[f64; 3]>,
    /// Principal moments of inertia about it along the link's axes, in kg·m².
    pub inertia_kgm2: quantity::moment_kgm2<[f64; 3]>,
    /// Inertia of the rotor that drives it, reflected to the joint, in kg·m².
    pub rotor_inertia_kgm2: quantity::rotor_inertia_kgm2,
}

impl Default for ArenaConfig {
    fn default() -> Self {
        Self {
            gripper: GripperDriveKind::default(),
            gripper_trigger: GripperTrigger::default(),
            published_bodies: false,
            published_gripper: false,
            friction: Drawn::Always(0.667),
            restitution_scale: 1.0,
            restitution_spread: 0.0,
            drag: false,
            drag_spread: 0.0,
            aerodynamics: AerodynamicsConfig::default(),
            wind: [0.0; 3],
            max_spin_radps: 0.0,
            robot_errors: RobotErrors::default(),
            robot_controller: RobotController::default(),
            labels: true,
            floor_visible: false,
            depth: DepthConfig::default(),
            camera_faults: Vec::new(),
            person: None,
            thrower: false,
            frame_rate_hz: 100.0,
            free_running_cameras: false,
            latency_s: Drawn::default(),
            step_s: 1e-3,
        }
    }
}

/// Room for the images that have been taken and have not arrived yet.
const MOST_GIB_UNDER_WAY: f64 = 1.0;

impl ArenaConfig {
    /// Finds all settings that cannot be used although every number is within its range; `file` and `table`
    /// name the place: ranges whose ends are swapped, a frame interval that is not a whole number of steps.
    pub fn faults(&self, file: &str, table: &str) -> Vec<InputError> {
        let mut faults: Vec<InputError> =
            self.depth.check(file, &format!("{table}.depth")).err().into_iter().flat_map(InputError::all).collect();
        let steps = 1.0 / self.frame_rate_hz / self.step_s;
        if !(steps >= 0.5 && (steps - steps.round()).abs() <= 1e-6 * steps) {
            let expected = "a rate whose interval is a whole number of steps (step_s)";
            faults.push(InputError::new(file, format!("{table}.frame_rate_hz"), self.frame_rate_hz, expected));
        }
        faults
    }

    /// Checks the settings against the cameras of a rig: faults of cameras that it does not have, rates of
    /// which the physics' steps leave out images, and more images under way than there is room for.
    ///
    /// # Errors
    /// If a setting cannot be used: the first of them.
    pub fn check_cameras(&self, cameras: &[CameraModel], file: &str, table: &str) -> Result<(), InputError> {
        let most_hz = self.step_s.recip();
        let too_fast = |it: &&CameraModel| it.rate_hz.is_some_and(|rate_hz| rate_hz > most_hz * (1.0 + 1e-9));
        if let Some(camera) = cameras.iter().find(too_fast).filter(|_| self.free_running_cameras) {
            let found = format!("true, with a camera at {} Hz", camera.rate_hz.unwrap_or_default());
            let expected = format!("cameras at {most_hz} Hz or less, an image for each step of {} s", self.step_s);
            return Err(InputError::new(file, format!("{table}.free_running_cameras"), found, expected));
        }
        let [_, latest_s] = self.latency_s.bounds();
        let bytes_per_s = |it: &CameraModel| {
            let own_hz = it.rate_hz.unwrap_or(self.frame_rate_hz);
            let rate_hz = if self.free_running_cameras { own_hz } else { own_hz.min(self.frame_rate_hz) };
            // A depth and a bit of the mask for each pixel.
            5.0 * rate_hz * it.full_window().area() as f64
        };
        let gib = latest_s * cameras.iter().map(bytes_per_s).sum::<f64>() / f64::from(1 << 30);
        if gib > MOST_GIB_UNDER_WAY {
            let found = format!("{latest_s} s, with {gib:.1} GiB of images under way");
            let expected = format!("at most {MOST_GIB_UNDER_WAY} GiB: less latency, or fewer images or pixels");
            return Err(InputError::new(file, format!("{table}.latency_s"), found, expected));
        }
        let faults = self.camera_faults.iter().enumerate();
        InputError::first_of(faults.map(|(i, it)| it.check(cameras, file, &format!("{table}.camera_faults[{i}]"))))
    }

    /// Steps of the physics from one image to the next.
    pub fn steps_per_frame(&self) -> u64 {
        (1.0 / self.frame_rate_hz / self.step_s).round().max(1.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_that_run_freely_are_no_faster_than_the_physics() {
        let camera = CameraModel {
            rate_hz: Some(2000.0),
            ..CameraModel::with_field_of_view(catch_body::Pose::identity(), 8, 8, 1.0)
        };
        let check = |free_running_cameras: bool, step_s: f64| {
            ArenaConfig { free_running_cameras, step_s, ..Default::default() }.check_cameras(
                std::slice::from_ref(&camera),
                "s.toml",
                "arena",
            )
        };
        let fault = check(true, 1e-3).unwrap_err().to_string();
        assert!(fault.contains("arena.free_running_cameras") && fault.contains("2000 Hz"), "{fault}");
        assert!(check(false, 1e-3).is_ok() && check(true, 5e-4).is_ok());
    }

    #[test]
    fn an_empty_table_is_the_default_and_a_misspelt_field_a_fault() {
        assert_eq!(toml::from_str::<ArenaConfig>("").unwrap(), ArenaConfig::default());
        let config: ArenaConfig = toml::from_str("friction = 0.5\ngripper = \"ideal\"").unwrap();
        assert_eq!(config.friction, Drawn::Always(0.5));
        assert!(toml::from_str::<ArenaConfig>("frictoin = 0.5").is_err());
        let config: ArenaConfig = toml::from_str("friction = { min = 0.4, max = 1.0 }\ngripper = \"real\"").unwrap();
        assert_eq!(config.friction.bounds(), [0.4, 1.0]);
        assert_eq!(config.gripper, GripperDriveKind::Real);
        assert!(toml::from_str::<ArenaConfig>("gripper = \"reel\"").is_err());
        assert!(toml::from_str::<ArenaConfig>("wind = [1.0, 2.0]").is_err());
    }

    #[test]
    fn values_out_of_range_are_named() {
        assert_eq!(ArenaConfig::default().faults("s.toml", "arena"), []);
        let uneven = ArenaConfig { frame_rate_hz: 300.0, ..Default::default() }.faults("s.toml", "arena");
        assert!(uneven.len() == 1 && uneven[0].to_string().contains("arena.frame_rate_hz"), "{uneven:?}");
        let read = |text: &str| InputError::parse_toml::<ArenaConfig>("s.toml", text).unwrap_err().to_string();
        for text in [
            "friction = -1",
            "drag_spread = 1.5",
            "step_s = nan",
            "frame_rate_hz = 1e-9",
            "max_spin_radps = 1e300",
            "latency_s = -1",
            "latency_s = { min = 0.01, max = 1 }",
            "step_s = 0",
            "robot_errors.tool_position_m = 1e300",
            "aerodynamics.drag_anisotropy = 1.0",
            "aerodynamics.max_magnus = -0.1",
            "aerodynamics.max_spin_decay_per_s = inf",
            "wind = [1e300, 0.0, 0.0]",
        ] {
            let fault = read(text);
            let field = text.split([' ', '{']).next().unwrap();
            assert!(fault.starts_with(&format!("s.toml: {field}")), "{fault}");
        }
        let fault = read("latency_s = { min = 0.03, max = 0.02 }");
        assert!(fault.contains("latency_s.min: found 0.03, expected 0.02 or less: not above the max"), "{fault}");
    }
}
