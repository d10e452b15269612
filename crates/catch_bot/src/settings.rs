//! Which values settings may have. Each stage names the ranges of its own.

use std::{
    error::Error,
    fmt::{self, Display},
    ops::RangeInclusive,
};

/// No count of anything may be larger: a brain that takes minutes for an image catches nothing.
const MOST: f64 = 1e5;
/// Nor any other value.
const LARGEST: f64 = 1e9;
/// Any value that is not negative.
pub const NOT_NEGATIVE: RangeInclusive<f64> = 0.0..=LARGEST;
/// What must be above zero, such as the speed of the fingers.
pub const POSITIVE: RangeInclusive<f64> = 1e-3..=LARGEST;
/// Durations within a flight, in seconds.
pub const DURATION_S: RangeInclusive<f64> = 0.0..=10.0;
/// Periods and steps of time, in seconds.
pub const PERIOD_S: RangeInclusive<f64> = 1e-3..=1.0;
/// Masses of what is caught, in kg.
pub const OBJECT_MASS_KG: RangeInclusive<f64> = 1e-3..=5.0;
/// Fractions of anything.
pub const FRACTION: RangeInclusive<f64> = 0.0..=1.0;
/// Fractions of a limit, with nothing of which nothing works.
pub const LIMIT_SCALE: RangeInclusive<f64> = 0.01..=1.0;
/// Angles up to a turn, in radians.
pub const ANGLE_RAD: RangeInclusive<f64> = -7.0..=7.0;

/// A setting that is out of its range.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SettingError {
    /// Path of the field, such as `perception.gate_m`.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub expected: String,
}

impl Display for SettingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: found {}, expected {}", self.field, self.found, self.expected)
    }
}

impl Error for SettingError {}

/// Settings that know their ranges.
pub trait Settings {
    /// Every setting that is out of its range.
    fn faults(&self) -> Vec<SettingError>;

    /// Whether all settings are in their ranges.
    ///
    /// # Errors
    /// The first that is not.
    fn check(&self) -> Result<(), SettingError> {
        self.faults().into_iter().next().map_or(Ok(()), Err)
    }
}

/// Gathers what is out of its range.
#[derive(Debug, Default)]
pub struct Faults(Vec<SettingError>);

impl Faults {
    /// Numbers that share a range.
    pub fn values<'a>(mut self, range: &RangeInclusive<f64>, values: impl IntoIterator<Item = (&'a str, f64)>) -> Self {
        for (field, value) in values {
            self.add(range, field, value, format!("{value:?}").to_lowercase());
        }
        self
    }

    /// Numbers that need not be set.
    pub fn options<'a>(
        self,
        range: &RangeInclusive<f64>,
        values: impl IntoIterator<Item = (&'a str, Option<f64>)>,
    ) -> Self {
        self.values(range, values.into_iter().filter_map(|(field, value)| Some((field, value?))))
    }

    /// Lists of numbers that share a range.
    pub fn lists<'a>(
        mut self,
        range: &RangeInclusive<f64>,
        lists: impl IntoIterator<Item = (&'a str, &'a [f64])>,
    ) -> Self {
        for (field, list) in lists {
            for (i, &value) in list.iter().enumerate() {
                self.add(range, &format!("{field}[{i}]"), value, format!("{value:?}").to_lowercase());
            }
        }
        self
    }

    /// Numbers of anything, one at least.
    pub fn counts<'a>(self, counts: impl IntoIterator<Item = (&'a str, usize)>) -> Self {
        self.counts_from(1, counts)
    }

    /// Numbers of things, so many at least.
    pub fn counts_from<'a>(mut self, least: usize, counts: impl IntoIterator<Item = (&'a str, usize)>) -> Self {
        for (field, count) in counts {
            self.add(&(least as f64..=MOST), field, count as f64, count.to_string());
        }
        self
    }

    /// A number that another setting bounds.
    pub fn at_most<T: PartialOrd + fmt::Display>(
        mut self,
        (field, value): (&str, T),
        (bound, most): (&str, T),
    ) -> Self {
        if value > most {
            let (found, expected) = (value.to_string(), format!("at most `{bound}`, {most}"));
            self.0.push(SettingError { field: field.to_owned(), found, expected });
        }
        self
    }

    /// Settings of a part.
    pub fn table(mut self, field: &str, settings: &impl Settings) -> Self {
        let below = |fault: SettingError| SettingError { field: format!("{field}.{}", fault.field), ..fault };
        self.0.extend(settings.faults().into_iter().map(below));
        self
    }

    /// All that were found.
    pub fn all(self) -> Vec<SettingError> {
        self.0
    }

    fn add(&mut self, range: &RangeInclusive<f64>, field: &str, value: f64, found: String) {
        if range.contains(&value) {
            return;
        }
        let expected = match (*range.start(), *range.end()) {
            (0.0, LARGEST) => "zero or more".to_owned(),
            (low, LARGEST) => format!("{low} or more"),
            (low, high) => format!("{low} to {high}"),
        };
        self.0.push(SettingError { field: field.to_owned(), found, expected });
    }
}
