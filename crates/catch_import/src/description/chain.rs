//! The serial arm within a tree of links: the path to its tip, fixed joints folded into rigid bodies, fingers
//! taken off.

use nalgebra::{UnitQuaternion, Vector3};

use super::{Geometry, TreeJoint};
use catch_body::{Pose, robot::Inertia};

/// Ends of the arm within a tree; an end that is `None` is found.
#[derive(Debug, Clone, Copy, Default)]
pub struct Selection<'a> {
    /// The link that stands still.
    pub base: Option<&'a str>,
    /// The link at whose frame the gripper is mounted.
    pub tip: Option<&'a str>,
}

/// A serial arm of revolute joints between rigid bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Body that stands still, in the base link's frame.
    pub base: Body,
    /// Joints, base to tip.
    pub joints: Vec<ChainJoint>,
    /// The link at whose frame F the gripper is mounted.
    pub flange: String,
    /// Pose of F in the last body's frame.
    pub X_LF: Pose,
    /// True if F has a joint of its own, so that its place is known; otherwise F is the last body's frame.
    pub has_flange: bool,
    /// Fingers that were taken off.
    pub fingers: Option<Fingers>,
    /// Links of branches that are left out.
    pub left_out: Vec<String>,
}

/// A joint with the rigid body that it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainJoint {
    /// The joint; its pose is that of the moved body's frame in the previous body's.
    pub joint: TreeJoint,
    /// The body.
    pub body: Body,
}

/// Links that are rigidly connected, in the frame of the first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Body {
    /// Names of the links; the first is that of the body.
    pub links: Vec<String>,
    /// Mass properties of all; `None` if none has mass.
    pub inertia: Option<Inertia>,
    /// Shapes for collisions.
    pub collisions: Vec<Geometry>,
    /// Shapes for the eye.
    pub visuals: Vec<Geometry>,
}

/// A gripper that was taken off.
#[derive(Debug, Clone, PartialEq)]
pub struct Fingers {
    /// Names of the fingers' links.
    pub links: Vec<String>,
    /// Reason why the fingers are no part of the arm.
    pub reason: String,
    /// Direction in F in which the first finger moves.
    pub closing_F: Option<Vector3<f64>>,
}

impl Chain {
    /// Directions in F of the gripper's approach and of its fingers' closing.
    ///
    /// The approach is the axis of F that is nearest to the last joint's, z where it is among them, away from
    /// the arm.
    pub fn mount_axes(&self) -> [Vector3<f64>; 2] {
        let last = self.joints.last().map_or_else(Vector3::z_axis, |it| it.joint.axis);
        let along_F = self.X_LF.rotation.inverse() * last.into_inner();
        let p_F = self.X_LF.rotation.inverse() * self.X_LF.translation.vector;
        let axis = if along_F.z.abs() > 0.9 { 2 } else { along_F.iamax() };
        let mut approach = Vector3::zeros();
        approach[axis] = if axis != 2 && p_F[axis] < -1e-3 { -1.0 } else { 1.0 };
        let mut across = Vector3::zeros();
        across[(axis + 1) % 3] = 1.0;
        let closing = self.fingers.as_ref().and_then(|it| it.closing_F).unwrap_or(across);
        let closing = closing - approach * closing.dot(&approach);
        [approach, closing.try_normalize(0.1).unwrap_or(across)]
    }

    /// Pose of the gripper's frame G in F: y is the approach, the fingers close along x.
    pub fn X_FG(&self) -> Pose {
        let [approach, closing] = self.mount_axes();
        let R_FG = nalgebra::Matrix3::from_columns(&[closing, approach, closing.cross(&approach)]);
        Pose::from_parts(Default::default(), UnitQuaternion::from_matrix(&R_FG))
    }
}
