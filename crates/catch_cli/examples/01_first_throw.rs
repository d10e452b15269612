//! One throw, its story as it happens, and its page: `cargo run --release --example 01_first_throw`.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use std::path::Path;

use catch_lab::{
    recording::recorded_throw::record,
    scenario::setup::{Choice, Setup},
};
use catch_view::{pages::catch_page, playback::Playback};

fn main() -> anyhow::Result<()> {
    // Nothing chosen: the paper's scenario, its near throw, a tennis ball.
    let setup = Setup::load(&Choice::default())?;

    let folder = Path::new("target/examples-out");
    let thrown = record(&setup, 1, 0, folder, &mut |entry| {
        println!("{:>6.3} s  {:<16}  {}", entry.time_s, entry.event.label(), entry.detail);
        Ok(())
    })?;

    let page = thrown.recording.with_extension("html");
    std::fs::write(&page, catch_page::page(&Playback::read(&thrown.recording)?))?;
    println!("caught: {}; look at {}", thrown.verdict.caught, page.display());
    Ok(())
}
