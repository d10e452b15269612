//! Numbers that may be drawn at random.

use catch_body::quantity::{Numbers, Quantity};
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

impl Default for Drawn {
    fn default() -> Self {
        Self::Always(0.0)
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

    /// The number that `unit`, from 0 to 1, stands for.
    pub(crate) fn at(self, unit: f64) -> f64 {
        let [least, most] = self.bounds();
        least + (most - least) * unit
    }
}

impl<'de> Numbers<'de> for Drawn {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let value = Self::deserialize(from)?;
        let ends @ [least, most] = value.bounds();
        match ends.into_iter().find(|it| !range.contains(*it)) {
            Some(found) => Err(D::Error::invalid_value(Unexpected::Float(found), &range)),
            None if least > most => {
                let expected = format!("{most} or less: not above the max");
                Err(D::Error::invalid_value(Unexpected::Float(least), &expected.as_str()))
            }
            None => Ok(value),
        }
    }
}

/// A range of numbers, the lower end first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span(pub [f64; 2]);

impl Span {
    /// The range times a factor above zero.
    pub(crate) fn scaled(self, by: f64) -> Self {
        Self(self.0.map(|end| end * by))
    }
}

impl<'de> Numbers<'de> for Span {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let ends @ [low, high] = <[f64; 2]>::within(range, from)?;
        if low <= high {
            return Ok(Self(ends));
        }
        let found = format!("[{low}, {high}]");
        Err(D::Error::invalid_value(Unexpected::Other(&found), &"a range, its lower end first"))
    }
}
