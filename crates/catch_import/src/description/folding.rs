//! Folding of rigidly connected links along an arm into one body for each joint.

use std::collections::{BTreeMap, HashSet};

use nalgebra::Vector3;

use super::{
    Geometry, JointKind, TreeJoint,
    chain::{Body, Chain, ChainJoint, Fingers},
    limbs::words,
    tree::Tree,
};
use catch_body::Pose;

/// Words in the names of frames at which grippers are mounted, the best first (ROS-Industrial's `tool0`, REP
/// 199's `flange`).
const FLANGE_WORDS: [&str; 9] = ["tool0", "flange", "tool", "ee", "eef", "effector", "endeffector", "tcp", "mount"];

/// End of an arm.
pub enum End<'a> {
    /// The arm ends at a frame that somebody chose.
    Tip(&'a str),
    /// A hand begins at a link.
    Hand { at: &'a str, reason: String },
    /// No joint moves behind the end.
    Open,
}

impl<'a> Tree<'a> {
    /// Folds what is rigidly connected on a path, of whose joints those numbered `moving` move.
    pub fn folded(&self, base: &'a str, path: &[&'a TreeJoint], moving: &[usize], end: &End<'a>) -> Chain {
        let (tip, fingers_at, reason) = match end {
            End::Tip(tip) => (Some(*tip), None, "they are behind the tip".to_owned()),
            End::Hand { at, reason } => (None, Some(*at), reason.clone()),
            End::Open => (None, None, String::new()),
        };
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
        let closing_F = self.closing_F(&taken_off, hand.or(tip).or(fingers_at), &X_LF, last_link);
        let mut links: Vec<String> = taken_off.iter().map(|it| (*it).to_owned()).collect();
        links.sort_unstable();
        let fingers = (!links.is_empty()).then_some(Fingers { links, reason, closing_F });
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

    /// The frame of the last body that its name says a gripper is mounted at; otherwise its only end, or the
    /// body's own.
    fn flange(&self, last_link: &'a str, X_BL: &BTreeMap<&'a str, Pose>) -> &'a str {
        let rank = |name: &str| {
            let words = words(name);
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

    /// Direction in F in which the first finger moves that was taken off.
    fn closing_F(
        &self,
        taken_off: &HashSet<&'a str>,
        hand: Option<&'a str>,
        X_LF: &Pose,
        last_link: &str,
    ) -> Option<Vector3<f64>> {
        let moves = |link: &str| {
            taken_off.contains(link) && self.places[link].joint.is_some_and(|it| it.kind != JointKind::Fixed)
        };
        let link = self.below(hand?).into_iter().find(|link| moves(link))?;
        let joint = self.places[link].joint?;
        let axis_F = X_LF.rotation.inverse() * self.pose_from(last_link, link)?.rotation * joint.axis.into_inner();
        // Fingers that swing close across their axis.
        Some(if joint.kind == JointKind::Prismatic { axis_F } else { axis_F.cross(&Vector3::z()) })
    }
}
