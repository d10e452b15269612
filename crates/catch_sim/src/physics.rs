//! The physics of arm, gripper, object and floor, on the engine `rapier3d-f64`.
//!
//! The engine's defaults are those of games and wrong for catching. What is set here made the outcome of 62
//! of 63 test catches agree with MuJoCo (`tests/it/catch_table.rs`):
//!
//! * steps of 1 ms with 4 substeps; Coulomb friction per contact point instead of one per patch;
//! * contacts worked out anew in each step; by default they are kept until a pair has moved 50 mm;
//! * contacts as critically damped springs that are as stiff as the object (`softness.rs`). The default would
//!   let a finger sink 23 mm into a tennis ball;
//! * nothing falls asleep; masses are given and not derived from the colliders.
//!
//! While nothing touches the object its motion is not the engine's but that of a free rigid body
//! (`free_motion.rs`), and rebounds follow Newton's law at all points at once (`restitution.rs`).

mod assembly;
mod contact_points;
mod convert;
mod free_motion;
mod release_gap;
mod restitution;
mod softness;

use catch_body::{Gripper, JointVector, MAX_JOINTS, Pose, Robot, Twist};
use nalgebra::{Matrix3, Vector3};
use rapier3d_f64::prelude as engine;

use crate::{
    object::ThrownObject,
    throw::{RecordedState, Release},
    truth::Contact,
};
use convert::{from_pose, from_vector, to_pose, to_vector};
pub(crate) use free_motion::FreeBody;

/// What the gripper is mounted on.
#[derive(Debug, Clone, Copy)]
pub enum Mount<'a> {
    /// An arm that stands still in a pose.
    Arm {
        /// The arm, without the gripper's mass.
        robot: &'a Robot,
        /// Its joint positions.
        q: &'a JointVector,
    },
    /// Nothing that moves: the pose of G in W.
    Fixed(Pose),
}

/// Constants of the physics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldSettings {
    /// Time step.
    pub step_s: f64,
    /// Solver substeps per step.
    pub substeps: usize,
    /// Coulomb friction coefficient of all contacts.
    pub friction: f64,
    /// Coefficient of restitution of all contacts.
    pub restitution: f64,
    /// Inertia of the gripper's motor and gear, reflected to each finger.
    pub drive_mass_kg: f64,
}

/// What acts on the world during one step.
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
    /// How far left and right finger's inner faces are from the middle of the gripper, in metres.
    pub finger_m: [f64; 2],
    /// Their speeds in m/s, positive while opening.
    pub finger_mps: [f64; 2],
    /// Pose of the object.
    pub X_WO: Pose,
    /// Its spatial velocity, the linear part at the origin of O.
    pub V_WO: Twist,
}

impl WorldState {
    /// Whether every number is finite, and joints and fingers are where sensors can tell it.
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
    /// What touched.
    pub contact: Contact,
    /// Sums of the normal forces at left and right finger, rebounds included, in N, averaged over the step.
    pub finger_n: [f64; 2],
}

/// The body that a collider belongs to, as far as the referee cares; kept in the collider's user data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Part {
    Object,
    LeftFinger,
    RightFinger,
    Palm,
    Arm,
    Floor,
    Obstacle,
}

const PARTS: [Part; 7] =
    [Part::Object, Part::LeftFinger, Part::RightFinger, Part::Palm, Part::Arm, Part::Floor, Part::Obstacle];

/// A joint of the tree: the moved body, its parent and the axis in the moved body's frame.
struct Axis {
    child: engine::RigidBodyHandle,
    parent: engine::RigidBodyHandle,
    direction: engine::Vector,
}

/// Arm, gripper, object and floor.
pub struct World {
    settings: WorldSettings,
    parameters: engine::IntegrationParameters,
    pipeline: engine::PhysicsPipeline,
    islands: engine::IslandManager,
    broad_phase: engine::BroadPhaseBvh,
    narrow_phase: engine::NarrowPhase,
    bodies: engine::RigidBodySet,
    colliders: engine::ColliderSet,
    impulse_joints: engine::ImpulseJointSet,
    multibodies: engine::MultibodyJointSet,
    soft_bodies: engine::SoftBodySet,
    ccd: engine::CCDSolver,
    /// The arm's joints, base to tip.
    joints: Vec<Axis>,
    /// The left and the right finger.
    fingers: [Axis; 2],
    object: engine::RigidBodyHandle,
    /// The object without its contacts, and its centre of mass in O.
    free: FreeBody,
    com_O: Vector3<f64>,
    stiffness: softness::Stiffness,
    finger_kg: f64,
    /// Of the last step.
    contact_forces: ContactForces,
}

impl World {
    /// A world at rest but for the object, which has just been released. The gripper is `width_m` open.
    pub fn new(
        settings: WorldSettings,
        mount: Mount,
        gripper: &Gripper,
        width_m: f64,
        object: &ThrownObject,
        release: &Release,
    ) -> Self {
        assembly::assemble(settings, mount, gripper, width_m, object, release)
    }

    /// Takes another number of substeps from now on.
    pub fn set_substeps(&mut self, substeps: usize) {
        self.parameters.num_solver_iterations = substeps;
    }

    /// Lets one step pass and tells whether all went well. If not, a body's state was no longer finite; the
    /// engine has taken that body out of the world, and what follows means nothing.
    pub fn step(&mut self, loads: &Loads) -> bool {
        let (X_WO, V_WO) = self.object_state();
        let before = self.velocities_before();
        self.set_softness();
        self.apply(loads);
        self.pipeline.step(
            to_vector(&loads.gravity),
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut self.soft_bodies,
            &mut self.ccd,
            &(),
            &(),
        );
        self.contact_forces = self.settle_contacts(&before);
        if !self.contact_forces.contact.any() {
            let wrench = (&loads.object_force_n, &loads.object_torque_nm);
            let (X_WC, V_WC) = carried((&X_WO, &V_WO), &self.com_O);
            let (X_WC, V_WC) = self.free.advanced((&X_WC, &V_WC), &loads.gravity, wrench, self.settings.step_s);
            let (X_WO, V_WO) = carried((&X_WC, &V_WC), &-self.com_O);
            self.set_object_state(&X_WO, &V_WO);
        }
        self.pipeline.quarantine().is_empty()
    }

    /// Moves the object to where its centre of mass is recorded to be.
    pub(crate) fn follow(&mut self, recorded: &RecordedState) {
        let (X_WO, V_WO) = self.object_state();
        let (mut X_WC, mut V_WC) = carried((&X_WO, &V_WO), &self.com_O);
        recorded.put((&mut X_WC, &mut V_WC));
        let (X_WO, V_WO) = carried((&X_WC, &V_WC), &-self.com_O);
        self.set_object_state(&X_WO, &V_WO);
    }

    fn object_state(&self) -> (Pose, Twist) {
        let object = &self.bodies[self.object];
        let X_WO = from_pose(object.position());
        let angular = from_vector(object.angvel());
        // The engine's linear velocity is that of the centre of mass.
        let linear = from_vector(object.linvel()) - angular.cross(&(X_WO.rotation * self.com_O));
        (X_WO, Twist { angular, linear })
    }

    /// Rotational inertia of the object as the engine has it, about its centre of mass along the axes of O,
    /// in kg·m².
    pub fn object_inertia(&self) -> Matrix3<f64> {
        let inertia = self.bodies[self.object].mass_properties().local_mprops.reconstruct_inertia_matrix();
        Matrix3::from_columns(&[inertia.x_axis, inertia.y_axis, inertia.z_axis].map(from_vector))
    }

    /// Kinetic energy of everything that moves, rotors and the gripper's drive included, in J.
    pub fn kinetic_energy_j(&self) -> f64 {
        let of_body = |handle: engine::RigidBodyHandle, [angular, linear]: [Vector3<f64>; 2]| {
            let body = &self.bodies[handle];
            let inertia = body.mass_properties().local_mprops.reconstruct_inertia_matrix();
            let local = body.rotation().inverse() * to_vector(&angular);
            body.mass() * linear.norm_squared() / 2.0 + local.dot(inertia * local) / 2.0
        };
        let axes = self.joints.iter().chain(&self.fingers);
        let links: f64 = axes.zip(self.link_velocities()).map(|(axis, twist)| of_body(axis.child, twist)).sum();
        let rotors: f64 = self.multibody().map_or(0.0, |multibody| {
            let velocities = multibody.generalized_velocity();
            velocities.iter().zip(multibody.armature().iter()).map(|(dq, inertia)| inertia * dq * dq / 2.0).sum()
        });
        links + rotors + of_body(self.object, velocities(&self.bodies[self.object]))
    }

    fn multibody(&self) -> Option<&engine::Multibody> {
        let id = self.multibodies.rigid_body_link(self.fingers[0].child)?;
        self.multibodies.get_multibody(id.multibody)
    }

    /// Angular and linear velocities of the links by joint, fingers last. The engine brings those of its
    /// bodies up to date in the next step only.
    fn link_velocities(&self) -> [[Vector3<f64>; 2]; MAX_JOINTS + 2] {
        let mut links = [[Vector3::zeros(); 2]; MAX_JOINTS + 2];
        let Some(multibody) = self.multibody() else { return links };
        let generalized = multibody.generalized_velocity();
        for (link, axis) in links.iter_mut().zip(self.joints.iter().chain(&self.fingers)) {
            let Some(id) = self.multibodies.rigid_body_link(axis.child) else { continue };
            let twist = multibody.body_jacobian(id.id) * generalized;
            *link = [Vector3::new(twist[3], twist[4], twist[5]), Vector3::new(twist[0], twist[1], twist[2])];
        }
        links
    }

    fn set_object_state(&mut self, X_WO: &Pose, V_WO: &Twist) {
        let object = &mut self.bodies[self.object];
        object.set_position(to_pose(X_WO), true);
        let of_com = V_WO.linear + V_WO.angular.cross(&(X_WO.rotation * self.com_O));
        object.set_linvel(to_vector(&of_com), true);
        object.set_angvel(to_vector(&V_WO.angular), true);
    }

    /// Replaces the forces on all bodies.
    ///
    /// The engine takes no generalized forces. A torque on a link and its opposite on the parent are exactly
    /// a torque of the joint between them: all other joints see their sum, which vanishes. For a finger both
    /// forces act at the same point.
    fn apply(&mut self, loads: &Loads) {
        let bodies = &mut self.bodies;
        for axis in self.joints.iter().chain(&self.fingers) {
            for handle in [axis.parent, axis.child] {
                bodies[handle].reset_forces(true);
                bodies[handle].reset_torques(true);
            }
        }
        for (i, axis) in self.joints.iter().enumerate() {
            let torque = *bodies[axis.child].rotation() * axis.direction * loads.torque[i];
            bodies[axis.child].add_torque(torque, true);
            bodies[axis.parent].add_torque(-torque, true);
        }
        for (axis, force_n) in self.fingers.iter().zip(loads.finger_force_n) {
            let force = *bodies[axis.child].rotation() * axis.direction * force_n;
            let point = bodies[axis.child].center_of_mass();
            bodies[axis.child].add_force_at_point(force, point, true);
            bodies[axis.parent].add_force_at_point(-force, point, true);
        }
        bodies[self.object].reset_forces(true);
        bodies[self.object].reset_torques(true);
        bodies[self.object].add_force(to_vector(&loads.object_force_n), true);
        bodies[self.object].add_torque(to_vector(&loads.object_torque_nm), true);
    }

    /// The state after the last step.
    pub fn state(&self) -> WorldState {
        let (X_WO, V_WO) = self.object_state();
        let mut state = WorldState {
            q: JointVector::zeros(),
            dq: JointVector::zeros(),
            finger_m: [0.0; 2],
            finger_mps: [0.0; 2],
            X_WO,
            V_WO,
        };
        for (i, axis) in self.joints.iter().enumerate() {
            [state.q[i], state.dq[i]] = self.coordinate(axis, 3);
        }
        for (i, axis) in self.fingers.iter().enumerate() {
            [state.finger_m[i], state.finger_mps[i]] = self.coordinate(axis, 0);
        }
        state
    }

    /// Position and velocity of a joint; `slot` is its place among the six coordinates of a joint.
    fn coordinate(&self, axis: &Axis, slot: usize) -> [f64; 2] {
        let Some(id) = self.multibodies.rigid_body_link(axis.child) else { return [f64::NAN; 2] };
        let Some(multibody) = self.multibodies.get_multibody(id.multibody) else { return [f64::NAN; 2] };
        let Some(link) = multibody.link(id.id) else { return [f64::NAN; 2] };
        [link.joint().coords()[slot], multibody.joint_velocity(link)[0]]
    }

    /// Forces on the object during the last step.
    pub fn contact_forces(&self) -> ContactForces {
        self.contact_forces
    }

    /// Lets the object rebound where it met something in the step that has passed, and sums up what touched
    /// it.
    fn settle_contacts(&mut self, before: &restitution::VelocitiesBefore) -> ContactForces {
        let mut impulses = [0.0; PARTS.len()];
        for point in self.contact_points() {
            impulses[point.part as usize] += point.impulse_ns;
        }
        let touches = impulses.map(|impulse_ns| impulse_ns > 0.0);
        if self.settings.restitution > 0.0 && touches.contains(&true) {
            let added_ns = self.let_rebound(before);
            impulses.iter_mut().zip(added_ns).for_each(|(impulse_ns, added_ns)| *impulse_ns += added_ns);
        }
        let force = |part: Part| impulses[part as usize] / self.settings.step_s;
        let touches = |part: Part| touches[part as usize];
        ContactForces {
            contact: Contact {
                left_finger: touches(Part::LeftFinger),
                right_finger: touches(Part::RightFinger),
                palm: touches(Part::Palm),
                arm: touches(Part::Arm),
                floor: touches(Part::Floor),
                obstacle: touches(Part::Obstacle),
                peak_impulse_ns: impulses.iter().copied().fold(0.0, f64::max),
            },
            finger_n: [force(Part::LeftFinger), force(Part::RightFinger)],
        }
    }
}

/// Angular and linear velocity of a body.
fn velocities(body: &engine::RigidBody) -> [Vector3<f64>; 2] {
    [from_vector(body.angvel()), from_vector(body.linvel())]
}

/// Pose and velocity of a frame that stands at `p_AB` in a moving frame A, with the same axes.
pub(crate) fn carried((X_WA, V_WA): (&Pose, &Twist), p_AB: &Vector3<f64>) -> (Pose, Twist) {
    let p_AB_W = X_WA.rotation * p_AB;
    let X_WB = Pose::from_parts((X_WA.translation.vector + p_AB_W).into(), X_WA.rotation);
    (X_WB, Twist { angular: V_WA.angular, linear: V_WA.linear + V_WA.angular.cross(&p_AB_W) })
}
