//! The limb that a joint belongs to, as its name and its link's say.

use super::TreeJoint;

/// A part of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limb {
    /// Arms, and all that no name says is another limb.
    Arm,
    /// Hands, grippers and their fingers.
    Hand,
    /// Legs, wheels and heads.
    Other,
}

/// Words of fingers, and of their parts.
const FINGERS: [&str; 11] =
    ["finger", "thumb", "jaw", "knuckle", "claw", "proximal", "intermediate", "distal", "index", "middle", "pinky"];
/// Words of joints that move a hand as a whole.
const WRISTS: [&str; 9] = ["wrist", "forearm", "roll", "pitch", "yaw", "rotate", "rotation", "twist", "swivel"];
/// Words of joints that open and close a hand.
const HANDS: [&str; 5] = ["gripper", "hand", "grip", "grasp", "clamp"];
/// Words of limbs that are no arms, in English and as abbreviated for quadrupeds.
const OTHERS: [&str; 16] = [
    "leg", "hip", "thigh", "calf", "knee", "shank", "ankle", "foot", "toe", "haa", "hfe", "kfe", "wheel", "caster",
    "head", "neck",
];

/// The limb that a joint begins or goes on with.
pub fn limb_of(joint: &TreeJoint) -> Limb {
    let (name, link) = (words(&joint.name), words(&joint.child));
    let has = |words: &[String], those: &[&str]| {
        words.iter().any(|it| those.contains(&it.trim_end_matches(char::is_numeric)))
    };
    if is_of_a_finger(&joint.name) {
        Limb::Hand
    } else if has(&name, &OTHERS) || has(&link, &OTHERS) {
        Limb::Other
    } else if has(&name, &WRISTS) {
        Limb::Arm
    } else if has(&name, &HANDS) || is_of_a_finger(&joint.child) {
        Limb::Hand
    } else {
        Limb::Arm
    }
}

/// Returns whether a name is one of a finger that can move. One of `leftfinger` is.
pub fn is_of_a_finger(name: &str) -> bool {
    let words = words(name);
    let is_finger = |it: &String| {
        let it = it.trim_end_matches(char::is_numeric).trim_end_matches('s');
        FINGERS.contains(&it) || it.ends_with("finger") || it.ends_with("thumb")
    };
    words.iter().any(is_finger) && !words.iter().any(|it| it == "fixed")
}

/// The words of a name in small letters: parted by what is no letter or digit, and as in `jointGripper`.
pub fn words(name: &str) -> Vec<String> {
    let letters: Vec<char> = name.chars().collect();
    let mut words = vec![String::new()];
    for (i, &it) in letters.iter().enumerate() {
        let before = i.checked_sub(1).map(|i| letters[i]);
        let is_lower = |letter: Option<&char>| letter.is_some_and(|it| it.is_lowercase());
        let begins = it.is_uppercase()
            && before
                .is_some_and(|before| before.is_lowercase() || before.is_uppercase() && is_lower(letters.get(i + 1)));
        if begins || !it.is_alphanumeric() {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| it.is_alphanumeric()) {
            word.extend(it.to_lowercase());
        }
    }
    words.retain(|it| !it.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Joints and their links, as those who build robots name them.
    #[test]
    fn names_say_what_is_no_arm() {
        for (joint, link, limb) in [
            ("Wrist_Roll", "Fixed_Jaw", Limb::Arm),
            ("Jaw", "Moving Jaw", Limb::Hand),
            ("wrist_roll", "gripper_link", Limb::Arm),
            ("5", "Fixed_Jaw", Limb::Arm),
            ("6", "Moving_Jaw_08d_v1", Limb::Hand),
            ("gripper", "moving_jaw_so101_v1_link", Limb::Hand),
            ("jointGripper", "gripperMover", Limb::Hand),
            ("effector_roll", "gripper_assembly", Limb::Arm),
            ("gripper_opening", "moving_side", Limb::Hand),
            ("gripper_left_joint", "gripper_left_motor_double_link", Limb::Hand),
            ("panda_finger_joint1", "panda_leftfinger", Limb::Hand),
            ("LThumbProximal1", "l", Limb::Hand),
            ("joint_7", "left_fingers", Limb::Hand),
            ("left_hand_yaw", "left_hand", Limb::Arm),
            ("joint_a6", "link_6", Limb::Arm),
            ("LF_HAA", "LF_HIP", Limb::Other),
            ("leg_left_1_joint", "leg_left_1_link", Limb::Other),
            ("LAnkleRoll", "l_ankle", Limb::Other),
            ("head_1_joint", "head_1_link", Limb::Other),
            ("wheel_right_joint", "w", Limb::Other),
        ] {
            let joint = TreeJoint { child: link.to_owned(), ..TreeJoint::fixed(joint.to_owned(), link) };
            assert_eq!(limb_of(&joint), limb, "{joint:?}");
        }
    }
}
