//! A description's links with their places in the tree.

use std::collections::HashMap;

use super::{
    Description, JointKind, TreeJoint,
    limbs::{Limb, is_of_a_finger, limb_of},
};
use catch_body::{InputError, Pose};

/// Place of a link in the tree.
pub struct Place<'a> {
    /// The joint that moves the link.
    pub joint: Option<&'a TreeJoint>,
    /// The link that carries this one.
    pub parent: Option<&'a str>,
    /// Limb that the names of the joints up to the link say.
    pub limb: Limb,
    /// Revolute joints one after another below the link, at most.
    pub arm_joints: usize,
    /// True if something moves below the link.
    pub moves_below: bool,
}

/// A description with what is known of each link's place in it.
pub struct Tree<'a> {
    /// The description.
    pub description: &'a Description,
    /// Places by the names of links.
    pub places: HashMap<&'a str, Place<'a>>,
}

impl<'a> Tree<'a> {
    pub fn new(description: &'a Description) -> Self {
        let mut places = HashMap::new();
        let mut order = vec![description.root.as_str()];
        let root = Place { joint: None, parent: None, limb: Limb::Arm, arm_joints: 0, moves_below: false };
        places.insert(description.root.as_str(), root);
        let mut next = 0;
        while let Some(&link) = order.get(next) {
            let above = places[link].limb;
            for joint in description.joints_of(link) {
                let limb = if above == Limb::Arm && can_move(joint, description) { limb_of(joint) } else { above };
                let place = Place { joint: Some(joint), parent: Some(link), limb, arm_joints: 0, moves_below: false };
                places.insert(joint.child.as_str(), place);
                order.push(joint.child.as_str());
            }
            next += 1;
        }
        // Children come after their parents.
        for link in order.into_iter().rev() {
            let Some(&Place { joint: Some(joint), parent: Some(parent), limb, arm_joints, moves_below }) =
                places.get(link)
            else {
                continue;
            };
            let joints = arm_joints + usize::from(limb == Limb::Arm && is_driven(joint));
            if let Some(parent) = places.get_mut(parent) {
                parent.arm_joints = parent.arm_joints.max(joints);
                parent.moves_below |= moves_below || can_move(joint, description);
            }
        }
        Self { description, places }
    }

    pub fn fault(&self, field: &str, found: impl std::fmt::Display, expected: impl std::fmt::Display) -> InputError {
        InputError::new(&self.description.file, field, found, expected)
    }

    pub fn known(&self, link: &'a str, argument: &str) -> Result<&'a str, InputError> {
        if self.places.contains_key(link) {
            return Ok(link);
        }
        let names: Vec<&str> = self.description.links.keys().take(60).map(String::as_str).collect();
        Err(self.fault(argument, format!("`{link}`"), format!("one of the links {}", names.join(", "))))
    }

    /// The joints from `base` to `tip`.
    pub fn path(&self, base: &str, tip: &'a str) -> Result<Vec<&'a TreeJoint>, InputError> {
        let (mut path, mut at) = (Vec::new(), tip);
        while at != base {
            let Some(&Place { joint: Some(joint), parent: Some(parent), .. }) = self.places.get(at) else {
                return Err(self.fault("--tip", format!("`{tip}`"), format!("a link that {base} carries")));
            };
            path.push(joint);
            at = parent;
        }
        path.reverse();
        Ok(path)
    }

    pub fn limb(&self, joint: &TreeJoint) -> Limb {
        self.places.get(joint.child.as_str()).map_or(Limb::Arm, |it| it.limb)
    }

    /// Returns whether the joint named `name` moves `link`.
    pub fn is_moved_by(&self, link: &str, name: &str) -> bool {
        self.places.get(link).and_then(|it| it.joint).is_some_and(|it| it.name == name)
    }

    pub fn is_moving(&self, joint: &TreeJoint) -> bool {
        can_move(joint, self.description) || self.places.get(joint.child.as_str()).is_some_and(|it| it.moves_below)
    }

    pub fn arm_joints(&self, joint: &TreeJoint) -> usize {
        let drives = self.limb(joint) == Limb::Arm && is_driven(joint);
        self.places.get(joint.child.as_str()).map_or(0, |it| it.arm_joints) + usize::from(drives)
    }

    /// Links from `link` on, itself among them.
    pub fn below(&self, link: &'a str) -> Vec<&'a str> {
        let mut links = vec![link];
        let mut next = 0;
        while let Some(&link) = links.get(next) {
            links.extend(self.description.joints_of(link).iter().map(|it| it.child.as_str()));
            next += 1;
        }
        links
    }

    /// All links behind those joints of `link` that move, or behind which something moves.
    pub fn moving_below(&self, link: &'a str) -> Vec<&'a str> {
        let joints = self.description.joints_of(link).iter().filter(|it| self.is_moving(it));
        joints.flat_map(|it| self.below(&it.child)).collect()
    }

    /// Pose of `link` in the frame of `from`, all joints at zero.
    pub fn pose_from(&self, from: &str, link: &'a str) -> Option<Pose> {
        let joints = self.path(from, link).ok()?;
        Some(joints.iter().rev().fold(Pose::identity(), |X_LE, joint| joint.X_PL * X_LE))
    }
}

/// Returns whether a joint can be one of an arm: revolute, and driven on its own.
pub fn is_driven(joint: &TreeJoint) -> bool {
    joint.kind == JointKind::Revolute && joint.mimics.is_none()
}

/// Returns whether a joint moves, or did before somebody fixed it: fingers are often fixed where only the arm
/// is to move.
pub fn can_move(joint: &TreeJoint, description: &Description) -> bool {
    let has_shape = || {
        let link = description.links.get(&joint.child);
        link.is_some_and(|it| !(it.collisions.is_empty() && it.visuals.is_empty()))
    };
    joint.kind != JointKind::Fixed || is_of_a_finger(&joint.name) && has_shape()
}
