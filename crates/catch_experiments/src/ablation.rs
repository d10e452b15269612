//! Cost of each assumption from the scenario `paper` down to `honest`: the built-in study as a table.

use anyhow::Result;
use catch_lab::{scenario::setup::Choice, study::Study};

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
};

const LEGEND: &str = "Each step takes one more assumption of the scenario `paper` away, down to `honest`; *only* takes away that one alone. \
All steps throw the same throws, where throws are random. The rate *caught* is of the throws within reach, with its interval (Wilson, 95 %).";

/// Every step and object.
pub fn run(options: &Options) -> Result<Findings> {
    let study = Study::load("ablation", ("catch_experiments", "NAME"))?;
    let columns: Vec<&str> = ["step", "change", "object"].into_iter().chain(FIGURES).collect();
    let mut caught = Table::new("Caught of the throws within reach", &columns);
    for step in &study.steps {
        for object in study.objects() {
            let cells = study.cells(step, &Choice::default(), std::slice::from_ref(&object))?;
            let setups = cells.into_iter().map(|cell| cell.setup).collect();
            let condition = [&step.head.name, &step.head.about, &object].map(Entry::text);
            caught.rows.push(condition.into_iter().chain(rates::figures(setups, options)?).collect());
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![caught] })
}
