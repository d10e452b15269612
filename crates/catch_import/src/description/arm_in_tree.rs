//! Finds the arm in a tree of links: which way it goes, where it ends, what is rigidly connected.

use std::collections::{BTreeMap, HashMap, HashSet};

use nalgebra::Vector3;

use super::{
    Description, Geometry, JointKind, TreeJoint,
    chain::{Body, Chain, ChainJoint, Fingers, Selection},
};
use catch_body::{InputError, MAX_JOINTS, Pose};

/// So many joints in a row are an arm where several branches could go on.
const LEAST_ARM_JOINTS: usize = 3;
/// After so many joints a branch is a hand.
const MOST_JOINTS_BEFORE_A_HAND: usize = 5;
/// Words in the names of frames at which grippers are mounted, the best first (ROS-Industrial's `tool0`, REP 199's `flange`).
const FLANGE_WORDS: [&str; 9] = ["tool0", "flange", "tool", "ee", "eef", "effector", "endeffector", "tcp", "mount"];

impl Chain {
    /// Finds the arm in a description.
    ///
    /// # Errors
    /// If there is none, more than one, or one with joints that are not revolute; a link of the selection that does not exist.
    pub fn of(description: &Description, selection: &Selection) -> Result<Self, InputError> {
        Tree::new(description).chain(selection)
    }
}

/// What is known of a link's place in the tree.
struct Place<'a> {
    joint: Option<&'a TreeJoint>,
    parent: Option<&'a str>,
    /// Revolute joints one after another below it, at most.
    arm_joints: usize,
    moves_below: bool,
}

/// A description with what is known of each link's place in it.
struct Tree<'a> {
    description: &'a Description,
    places: HashMap<&'a str, Place<'a>>,
}

impl<'a> Tree<'a> {
    fn new(description: &'a Description) -> Self {
        let mut places = HashMap::new();
        let mut order = vec![description.root.as_str()];
        places
            .insert(description.root.as_str(), Place { joint: None, parent: None, arm_joints: 0, moves_below: false });
        let mut next = 0;
        while let Some(&link) = order.get(next) {
            for joint in description.joints_of(link) {
                let place = Place { joint: Some(joint), parent: Some(link), arm_joints: 0, moves_below: false };
                places.insert(joint.child.as_str(), place);
                order.push(joint.child.as_str());
            }
            next += 1;
        }
        // Children come after their parents.
        for link in order.into_iter().rev() {
            let Some(&Place { joint: Some(joint), parent: Some(parent), arm_joints, moves_below }) = places.get(link)
            else {
                continue;
            };
            let joints = arm_joints + usize::from(drives_an_arm(joint));
            if let Some(parent) = places.get_mut(parent) {
                parent.arm_joints = parent.arm_joints.max(joints);
                parent.moves_below |= moves_below || joint.kind != JointKind::Fixed;
            }
        }
        Self { description, places }
    }

    fn fault(&self, field: &str, found: impl std::fmt::Display, expected: impl std::fmt::Display) -> InputError {
        InputError::new(&self.description.file, field, found, expected)
    }

    fn known(&self, link: &'a str, argument: &str) -> Result<&'a str, InputError> {
        if self.places.contains_key(link) {
            return Ok(link);
        }
        let names: Vec<&str> = self.description.links.keys().take(60).map(String::as_str).collect();
        Err(self.fault(argument, format!("`{link}`"), format!("one of the links {}", names.join(", "))))
    }

    fn chain(&self, selection: &Selection<'a>) -> Result<Chain, InputError> {
        let base = self.known(selection.base.unwrap_or(&self.description.root), "--base")?;
        let (path, tip, fingers) = match selection.tip {
            Some(tip) => {
                let tip = self.known(tip, "--tip")?;
                (self.path(base, tip)?, Some(tip), None)
            }
            None => self.longest_arm(base)?,
        };
        let moving: Vec<usize> = (0..path.len()).filter(|&i| path[i].kind != JointKind::Fixed).collect();
        for &i in &moving {
            if !drives_an_arm(path[i]) {
                return Err(self.not_of_an_arm(path[i]));
            }
        }
        if moving.is_empty() {
            return Err(self.fault("joint", "none that moves an arm", "a serial arm of revolute joints"));
        }
        if moving.len() > MAX_JOINTS {
            let found = format!("{} joints from {base} to {}", moving.len(), tip.unwrap_or("the tip"));
            let expected = format!("at most {MAX_JOINTS}: `--base LINK` and `--tip LINK` choose a part");
            return Err(self.fault("joint", found, expected));
        }
        Ok(self.folded(base, &path, &moving, tip, fingers))
    }

    fn not_of_an_arm(&self, joint: &TreeJoint) -> InputError {
        let found =
            if joint.mimics.is_some() { "a joint that another drives" } else { "a joint that slides or floats" };
        let expected = format!("revolute joints only: `--base {}` begins behind it", joint.child);
        self.fault(&format!("joint {}", joint.name), found, expected)
    }

    /// The joints from `base` to `tip`.
    fn path(&self, base: &str, tip: &'a str) -> Result<Vec<&'a TreeJoint>, InputError> {
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

    /// Follows the only branch that is an arm. Returns the joints up to the last body, and the link at which fingers begin.
    #[expect(clippy::type_complexity, reason = "three parts of one answer, taken apart at once")]
    fn longest_arm(&self, base: &'a str) -> Result<(Vec<&'a TreeJoint>, Option<&'a str>, Option<&'a str>), InputError> {
        let (mut path, mut passed, mut at, mut end) = (Vec::<&TreeJoint>::new(), 0, base, 0);
        loop {
            let moving: Vec<&TreeJoint> =
                self.description.joints_of(at).iter().filter(|it| self.is_moving(it)).collect();
            let arms: Vec<&TreeJoint> =
                moving.iter().copied().filter(|it| self.arm_joints(it) >= LEAST_ARM_JOINTS).collect();
            let next = match (&moving[..], &arms[..]) {
                ([], _) => return Ok((path[..end].to_vec(), None, None)),
                ([one], _) => *one,
                (_, [one]) if passed < MOST_JOINTS_BEFORE_A_HAND => *one,
                (_, [_, _, ..]) if passed < MOST_JOINTS_BEFORE_A_HAND => {
                    let tips: Vec<&str> = arms.iter().map(|it| self.last_of(it)).collect();
                    let found = format!("{} arms that begin at {at}", arms.len());
                    return Err(self.fault(
                        "joint",
                        found,
                        format!("one: `--tip LINK`, such as {}", tips.join(" or ")),
                    ));
                }
                _ => return Ok((path[..end].to_vec(), None, Some(at))),
            };
            let is_finger = !drives_an_arm(next) && next.kind != JointKind::Fixed && passed >= LEAST_ARM_JOINTS;
            // What a joint of the arm drives is part of the arm.
            if next.mimics.as_ref().is_some_and(|driver| path.iter().any(|it| it.name == *driver)) {
                return Err(self.not_of_an_arm(next));
            }
            if is_finger {
                return Ok((path[..end].to_vec(), None, Some(at)));
            }
            path.push(next);
            if next.kind != JointKind::Fixed {
                passed += 1;
                end = path.len();
            }
            at = &next.child;
        }
    }

    fn is_moving(&self, joint: &TreeJoint) -> bool {
        joint.kind != JointKind::Fixed || self.places.get(joint.child.as_str()).is_some_and(|it| it.moves_below)
    }

    fn arm_joints(&self, joint: &TreeJoint) -> usize {
        self.places.get(joint.child.as_str()).map_or(0, |it| it.arm_joints) + usize::from(drives_an_arm(joint))
    }

    /// The last link of the longest arm that begins with `joint`.
    fn last_of(&self, joint: &'a TreeJoint) -> &'a str {
        let mut at = joint.child.as_str();
        while let Some(next) = self.description.joints_of(at).iter().max_by_key(|it| self.arm_joints(it)) {
            if self.arm_joints(next) == 0 {
                break;
            }
            at = &next.child;
        }
        at
    }

    /// Folds what is rigidly connected. `tip` is the chosen frame of the flange, `fingers_at` the link that carries fingers.
    fn folded(
        &self,
        base: &'a str,
        path: &[&'a TreeJoint],
        moving: &[usize],
        tip: Option<&'a str>,
        fingers_at: Option<&'a str>,
    ) -> Chain {
        let last_link = moving.last().map_or(base, |&i| path[i].child.as_str());
        // The hand begins behind a fixed joint; fingers directly on the last link leave that where it is.
        let hand = fingers_at.filter(|link| *link != last_link);
        let taken_off: HashSet<&str> = match (tip, hand, fingers_at) {
            (Some(tip), ..) => self.below(tip).into_iter().filter(|it| *it != tip).collect(),
            (None, Some(hand), _) => self.below(hand).into_iter().collect(),
            (None, None, Some(link)) => self.moving_below(link).into_iter().collect(),
            (None, None, None) => HashSet::new(),
        };
        let starts: HashSet<&str> = moving.iter().map(|&i| path[i].child.as_str()).collect();
        let mut left_out = Vec::new();
        let mut body = |first: &'a str| self.body(first, &starts, &taken_off, &mut left_out);

        let (base_body, mut X_BL) = body(base);
        let mut joints = Vec::new();
        for &i in moving {
            let X_BP =
                X_BL.get(self.places[path[i].child.as_str()].parent.unwrap_or(base)).copied().unwrap_or_default();
            let (body, poses) = body(&path[i].child);
            let joint = TreeJoint { X_PL: X_BP * path[i].X_PL, ..path[i].clone() };
            joints.push(ChainJoint { joint, body });
            X_BL = poses;
        }
        let flange = tip.or(hand).unwrap_or_else(|| self.flange(last_link, &X_BL));
        let X_LF = X_BL.get(flange).copied().or_else(|| self.pose_from(last_link, flange)).unwrap_or_default();
        let fingers = self.fingers(&taken_off, hand.or(tip).or(fingers_at), &X_LF, last_link);
        let flange_link = if hand.is_some() { self.places[flange].parent.unwrap_or(flange) } else { flange };
        Chain {
            base: base_body,
            joints,
            flange: flange_link.to_owned(),
            X_LF,
            has_flange: flange != last_link,
            fingers,
            left_out,
        }
    }

    /// The links from `first` on that are rigidly connected to it as one body, and their poses in its frame.
    fn body(
        &self,
        first: &'a str,
        starts: &HashSet<&str>,
        taken_off: &HashSet<&str>,
        left_out: &mut Vec<String>,
    ) -> (Body, BTreeMap<&'a str, Pose>) {
        let (mut body, mut poses) = (Body::default(), BTreeMap::from([(first, Pose::identity())]));
        let mut waiting = vec![first];
        while let Some(name) = waiting.pop() {
            let X_BL = poses[name];
            body.links.push(name.to_owned());
            if let Some(link) = self.description.links.get(name) {
                let moved = |it: &Geometry| Geometry { X_LS: X_BL * it.X_LS, shape: it.shape.clone() };
                body.collisions.extend(link.collisions.iter().map(moved));
                body.visuals.extend(link.visuals.iter().map(moved));
                let inertia = link.inertia.map(|it| it.transformed(&X_BL));
                body.inertia = match (body.inertia, inertia) {
                    (Some(one), Some(other)) => Some(one.joined(&other)),
                    (one, other) => one.or(other),
                };
            }
            for joint in self.description.joints_of(name) {
                let child = joint.child.as_str();
                if taken_off.contains(child) || starts.contains(child) {
                    continue;
                }
                if joint.kind == JointKind::Fixed {
                    let X_LC = joint.X_PL;
                    poses.insert(child, X_BL * X_LC);
                    waiting.push(child);
                } else {
                    left_out.push(child.to_owned());
                }
            }
        }
        (body, poses)
    }

    /// All links from `link` on.
    fn below(&self, link: &'a str) -> Vec<&'a str> {
        let mut links = vec![link];
        let mut next = 0;
        while let Some(&link) = links.get(next) {
            links.extend(self.description.joints_of(link).iter().map(|it| it.child.as_str()));
            next += 1;
        }
        links
    }

    /// All links behind those joints of `link` that move, or behind which something moves.
    fn moving_below(&self, link: &'a str) -> Vec<&'a str> {
        let joints = self.description.joints_of(link).iter().filter(|it| self.is_moving(it));
        joints.flat_map(|it| self.below(&it.child)).collect()
    }

    /// The frame of the last body that its name says a gripper is mounted at; otherwise its only end, or the body's own.
    fn flange(&self, last_link: &'a str, X_BL: &BTreeMap<&'a str, Pose>) -> &'a str {
        let rank = |name: &str| {
            let words: Vec<String> = name.split(['_', '-', '/']).map(str::to_lowercase).collect();
            FLANGE_WORDS.iter().position(|flange| words.iter().any(|word| word == flange))
        };
        let named = X_BL.keys().filter_map(|name| Some((rank(name)?, *name))).min();
        let is_end = |name: &&str| self.description.joints_of(name).is_empty();
        let is_frame = |name: &&str| {
            let link = self.description.links.get(*name);
            link.is_some_and(|it| it.inertia.is_none() && it.collisions.is_empty() && it.visuals.is_empty())
        };
        let ends: Vec<&str> = X_BL.keys().copied().filter(is_end).collect();
        let frames: Vec<&str> = ends.iter().copied().filter(is_frame).collect();
        match (named, &frames[..], &ends[..]) {
            (Some((_, name)), ..) => name,
            (None, [one], _) | (None, _, [one]) => one,
            _ => last_link,
        }
    }

    /// Pose of `link` in the frame of `from`, all joints at zero.
    fn pose_from(&self, from: &str, link: &'a str) -> Option<Pose> {
        let (mut X_AL, mut at) = (Pose::identity(), link);
        while at != from {
            let place = self.places.get(at)?;
            let X_PA = place.joint?.X_PL;
            let X_PL = X_PA * X_AL;
            (X_AL, at) = (X_PL, place.parent?);
        }
        Some(X_AL)
    }

    fn fingers(
        &self,
        taken_off: &HashSet<&'a str>,
        hand: Option<&'a str>,
        X_LF: &Pose,
        last_link: &str,
    ) -> Option<Fingers> {
        let hand = hand?;
        let moving = self.below(hand).into_iter().filter(|link| {
            taken_off.contains(link) && self.places[link].joint.is_some_and(|it| it.kind != JointKind::Fixed)
        });
        let moving: Vec<&str> = moving.collect();
        if taken_off.is_empty() {
            return None;
        }
        let closing_F = moving.first().and_then(|link| {
            let joint = self.places[link].joint?;
            let axis_F = X_LF.rotation.inverse() * self.pose_from(last_link, link)?.rotation * joint.axis.into_inner();
            // Fingers that swing close across their axis.
            let [approach_F, swing_F] = [Vector3::z(), axis_F];
            Some(if joint.kind == JointKind::Prismatic { axis_F } else { swing_F.cross(&approach_F) })
        });
        let mut links: Vec<String> = taken_off.iter().map(|it| (*it).to_owned()).collect();
        links.sort_unstable();
        Some(Fingers { links, moving_joints: moving.len(), closing_F })
    }
}

/// Whether a joint is one of an arm: revolute, and driven on its own.
fn drives_an_arm(joint: &TreeJoint) -> bool {
    joint.kind == JointKind::Revolute && joint.mimics.is_none()
}
