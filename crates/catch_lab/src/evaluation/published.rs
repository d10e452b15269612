//! The published rates that results are compared with.

use serde::Deserialize;

use super::cell_summary::CellSummary;

const PUBLISHED: &str = include_str!("published.toml");

/// A published rate of catching.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedRate {
    /// Name of the object.
    pub object: String,
    /// Name of the throw.
    pub throw: String,
    /// Share that was caught.
    pub caught: f64,
}

#[derive(Deserialize)]
struct Published {
    rate: Vec<PublishedRate>,
}

/// The published rates that this project compares itself with.
pub fn published_rates() -> Vec<PublishedRate> {
    toml::from_str::<Published>(PUBLISHED).map(|it| it.rate).unwrap_or_default()
}

/// The published rate for a cell: that of the throw, or of the fixed throw that a sampler or the published
/// orientation is of.
pub fn published_rate(rates: &[PublishedRate], cell: &CellSummary) -> Option<f64> {
    let throw = cell.throw.trim_start_matches("published_").trim_end_matches("_sampled");
    rates.iter().find(|rate| rate.object == cell.object && rate.throw == throw).map(|rate| rate.caught)
}
