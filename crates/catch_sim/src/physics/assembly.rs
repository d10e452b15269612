//! Builds the engine's bodies, joints and colliders.

use catch_body::{
    Gripper, JointVector, Pose, Robot,
    robot::Inertia,
    shape::{Capsule, Cuboid},
    workcell::{FLOOR_Z_M, Obstacle},
};
use engine::{Group, InteractionGroups, InteractionTestMode, JointAxesMask, JointAxis};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rapier3d_f64::prelude as engine;

use super::convert::{to_pose, to_rotation, to_vector};
use super::{Axis, ContactForces, Mount, Part, World, WorldSettings, free_motion::FreeBody, softness::Stiffness};
use crate::{object::ThrownObject, object_shape::ColliderPart, throw::Release};

pub(super) fn assemble(
    settings: WorldSettings,
    mount: Mount,
    gripper: &Gripper,
    width_m: f64,
    object: &ThrownObject,
    release: &Release,
) -> World {
    let mut builder = Builder {
        settings,
        bodies: engine::RigidBodySet::new(),
        colliders: engine::ColliderSet::new(),
        multibodies: engine::MultibodyJointSet::new(),
    };
    builder.add_floor();
    let (hand, X_HG, joints) = match mount {
        Mount::Arm { robot, q } => builder.add_arm(robot, gripper, q),
        Mount::Fixed(X_WG) => {
            let hand = builder.bodies.insert(engine::RigidBodyBuilder::fixed().pose(to_pose(&X_WG)));
            (hand, Pose::identity(), Vec::new())
        }
    };
    builder.attach_box(hand, &X_HG, &gripper.body(), Part::Palm);
    let fingers = builder.add_fingers(gripper, hand, &X_HG);
    let (free, com_O) = (FreeBody::of(object), object.com_O.coords);
    let finger_kg = gripper.finger_mass_kg + settings.drive_mass_kg;
    let stiffness = Stiffness::of(object, finger_kg);
    let object = builder.add_object(object, release);
    // The engine would take the masses into account in the first step only, but the kinematics below need
    // them.
    for (_, body) in builder.bodies.iter_mut() {
        body.recompute_mass_properties_from_colliders(&builder.colliders);
    }
    builder.set_coordinates(mount, &joints, &fingers, width_m / 2.0);

    let parameters = engine::IntegrationParameters {
        dt: settings.step_s,
        num_solver_iterations: settings.substeps,
        contact_recycling: false,
        friction_model: engine::FrictionModel::Coulomb,
        // Fast bodies would be swept against what is fixed: the floor, and nothing can be behind it, and
        // obstacles, which are thicker than what an object flies in a step.
        max_ccd_substeps: 0,
        ..Default::default()
    };
    World {
        settings,
        parameters,
        pipeline: engine::PhysicsPipeline::new(),
        islands: engine::IslandManager::new(),
        broad_phase: engine::BroadPhaseBvh::new(),
        narrow_phase: engine::NarrowPhase::new(),
        bodies: builder.bodies,
        colliders: builder.colliders,
        impulse_joints: engine::ImpulseJointSet::new(),
        multibodies: builder.multibodies,
        soft_bodies: engine::SoftBodySet::new(),
        ccd: engine::CCDSolver::new(),
        joints,
        fingers,
        object,
        free,
        com_O,
        stiffness,
        finger_kg,
        contact_forces: ContactForces::default(),
    }
}

impl World {
    /// Takes the object out and puts another one in, which has just been released. Friction and restitution
    /// of all contacts are those of the new one from now on.
    pub fn exchange_object(&mut self, object: &ThrownObject, release: &Release, friction: f64, restitution: f64) {
        self.bodies.remove(
            self.object,
            &mut self.islands,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibodies,
            &mut self.soft_bodies,
            true,
        );
        (self.settings.friction, self.settings.restitution) = (friction, restitution);
        for (_, collider) in self.colliders.iter_mut() {
            collider.set_friction(friction);
        }
        let mut builder = Builder {
            settings: self.settings,
            bodies: std::mem::take(&mut self.bodies),
            colliders: std::mem::take(&mut self.colliders),
            multibodies: engine::MultibodyJointSet::new(),
        };
        self.object = builder.add_object(object, release);
        builder.bodies[self.object].recompute_mass_properties_from_colliders(&builder.colliders);
        (self.bodies, self.colliders) = (builder.bodies, builder.colliders);
        (self.free, self.com_O) = (FreeBody::of(object), object.com_O.coords);
        self.stiffness = Stiffness::of(object, self.finger_kg);
        self.contact_forces = ContactForces::default();
    }
}

struct Builder {
    settings: WorldSettings,
    bodies: engine::RigidBodySet,
    colliders: engine::ColliderSet,
    multibodies: engine::MultibodyJointSet,
}

impl Builder {
    fn add_floor(&mut self) {
        let floor = self.bodies.insert(engine::RigidBodyBuilder::fixed().translation(engine::Vector::Z * FLOOR_Z_M));
        let up = engine::ColliderBuilder::new(engine::SharedShape::halfspace(engine::Vector::Z));
        self.attach(floor, up, Part::Floor);
    }

    fn add_obstacles(&mut self, obstacles: &[Obstacle]) {
        for obstacle in obstacles {
            let body = self.bodies.insert(engine::RigidBodyBuilder::fixed());
            if let Some((X_WS, cuboid)) = obstacle.as_cuboid() {
                self.attach_box(body, X_WS, cuboid, Part::Obstacle);
            }
            if let Some(Capsule { from, to, radius }) = obstacle.as_capsule() {
                let (from, to) = (to_vector(&from.coords), to_vector(&to.coords));
                self.attach(body, engine::ColliderBuilder::capsule_from_endpoints(from, to, *radius), Part::Obstacle);
            }
        }
    }

    /// The arm's links and joints. The last link carries the gripper's housing; it is returned with the pose
    /// of G in it.
    fn add_arm(
        &mut self,
        robot: &Robot,
        gripper: &Gripper,
        q: &JointVector,
    ) -> (engine::RigidBodyHandle, Pose, Vec<Axis>) {
        let X_WL = robot.link_poses(q);
        self.add_obstacles(&robot.obstacles);
        let mut links = vec![self.bodies.insert(engine::RigidBodyBuilder::fixed().pose(to_pose(&robot.X_WB)))];
        let mut joints = Vec::new();
        for (i, joint) in robot.joints.iter().enumerate() {
            let mut inertia = joint.inertia;
            if i + 1 == robot.dof() {
                inertia = inertia.joined(&gripper.body_inertia().transformed(&robot.X_LG));
            }
            let (parent, child) = (links[i], self.add_body(&X_WL[i + 1], &inertia));
            // The engine's joints turn about their own x axis.
            let R_LJ = rotation_from_x_to(&joint.axis);
            let revolute = engine::GenericJointBuilder::new(JointAxesMask::LOCKED_REVOLUTE_AXES)
                .local_frame1(to_pose(&(joint.X_PL * R_LJ)))
                .local_frame2(to_pose(&Pose::from_parts(Vector3::zeros().into(), R_LJ)));
            self.multibodies.insert(parent, child, revolute.build(), true);
            joints.push(Axis { child, parent, direction: to_vector(&joint.axis) });
            links.push(child);
        }
        for (link, capsule) in &robot.capsules {
            let (from, to) = (to_vector(&capsule.from.coords), to_vector(&capsule.to.coords));
            let shape = engine::ColliderBuilder::capsule_from_endpoints(from, to, capsule.radius);
            self.attach(links[*link], shape, Part::Arm);
        }
        (links[robot.dof()], robot.X_LG, joints)
    }

    /// Two fingers that slide along the x axis of G, the left one towards −x. Their frames lie on G when
    /// their inner faces meet in the middle.
    fn add_fingers(&mut self, gripper: &Gripper, hand: engine::RigidBodyHandle, X_HG: &Pose) -> [Axis; 2] {
        let X_WH = super::convert::from_pose(self.bodies[hand].position());
        let mut closed = gripper.finger_contacts(0.0).into_iter().zip(gripper.finger_inertias(0.0));
        [(Part::LeftFinger, -Vector3::x_axis()), (Part::RightFinger, Vector3::x_axis())].map(|(part, opening)| {
            let ((finger, balls), inertia) = closed.next().expect("a gripper has two fingers");
            let child = self.add_body(&(X_WH * X_HG), &inertia);
            let R_GJ = rotation_from_x_to(&opening);
            let prismatic = engine::GenericJointBuilder::new(JointAxesMask::LOCKED_PRISMATIC_AXES)
                .local_frame1(to_pose(&(X_HG * R_GJ)))
                .local_frame2(to_pose(&Pose::from_parts(Vector3::zeros().into(), R_GJ)))
                .limits(JointAxis::LinX, [0.0, gripper.max_width_m / 2.0]);
            self.multibodies.insert(hand, child, prismatic.build(), true);
            self.attach_box(child, &Pose::identity(), &finger, part);
            for (centre, radius_m) in balls {
                let ball = engine::ColliderBuilder::ball(radius_m).translation(to_vector(&centre.coords));
                self.attach(child, ball, part);
            }
            Axis { child, parent: hand, direction: to_vector(&opening) }
        })
    }

    /// Sets joint positions, damping and rotor inertia. The tree was put together with all coordinates at
    /// zero.
    fn set_coordinates(&mut self, mount: Mount, joints: &[Axis], fingers: &[Axis; 2], finger_m: f64) {
        let index = self.multibodies.rigid_body_link(fingers[0].child).expect("fingers are part of the tree").multibody;
        let multibody = self.multibodies.get_multibody_mut(index).expect("the tree exists");
        // Only now does the engine notice that the root is fixed and drop its six coordinates.
        multibody.forward_kinematics(&self.bodies, true);
        // No link of the tree collides with another; how close they come is watched elsewhere.
        multibody.set_self_contacts_enabled(false);

        let mut coordinates = vec![0.0; joints.len() + fingers.len()];
        // The engine gives each joint a damping of its own.
        multibody.damping_mut().fill(0.0);
        if let Mount::Arm { robot, q } = mount {
            for (i, joint) in robot.joints.iter().enumerate() {
                coordinates[i] = q[i];
                multibody.damping_mut()[i] = joint.damping;
                multibody.armature_mut()[i] = joint.rotor_inertia;
            }
        }
        coordinates[joints.len()..].fill(finger_m);
        for i in 0..fingers.len() {
            multibody.armature_mut()[joints.len() + i] = self.settings.drive_mass_kg;
        }
        multibody.apply_displacements(&coordinates);
        multibody.forward_kinematics(&self.bodies, true);
        multibody.update_rigid_bodies(&mut self.bodies, true);
    }

    fn add_object(&mut self, object: &ThrownObject, release: &Release) -> engine::RigidBodyHandle {
        let X_WO = Pose::from_parts(release.p_WO.into(), release.q_WO);
        let inertia = Inertia { mass: object.mass_kg, com: object.com_O, about_com: object.inertia_kgm2 };
        let handle = self.add_body(&X_WO, &inertia);
        let of_com = release.v_WO + release.omega_WO.cross(&(X_WO.rotation * object.com_O.coords));
        self.bodies[handle].set_linvel(to_vector(&of_com), true);
        self.bodies[handle].set_angvel(to_vector(&release.omega_WO), true);
        for part in &object.parts {
            let shape = match part {
                ColliderPart::Ball { centre, radius_m } => {
                    engine::ColliderBuilder::ball(*radius_m).translation(to_vector(&centre.coords))
                }
                ColliderPart::Hull(points) => {
                    let points: Vec<engine::Vector> = points.iter().map(|point| to_vector(&point.coords)).collect();
                    engine::ColliderBuilder::convex_hull(&points).expect("a part of an object encloses a volume")
                }
            };
            self.attach(handle, shape, Part::Object);
        }
        handle
    }

    fn add_body(&mut self, X_WL: &Pose, inertia: &Inertia) -> engine::RigidBodyHandle {
        let com = to_vector(&inertia.com.coords);
        // Not the engine's own: it takes an inertia below some 1e-5 kg·m² for a multiple of the identity.
        let principal = inertia.about_com.symmetric_eigen();
        let mut axes = principal.eigenvectors;
        if axes.determinant() < 0.0 {
            axes.neg_mut();
        }
        let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let mass = engine::MassProperties::with_principal_inertia_frame(
            com,
            inertia.mass,
            to_vector(&principal.eigenvalues),
            to_rotation(&axes),
        );
        let body = engine::RigidBodyBuilder::dynamic()
            .pose(to_pose(X_WL))
            .additional_mass_properties(mass)
            // A thrown object may spin fast.
            .allow_fast_rotation(true)
            .can_sleep(false);
        self.bodies.insert(body)
    }

    fn attach_box(&mut self, body: engine::RigidBodyHandle, X_LG: &Pose, cuboid: &Cuboid, part: Part) {
        let half = cuboid.size / 2.0;
        let X_LC = X_LG * nalgebra::Translation3::from(cuboid.centre.coords);
        let shape = engine::ColliderBuilder::cuboid(half.x, half.y, half.z).position(to_pose(&X_LC));
        self.attach(body, shape, part);
    }

    /// Everything collides with the object and with floor and obstacles, and with nothing else. Friction of a
    /// pair is the mean of both surfaces, so all surfaces get the same. Restitution is not the engine's.
    fn attach(&mut self, body: engine::RigidBodyHandle, shape: engine::ColliderBuilder, part: Part) {
        let (object, floor, machine) = (Group::GROUP_1, Group::GROUP_2, Group::GROUP_3);
        let (memberships, filter) = match part {
            Part::Object => (object, floor | machine),
            Part::Floor | Part::Obstacle => (floor, object | machine),
            Part::LeftFinger | Part::RightFinger | Part::Palm | Part::Arm => (machine, object | floor),
        };
        let collider = shape
            .density(0.0)
            .friction(self.settings.friction)
            .restitution(0.0)
            .collision_groups(InteractionGroups::new(memberships, filter, InteractionTestMode::And))
            .user_data(part as u128);
        self.colliders.insert_with_parent(collider, body, &mut self.bodies);
    }
}

/// A rotation that takes the x axis to `direction`.
fn rotation_from_x_to(direction: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::x(), direction)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI))
}
