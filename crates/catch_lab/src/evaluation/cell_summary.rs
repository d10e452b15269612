//! Summary of the trials of one object and one throw.

use std::collections::BTreeMap;

use catch_body::statistics::{median, wilson95};
use serde::Serialize;

use crate::referee::{Row, reason::Reason};

/// All trials of one object and one throw.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CellSummary {
    /// Name of the object.
    pub object: String,
    /// Name of the throw.
    pub throw: String,
    /// Number of trials.
    pub trials: usize,
    /// True if every trial repeats the same throw, so that the trials are no sample.
    pub throw_is_fixed: bool,
    /// Number of catches.
    pub caught: usize,
    /// Number of catches by the paper's measure.
    pub caught_paper: usize,
    /// Number of catches by the measure of the authors' code.
    pub caught_paper_code: usize,
    /// Number of trials with the object squeezed 0.4 s after the instant of the paper's measure.
    pub held_later: usize,
    /// Number of catches if broken limits of the arm are ignored.
    pub caught_beyond_limits: usize,
    /// Number of misses that the arm could not have reached in time, had the flight been given from the first
    /// image on, according to the oracle. None where some of these were for an arm that the oracle does not
    /// know.
    pub out_of_reach: Option<usize>,
    /// Interval for the probability of a catch; none for a throw that is always the same, whose outcomes
    /// repeat.
    pub wilson95: Option<[f64; 2]>,
    /// Number of misses for each reason.
    pub reasons: BTreeMap<Reason, usize>,
    /// Limits of the arm that commands broke, over all trials.
    pub limit_violations: usize,
    /// Programs and factorizations of the brain that failed though nothing was infeasible, over all trials.
    pub numerical_failures: u64,
    /// Limits that the motion exceeded, as at impacts.
    pub motion_excursions: usize,
    /// Median over trials of the joint travel from the ready pose to the catch, summed over the joints.
    pub median_joint_travel_rad: Option<f64>,
}

impl CellSummary {
    /// Sums up the trials of one cell; `throw_is_fixed` if they all saw the same throw.
    pub fn of(object: &str, throw: &str, rows: &[&Row], throw_is_fixed: bool) -> Self {
        let count = |counts: &dyn Fn(&Row) -> bool| rows.iter().filter(|row| counts(row)).count();
        let mut reasons = BTreeMap::new();
        for reason in rows.iter().filter_map(|row| row.verdict.reason) {
            *reasons.entry(reason).or_insert(0) += 1;
        }
        let caught = count(&|row| row.verdict.caught);
        let joint_travels_rad = rows.iter().filter_map(|row| row.verdict.measures.joint_travel_rad);
        let is_known = rows.iter().all(|row| row.verdict.caught || row.verdict.reach.is_some());
        Self {
            object: object.to_owned(),
            throw: throw.to_owned(),
            trials: rows.len(),
            throw_is_fixed,
            caught,
            caught_paper: count(&|row| row.verdict.caught_paper),
            caught_paper_code: count(&|row| row.verdict.caught_paper_code),
            held_later: count(&|row| row.verdict.held_later),
            caught_beyond_limits: count(&|row| row.verdict.caught_beyond_limits),
            out_of_reach: is_known.then(|| count(&|row| row.verdict.is_out_of_reach())),
            wilson95: (!throw_is_fixed).then(|| wilson95(caught, rows.len())),
            reasons,
            limit_violations: rows.iter().map(|row| row.verdict.limit_violations).sum(),
            numerical_failures: rows.iter().map(|row| u64::from(row.verdict.measures.numerical_failures)).sum(),
            motion_excursions: rows.iter().map(|row| row.verdict.motion_excursions).sum(),
            median_joint_travel_rad: median(joint_travels_rad.collect()),
        }
    }
}
