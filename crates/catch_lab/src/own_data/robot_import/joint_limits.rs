//! Reads `joint_limits.yaml`, the file beside a robot's description in which MoveIt and drivers keep what URDF cannot say.
//!
//! What is read of YAML: nested `key: value` lines, comments, quotes and the tag `!degrees`. That is all that such files use, and a
//! parser of the whole language would be a dependency for nine numbers a joint.

use std::collections::BTreeMap;

use catch_body::{InputError, quantity, quantity::Quantity};

/// Limits of a joint; `None` where the file has none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointLimitFields {
    /// Lowest position.
    pub lower: Option<f64>,
    /// Highest position.
    pub upper: Option<f64>,
    /// Highest speed.
    pub velocity: Option<f64>,
    /// Highest acceleration.
    pub acceleration: Option<f64>,
    /// Highest jerk.
    pub jerk: Option<f64>,
    /// Highest torque.
    pub effort: Option<f64>,
}

/// Lines of a file at most.
const MOST_LINES: usize = 20_000;
/// Tables within tables at most.
const DEEPEST: usize = 8;

/// Limits by the names of their joints.
///
/// # Errors
/// A line that is no `key: value`, a number that is none or out of its range.
pub fn read(file: &str, text: &str) -> Result<BTreeMap<String, JointLimitFields>, InputError> {
    let mut joints: BTreeMap<String, Fields> = BTreeMap::new();
    // The keys that lead to the present line, with their indentation.
    let mut path: Vec<(usize, String)> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let fault = |found: &str, expected: &str| InputError::new(file, format!("line {}", i + 1), found, expected);
        if i >= MOST_LINES {
            return Err(fault("one more line", &format!("at most {MOST_LINES}")));
        }
        let content = without_comment(line).trim_end();
        if content.trim().is_empty() || content.trim() == "---" {
            continue;
        }
        let indentation = content.len() - content.trim_start().len();
        let key_and_value = content.trim_start().split_once(':').filter(|(key, value)| {
            !key.starts_with(['-', '{', '[', '&', '*', '\t']) && (value.is_empty() || value.starts_with([' ', '\t']))
        });
        let Some((key, value)) = key_and_value else {
            return Err(fault(&format!("`{}`", short(content.trim())), "`key: value`, one a line"));
        };
        while path.last().is_some_and(|(outer, _)| *outer >= indentation) {
            path.pop();
        }
        let (key, value) = (unquoted(key.trim()).to_owned(), value.trim());
        if value.is_empty() {
            if path.len() >= DEEPEST {
                return Err(fault(&format!("`{}`", short(&key)), &format!("tables at most {DEEPEST} deep")));
            }
            path.push((indentation, key));
            continue;
        }
        // `joint_limits: NAME: key: value`, below whatever else.
        let [.., (_, parent), (_, joint)] = &path[..] else { continue };
        if parent == "joint_limits" {
            joints.entry(joint.clone()).or_default().insert(key, (i + 1, value.to_owned()));
        }
    }
    joints.into_iter().map(|(name, fields)| Ok((name.clone(), limits(file, &name, &fields)?))).collect()
}

/// Lines and values by their keys.
type Fields = BTreeMap<String, (usize, String)>;

fn limits(file: &str, joint: &str, fields: &Fields) -> Result<JointLimitFields, InputError> {
    let has = |what: &str| {
        let said = fields.get(&format!("has_{what}_limits")).map(|(_, value)| value.to_lowercase());
        said.is_none_or(|it| matches!(it.as_str(), "true" | "yes" | "on"))
    };
    let number = |what: &str, key: &str, range: Quantity| match fields.get(key) {
        Some((line, value)) if has(what) => {
            let (text, factor) = match value.strip_prefix("!degrees") {
                Some(degrees) => (degrees.trim(), std::f64::consts::PI / 180.0),
                None => (value.as_str(), 1.0),
            };
            let number = unquoted(text).parse::<f64>().ok().map(|it| it * factor).filter(|it| range.contains(*it));
            let field = format!("line {line}: {joint}.{key}");
            number.map(Some).ok_or_else(|| InputError::new(file, field, format!("`{}`", short(value)), range))
        }
        _ => Ok(None),
    };
    Ok(JointLimitFields {
        lower: number("position", "min_position", quantity::JOINT_POSITION_RAD)?,
        upper: number("position", "max_position", quantity::JOINT_POSITION_RAD)?,
        velocity: number("velocity", "max_velocity", quantity::JOINT_VELOCITY_RADPS)?,
        acceleration: number("acceleration", "max_acceleration", quantity::JOINT_ACCELERATION_RADPS2)?,
        jerk: number("jerk", "max_jerk", quantity::JOINT_JERK_RADPS3)?,
        effort: number("effort", "max_effort", quantity::TORQUE_NM)?,
    })
}

fn without_comment(line: &str) -> &str {
    let comment = line.match_indices('#').map(|(at, _)| at).find(|&at| at == 0 || line[..at].ends_with([' ', '\t']));
    comment.map_or(line, |at| &line[..at])
}

fn unquoted(text: &str) -> &str {
    let inner = |quote| text.strip_prefix(quote).and_then(|it| it.strip_suffix(quote));
    inner('"').or_else(|| inner('\'')).unwrap_or(text)
}

fn short(text: &str) -> String {
    text.chars().take(60).collect()
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
        let first = JointLimitFields { velocity: Some(2.5), ..Default::default() };
        assert_eq!(limits["joint_1"], first);
        let second = limits["joint_2"];
        assert!((second.acceleration.unwrap() - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!((second.effort, second.lower, second.jerk), (Some(40.0), Some(-1.5), Some(500.0)));
        assert!(read("none.yaml", "").unwrap().is_empty());
    }

    #[test]
    fn faults_are_told_with_their_line() {
        for (text, expected) in [
            ("joint_limits:\n  a:\n    max_velocity: fast", "line 3: a.max_velocity: found `fast`, expected 0.001 to"),
            ("joint_limits:\n  a:\n    max_velocity: -1", "line 3: a.max_velocity: found `-1`"),
            ("joint_limits:\n  - a", "line 2: found `- a`, expected `key: value`"),
            ("{a: 1}", "line 1: found `{a: 1}`"),
            ("a:\n b:\n  c:\n   d:\n    e:\n     f:\n      g:\n       h:\n        i:\n", "at most 8 deep"),
        ] {
            let fault = read("joint_limits.yaml", text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
