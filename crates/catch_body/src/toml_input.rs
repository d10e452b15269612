//! Reads TOML strictly: numbers are finite, lists have their exact length, tables are tables, and every fault
//! is told with the path of its field.

mod node;

use std::fmt::{self, Display};

use serde::{
    Serialize,
    de::{DeserializeOwned, Error, Expected, Unexpected},
};
use toml::Value;

use crate::InputError;
use node::Node;

/// Letters of a value that are repeated in an error.
const MOST_LETTERS: usize = 80;
/// Greatest number of faults of one file that are reported at once.
const MOST_FAULTS: usize = 20;

impl InputError {
    /// What an error says it found where a field is unknown.
    pub const UNKNOWN_FIELD: &str = "an unknown field";

    /// Parses TOML into `T`.
    ///
    /// # Errors
    /// The line that is no TOML; or each field that is missing, unknown, of another kind or out of its range,
    /// the first of them with the others.
    pub fn parse_toml<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, Self> {
        Self::without_faults(Self::parse_toml_all(file, text)?)
    }

    /// Parses TOML into `T` even where numbers are out of their ranges: each of these is a fault, and the
    /// least that would be right stands in its place.
    ///
    /// # Errors
    /// As [`parse_toml`](Self::parse_toml), with all faults, if there is one that is no number out of its
    /// range.
    pub fn parse_toml_all<T: DeserializeOwned>(file: &str, text: &str) -> Result<(T, Vec<Self>), Self> {
        let table = Self::toml_table(text).map_err(|fault| {
            let line = text[..fault.span().unwrap_or_default().start].matches('\n').count() + 1;
            let found = text.lines().nth(line - 1).unwrap_or_default().trim();
            let found = if found.is_empty() { "nothing".to_owned() } else { format!("`{}`", brief(found)) };
            Self::new(file, format!("line {line}"), found, format!("valid TOML: {}", fault.message()))
        })?;
        Self::from_table(file, table)
    }

    /// A document's table. A whole number of more than 64 bits is read as a float, so that whoever refuses it
    /// knows its field.
    ///
    /// # Errors
    /// What is no TOML.
    pub fn toml_table(text: &str) -> Result<toml::Table, toml::de::Error> {
        let mut text = text.to_owned();
        let mut read = toml::from_str(&text);
        for _ in 0..MOST_FAULTS {
            let Some(place) = read.as_ref().err().and_then(toml::de::Error::span) else { break };
            let number = text.get(place.clone()).unwrap_or_default().replace('_', "");
            let digits = number.trim_start_matches(['+', '-']);
            if number.parse::<i64>().is_ok() || digits.is_empty() || !digits.bytes().all(|it| it.is_ascii_digit()) {
                break;
            }
            text.insert_str(place.end, ".0");
            read = toml::from_str(&text);
        }
        read
    }

    /// Reads settings from a table that has been parsed.
    ///
    /// # Errors
    /// As [`parse_toml_all`](Self::parse_toml_all).
    pub fn from_table<T: DeserializeOwned>(file: &str, table: toml::Table) -> Result<(T, Vec<Self>), Self> {
        let mut root = Value::Table(table);
        let mut faults = Vec::new();
        loop {
            let mut fault = match T::deserialize(Node(&root)) {
                Ok(parsed) => return Ok((parsed, faults)),
                Err(fault) => fault,
            };
            let substitute = fault.complete(&root);
            if root.as_table().is_some_and(toml::Table::is_empty) {
                return Err(Self::new(file, fault.field(), "an empty file", &fault.expected));
            }
            faults.push(Self::new(file, fault.field(), &fault.found, &fault.expected));
            match substitute.zip(at(&mut root, &fault.path)) {
                Some((substitute, place)) if faults.len() < MOST_FAULTS => *place = substitute,
                _ => return Err(Self { also: faults.split_off(1).into(), ..faults.remove(0) }),
            }
        }
    }

    /// Settings that were read, if no number in them was out of its range.
    ///
    /// # Errors
    /// The first of the faults with the others.
    pub fn without_faults<T>((parsed, faults): (T, Vec<Self>)) -> Result<T, Self> {
        Self::first_of(faults.into_iter().map(Err::<(), _>)).map(|()| parsed)
    }

    /// Checks that settings made in code could stand in a file, every number within its range; `name` takes
    /// the place of the file.
    ///
    /// # Errors
    /// As [`parse_toml`](Self::parse_toml).
    pub fn check_settings<T: Serialize + DeserializeOwned>(name: &str, settings: &T) -> Result<(), Self> {
        let table = toml::Table::try_from(settings).map_err(|fault| Self::new(name, "settings", fault, "a table"))?;
        Self::without_faults(Self::from_table::<T>(name, table)?).map(drop)
    }
}

/// Step from a table or list to a value in it.
#[derive(Debug, Clone, PartialEq)]
enum Step {
    Key(String),
    Index(usize),
}

/// Fault at a place of a document.
#[derive(Debug)]
struct Fault {
    /// Path to the place, from the inside out while it is handed up, then from the outside in.
    path: Vec<Step>,
    found: String,
    expected: String,
    kind: FaultKind,
}

/// Kind of a fault in the value at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
enum FaultKind {
    /// A number out of its range.
    Range,
    /// A value of another kind, or a list of another length.
    Kind,
    /// Any other fault.
    Other,
}

impl Fault {
    fn new(found: impl Into<String>, expected: impl Display, kind: FaultKind) -> Self {
        Self { path: Vec::new(), found: found.into(), expected: expected.to_string(), kind }
    }

    fn within(mut self, step: Step) -> Self {
        self.path.push(step);
        self
    }

    /// Turns the path around, leads it to the value that is meant where the reader knew only its table, and
    /// says what stands there. Returns what could stand there instead.
    fn complete(&mut self, root: &Value) -> Option<Value> {
        self.path.reverse();
        let mut value = self.path.iter().try_fold(root, step);
        if self.kind != FaultKind::Other
            && let Some(table @ Value::Table(_)) = value
            && let Some((path, meant)) = leaf(table, &self.found)
        {
            self.path.extend(path);
            value = Some(meant);
        }
        let stands_there = value.filter(|_| self.kind != FaultKind::Other || self.found.is_empty());
        if let Some(value) = stands_there {
            self.found = said(value);
        }
        let is_integer = value.is_some_and(Value::is_integer);
        // A range begins with its least number.
        let least = self.expected.split(' ').next()?.parse::<f64>().ok().filter(|_| self.kind == FaultKind::Range)?;
        Some(if is_integer && least.fract() == 0.0 { Value::Integer(least as i64) } else { Value::Float(least) })
    }

    fn field(&self) -> String {
        let mut field = String::new();
        for step in &self.path {
            match step {
                Step::Key(key) if field.is_empty() => field.push_str(key),
                Step::Key(key) => field.extend([".", key]),
                Step::Index(index) => field.push_str(&format!("[{index}]")),
            }
        }
        if field.is_empty() { "the file".to_owned() } else { field }
    }
}

fn step<'a>(value: &'a Value, step: &Step) -> Option<&'a Value> {
    match step {
        Step::Key(key) => value.get(key),
        Step::Index(index) => value.get(index),
    }
}

fn at<'a>(value: &'a mut Value, path: &[Step]) -> Option<&'a mut Value> {
    path.iter().try_fold(value, |value, step| match step {
        Step::Key(key) => value.get_mut(key),
        Step::Index(index) => value.get_mut(index),
    })
}

/// The first value within a table that an error calls `found`.
fn leaf<'a>(value: &'a Value, found: &str) -> Option<(Vec<Step>, &'a Value)> {
    let below = |step: Step, value: &'a Value| {
        let (mut path, leaf) = leaf(value, found)?;
        path.insert(0, step);
        Some((path, leaf))
    };
    let own = match value {
        Value::Table(table) => return table.iter().find_map(|(key, value)| below(Step::Key(key.clone()), value)),
        Value::Array(list) => {
            let inner = list.iter().enumerate().find_map(|(i, value)| below(Step::Index(i), value));
            if inner.is_some() {
                return inner;
            }
            format!("{} values", list.len()) == found || found == "a list" || found == said(value)
        }
        Value::Integer(number) => number.to_string() == found || (*number as f64).to_string() == found,
        Value::Float(number) => number.to_string() == found,
        Value::String(text) => format!("\"{text}\"") == found,
        Value::Boolean(is) => is.to_string() == found,
        Value::Datetime(_) => false,
    };
    own.then(|| (Vec::new(), value))
}

/// A value as an error repeats it.
fn said(value: &Value) -> String {
    match value {
        Value::Table(_) => "a table".to_owned(),
        Value::Float(number) => format!("{number:?}").trim_end_matches(".0").to_lowercase(),
        Value::Array(list) => {
            let said: Vec<String> = list.iter().take(MOST_LETTERS).map(said).collect();
            brief(&format!("[{}]", said.join(", ")))
        }
        value => brief(&value.to_string()),
    }
}

fn brief(text: &str) -> String {
    let mut letters = text.chars();
    let start: String = letters.by_ref().take(MOST_LETTERS).collect();
    if letters.next().is_some() { start + "…" } else { start }
}

/// Value that serde expected, in the words of a person who writes a file.
fn in_words(expected: &dyn Expected) -> String {
    let text = expected.to_string();
    if let Some(length) = text.strip_prefix("an array of length ").or(text.strip_suffix(" elements in sequence")) {
        return format!("a list of {length}");
    }
    if let Some(length) = text.strip_prefix("a tuple of size ") {
        return format!("a list of {length}");
    }
    let said = match text.split(' ').next().unwrap_or_default() {
        "f64" | "f32" => "a number",
        "u64" | "u32" | "usize" | "i64" | "i32" => "a whole number",
        "struct" | "map" => "a table",
        _ => match &*text {
            "a boolean" => "true or false",
            "a string" => "text in quotes",
            "a sequence" => "a list",
            "newtype variant" | "struct variant" => "a table with it and what belongs to it",
            "unit" => "its name alone, in quotes",
            kind => kind,
        },
    };
    said.to_owned()
}

impl Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "found {}, expected {}", self.found, self.expected)
    }
}

impl std::error::Error for Fault {}

impl Error for Fault {
    fn custom<T: Display>(message: T) -> Self {
        Self::new("", message, FaultKind::Other)
    }

    fn invalid_type(found: Unexpected, expected: &dyn Expected) -> Self {
        let found = match found {
            Unexpected::Str(text) => format!("\"{text}\""),
            Unexpected::Unsigned(number) => number.to_string(),
            Unexpected::Signed(number) => number.to_string(),
            Unexpected::Float(number) => number.to_string(),
            Unexpected::Bool(is) => is.to_string(),
            Unexpected::Seq => "a list".to_owned(),
            Unexpected::Map => "a table".to_owned(),
            other => other.to_string(),
        };
        Self::new(found, in_words(expected), FaultKind::Kind)
    }

    fn invalid_value(found: Unexpected, expected: &dyn Expected) -> Self {
        let fault = Self::invalid_type(found, expected);
        Self { kind: FaultKind::Range, ..fault }
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        Self::new(format!("{length} values"), in_words(expected), FaultKind::Kind)
    }

    fn unknown_variant(variant: &str, expected: &'static [&'static str]) -> Self {
        Self::new(format!("`{}`", brief(variant)), one_of(expected), FaultKind::Other)
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        Self::new(InputError::UNKNOWN_FIELD, one_of(expected), FaultKind::Other).within(Step::Key(brief(field)))
    }

    fn missing_field(field: &'static str) -> Self {
        Self::new("nothing", "a value: the field has no default", FaultKind::Other).within(Step::Key(field.to_owned()))
    }

    fn duplicate_field(field: &'static str) -> Self {
        Self::new("the field twice", "it once", FaultKind::Other).within(Step::Key(field.to_owned()))
    }
}

fn one_of(names: &[&str]) -> String {
    match names {
        [] => "nothing".to_owned(),
        [one] => format!("`{one}`"),
        names => format!("one of {}", names.iter().map(|it| format!("`{it}`")).collect::<Vec<_>>().join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only whether they can be read matters")]
    struct File {
        #[serde(default)]
        arena: Arena,
        #[serde(default)]
        seed: u64,
        motion: Option<Motion>,
        #[serde(default)]
        turns: Vec<(Axis, f64)>,
    }

    #[quantity::checked(default, deny_unknown_fields)]
    #[derive(Debug, Default, serde::Deserialize)]
    struct Arena {
        rate_hz: quantity::rate_hz,
        drag: bool,
    }

    #[quantity::checked(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
    #[derive(Debug, serde::Deserialize)]
    #[expect(dead_code, reason = "only whether they can be read matters")]
    enum Motion {
        Fixed { position_m: quantity::place_m<[f64; 3]> },
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Axis {
        X,
    }

    #[test]
    fn every_fault_names_its_field() {
        for (text, expected) in [
            ("[arena]\nrate_hz = \"100\"", "arena.rate_hz: found \"100\", expected a number"),
            ("seed = 1.5", "seed: found 1.5, expected a whole number"),
            ("seed = 99_999_999_999_999_999_999", "seed: found 1e20, expected a whole number"),
            ("arena = { rate_hz = -9223372036854775809 }", "arena.rate_hz: found -9.223372036854776e18, expected 1 to"),
            ("arena = { rate_hz = 1.0, drag = 1 }", "arena.drag: found 1, expected true or false"),
            ("arena = 3", "arena: found 3, expected a table"),
            ("arena = []", "arena: found [], expected a table"),
            ("arena = { rate_hz = -inf }", "arena.rate_hz: found -inf, expected a finite number"),
            ("arena = { rate_hz = 1e9 }", "arena.rate_hz: found 1000000000, expected 1 to 10000 Hz"),
            ("arena = { rates_hz = 1 }", "arena.rates_hz: found an unknown field, expected one of `rate_hz`, `drag`"),
            ("seed = ", "line 1: found `seed =`, expected valid TOML"),
            ("motion = { kind = \"fixed\" }", "motion.position_m: found nothing, expected a value"),
            ("motion = { kind = \"sent\" }", "motion.kind: found `sent`, expected `fixed`"),
            (
                "motion = { kind = \"fixed\", position_m = [0, 900, 0] }",
                "motion.position_m[1]: found 900, expected -50 to 50 m",
            ),
            (
                "motion = { kind = \"fixed\", position_m = [0, 0, 0, 7] }",
                "motion.position_m: found [0, 0, 0, 7], expected a list of 3",
            ),
            (
                "motion = { kind = \"fixed\", position_m = [0, nan, 0] }",
                "motion.position_m[1]: found nan, expected a finite",
            ),
            ("turns = [[\"x\", 1, 2]]", "turns[0]: found [\"x\", 1, 2], expected a list of 2"),
            ("turns = [[\"w\", 1]]", "turns[0][0]: found `w`, expected `x`"),
        ] {
            let fault = InputError::parse_toml::<File>("f.toml", text).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("f.toml: {expected}")), "{text}: {fault}");
        }
    }

    #[test]
    fn all_numbers_out_of_range_are_told() {
        let text = "arena = { rate_hz = 0 }\nmotion = { kind = \"fixed\", position_m = [60, 70, 0.5] }";
        let (_, faults) = InputError::parse_toml_all::<File>("f.toml", text).unwrap();
        let fields: Vec<&str> = faults.iter().map(|it| it.field.as_str()).collect();
        assert_eq!(fields, ["arena.rate_hz", "motion.position_m[0]", "motion.position_m[1]"]);
    }
}
