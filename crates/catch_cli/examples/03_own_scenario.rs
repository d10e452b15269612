//! A changed scenario, and how often it still catches: `cargo run --release --example 03_own_scenario`.
//!
//! On the command line: `catchingbot new scenario slippery`, change the file,
//! `catchingbot eval --scenario slippery.toml`.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use catch_lab::{
    evaluation::{Cell, Evaluation},
    scenario::setup::{Choice, Setup},
};
use catch_sim::config::Drawn;

fn main() -> anyhow::Result<()> {
    for friction in [0.667, 0.3] {
        let mut setup = Setup::load(&Choice { throw: Some("near_sampled"), ..Choice::default() })?;
        setup.scenario.arena.friction = Drawn::Always(friction);
        let evaluation = Evaluation { cells: vec![Cell::new(setup)], seed: 1, first: 0, trials: 4 };

        let mut rows = Vec::new();
        evaluation.run(0, 2, &mut |row, _| {
            rows.push(row);
            Ok(())
        })?;
        for cell in evaluation.identity().summarize(&rows) {
            println!("friction {friction}: {} of {} caught, {:?}", cell.caught, cell.trials, cell.reasons);
        }
    }
    Ok(())
}
