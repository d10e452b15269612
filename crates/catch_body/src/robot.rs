//! Model of a serial arm: joints, links, limits, collision geometry.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::{Point3, SMatrix, SVector, Translation3, Unit, Vector3};
use serde::{Deserialize, Serialize};

pub use crate::inertia::Inertia;
use crate::{
    Gripper, InputError, TriangleMesh,
    pose::Pose,
    quantity,
    shape::Capsule,
    velocity_table::VelocityTable,
    visual::{ReadMesh, Visual},
    workcell::Obstacle,
};

/// The most joints an arm may have.
pub const MAX_JOINTS: usize = 8;

/// A vector of one number per joint, base to tip: radians, rad/s, rad/s² or N·m. An arm with fewer joints
/// than [`MAX_JOINTS`] leaves the last entries at zero, so that vectors are plain values and nothing
/// allocates.
pub type JointVector = SVector<f64, MAX_JOINTS>;

/// Maps joint velocities in rad/s to a spatial velocity in W: rows 0–2 angular in rad/s, rows 3–5 linear in
/// m/s; one column per joint, base to tip, zero beyond the last.
pub type Jacobian = SMatrix<f64, 6, MAX_JOINTS>;

/// Maps joint accelerations in rad/s² to torques in N·m; entries in kg·m².
pub type MassMatrix = SMatrix<f64, MAX_JOINTS, MAX_JOINTS>;

/// Limits of a joint. All bounds are symmetric but the position's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Lowest position in radians.
    pub lower: f64,
    /// Highest position in radians.
    pub upper: f64,
    /// Highest speed in rad/s.
    pub velocity: f64,
    /// Highest acceleration in rad/s².
    pub acceleration: f64,
    /// Highest torque in N·m.
    pub torque: f64,
    /// Highest jerk in rad/s³, where the robot states one.
    pub jerk: Option<f64>,
}

/// Factors on an arm's limits; 1 is the arm as it is.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LimitScale {
    /// Factor on velocities.
    pub velocity: quantity::limit_factor,
    /// Factor on accelerations.
    pub acceleration: quantity::limit_factor,
    /// Factor on jerks, where the arm states them.
    pub jerk: quantity::limit_factor,
}

impl Default for LimitScale {
    fn default() -> Self {
        Self { velocity: 1.0, acceleration: 1.0, jerk: 1.0 }
    }
}

/// Contact at the hand at which the maker's controller stops; at a joint it is the torque of the motor.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct ContactStop {
    /// Force of the contact, along any axis of the base.
    pub force_n: quantity::force_n,
    /// Moment of the contact about the origin of the gripper, about any axis of the base.
    pub moment_nm: quantity::torque_nm,
}

/// A revolute joint and the link that it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Pose of the link's frame L in its parent's frame P while the joint is at zero.
    pub X_PL: Pose,
    /// Axis in the link's frame.
    pub axis: Unit<Vector3<f64>>,
    /// Position, velocity, acceleration and torque limits, and that of the jerk where there is one.
    pub limits: JointLimits,
    /// Velocity limits that depend on the position, below that of `limits`, where the robot has them.
    pub velocity_table: Option<VelocityTable>,
    /// Rotor inertia reflected to the joint, in kg·m².
    pub rotor_inertia: f64,
    /// Viscous damping in N·m·s/rad.
    pub damping: f64,
    /// Inertia of the moved link.
    pub inertia: Inertia,
    /// Name of the moved link.
    pub link_name: String,
}

impl Joint {
    /// The lowest and the highest velocity in rad/s at the position `q` in radians.
    pub fn velocity_range(&self, q: f64) -> [f64; 2] {
        let most = self.limits.velocity;
        let [low, high] = self.velocity_table.as_ref().map_or([-most, most], |it| it.at(q));
        [low.max(-most), high.min(most)]
    }

    /// The highest speed in rad/s at `q`, in the direction of `dq`.
    pub fn max_speed(&self, q: f64, dq: f64) -> f64 {
        let [low, high] = self.velocity_range(q);
        if dq < 0.0 { -low } else { high }
    }
}

/// A serial arm of revolute joints, welded to the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name in the URDF.
    pub name: String,
    /// Name of the base link in the URDF.
    pub base_link: String,
    /// Pose of the base link in the world.
    pub X_WB: Pose,
    /// Joints, base to tip.
    pub joints: Vec<Joint>,
    /// Pose of the flange in the last link, with the axes of a gripper that is mounted there.
    pub X_LF: Pose,
    /// Flanges as grippers meet them that are mounted in another way, by their names.
    pub X_LF_by_gripper: BTreeMap<String, Pose>,
    /// Pose of the gripper in the last link: the flange's until one is [mounted](Self::with_mount_of).
    pub X_LG: Pose,
    /// Point in the frame of the gripper at which the fingers close: its origin until one is
    /// [carried](Self::carrying).
    pub tool_G: Point3<f64>,
    /// Speed of the hand in m/s at which the maker's controller stops, where one is stated.
    pub max_hand_speed_mps: Option<f64>,
    /// Contact at which it stops, where one is stated.
    pub contact_stop: Option<ContactStop>,
    /// The paper's comfortable pose q0 (III-D).
    pub comfortable_q: JointVector,
    /// Joint positions in which the arm waits unless others are given.
    pub ready_q: JointVector,
    /// Collision geometry of the arm: capsules in the frame of link `.0`, link 0 being the base and link i
    /// the one that joint i moves.
    pub capsules: Vec<(usize, Capsule)>,
    /// Surfaces of links as cameras see them, by the links' numbers; of other links they see the capsules.
    pub visuals: BTreeMap<usize, Visual>,
    /// Links at most this far apart in the chain are not checked for collision with each other.
    pub ignored_neighbours: usize,
    /// Obstacles that stand still around the arm in its workcell.
    pub obstacles: Vec<Obstacle>,
}

impl Robot {
    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Names of the links, the base first.
    pub fn link_names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.base_link).chain(self.joints.iter().map(|it| &it.link_name)).map(String::as_str)
    }

    /// Returns whether the joints are too few to bring the hand to every pose.
    pub fn has_few_joints(&self) -> bool {
        self.dof() < 6
    }

    /// The arm's length in metres: from its second joint to the gripper, link by link.
    pub fn length_m(&self) -> f64 {
        let links = self.joints.iter().skip(2).map(|joint| joint.X_PL.translation.vector.norm());
        links.sum::<f64>() + self.X_LG.translation.vector.norm()
    }

    /// Vector of one value per joint, zero beyond the last.
    pub fn per_joint(&self, value: impl Fn(&Joint) -> f64) -> JointVector {
        JointVector::from_fn(|i, _| self.joints.get(i).map_or(0.0, &value))
    }

    /// A joint vector from `dof` numbers, `None` if there are more or fewer or one is not finite.
    pub fn joint_vector(&self, values: &[f64]) -> Option<JointVector> {
        let fits = values.len() == self.dof() && values.iter().all(|value| value.is_finite());
        fits.then(|| JointVector::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0)))
    }

    /// Reads the meshes of the visual shapes that files hold.
    ///
    /// # Errors
    /// The first fault of one of them.
    pub fn with_meshes(mut self, read: &ReadMesh) -> Result<Self, InputError> {
        self.visuals.values_mut().filter(|it| !it.mesh.is_empty()).try_for_each(|it| it.read(read))?;
        Ok(self)
    }

    /// Surface of a link as cameras see it, in the link's frame: its visual shape, or its capsules with so
    /// many flat strips around each.
    pub fn link_surface(&self, link: usize, segments: u32) -> TriangleMesh {
        if let Some(mesh) = self.visuals.get(&link).and_then(Visual::mesh) {
            return mesh.clone();
        }
        let mut mesh = TriangleMesh::default();
        for (_, capsule) in self.capsules.iter().filter(|(of, _)| *of == link) {
            mesh.merge(&TriangleMesh::capsule(capsule, segments));
        }
        mesh
    }

    /// Makes the surface of each link thicker all around by `offset_m` of its number.
    pub fn with_thicker_links(mut self, offset_m: impl Fn(usize) -> f64) -> Self {
        for (link, capsule) in &mut self.capsules {
            capsule.radius = (capsule.radius + offset_m(*link)).max(quantity::RADIUS_M.least);
        }
        for (link, visual) in self.visuals.iter_mut().filter(|(link, _)| offset_m(**link) != 0.0) {
            visual.surface = Arc::new(visual.surface.thicker(offset_m(*link)));
        }
        self
    }

    /// Multiplies the arm's limits.
    pub fn with_limits_scaled(mut self, by: &LimitScale) -> Self {
        self.max_hand_speed_mps = self.max_hand_speed_mps.map(|it| it * by.velocity);
        for joint in &mut self.joints {
            joint.limits.velocity *= by.velocity;
            joint.velocity_table = joint.velocity_table.take().map(|it| it.scaled(by.velocity));
            joint.limits.acceleration *= by.acceleration;
            joint.limits.jerk = joint.limits.jerk.map(|jerk| jerk * by.jerk);
        }
        self
    }

    /// Mounts a gripper: the back of its housing at the flange.
    pub fn with_mount_of(mut self, gripper: &Gripper) -> Self {
        let X_LF = self.X_LF_by_gripper.get(&gripper.name).unwrap_or(&self.X_LF);
        self.X_LG = X_LF * Translation3::new(0.0, gripper.palm_y_m(), 0.0);
        self
    }

    /// Adds the gripper's mass to the arm's last link, and puts the tool where the gripper grasps.
    ///
    /// The fingers count at their mean opening; where they stand changes the inertia by less than 1e-3 kg·m².
    pub fn carrying(self, gripper: &Gripper) -> Self {
        let mut this = self.with_mount_of(gripper);
        this.tool_G = Point3::new(0.0, gripper.grasp_centre_y_m, 0.0);
        if let Some(last) = this.joints.last_mut() {
            last.inertia = last.inertia.joined(&gripper.inertia(gripper.max_width_m / 2.0).transformed(&this.X_LG));
        }
        this
    }
}
