//! What is wrong with a file or an argument, said so that its author can mend it.

use std::fmt::Display;

/// A fault in a user's input: where it is, what was found and what would be right.
///
/// ```
/// use catch_body::InputError;
/// let error = InputError::new("robot.toml", "joints.wrist.max_acceleration_radps2", "-3", "a number above zero");
/// assert_eq!(
///     error.to_string(),
///     "robot.toml: joints.wrist.max_acceleration_radps2: found -3, expected a number above zero"
/// );
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {field}: found {found}, expected {expected}")]
pub struct InputError {
    /// File or argument that holds the fault.
    pub file: String,
    /// Path of the field within the file, `line N` where no field is known.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub expected: String,
}

impl InputError {
    /// A fault at `field` of `file`: `found` stands there, `expected` would be right.
    pub fn new(file: impl Display, field: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self {
            file: file.to_string(),
            field: field.to_string(),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }

    /// Parses TOML into `T`; a fault names the file, the place and what the parser expected.
    pub fn parse_toml<T: serde::de::DeserializeOwned>(file: &str, text: &str) -> Result<T, Self> {
        toml::from_str(text).map_err(|fault| {
            let line = fault.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            let found = text.lines().nth(line - 1).unwrap_or("").trim();
            let found = if found.is_empty() { "nothing".to_owned() } else { format!("`{found}`") };
            Self::new(
                file,
                format!("line {line}"),
                found,
                format!("valid TOML for this kind of file: {}", fault.message()),
            )
        })
    }

    /// `value` if it is finite and above zero.
    pub fn positive(file: &str, field: impl Display, value: f64) -> Result<f64, Self> {
        if value.is_finite() && value > 0.0 {
            Ok(value)
        } else {
            Err(Self::new(file, field, value, "a number above zero"))
        }
    }

    /// `values` if all of them are finite.
    pub fn finite<const N: usize>(file: &str, field: impl Display, values: [f64; N]) -> Result<[f64; N], Self> {
        if values.iter().all(|value| value.is_finite()) {
            Ok(values)
        } else {
            Err(Self::new(file, field, format!("{values:?}"), "finite numbers"))
        }
    }
}
