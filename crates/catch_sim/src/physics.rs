//! The physics of arm, gripper, object and floor.
//!
//! Arm and fingers are a tree of rigid bodies in minimal coordinates (`machine.rs`), the object is a free
//! rigid body (`free_motion.rs`). While nothing is in reach of anything, both go on by integrators of second
//! order or better. Contacts are critically damped springs that are as stiff as the object (`contacts.rs`);
//! the library `parry3d-f64` finds the points (`colliders.rs`). Where something moves against something, a
//! step of 1 ms is divided into four. Rebounds follow Poisson's law at all points at once (`restitution.rs`).

mod colliders;
mod contacts;
mod free_motion;
mod machine;
mod restitution;
mod spatial;

use catch_body::{Gripper, JointVector, Pose, Robot, Twist};
use nalgebra::{UnitQuaternion, Vector3};

use crate::{object::ThrownObject, throw::Release, truth::Contact};
use colliders::{Bodies, Body, Colliders};
use contacts::{Contacts, Masses, Velocities};
pub(crate) use free_motion::FlyingObject;
use machine::{Coordinates, Machine, Posture, Stop};

/// Constants of the physics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldSettings {
    /// Time step.
    pub step_s: f64,
    /// Number of substeps into which the solver divides a step with contacts.
    pub substeps: usize,
    /// Coulomb friction coefficient of all contacts.
    pub friction: f64,
    /// Coefficient of restitution of all contacts.
    pub restitution: f64,
    /// Inertia of the gripper's motor and gear, reflected to each finger.
    pub drive_mass_kg: f64,
}

/// Loads on the world during one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loads {
    /// Torques of the arm's motors in N·m.
    pub torque: JointVector,
    /// Forces that open the left and the right finger, in N.
    pub finger_force_n: [f64; 2],
    /// Force on the object's centre of mass in W, in N.
    pub object_force_n: Vector3<f64>,
    /// Torque on it in W, in N·m.
    pub object_torque_nm: Vector3<f64>,
    /// Gravity in W, in m/s².
    pub gravity: Vector3<f64>,
}

/// The state of everything that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldState {
    /// Joint positions.
    pub q: JointVector,
    /// Joint velocities.
    pub dq: JointVector,
    /// Distances of the left and the right finger's inner face from the middle of the gripper, in metres.
    pub finger_m: [f64; 2],
    /// Speeds of the fingers in m/s, positive while opening.
    pub finger_mps: [f64; 2],
    /// Pose of the object.
    pub X_WO: Pose,
    /// Spatial velocity of the object, the linear part at the origin of O.
    pub V_WO: Twist,
}

impl WorldState {
    /// Returns whether every number is finite, and joints and fingers are within the range of sensors.
    pub fn is_measurable(&self) -> bool {
        use catch_body::quantity::{DRIVE_M, DRIVE_MPS, JOINT_RAD, JOINT_RADPS};
        let X_WO = &self.X_WO;
        self.q.iter().all(|it| JOINT_RAD.contains(*it))
            && self.dq.iter().all(|it| JOINT_RADPS.contains(*it))
            && self.finger_m.iter().all(|it| DRIVE_M.contains(2.0 * it))
            && self.finger_mps.iter().all(|it| DRIVE_MPS.contains(2.0 * it))
            && X_WO.translation.vector.iter().chain(X_WO.rotation.coords.iter()).all(|value| value.is_finite())
            && self.V_WO.angular.iter().chain(self.V_WO.linear.iter()).all(|value| value.is_finite())
    }
}

/// Contact between the object and its surroundings during the last step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContactForces {
    /// Parts that touched the object.
    pub contact: Contact,
    /// Sums of the normal forces at left and right finger, rebounds included, in N, averaged over the step.
    pub finger_n: [f64; 2],
}

/// The body that a collider belongs to, as far as the referee cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Object,
    LeftFinger,
    RightFinger,
    Palm,
    Arm,
    Floor,
    Obstacle,
}

/// Things that move against each other more slowly are at rest, in m/s.
const AT_REST_MPS: f64 = 0.01;
/// Number of the parts.
const PARTS: usize = 7;

impl Part {
    /// Name of the part for people.
    fn name(self) -> &'static str {
        match self {
            Self::Object => "itself",
            Self::LeftFinger | Self::RightFinger => "a finger",
            Self::Palm => "the palm",
            Self::Arm => "the arm",
            Self::Floor => "the floor",
            Self::Obstacle => "an obstacle",
        }
    }
}

/// Arm, gripper, object and floor.
pub struct World {
    settings: WorldSettings,
    machine: Machine,
    colliders: Colliders,
    contacts: Contacts,
    pub(crate) object: FlyingObject,
    /// Stiffness of the object's surface, if it is soft.
    stiffness_npm: Option<f64>,
    /// Contact forces of the last step.
    pub contact_forces: ContactForces,
}

/// Normal impulses on the object in a step, by the part that pushes, in N·s.
type Impulses = [f64; PARTS];

impl ContactForces {
    /// Forces that impulses are over a step.
    fn of(impulses: &Impulses, step_s: f64) -> Self {
        let touches = |part: Part| impulses[part as usize] > 0.0;
        Self {
            contact: Contact {
                left_finger: touches(Part::LeftFinger),
                right_finger: touches(Part::RightFinger),
                palm: touches(Part::Palm),
                arm: touches(Part::Arm),
                floor: touches(Part::Floor),
                obstacle: touches(Part::Obstacle),
                peak_impulse_ns: impulses.iter().copied().fold(0.0, f64::max),
            },
            finger_n: [Part::LeftFinger, Part::RightFinger].map(|part| impulses[part as usize] / step_s),
        }
    }
}

impl World {
    /// A world at rest but for the object, which has just been released. The arm comes without the gripper's
    /// mass; one without joints is a mount that is fixed in the world. The gripper is `width_m` open.
    pub fn new(
        settings: WorldSettings,
        (robot, q): (&Robot, &JointVector),
        gripper: &Gripper,
        width_m: f64,
        (object, release): (&ThrownObject, &Release),
    ) -> Self {
        let machine = Machine::new(robot, q, gripper, settings.drive_mass_kg, width_m / 2.0);
        let mut colliders = Colliders::new(&machine, robot, gripper);
        colliders.exchange_object(object);
        let mut contacts = Contacts::default();
        contacts.contacts.reserve(colliders.touches.capacity());
        Self {
            settings,
            machine,
            colliders,
            contacts,
            object: FlyingObject::released(object, release),
            stiffness_npm: object.stiffness_npm,
            contact_forces: ContactForces::default(),
        }
    }

    /// Takes the object out and puts another one in, which has just been released. Friction and restitution
    /// of all contacts are those of the new one from now on.
    pub fn exchange_object(&mut self, object: &ThrownObject, release: &Release, friction: f64, restitution: f64) {
        (self.settings.friction, self.settings.restitution) = (friction, restitution);
        self.colliders.exchange_object(object);
        (self.object, self.stiffness_npm) = (FlyingObject::released(object, release), object.stiffness_npm);
        self.contact_forces = ContactForces::default();
    }

    /// Lets one step pass and tells whether all went well. If not, something was no longer finite, and what
    /// follows means nothing.
    pub fn step(&mut self, loads: &Loads) -> bool {
        let WorldSettings { step_s, substeps, .. } = self.settings;
        let mut impulses = Impulses::default();
        let went_well = self.advance(loads, (step_s, substeps), &mut impulses).is_some();
        self.contact_forces = ContactForces::of(&impulses, step_s);
        went_well && self.state().is_measurable()
    }

    /// Lets `step_s` pass, in so many parts where something moves against something.
    fn advance(&mut self, loads: &Loads, (step_s, parts): (f64, usize), impulses: &mut Impulses) -> Option<()> {
        let Machine { positions, velocities, .. } = self.machine;
        let forces = self.machine.joined(&loads.torque, loads.finger_force_n);
        let posture = self.machine.posture(&positions, step_s)?;
        let bodies = self.bodies(&posture);
        self.colliders.find_touches(&bodies, step_s);
        let touches = &self.colliders.touches;
        if parts > 1 && touches.iter().any(|touch| bodies.relative_mps(touch) > AT_REST_MPS) {
            return (0..parts)
                .try_for_each(|_| self.advance(loads, (step_s / parts as f64, 1), impulses).ok_or(()))
                .ok();
        }
        let damping = self.machine.damping(&velocities);
        let acceleration_in = |posture: &Posture, velocities: &Coordinates| {
            posture.factor.solve(&(forces - damping - self.machine.bias_forces(posture, velocities, &loads.gravity)))
        };
        // The midpoint rule.
        let halfway = velocities + acceleration_in(&posture, &velocities) * (step_s / 2.0);
        let half_posture = self.machine.posture(&(positions + velocities * (step_s / 2.0)), step_s)?;
        let acceleration = acceleration_in(&half_posture, &halfway);
        let stops = self.machine.stops(&acceleration, step_s);
        if touches.is_empty() && stops.iter().all(Option::is_none) {
            self.machine.positions += halfway * step_s;
            self.machine.velocities += acceleration * step_s;
            self.object.fly(&loads.gravity, (&loads.object_force_n, &loads.object_torque_nm), step_s);
        } else {
            // The stops of the fingers alone are met in parts at no cost.
            let parts = if touches.is_empty() { self.settings.substeps } else { 1 };
            self.step_in_contact(loads, (&posture, &acceleration), &stops, (step_s, parts), impulses);
        }
        Some(())
    }

    /// A step in which something may touch something, in so many parts.
    fn step_in_contact(
        &mut self,
        loads: &Loads,
        (posture, acceleration): (&Posture, &Coordinates),
        stops: &[Option<Stop>],
        (step_s, parts): (f64, usize),
        impulses: &mut Impulses,
    ) {
        let WorldSettings { friction, restitution, .. } = self.settings;
        let part_s = step_s / parts as f64;
        let FlyingObject { body, mut X_WC, V_WC, .. } = self.object;
        let mut positions = self.machine.positions;
        let before = Velocities { machine: self.machine.velocities, linear: V_WC.linear, angular: V_WC.angular };
        let masses = Masses {
            machine: &self.machine,
            posture,
            root_kg: body.mass_kg.sqrt(),
            roots_W: body.roots_along(&X_WC.rotation),
            p_WC: X_WC.translation.vector,
        };
        let contacts = &mut self.contacts;
        contacts.begin(&masses, (&self.colliders.touches, stops), (friction, self.stiffness_npm), part_s);
        let linear = loads.gravity + loads.object_force_n / body.mass_kg;
        let q_WC = X_WC.rotation;
        let mut momentum = body.momentum(&q_WC, &V_WC.angular);
        let mut now = before;
        for _ in 0..parts {
            now.machine += acceleration * part_s;
            now.linear += linear * part_s;
            momentum += loads.object_torque_nm * part_s;
            now.angular = body.angular_velocity(&X_WC.rotation, &momentum);
            let unpushed = now.angular;
            contacts.advance(&masses, &mut now, |now| {
                positions += now.machine * part_s;
                X_WC.translation.vector += now.linear * part_s;
                X_WC.rotation = UnitQuaternion::from_scaled_axis(now.angular * part_s) * X_WC.rotation;
            });
            // Contacts stay where they were when the step began, and answer by the inertia of then.
            momentum += body.momentum(&q_WC, &(now.angular - unpushed));
        }
        now.angular = body.angular_velocity(&X_WC.rotation, &momentum);
        let contacts = &mut contacts.contacts;
        let of_object = || contacts.iter().filter(|it| it.touch.pushed == Body::Object);
        if of_object().any(|it| it.normal.total_ns > 0.0) {
            of_object().for_each(|it| impulses[it.touch.part as usize] += it.normal.total_ns);
            let unpushed = now.angular;
            restitution::let_rebound(&masses, contacts, (friction, restitution), &mut now, impulses);
            momentum += body.momentum(&q_WC, &(now.angular - unpushed));
            now.angular = body.angular_velocity(&X_WC.rotation, &momentum);
            (self.object.X_WC, self.object.V_WC) = (X_WC, Twist { angular: now.angular, linear: now.linear });
        } else {
            self.object.fly(&loads.gravity, (&loads.object_force_n, &loads.object_torque_nm), step_s);
        }
        (self.machine.positions, self.machine.velocities) = (positions, now.machine);
        for contact in contacts {
            self.colliders.keep_load(&contact.touch, contact.load(part_s));
        }
    }

    /// Poses and velocities of all bodies.
    fn bodies(&self, posture: &Posture) -> Bodies {
        let (X_WO, V_WO) = self.object.state();
        Bodies { X_WL: posture.X_WL, motions: self.machine.motions(posture, &self.machine.velocities), X_WO, V_WO }
    }

    /// Part that is nearest to the object, and its distance in metres: zero where they touch or overlap.
    pub(crate) fn nearest_to_object(&self) -> Option<(&'static str, f64)> {
        let posture = self.machine.posture(&self.machine.positions, self.settings.step_s)?;
        self.colliders.nearest_to_object(&self.bodies(&posture))
    }

    /// The state after the last step.
    pub fn state(&self) -> WorldState {
        let (X_WO, V_WO) = self.object.state();
        let (q, finger_m) = self.machine.apart(&self.machine.positions);
        let (dq, finger_mps) = self.machine.apart(&self.machine.velocities);
        WorldState { q, dq, finger_m, finger_mps, X_WO, V_WO }
    }
}
