//! Numbers that may be drawn at random.

use catch_body::{
    InputError,
    quantity::{self, Numbers, Quantity},
};
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{Error, Unexpected},
};

/// A number, or a range from which one is drawn uniformly: by every throw, where nothing else is said.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number or { min = …, max = … }")]
pub enum Drawn {
    /// Constant value.
    Always(f64),
    /// Drawn.
    Between(Between),
}

/// Bounds of what is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Between {
    /// The least.
    pub min: f64,
    /// The most.
    pub max: f64,
}

impl From<f64> for Drawn {
    fn from(value: f64) -> Self {
        Self::Always(value)
    }
}

impl Drawn {
    /// The least and the most.
    pub fn bounds(self) -> [f64; 2] {
        match self {
            Self::Always(value) => [value, value],
            Self::Between(Between { min, max }) => [min, max],
        }
    }

    /// Checks that this can be a friction coefficient.
    ///
    /// # Errors
    /// If it is out of the range of friction coefficients.
    pub fn check_friction(self, file: &str, field: &str) -> Result<(), InputError> {
        self.check(&quantity::FRICTION, file, field)
    }

    /// Checks that this is within a range.
    ///
    /// # Errors
    /// If a value is out of the range, or if the ends are swapped.
    pub fn check(self, range: &Quantity, file: &str, field: &str) -> Result<(), InputError> {
        let [least, most] = self.bounds();
        range.check(file, field, least)?;
        range.check(file, field, most)?;
        let expected = "a min that is not above the max";
        if least > most { Err(InputError::new(file, field, least, expected)) } else { Ok(()) }
    }

    /// The number that `unit`, from 0 to 1, stands for.
    pub(crate) fn at(self, unit: f64) -> f64 {
        let [least, most] = self.bounds();
        least + (most - least) * unit
    }
}

impl<'de> Numbers<'de> for Drawn {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let value = Self::deserialize(from)?;
        match value.bounds().into_iter().find(|it| !range.contains(*it)) {
            Some(found) => Err(D::Error::invalid_value(Unexpected::Float(found), &range)),
            None => Ok(value),
        }
    }
}
