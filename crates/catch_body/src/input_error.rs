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
    /// More faults that were found with it.
    pub also: Vec<InputError>,
}

impl InputError {
    /// A fault at `field` of `file`: `found` stands there, `expected` would be right.
    pub fn new(file: impl Display, field: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self {
            file: file.to_string(),
            field: field.to_string(),
            found: found.to_string(),
            expected: expected.to_string(),
            also: Vec::new(),
        }
    }

    /// All faults among several checks as one, the first of them with the others.
    pub fn first_of<T>(checks: impl IntoIterator<Item = Result<T, Self>>) -> Result<(), Self> {
        let mut faults = checks.into_iter().filter_map(Result::err).flat_map(Self::all);
        faults.next().map_or(Ok(()), |first| Err(Self { also: faults.collect(), ..first }))
    }

    /// This fault and those that were found with it.
    pub fn all(mut self) -> Vec<Self> {
        let also = std::mem::take(&mut self.also);
        std::iter::once(self).chain(also).collect()
    }

    /// What a kind of value, as serde calls it, is called in files.
    pub fn kind_in_words(kind: &str) -> &str {
        match kind.split(' ').next().unwrap_or_default() {
            "f64" | "f32" => "a number",
            "u64" | "u32" | "usize" | "i64" | "i32" => "a whole number",
            "struct" | "map" => "a table",
            _ => match kind {
                "a boolean" => "true or false",
                "a string" => "text in quotes",
                "a sequence" => "a list",
                kind => kind,
            },
        }
    }

    /// Parses TOML into `T`; a fault names the file, the place and what the parser expected.
    pub fn parse_toml<T: serde::de::DeserializeOwned>(file: &str, text: &str) -> Result<T, Self> {
        toml::from_str(text).map_err(|fault| {
            let span = fault.span().unwrap_or_default();
            let is_wrong_kind = fault.message().starts_with("invalid type");
            if let Some(fault) = wrong_in_table(file, &text[span.start..], fault.message()) {
                return fault;
            }
            if let Some((field, (_, kind))) = field_before(&text[..span.start])
                .zip(fault.message().rsplit_once("expected "))
                .filter(|_| is_wrong_kind)
            {
                let found = text[span].lines().next().unwrap_or_default();
                return Self::new(file, field, found, Self::kind_in_words(kind));
            }
            let line = text[..span.start].matches('\n').count() + 1;
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

/// A value of the wrong kind, where the parser only tells the table `[…]` with which `text` begins: the field that has that value.
fn wrong_in_table(file: &str, text: &str, message: &str) -> Option<InputError> {
    let (wrong, kind) = message.strip_prefix("invalid type: ")?.rsplit_once(", expected ")?;
    // A number stands between backticks, text between quotes.
    let wrong = wrong.split('`').nth(1).or_else(|| Some(wrong.split_once(' ')?.1))?;
    let (table, fields) = text.strip_prefix('[')?.split_once(']')?;
    let assignments = fields.lines().take_while(|line| !line.starts_with('[')).filter_map(|line| line.split_once('='));
    let has_value = |value: &str| value.split('#').next().is_some_and(|value| value.trim() == wrong);
    let (name, _) = assignments.into_iter().find(|(_, value)| has_value(value))?;
    let field = format!("{}.{}", table.trim_matches(['[', ']']), name.trim());
    Some(InputError::new(file, field, wrong, InputError::kind_in_words(kind)))
}

/// The field whose value begins where `text` ends: its table and its name.
fn field_before(text: &str) -> Option<String> {
    let line = text.lines().next_back().filter(|_| !text.ends_with('\n'))?;
    let name = line.rsplit_once('=')?.0.rsplit(['{', ',']).next()?.trim();
    let mut tables = text.lines().rev().filter_map(|line| Some(line.trim().strip_prefix('[')?.split_once(']')?.0));
    let table = tables.next().map(|table| format!("{table}.")).unwrap_or_default();
    Some(format!("{}{name}", table.trim_start_matches('[')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[expect(dead_code, reason = "only whether they can be read matters")]
    struct File {
        arena: Arena,
        seed: u64,
    }

    #[derive(Debug, serde::Deserialize)]
    #[expect(dead_code, reason = "only whether they can be read matters")]
    struct Arena {
        rate_hz: f64,
        drag: bool,
    }

    #[test]
    fn values_of_the_wrong_kind_name_their_field() {
        for (text, expected) in [
            ("seed = 1\n[arena]\nrate_hz = \"100\"\ndrag = true", "arena.rate_hz: found \"100\", expected a number"),
            ("seed = 1.5\n[arena]\nrate_hz = 100\ndrag = true", "seed: found 1.5, expected a whole number"),
            ("seed = 1\narena = { rate_hz = 1.0, drag = 1 }", "drag: found 1, expected true or false"),
            ("seed = 1\narena = 3", "arena: found 3, expected a table"),
            ("seed = 1\n[arena]\nrate_hz = 1.0", "line 2: found `[arena]`, expected valid TOML"),
            ("seed = ", "line 1: found `seed =`, expected valid TOML"),
        ] {
            let fault = InputError::parse_toml::<File>("f.toml", text).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("f.toml: {expected}")), "{fault}");
        }
    }
}
