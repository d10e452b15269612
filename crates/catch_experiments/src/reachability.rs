//! How many throws the oracle calls within reach.

use anyhow::Result;
use catch_lab::{
    assets::Kind,
    reachability::oracle::{Oracle, Reach},
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options, parallel,
    results::{Entry, Table},
    spread::percent,
};

const LEGEND: &str = "The oracle knows the true flight, and neither the object's shape nor how fast the fingers are. *From the first \
image*: for an arm that begins to move 60 ms after it; *from the release*: for one that begins at once.";

/// Random throws in the waiting pose of each scenario.
pub fn run(options: &Options) -> Result<Findings> {
    let columns = ["scenario", "throws", "from the first image, %", "from the release, %"];
    let mut table = Table::new("Random throws within reach", &columns);
    for scenario in Kind::Scenario.names() {
        let choice = Choice { scenario: Some(scenario), throw: Some("random"), ..Choice::default() };
        let setup = Setup::load(&choice)?;
        let oracle = Oracle::of(&setup);
        let count = options.trials as usize;
        let reaches = parallel::map(count, |index| oracle.reach(&setup, options.seed, index as u64));
        let within = |of: fn(&Reach) -> bool| percent(reaches.iter().filter(|reach| of(reach)).count(), count);
        table.rows.push(vec![
            Entry::text(scenario),
            Entry::Count(count),
            within(|it| it.from_first_image_s.is_some()),
            within(|it| it.from_release_s.is_some()),
        ]);
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}
