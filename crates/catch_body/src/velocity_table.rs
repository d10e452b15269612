//! Velocity limits of a joint that depend on its position.

use serde::Deserialize;

use crate::{InputError, quantity};

/// The velocity limits of a joint that depend on its position, linear between rows.
#[derive(Debug, Clone, PartialEq)]
pub struct VelocityTable {
    /// Positions in radians, increasing, with the lowest (negative) and the highest velocity there in rad/s;
    /// never empty.
    rows: Vec<[f64; 3]>,
}

impl VelocityTable {
    /// A table of `[position, lowest, highest]`; `None` if it has no row, if positions do not increase or if
    /// a row does not have a negative and a positive velocity.
    pub fn new(rows: Vec<[f64; 3]>) -> Option<Self> {
        let increases = rows.windows(2).all(|pair| pair[0][0] < pair[1][0]);
        let has_both_signs = |row: &[f64; 3]| row.iter().all(|it| it.is_finite()) && row[1] < 0.0 && row[2] > 0.0;
        (!rows.is_empty() && increases && rows.iter().all(has_both_signs)).then_some(Self { rows })
    }

    /// The lowest and the highest velocity at the position `q` in radians; beyond the table those of its
    /// ends.
    pub fn at(&self, q: f64) -> [f64; 2] {
        let after = self.rows.partition_point(|row| row[0] <= q).min(self.rows.len() - 1);
        let [[from, low, high], [to, next_low, next_high]] = [self.rows[after.saturating_sub(1)], self.rows[after]];
        let by = if to > from { ((q - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        [low + by * (next_low - low), high + by * (next_high - high)]
    }

    /// The table with its velocities multiplied.
    pub(crate) fn scaled(mut self, by: f64) -> Self {
        self.rows.iter_mut().flat_map(|row| &mut row[1..]).for_each(|it| *it *= by);
        self
    }
}

/// Limits of a joint's velocity by its position, linear between these; beyond them those of the first and the
/// last count.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
pub(crate) struct VelocityFields {
    /// Positions of the joint, increasing.
    position_rad: quantity::joint_position_rad<Vec<f64>>,
    /// Lowest velocity at each position, below 0.
    lowest_radps: quantity::signed_joint_velocity_radps<Vec<f64>>,
    /// Highest velocity at each position, above 0.
    highest_radps: quantity::signed_joint_velocity_radps<Vec<f64>>,
}

impl VelocityFields {
    /// The table of the field `field` in `file`.
    pub(crate) fn checked(&self, file: &str, field: &str) -> Result<VelocityTable, InputError> {
        let Self { position_rad, lowest_radps, highest_radps } = self;
        let lengths = [position_rad, lowest_radps, highest_radps].map(Vec::len);
        let rows = position_rad.iter().zip(lowest_radps).zip(highest_radps).map(|((q, low), high)| [*q, *low, *high]);
        let is_even = lengths.iter().all(|it| *it == lengths[0]);
        is_even.then(|| VelocityTable::new(rows.collect())).flatten().ok_or_else(|| {
            let found = format!("{position_rad:?}, {lowest_radps:?} and {highest_radps:?}");
            let expected = "three lists of one length: increasing positions, negative and positive velocities";
            InputError::new(file, field, found, expected)
        })
    }
}
