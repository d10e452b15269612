//! The simulated cell.

use std::{convert::Infallible, f64::consts::TAU, sync::Arc};

use catch_body::{JointVector, MAX_JOINTS, Pose, Robot, dynamics, kinematics::LinkPoses};
use catch_cell::{Cell, Command, Observation};
use nalgebra::Vector3;

use crate::{
    cameras::{Renderer, Scene},
    conditions::Conditions,
    config::{ArenaConfig, GripperDriveKind, GripperTrigger},
    encoders::Encoders,
    equipment::{Equipment, Shared},
    free_flight,
    gripper_drive::{DRIVE_MASS_KG, GripperDrive},
    link_surfaces,
    person::Thrower,
    physics::{ContactForces, Loads, World, WorldSettings, WorldState},
    random_streams::{Draws, Stream},
    sensors::Sensors,
    servo::Servo,
    throw::{RecordedFlight, Release},
    throw_conditions::{CellConditions, FlightConditions, ThrowConditions},
    truth::{Truth, TruthSample},
};

/// An object that is released nearer to something than this, in metres, is in its contact.
const RELEASE_GAP_M: f64 = 1e-3;
/// Parts of a step in which something moves against something: with 4 the outcome of a catch agrees with
/// MuJoCo in 62 of 63 cases.
const SUBSTEPS: usize = 4;
/// Within these distances from the gripper's origin, in all and along its z, the paper's sensor sees the
/// object's, in metres (code).
const SENSED_WITHIN_M: [f64; 2] = [0.25, 0.01];
/// Height of an object that no camera sees, in metres.
const NOWHERE_M: f64 = -1e3;
/// Amplitude and frequency of the disturbance with which the referee tests whether an object is held, in m/s²
/// and Hz, along (1, 1, 1).
const DISTURBANCE_MPS2: f64 = 5.0;
const DISTURBANCE_HZ: f64 = 2.0;

/// An arm, a gripper, cameras and an object in flight.
///
/// Time passes in [`Cell::sense`] only, from one image to the next. The first call senses t = 0.
pub struct Arena {
    equipment: Equipment,
    conditions: Conditions,
    /// The arm as it is, without the gripper's mass; the robot controller and the brain know another one.
    true_robot: Robot,
    encoders: Encoders,
    /// What cameras see.
    renderer: Renderer,
    world: World,
    servo: Servo,
    drive: GripperDrive,
    sensors: Sensors,
    /// Commands under way, with their times of arrival.
    under_way: Vec<(f64, Command)>,
    steps: u64,
    has_sensed: bool,
    /// True if the sensor in the gripper has seen the object.
    has_triggered: bool,
    /// The recorded flight along which the untouched object moves, and when it was released.
    path: Option<(Arc<RecordedFlight>, f64)>,
    /// How long after the next contact with the gripper the disturbance begins, and when it does so.
    disturb_after_s: Option<f64>,
    disturb_from_s: Option<f64>,
    state: WorldState,
    truth: Truth,
}

impl Arena {
    /// The scene (`seed`, `index`): the object is released at t = 0, the arm waits at `ready_q` with its
    /// fingers `width_m` apart.
    pub fn new(equipment: &Equipment, release: &Release, waiting: (&JointVector, f64), seed: u64, index: u64) -> Self {
        let (ready_q, width_m) = waiting;
        let Shared { config, robot, robot_with_gripper, gripper, object, cameras, .. } = &*equipment.shared;
        let conditions = Conditions::draw(config, object, seed, index);
        let true_robot = conditions.true_robot(robot);
        let settings = WorldSettings {
            step_s: config.step_s,
            substeps: SUBSTEPS,
            friction: conditions.friction,
            restitution: conditions.restitution,
            drive_mass_kg: if config.gripper == GripperDriveKind::Real { DRIVE_MASS_KG } else { 0.0 },
        };
        let world = World::new(settings, (&true_robot, ready_q), gripper, width_m, (object, release));
        let surface_sd_m = config.robot_errors.link_surface_sd_m;
        let mut renderer = equipment.shared.renderer.clone();
        if surface_sd_m > 0.0 {
            let mut draws = Draws::new(Stream::LinkSurfaces, seed, index);
            renderer = renderer.with_arm(&link_surfaces::drawn(robot, surface_sd_m, &mut draws), gripper);
        }
        let mut gripper_draws = Draws::new(Stream::Gripper, seed, index);
        let mut arena = Self {
            state: world.state(),
            world,
            servo: Servo::new(
                robot_with_gripper.clone(),
                *ready_q,
                config.robot_controller.clone(),
                Draws::new(Stream::RobotController, seed, index),
            ),
            drive: GripperDrive::new(config.gripper, gripper, width_m, &mut gripper_draws),
            sensors: Sensors::new(config, cameras, seed, index),
            conditions,
            true_robot,
            encoders: Encoders::new(
                &config.robot_errors,
                robot.dof(),
                ready_q,
                Draws::new(Stream::Encoders, seed, index),
            ),
            renderer,
            equipment: equipment.clone(),
            under_way: Vec::new(),
            steps: 0,
            has_sensed: false,
            has_triggered: false,
            path: release.path.clone().map(|path| (path, 0.0)),
            disturb_after_s: None,
            disturb_from_s: None,
            truth: Truth::default(),
        };
        arena.truth.conditions = Some(ThrowConditions {
            flight: FlightConditions::of(object, release, &arena.conditions),
            cell: arena.cell_conditions(),
        });
        arena.see_thrower(release);
        arena.record(JointVector::zeros(), &ContactForces::default());
        arena
    }

    /// Drawn conditions of arm, gripper and cameras.
    fn cell_conditions(&self) -> CellConditions {
        let Conditions { link_mass_ratio, X_MG, .. } = &self.conditions;
        CellConditions {
            link_mass_ratios: link_mass_ratio[..self.true_robot.dof()].to_vec(),
            gripper_mount: X_MG.into(),
            gripper_phase_s: self.drive.phase_s(),
            cameras: self.sensors.camera_poses(),
            hole_fraction: self.sensors.cameras.hole_fraction(),
        }
    }

    /// Name of the part that the object touches or overlaps just after its release: such an object is not
    /// thrown.
    pub fn released_in_contact_with(&self) -> Option<&'static str> {
        self.world.nearest_to_object().filter(|(_, gap_m)| *gap_m < RELEASE_GAP_M).map(|(part, _)| part)
    }

    fn config(&self) -> &ArenaConfig {
        &self.equipment.shared.config
    }

    /// Ground truth so far. No brain may see it.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// Takes the ground truth since the last call, or since the beginning. The disturbance ends.
    pub fn take_truth(&mut self) -> Truth {
        self.update_report();
        self.servo.take_report();
        (self.disturb_after_s, self.disturb_from_s) = (None, None);
        let (last, conditions) = (self.truth.samples.last().copied(), self.truth.conditions.clone());
        std::mem::replace(
            &mut self.truth,
            Truth { samples: last.into_iter().collect(), conditions, ..Truth::default() },
        )
    }

    /// The object is taken away, and that of `equipment` is released now: throw number `index` of `seed`. All
    /// else stays as it is, the robot's and the cameras' errors included; `equipment` must have the same arm,
    /// gripper and cameras. The next image is of this instant.
    pub fn throw_next(&mut self, equipment: &Equipment, release: &Release, seed: u64, index: u64) {
        let Shared { config, object, .. } = &*equipment.shared;
        self.conditions = Conditions::draw(config, object, seed, index);
        self.world.exchange_object(object, release, self.conditions.friction, self.conditions.restitution);
        self.equipment = equipment.clone();
        self.renderer = self.renderer.clone().with_object_of(&equipment.shared.renderer);
        self.path = release.path.clone().map(|path| (path, self.time_s()));
        self.see_thrower(release);
        self.state = self.world.state();
        (self.has_sensed, self.has_triggered) = (false, false);
        self.take_truth();
        self.truth.samples.clear();
        if let Some(conditions) = &mut self.truth.conditions {
            conditions.flight = FlightConditions::of(object, release, &self.conditions);
        }
        self.record(JointVector::zeros(), &ContactForces::default());
    }

    /// The cameras have looked so many times before the throw; the next observation has these images, too.
    /// They show all but the object and who throws it.
    pub fn show_before(&mut self, images: usize) {
        let scene = Scene { X_WO: Pose::translation(0.0, 0.0, NOWHERE_M), ..self.scene() };
        self.sensors.expose_before(&self.renderer, &scene, images);
    }

    /// The cell's clock.
    pub fn time_s(&self) -> f64 {
        self.steps as f64 * self.config().step_s
    }

    /// Starts the disturbance, a vibration of the world along (1, 1, 1), `after_s` after the first contact
    /// with the gripper.
    pub fn disturb_after_contact(&mut self, after_s: f64) {
        (self.disturb_after_s, self.disturb_from_s) = (Some(after_s), None);
    }

    /// Takes note of the first contact with the gripper; `time_s` is the end of its step.
    fn note_contact(&mut self, time_s: f64, forces: &ContactForces) {
        if !forces.contact.gripper() {
            return;
        }
        self.truth.before_contact.get_or_insert_with(|| (&self.servo.report).into());
        let from_s = self.disturb_after_s.map(|after_s| time_s + after_s);
        self.disturb_from_s = self.disturb_from_s.or(from_s);
    }

    /// Acts like [`Cell::act`], but the command arrives `delay_s` from now: the time to compute it.
    pub fn act_after(&mut self, delay_s: f64, command: &Command) {
        self.under_way.push((self.time_s() + delay_s.max(0.0), command.clone()));
        self.deliver();
        self.update_report();
    }

    fn update_report(&mut self) {
        self.truth.servo.clone_from(&self.servo.report);
        self.truth.servo.rejected_gripper_moves = self.drive.refused_moves();
    }

    /// Hands over the commands that have arrived, in the order in which they were sent.
    fn deliver(&mut self) {
        let (now_s, trigger) = (self.time_s() + 1e-9, self.config().gripper_trigger);
        for (at_s, command) in self.under_way.extract_if(.., |(at_s, _)| *at_s <= now_s) {
            if let Some(trajectory) = command.arm {
                self.servo.receive(&trajectory, at_s);
            }
            if let (Some(moves), GripperTrigger::Command) = (command.gripper, trigger) {
                self.drive.receive(&moves, at_s);
            }
            self.sensors.windows = command.windows;
        }
    }

    /// Gravity, and the shaking if there is any.
    fn gravity(&self) -> Vector3<f64> {
        let shaking = self.truth.disturbed_since_s.map_or(0.0, |since_s| {
            DISTURBANCE_MPS2 * libm::sin(TAU * DISTURBANCE_HZ * (self.time_s() - since_s)) / 3.0f64.sqrt()
        });
        dynamics::gravity() + Vector3::repeat(shaking)
    }

    /// Closes the fingers for good once the sensor in the gripper, if there is one, sees the object.
    fn trigger(&mut self, now_s: f64) {
        if self.config().gripper_trigger != GripperTrigger::Proximity {
            return;
        }
        let Some(last) = self.truth.samples.last().filter(|_| !self.has_triggered) else { return };
        let p_GO = last.X_WG.inverse_transform_point(&(last.X_WO * self.equipment.shared.object.origin_O));
        if p_GO.coords.norm() < SENSED_WITHIN_M[0] && p_GO.z.abs() < SENSED_WITHIN_M[1] {
            self.has_triggered = true;
            self.drive.squeeze(now_s);
        }
    }

    /// Torque on the object by the fingers' patches, against its rotation about their normal; it stops the
    /// rotation at most. What the gripper feels of it is less than a thousandth of its own weight.
    fn spin_friction(&self) -> Vector3<f64> {
        let object = &self.equipment.shared.object;
        let Some(last) = self.truth.samples.last() else { return Vector3::zeros() };
        let of_finger = |force_n: &f64| object.spin_friction_nm(self.conditions.friction, *force_n, last.width_m);
        let most: f64 = last.finger_force_n.iter().map(of_finger).sum();
        if most == 0.0 {
            return Vector3::zeros();
        }
        let normal_W = last.X_WG.rotation * Vector3::x();
        let normal_O = last.X_WO.rotation.inverse() * normal_W;
        let rate = (last.V_WO.angular - last.V_WG.angular).dot(&normal_W);
        let stopping = normal_O.dot(&(object.inertia_kgm2 * normal_O)) * rate.abs() / self.config().step_s;
        -normal_W * (rate.signum() * most.min(stopping))
    }

    /// Poses of the links. That of the last one carries the gripper where it truly is: its collision geometry
    /// and its surface are those of the model.
    fn link_poses(&self, q: &JointVector) -> LinkPoses {
        let model = &self.equipment.shared.robot;
        let mut X_WL = self.true_robot.link_poses(q);
        let mounted_off: Pose = self.true_robot.X_LG * model.X_LG.inverse();
        X_WL[MAX_JOINTS] *= mounted_off;
        X_WL
    }

    /// Takes one step of servo, gripper and physics.
    fn step(&mut self) {
        self.deliver();
        let (now_s, step_s) = (self.time_s(), self.config().step_s);
        self.trigger(now_s);
        if self.disturb_from_s.is_some_and(|from_s| now_s >= from_s - 1e-9) {
            self.truth.disturbed_since_s.get_or_insert(now_s);
        }
        let before = self.state;
        let (q, dq) = self.encoders.sensed();
        let torque = self.servo.torque(now_s, step_s, &q, &dq);
        let (air_n, air_nm) = free_flight::air(&self.world.object, &self.conditions, step_s);
        let loads = Loads {
            torque,
            finger_force_n: self.drive.forces(now_s, before.finger_m, before.finger_mps),
            object_force_n: air_n,
            object_torque_nm: self.spin_friction() + air_nm,
            gravity: self.gravity(),
        };
        self.steps += 1;
        let mut forces = ContactForces::default();
        if self.truth.diverged_s.is_none() {
            let went_well = self.world.step(&loads);
            self.follow_path();
            let state = self.world.state();
            if went_well && state.is_measurable() {
                self.state = state;
                forces = self.world.contact_forces;
            } else {
                self.truth.diverged_s = Some(self.time_s());
            }
        }
        self.note_contact(self.time_s(), &forces);
        self.encoders.pass_cycle(&before.q, (&self.state.q, &self.state.dq), &self.servo.asked_radps2, step_s);
        self.servo.watch(self.time_s(), step_s, &self.state.q, &self.state.dq, &before.dq);
        self.record(torque, &forces);
        self.look(false);
    }

    /// Cameras take their images: those that run freely when it is their time, the others at observations.
    fn look(&mut self, at_observation: bool) {
        if self.sensors.are_due(self.time_s(), at_observation) {
            self.sensors.expose(&self.renderer, &self.scene(), at_observation);
        }
    }

    /// All that cameras may see now.
    fn scene(&self) -> Scene {
        let WorldState { q, finger_m, X_WO, .. } = self.state;
        let (X_WL, width_m) = (self.link_poses(&q), finger_m[0] + finger_m[1]);
        Scene { capture_s: self.time_s(), X_WL, width_m, X_WO }
    }

    /// Somebody throws now, where the images show who.
    fn see_thrower(&mut self, release: &Release) {
        let Shared { config, object, .. } = &*self.equipment.shared;
        let thrower =
            config.thrower.then(|| Thrower::new(&release.p_WO, release.v_WO, object.bounding_radius_m)).flatten();
        self.sensors.cameras.thrower = thrower.map(|it| (it, self.time_s()));
    }

    /// Moves the object along the recorded flight until something touches it or the recording ends.
    fn follow_path(&mut self) {
        let untouched = !self.world.contact_forces.contact.any();
        let now_s = self.time_s();
        let recorded = self.path.as_ref().filter(|_| untouched).and_then(|(path, since_s)| path.at(now_s - since_s));
        match recorded {
            Some(recorded) => self.world.object.follow(&recorded),
            None => self.path = None,
        }
    }

    fn record(&mut self, torque: JointVector, forces: &ContactForces) {
        let state = &self.state;
        let Shared { robot, clearance, .. } = &*self.equipment.shared;
        let (X_WL, width_m) = (self.link_poses(&state.q), state.finger_m[0] + state.finger_m[1]);
        self.servo
            .note_clearances(clearance.self_clearance(&X_WL, width_m), clearance.environment_clearance(&X_WL, width_m));
        self.truth.samples.push(TruthSample {
            time_s: self.time_s(),
            q: state.q,
            dq: state.dq,
            torque,
            X_WG: robot.gripper_in(&X_WL),
            V_WG: self.true_robot.gripper_twist(&state.q, &state.dq),
            width_m,
            commanded_width_m: self.drive.commanded_width_m(),
            finger_force_n: forces.finger_n,
            X_WO: state.X_WO,
            V_WO: state.V_WO,
            contact: forces.contact,
        });
    }
}

impl Cell for Arena {
    /// No errors: if the physics diverges, everything stands still from then on, and the truth reports it.
    type Error = Infallible;

    fn sense(&mut self) -> Result<Observation, Infallible> {
        if std::mem::replace(&mut self.has_sensed, true) {
            for _ in 0..self.config().steps_per_frame() {
                self.step();
            }
        }
        let (now_s, state) = (self.time_s(), self.state);
        self.look(true);
        self.update_report();
        let (q, dq) = self.encoders.sensed();
        Ok(Observation {
            time_s: now_s,
            arm: self.servo.arm_state(now_s, q, dq),
            gripper: self.drive.state(state.finger_m, state.finger_mps),
            frames: self.sensors.arrived(now_s),
        })
    }

    fn act(&mut self, command: &Command) -> Result<(), Infallible> {
        self.act_after(0.0, command);
        Ok(())
    }
}
