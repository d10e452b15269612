//! Reads `joint_limits.yaml`, the file beside a robot's description in which MoveIt and drivers keep what
//! URDF cannot say.
//!
//! The tag `!degrees` in front of a number is understood, `null` is what is not given, and a limit only
//! narrows what others state.

use std::collections::BTreeMap;

use catch_body::{
    InputError,
    document::{Harmless, Node},
    quantity,
    quantity::Quantity,
};

use crate::{
    description::{StatedLimits, narrower},
    yaml,
};

/// Names that do not concern a joint's limits.
const HARMLESS: Harmless = &[
    ("", "default_velocity_scaling_factor default_acceleration_scaling_factor cartesian_limits"),
    // Gains of the controller that keeps soft limits.
    ("*", "k_position k_velocity"),
];

/// Limits by the names of their joints, wherever in the document `joint_limits` stands.
///
/// # Errors
/// A line that is no YAML, a document of other than keys, a number that is none or out of its range, a key
/// that is not known.
pub fn read(file: &str, text: &str) -> Result<BTreeMap<String, StatedLimits>, InputError> {
    let document = yaml::document(file, text)?;
    let mut all = BTreeMap::new();
    let mut waiting = vec![yaml::table(document.root())?];
    while let Some(node) = waiting.pop() {
        for limits in node.children("joint_limits") {
            for joint in yaml::table(limits)?.elements() {
                let limits = of_joint(yaml::table(joint.read())?)?;
                let known: &mut StatedLimits = all.entry(joint.name().to_owned()).or_default();
                *known = known.narrowed(&limits);
            }
        }
        // Parameters of nodes have names around them: `/**: ros__parameters: robot_description_planning: …`.
        waiting.extend(
            node.elements()
                .filter(|it| it.name() != "joint_limits" && !it.is_list())
                .filter(|it| it.descendants().any(|it| it.name() == "joint_limits"))
                .map(Node::read),
        );
    }
    document.finish(&[HARMLESS])?;
    Ok(all)
}

fn of_joint(joint: Node) -> Result<StatedLimits, InputError> {
    let value = |key| joint.child(key).filter(|it| !it.is_null());
    let has = |key| value(key).map_or(Ok(true), yaml::boolean);
    let number = |has: bool, key, range: Quantity| {
        let Some(node) = value(key).filter(|_| has) else { return Ok(None) };
        let (text, factor) = match node.text().strip_prefix("!degrees") {
            Some(degrees) => (degrees.trim(), std::f64::consts::PI / 180.0),
            None => (node.text(), 1.0),
        };
        let number = text.parse::<f64>().ok().map(|it| it * factor).filter(|it| range.contains(*it));
        number.map(Some).ok_or_else(|| node.fault(format!("`{}`", node.text()), range))
    };
    let has_position = has("has_position_limits")?;
    let has_soft = value("has_soft_limits").is_some() && has("has_soft_limits")?;
    let range = quantity::JOINT_POSITION_RAD;
    let (lower, upper) = (number(has_position, "min_position", range)?, number(has_position, "max_position", range)?);
    let soft = [number(has_soft, "soft_lower_limit", range)?, number(has_soft, "soft_upper_limit", range)?];
    if has("angle_wraparound")? && value("angle_wraparound").is_some() && (lower.is_some() || upper.is_some()) {
        return Err(joint.fault("angle_wraparound beside limits of the position", "one of both"));
    }
    let acceleration =
        number(has("has_acceleration_limits")?, "max_acceleration", quantity::JOINT_ACCELERATION_RADPS2)?;
    let deceleration =
        number(has("has_deceleration_limits")?, "max_deceleration", quantity::JOINT_ACCELERATION_RADPS2)?;
    let (lower, upper) = (narrower(lower, soft[0], f64::max), narrower(upper, soft[1], f64::min));
    if let (Some(lower), Some(upper)) = (lower, upper)
        && lower >= upper
    {
        return Err(joint.fault(format!("positions from {lower} to {upper}"), "the lowest below the highest"));
    }
    Ok(StatedLimits {
        lower,
        upper,
        velocity: number(has("has_velocity_limits")?, "max_velocity", quantity::JOINT_VELOCITY_RADPS)?,
        acceleration: narrower(acceleration, deceleration, f64::min),
        jerk: number(has("has_jerk_limits")?, "max_jerk", quantity::JOINT_JERK_RADPS3)?,
        effort: number(has("has_effort_limits")?, "max_effort", quantity::TORQUE_NM)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_both_forms_are_read() {
        let text = "# limits\ndefault_velocity_scaling_factor: 0.1\njoint_limits:\n  joint_1:  # the first\n    \
            has_velocity_limits: true\n    max_velocity: 2.5\n    has_acceleration_limits: false\n    \
            max_acceleration: 7\n  'joint_2':\n    max_acceleration: !degrees 180.0\n    max_effort: 40\n    \
            min_position: -1.5\n    max_jerk: 5e2\n";
        let limits = read("joint_limits.yaml", text).unwrap();
        let first = StatedLimits { velocity: Some(2.5), ..Default::default() };
        assert_eq!(limits["joint_1"], first);
        let second = limits["joint_2"];
        assert!((second.acceleration.unwrap() - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!((second.effort, second.lower, second.jerk), (Some(40.0), Some(-1.5), Some(500.0)));
        assert!(read("none.yaml", "").unwrap().is_empty());
    }

    #[test]
    fn faults_are_told_with_their_line() {
        for (text, expected) in [
            (
                "joint_limits:\n  a:\n    max_velocity: fast",
                "line 3: joint_limits.a.max_velocity: found `fast`, expected 0.001 to",
            ),
            ("joint_limits:\n  a:\n    max_velocity: -1", "line 3: joint_limits.a.max_velocity: found `-1`"),
            (
                "joint_limits:\n  a:\n    max_speed: 1",
                "line 3: joint_limits.a.max_speed: found `max_speed`, which is not read",
            ),
            (
                "joint_limits:\n  a: {has_velocity_limits: treu, max_velocity: 1}",
                "line 2: joint_limits.a.has_velocity_limits: found `treu`, expected true or false",
            ),
            (
                "joint_limits: {a: {min_position: 1, max_position: -1}}",
                "line 1: joint_limits.a: found positions from 1 to -1, expected the lowest below the highest",
            ),
            ("joint_limits: {a: 1.0}", "line 1: joint_limits.a: found `1.0`, expected a table"),
            ("joint_limits: 5", "line 1: joint_limits: found `5`, expected a table"),
            ("joint_limits: [5]", "line 1: joint_limits: found a list, expected a table"),
            ("joint_limits\n  a\n    max_velocity 0.5", "found `joint_limits a max_velocity 0.5`, expected a table"),
            ("{a: 1}", "line 1: a: found `a`, which is not read"),
        ] {
            let fault = read("joint_limits.yaml", text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn what_yaml_allows_is_read() {
        let text = "/**:\n  ros__parameters:\n    robot_description_planning:\n      joint_limits:\n        a: {has_velocity_limits: true, max_velocity: 2.0}\n        \
            b:\n          max_velocity: null\n          max_position: 1\n          max_acceleration: ~\n        c: {max_acceleration: 4, max_deceleration: 3}\n";
        let limits = read("joint_limits.yaml", text).unwrap();
        assert_eq!(limits["a"], StatedLimits { velocity: Some(2.0), ..Default::default() });
        assert_eq!(limits["b"], StatedLimits { upper: Some(1.0), ..Default::default() });
        assert_eq!(limits["c"], StatedLimits { acceleration: Some(3.0), ..Default::default() });
    }

    #[test]
    fn of_two_blocks_the_narrower_counts_and_truth_has_many_words() {
        let text = "joint_limits:\n  a: {has_velocity_limits: 1, max_velocity: 2, min_position: -1}\nplanning:\n  \
            joint_limits:\n    a: {has_velocity_limits: Y, max_velocity: 3, has_jerk_limits: OFF, max_jerk: 9, min_position: -2}\n";
        let expected = StatedLimits { lower: Some(-1.0), velocity: Some(2.0), ..Default::default() };
        assert_eq!(read("joint_limits.yaml", text).unwrap()["a"], expected);
    }
}
