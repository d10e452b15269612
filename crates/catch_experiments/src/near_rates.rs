//! What rigs of a few near cameras catch.

use std::collections::BTreeMap;

use anyhow::Result;
use catch_lab::{assets::Kind, statistics::wilson95};

use crate::{
    Findings, Options,
    near_rigs::{rigs, setup},
    rates,
    results::{Entry, Table},
    spread::percent,
};

const LEGEND: &str = "The scenario honest with random throws and one to four near stereo cameras that run freely, without labels. Each throw draws how \
far the cameras are from where they are believed to stand: 0.2 mm along and 0.2 mrad about each axis (standard deviations), which is no less than \
[calibration on the arm](calibration.md) leaves. The brain lets corrections use up to 0.97 of what each joint can still reach \
(`reach_fractions`), as in honest-aero. The rate *caught* is of all throws, also of those out of reach, with its interval (Wilson, 95 %).";

/// Every rig with every object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns =
        ["rig", "object", "throws", "caught, %", "from, %", "to, %", "out of reach, %", "limits broken", "misses"];
    let mut table = Table::new("Caught with near cameras", &columns);
    for rig in rigs() {
        for object in Kind::Object.names() {
            let rows = rates::rows(vec![setup(&rig, object, &[])?], options)?;
            let caught = rows.iter().filter(|row| row.verdict.caught).count();
            let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
            for reason in rows.iter().filter_map(|row| row.verdict.reason) {
                *reasons.entry(reason.to_string()).or_default() += 1;
            }
            let mut reasons: Vec<(String, usize)> = reasons.into_iter().collect();
            reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
            let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
            let [low, high] = wilson95(caught, rows.len());
            table.rows.push(vec![
                Entry::text(&rig),
                Entry::text(object),
                Entry::Count(rows.len()),
                percent(caught, rows.len()),
                Entry::Number(Some(100.0 * low)),
                Entry::Number(Some(100.0 * high)),
                percent(rows.iter().filter(|row| row.verdict.is_out_of_reach()).count(), rows.len()),
                Entry::Count(rows.iter().map(|row| row.verdict.limit_violations).sum()),
                Entry::text(reasons.join(", ")),
            ]);
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}
