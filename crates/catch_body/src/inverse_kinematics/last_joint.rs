//! The angle of the last joint of arms with a spherical shoulder, which is free: sampled, and searched where
//! a sample is nearly within the ranges of the other joints.

use std::f64::consts::{PI, TAU};

use super::{
    Ranges,
    spherical_shoulder::{ALL_BRANCHES, BRANCHES, SphericalShoulderArm},
};
use crate::{pose::Pose, robot::JointVector};

/// Angles of the last joint that are looked at in a part of its range, and the parts: the whole, or in a
/// thorough search quarters. Of each part and branch one posture is kept.
const LAST_JOINT_SAMPLES: usize = 10;
const THOROUGH_PARTS: usize = 4;
/// Distance by which samples may be out of a range, as a fraction of it, and still lead to a posture within;
/// number of intervals by which the search for that posture narrows.
const NEARLY: f64 = 0.25;
const NARROWINGS: usize = 1;
const GOLDEN_SECTION: f64 = 0.381_966;

impl SphericalShoulderArm {
    /// Joint positions within `ranges` that put the gripper at `X_WG`: of each branch those that leave the
    /// joints most room, of a `thorough` search in each of four parts of the last joint's range.
    pub fn solutions(&self, X_WG: &Pose, from: &JointVector, ranges: &Ranges, thorough: bool) -> Vec<JointVector> {
        let parts = if thorough { THOROUGH_PARTS } else { 1 };
        (0..parts).flat_map(|part| easiest(self, X_WG, from, ranges, (part, parts))).collect()
    }
}

/// For each branch, the posture that leaves the joints most room within `ranges`, the last joint being in one
/// of so many parts of its range: the best sample, or, where none is quite within but one between them may
/// be, the posture that a golden-section search finds there.
fn easiest(
    arm: &SphericalShoulderArm,
    X_WG: &Pose,
    from: &JointVector,
    ranges: &Ranges,
    (part, parts): (usize, usize),
) -> impl Iterator<Item = JointVector> {
    // An angle that is more than half a turn away is nearer the other way round, where that is within the
    // range.
    let [low, high] = match ranges[6] {
        [low, high] if high - low > TAU => {
            let low = (from[6] - PI).clamp(low, high - TAU);
            [low, low + TAU]
        }
        range => range,
    };
    let nearly = ranges.map(|[low, high]| [low - NEARLY * (high - low), high + NEARLY * (high - low)]);
    let each = |q7: f64, wanted: u8, found: &mut dyn FnMut(usize, Room)| {
        arm.for_each_solution((X_WG, q7), from, &nearly, wanted, |branch, q| {
            let used = |i: usize| ((2.0 * q[i] - ranges[i][0] - ranges[i][1]) / (ranges[i][1] - ranges[i][0])).abs();
            found(branch, Room { used: (0..6).map(used).fold(0.0, f64::max), q });
        });
    };
    let step = (high - low) / (parts * LAST_JOINT_SAMPLES) as f64;
    let mut best = [const { None::<Room> }; BRANCHES];
    let mut used = [[f64::INFINITY; LAST_JOINT_SAMPLES]; BRANCHES];
    for sample in (0..LAST_JOINT_SAMPLES).filter(|_| low <= high) {
        let q7 = low + step * ((part * LAST_JOINT_SAMPLES + sample) as f64 + 0.5);
        each(q7, ALL_BRANCHES, &mut |branch, room| {
            used[branch][sample] = room.used;
            room.improve(&mut best[branch]);
        });
    }
    for (branch, best) in best.iter_mut().enumerate() {
        let Some(Room { q, .. }) = best.filter(|it| it.used > 1.0 && may_be_within(&used[branch])) else { continue };
        let within = [q[6] - step, q[6] + step].map(|it| it.clamp(low, high));
        golden_section_search(within, |q7| {
            let mut used = f64::INFINITY;
            each(q7, 1 << branch, &mut |_, room| {
                used = room.used;
                room.improve(best);
            });
            used
        });
    }
    best.into_iter().flatten().filter(|room| room.used <= 1.0).map(|room| room.q)
}

/// Looks where a function is low between two ends, a few times.
fn golden_section_search([mut low, mut high]: [f64; 2], mut value_at: impl FnMut(f64) -> f64) {
    let mut inner = [low + GOLDEN_SECTION * (high - low), high - GOLDEN_SECTION * (high - low)];
    let mut values = inner.map(&mut value_at);
    for _ in 0..NARROWINGS {
        if values[0] < values[1] {
            high = inner[1];
            inner = [low + GOLDEN_SECTION * (high - low), inner[0]];
            values = [value_at(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], high - GOLDEN_SECTION * (high - low)];
            values = [values[1], value_at(inner[1])];
        }
    }
}

/// Returns whether a branch may use less than all of the ranges between two samples of what it uses, beside
/// the least one. The ranges used fall nowhere faster than they rise on the steeper side of that sample.
fn may_be_within(used: &[f64; LAST_JOINT_SAMPLES]) -> bool {
    let Some((at, least)) = used.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1)) else { return false };
    let beside = [at.checked_sub(1), Some(at + 1)].map(|i| i.and_then(|i| used.get(i)).copied());
    let rise = |it: Option<f64>| it.filter(|it| it.is_finite()).map(|it| it - least);
    let [Some(before), Some(after)] = beside.map(rise) else { return true };
    // There two lines of that slope would meet.
    let [lower, steeper] = [before.min(after), before.max(after)];
    least - (steeper - lower) / 2.0 <= 1.0
}

/// The largest fraction of their ranges that joint positions use, from the middle on.
#[derive(Clone, Copy)]
struct Room {
    used: f64,
    q: JointVector,
}

impl Room {
    fn improve(self, best: &mut Option<Self>) {
        if best.is_none_or(|it| self.used < it.used) {
            *best = Some(self);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Between samples of two lines with the same slope, the test for a place where they use less is
        /// exact.
        #[test]
        fn what_lies_between_samples_is_told_by_them(slope in 0.01f64..2.0, tip in 1.0f64..2.0, least in 0.5f64..1.5) {
            let used = std::array::from_fn(|sample| least + slope * (sample as f64 - tip).abs());
            prop_assert_eq!(may_be_within(&used), least <= 1.0 + 1e-12);
        }

        /// A search narrows to the lowest place as far as its steps allow.
        #[test]
        fn a_golden_section_search_comes_near_the_lowest_place(lowest in 0.0f64..1.0) {
            let mut nearest = f64::INFINITY;
            golden_section_search([0.0, 1.0], |x| {
                nearest = nearest.min((x - lowest).abs());
                (x - lowest).powi(2)
            });
            prop_assert!(nearest <= GOLDEN_SECTION * (1.0 - GOLDEN_SECTION) + 1e-5);
        }
    }
}
