//! Faults of a file or an argument, reported so that its author can mend them.

use std::{collections::BTreeSet, fmt::Display};

use serde::Serialize;

/// Returns whether a character steers how the text around it is displayed: control characters, and marks of
/// the direction of writing, by which a name looks like another.
pub fn steers_text(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

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
#[derive(Debug, Clone, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("{file}: {field}: found {found}, expected {expected}")]
pub struct InputError {
    /// File or argument that holds the fault.
    pub file: String,
    /// Path of the field within the file, `line N` where no field is known.
    pub field: String,
    /// Value that stands there.
    pub found: String,
    /// Value that would be right.
    pub expected: String,
    /// Further faults that were found with this one.
    #[serde(skip)]
    pub also: Box<[InputError]>,
    /// True if nothing is wrong with the input, but a result could not be written.
    #[serde(skip)]
    pub of_output: bool,
}

impl InputError {
    /// A fault at `field` of `file`: `found` stands there, `expected` would be right.
    pub fn new(file: impl Display, field: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self {
            file: file.to_string(),
            field: field.to_string(),
            found: abbreviated(&found.to_string()),
            expected: expected.to_string(),
            also: Box::default(),
            of_output: false,
        }
    }

    /// A result that cannot be written to `file`; `expected` says what would help. Where no file could ever
    /// be, the place is at fault, which is input; a full disk is not.
    pub fn unwritten(file: impl Display, fault: &std::io::Error, expected: impl Display) -> Self {
        use std::io::ErrorKind::{
            AlreadyExists, InvalidFilename, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied,
            ReadOnlyFilesystem,
        };
        let of_place = matches!(
            fault.kind(),
            AlreadyExists
                | InvalidFilename
                | InvalidInput
                | IsADirectory
                | NotADirectory
                | NotFound
                | PermissionDenied
                | ReadOnlyFilesystem
        );
        Self { of_output: !of_place, ..Self::new(file, "the file", fault, expected) }
    }

    /// All faults among several checks as one, the first of them with the others; one of each field.
    pub fn first_of<T>(checks: impl IntoIterator<Item = Result<T, Self>>) -> Result<(), Self> {
        let mut told = BTreeSet::new();
        let is_new = |it: &Self| told.insert((it.file.clone(), it.field.clone()));
        let mut faults = checks.into_iter().filter_map(Result::err).flat_map(Self::all).filter(is_new);
        faults.next().map_or(Ok(()), |first| Err(Self { also: faults.collect(), ..first }))
    }

    /// Returns this fault and those that were found with it.
    pub fn all(mut self) -> Vec<Self> {
        let also = std::mem::take(&mut self.also);
        std::iter::once(self).chain(also).collect()
    }
}

/// Greatest number of characters of what a message says was found.
const MOST_CHARACTERS: usize = 400;
/// Greatest number of digits that an f64 needs; numbers with more in a row are given by their power of ten.
const MOST_DIGITS: usize = 17;

/// A text for one message: long numbers by their power of ten, long texts by their beginning.
fn abbreviated(text: &str) -> String {
    let mut short = String::with_capacity(text.len().min(MOST_CHARACTERS));
    let mut rest = text;
    while let Some(start) = rest.find(|it: char| it.is_ascii_digit()) {
        let number = &rest[start..];
        let digits = |text: &str| text.len() - text.trim_start_matches(|it: char| it.is_ascii_digit()).len();
        let whole = digits(number);
        let fraction = if number[whole..].starts_with('.') { 1 + digits(&number[whole + 1..]) } else { 0 };
        let length = whole + fraction;
        let is_part_of_word = rest[..start].ends_with(|it: char| it.is_alphanumeric() || it == '_');
        short += &rest[..start];
        match number[..length].trim_end_matches('.').parse::<f64>() {
            Ok(value) if whole.max(fraction) > MOST_DIGITS + 3 && !is_part_of_word => short += &format!("{value:e}"),
            _ => short += &number[..length],
        }
        rest = &number[length..];
    }
    short += rest;
    match short.char_indices().nth(MOST_CHARACTERS) {
        Some((end, _)) => format!("{}…", &short[..end]),
        None => short,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_stay_short() {
        assert_eq!(abbreviated(&format!("floating point `{}.0`", 1e300)), "floating point `1e300`");
        assert_eq!(abbreviated(&format!("{} and {}", -2.5e-30, 0.1)), "-2.5e-30 and 0.1");
        assert_eq!(abbreviated("[1.25, -3, 1234567.0]"), "[1.25, -3, 1234567.0]");
        assert_eq!(abbreviated(&1.234_567_890_123_456_7.to_string()), "1.2345678901234567");
        let name = "object_123456789012345678901234567890.toml";
        assert_eq!(abbreviated(name), name);
        assert_eq!(abbreviated(&"é".repeat(1000)).chars().count(), MOST_CHARACTERS + 1);
    }
}
