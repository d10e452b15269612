//! Finds the arm in a tree of links: which way it goes, and where it ends.

use super::{
    Description, JointKind, TreeJoint,
    chain::{Chain, Selection},
    folding::End,
    limbs::Limb,
    tree::{Tree, is_driven},
};
use catch_body::{InputError, MAX_JOINTS};

/// Least number of joints in a row that are an arm.
const LEAST_ARM_JOINTS: usize = 3;
/// Number of joints after which a branch is a hand.
const MOST_JOINTS_BEFORE_A_HAND: usize = 5;
/// Range in radians above which a joint is no jaw.
const JAW_RANGE_RAD: f64 = 2.4;
/// The middle of a jaw's range is further from zero, as a fraction of it.
const JAW_ONE_SIDED: f64 = 0.2;
/// The centre of mass of a jaw is further from its axis, in metres.
const JAW_OFF_AXIS_M: f64 = 5e-3;

impl Chain {
    /// Finds the arm in a description.
    ///
    /// # Errors
    /// If there is none, more than one, or one with joints that are not revolute; a link of the selection
    /// that does not exist.
    pub fn of(description: &Description, selection: &Selection) -> Result<Self, InputError> {
        Tree::new(description).chain(selection)
    }
}

impl<'a> Tree<'a> {
    fn chain(&self, selection: &Selection<'a>) -> Result<Chain, InputError> {
        let base = self.known(selection.base.unwrap_or(&self.description.root), "--base")?;
        let (path, end) = match selection.tip {
            Some(tip) => {
                let tip = self.known(tip, "--tip")?;
                (self.path(base, tip)?, End::Tip(tip))
            }
            None => self.longest_arm(base)?,
        };
        let moving: Vec<usize> = (0..path.len()).filter(|&i| path[i].kind != JointKind::Fixed).collect();
        for &i in &moving {
            if !is_driven(path[i]) || selection.tip.is_none() && self.limb(path[i]) == Limb::Other {
                return Err(self.not_of_an_arm(path[i]));
            }
        }
        if moving.len() < LEAST_ARM_JOINTS {
            let (found, least) = (moving.len(), LEAST_ARM_JOINTS);
            let expected =
                format!("{least} or more revolute joints in a row, without which no hand is brought anywhere");
            return Err(self.fault("joint", format!("{found} from {base} on that move an arm"), expected));
        }
        if moving.len() > MAX_JOINTS {
            let tip = selection.tip.unwrap_or("the tip");
            let found = format!("{} joints from {base} to {tip}", moving.len());
            let expected = format!("at most {MAX_JOINTS}: `--base LINK` and `--tip LINK` choose a part");
            return Err(self.fault("joint", found, expected));
        }
        Ok(self.folded(base, &path, &moving, &end))
    }

    fn not_of_an_arm(&self, joint: &TreeJoint) -> InputError {
        let (found, or) = match (&joint.mimics, joint.kind) {
            (Some(_), _) => ("a joint that another drives", ""),
            (None, JointKind::Revolute) => {
                ("a joint of a leg, a wheel or a head by its name", ", `--tip LINK` says that it is one of an arm")
            }
            _ => ("a joint that slides or floats", ""),
        };
        let expected = format!("revolute joints of an arm: `--base {}` begins behind it{or}", joint.child);
        self.fault(&format!("joint {}", joint.name), found, expected)
    }

    /// Follows the only branch that is an arm. Returns the joints up to the last body, and why it ends there.
    fn longest_arm(&self, base: &'a str) -> Result<(Vec<&'a TreeJoint>, End<'a>), InputError> {
        let (mut path, mut passed, mut at, mut end) = (Vec::<&TreeJoint>::new(), 0, base, 0);
        loop {
            let moving: Vec<&TreeJoint> =
                self.description.joints_of(at).iter().filter(|it| self.is_moving(it)).collect();
            let with = |least: usize| moving.iter().copied().filter(move |it| self.arm_joints(it) >= least);
            let arms: Vec<&TreeJoint> = with(LEAST_ARM_JOINTS).collect();
            let is_in_path = |name: &String| path.iter().any(|it| it.name == *name);
            let is_driven_from_below = |it: &&TreeJoint| it.mimics.as_ref().is_some_and(is_in_path);
            let hand = |reason: String| Ok((path[..end].to_vec(), End::Hand { at, reason }));
            let next = match (&moving[..], &arms[..]) {
                ([], _) => {
                    path.truncate(end);
                    return path.last().map_or(Ok(()), |last| self.is_no_jaw(last)).map(|()| (path, End::Open));
                }
                ([one], _) => *one,
                (_, [one]) if passed < MOST_JOINTS_BEFORE_A_HAND => *one,
                (_, [_, _, ..]) if passed < MOST_JOINTS_BEFORE_A_HAND => {
                    let tips: Vec<&str> = arms.iter().map(|it| self.last_of(it)).collect();
                    let found = format!("{} arms that begin at {at}", arms.len());
                    let expected = format!("one: `--tip LINK`, such as {}", tips.join(" or "));
                    return Err(self.fault("joint", found, expected));
                }
                // A linkage beside the arm, as those that keep a hand level.
                _ if moving.iter().filter(|it| !is_driven_from_below(it)).count() == 1 && with(1).count() == 1 => {
                    with(1).next().unwrap_or(moving[0])
                }
                _ => return hand(format!("{} joints begin at {at}", moving.len())),
            };
            if self.limb(next) == Limb::Hand {
                return hand(format!("{} is one of a hand by its name", next.name));
            }
            // A joint that a joint of the arm drives is part of the arm.
            if is_driven_from_below(&next) {
                return Err(self.not_of_an_arm(next));
            }
            if !is_driven(next) && next.kind != JointKind::Fixed && passed >= LEAST_ARM_JOINTS {
                return match &next.mimics {
                    // A joint that another branch drives is a hand only if all of it is behind.
                    Some(driver) if !self.below(at).iter().any(|it| self.is_moved_by(it, driver)) => {
                        Err(self.not_of_an_arm(next))
                    }
                    Some(driver) => hand(format!("{} follows {driver}", next.name)),
                    None => hand(format!("{} slides", next.name)),
                };
            }
            path.push(next);
            if next.kind != JointKind::Fixed {
                passed += 1;
                end = path.len();
            }
            at = &next.child;
        }
    }

    /// Checks that the last joint of an arm is no jaw: it rotates far or both ways alike, it carries
    /// something, or it bears its link in the middle.
    fn is_no_jaw(&self, last: &TreeJoint) -> Result<(), InputError> {
        let is_end = self.description.joints_of(&last.child).is_empty();
        let (Some(lower), Some(upper), true) = (last.limits.lower, last.limits.upper, is_end) else { return Ok(()) };
        let is_one_sided = (lower + upper).abs() > JAW_ONE_SIDED * (upper - lower) && upper - lower < JAW_RANGE_RAD;
        let inertia = self.description.links.get(&last.child).and_then(|it| it.inertia);
        let off_axis_m = inertia.map(|it| {
            let com = it.com.coords;
            (com - last.axis.into_inner() * com.dot(&last.axis)).norm()
        });
        if !is_one_sided || off_axis_m.is_some_and(|it| it < JAW_OFF_AXIS_M) {
            return Ok(());
        }
        let found = format!(
            "a last joint that may be a jaw: from {lower} to {upper} rad, its link to one side of the axis, and \
             nothing behind it"
        );
        let parent = self.places.get(&*last.child).and_then(|it| it.parent).unwrap_or_default();
        let expected = format!("`--tip {parent}` if it is a jaw, `--tip {}` if it is one of the arm", last.child);
        Err(self.fault(&format!("joint {}", last.name), found, expected))
    }

    /// The last link of the longest arm that begins with `joint`, before any hand.
    fn last_of(&self, joint: &'a TreeJoint) -> &'a str {
        let (mut at, mut passed) = (joint, 1);
        loop {
            let joints = self.description.joints_of(&at.child).iter();
            let arms: Vec<&TreeJoint> = joints.filter(|it| self.arm_joints(it) > 0).collect();
            let next = match arms[..] {
                [one] => one,
                [first, .., last] if passed < MOST_JOINTS_BEFORE_A_HAND => {
                    if self.arm_joints(first) < self.arm_joints(last) { last } else { first }
                }
                _ => return &at.child,
            };
            passed += usize::from(next.kind != JointKind::Fixed);
            at = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A description of joints, each a line: name, kind, parent, child, and the rest of its element.
    fn description(joints: &str) -> Description {
        let joints: Vec<Vec<&str>> =
            joints.lines().map(|it| it.split_whitespace().collect()).filter(|it: &Vec<&str>| !it.is_empty()).collect();
        let links: std::collections::BTreeSet<&str> = joints.iter().flat_map(|it| [it[2], it[3]]).collect();
        let link = |it: &&str| {
            let inertia = "<inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/>";
            let com = format!("<origin xyz=\"{} 0 0.1\"/>", if it.starts_with("round") { 0.0 } else { 0.02 });
            let visual = "<visual><geometry><sphere radius=\"0.1\"/></geometry></visual>";
            let visual = if it.contains("frame") { "" } else { visual };
            format!("<link name=\"{it}\"><inertial>{com}<mass value=\"1\"/>{inertia}</inertial>{visual}</link>")
        };
        let joint = |it: &Vec<&str>| {
            let rest = match it[4..] {
                ["mimics", driver] => format!("<limit lower=\"-2\" upper=\"2\"/><mimic joint=\"{driver}\"/>"),
                [lower, upper] => format!("<limit lower=\"{lower}\" upper=\"{upper}\"/>"),
                _ => "<limit lower=\"-2\" upper=\"2\"/>".to_owned(),
            };
            let [name, kind, parent, child] = [it[0], it[1], it[2], it[3]];
            format!(
                "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
                 <axis xyz=\"0 0 1\"/>{rest}</joint>"
            )
        };
        let links: String = links.iter().map(link).collect();
        let text = format!("<robot name=\"a\">{links}{}</robot>", joints.iter().map(joint).collect::<String>());
        Description::from_urdf("a.urdf", &text).unwrap()
    }

    /// Joints j1 to j`n` in a row, links l0 to l`n`, and `rest`.
    fn arm(n: usize, rest: &str) -> Description {
        let joints = (1..=n).map(|i| format!("j{i} revolute l{} l{i}\n", i - 1));
        description(&(joints.collect::<String>() + rest))
    }

    /// Joints of the arm, and why what is behind is none.
    fn found(description: &Description) -> Result<(usize, Option<String>), String> {
        let chain = Chain::of(description, &Selection::default()).map_err(|it| it.to_string())?;
        Ok((chain.joints.len(), chain.fingers.map(|it| it.reason)))
    }

    #[test]
    fn hands_are_no_joints_of_an_arm() {
        for (joints, rest, reason) in [
            (5, "gripper revolute l5 moving_jaw", "gripper is one of a hand by its name"),
            (5, "6 revolute l5 Moving_Jaw -0.2 1.8", "6 is one of a hand by its name"),
            (
                6,
                "s fixed l6 stator\njointGripper revolute stator mover -1.57 0",
                "jointGripper is one of a hand by its name",
            ),
            (6, "f1 prismatic l6 a", "f1 slides"),
            (6, "f1 revolute l6 a\nf2 revolute l6 b mimics f1", "2 joints begin at l6"),
            (4, "f1 revolute l4 a\nf2 revolute l4 b mimics f1", "2 joints begin at l4"),
            (6, "finger_1 fixed l6 a\nfinger_2 fixed l6 b", "2 joints begin at l6"),
        ] {
            assert_eq!(found(&arm(joints, rest)), Ok((joints, Some(reason.to_owned()))), "{rest}");
        }
        assert_eq!(found(&arm(6, "finger_tip fixed l6 frame")), Ok((6, None)), "a frame is no finger");
    }

    #[test]
    fn a_last_joint_that_may_be_a_jaw_is_asked_for() {
        let fault = found(&arm(5, "j6 revolute l5 l6 -0.2 1.8")).unwrap_err();
        assert!(fault.contains("joint j6: found a last joint that may be a jaw"), "{fault}");
        assert!(fault.contains("`--tip l5` if it is a jaw, `--tip l6` if it is one of the arm"), "{fault}");
        let both = arm(5, "j6 revolute l5 l6 -0.2 1.8");
        for (tip, joints) in [("l5", 5), ("l6", 6)] {
            let chain = Chain::of(&both, &Selection { tip: Some(tip), base: None }).unwrap();
            assert_eq!(chain.joints.len(), joints);
        }
        for last in ["l6 -1 1", "l6 -0.2 3", "round -0.2 1.8", "l6 -0.2 1.8\nt fixed l6 tool0"] {
            assert_eq!(found(&arm(5, &format!("j6 revolute l5 {last}"))), Ok((6, None)), "{last}");
        }
    }

    #[test]
    fn coupled_joints_cut_no_arm() {
        // A linkage that keeps the hand level, beside the arm and within it.
        let beside = "p revolute l3 bar mimics j2\nj4 revolute l3 l4\nj5 revolute l4 l5";
        assert_eq!(found(&arm(3, beside)), Ok((5, None)));
        for (rest, joint) in [
            ("p revolute l3 l4 mimics j2\nj5 revolute l4 l5", "joint p: found a joint that another drives"),
            ("p revolute l3 l4 mimics q\nq revolute l0 bar", "joint p: found a joint that another drives"),
        ] {
            let fault = found(&arm(3, rest)).unwrap_err();
            assert!(fault.contains(joint), "{fault}");
        }
    }

    #[test]
    fn tips_are_ends_of_arms() {
        let limb = |side: &str, name: &str, joints: usize, from: &str| -> String {
            let link = |i: usize| if i == 0 { from.to_owned() } else { format!("{side}_{name}_{i}") };
            (1..=joints).map(|i| format!("{side}_{name}_{i}_joint revolute {} {}\n", link(i - 1), link(i))).collect()
        };
        let mut text = String::new();
        for side in ["left", "right"] {
            text += &limb(side, "leg", 6, "pelvis");
            text += &limb(side, "arm", 7, "torso");
            for finger in ["a", "b", "c"] {
                text += &limb(side, finger, 3, &format!("{side}_arm_7"));
            }
        }
        let fault = found(&description(&(text + "waist revolute pelvis torso\nhead revolute torso head"))).unwrap_err();
        assert!(fault.contains("2 arms that begin at torso"), "{fault}");
        assert!(fault.contains("such as left_arm_7 or right_arm_7"), "{fault}");
        let fault = found(&description(&limb("front", "leg", 3, "trunk"))).unwrap_err();
        assert!(fault.contains("a joint of a leg, a wheel or a head by its name"), "{fault}");
    }
}
