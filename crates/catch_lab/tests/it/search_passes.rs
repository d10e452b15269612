//! A search in bounded passes: what it misses.

#![allow(clippy::print_stdout, reason = "figures for the docs, shown by --nocapture")]

use catch_bot::trajectory_optimization::{PlanningFailure, search::PASSES};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::planning::{Desk, OBJECTS, random_flight};

/// A fifth of the usual distance between catch times.
const FINER_S: f64 = 0.004;

/// Throws that a search on a grid five times finer catches and the passes of a search, one after the other,
/// do not.
fn lost(throws: usize) -> (usize, usize, Vec<(usize, PlanningFailure)>) {
    let (mut caught, mut caught_finer, mut lost) = (0, 0, Vec::new());
    for (o, object) in OBJECTS.iter().enumerate() {
        let desk = Desk::new(object, |_| {});
        let mut finer = Desk::new(object, |_| {});
        finer.search.time_step_s = FINER_S;
        let mut rng = Pcg64::seed_from_u64(o as u64);
        for i in (o..throws).step_by(OBJECTS.len()) {
            let flight = random_flight(&mut rng);
            let (mut pass, mut found) = (0, None);
            while pass < PASSES && !matches!(found, Some(Ok(_))) {
                found = Some(desk.search_in_passes(&mut pass, &desk.waiting(), &flight));
            }
            let found_finer = finer.search(&finer.waiting(), &flight);
            caught += usize::from(matches!(found, Some(Ok(_))));
            caught_finer += usize::from(found_finer.is_ok());
            if let (Some(Err(refusal)), Ok(_)) = (found, found_finer) {
                lost.push((i, refusal));
            }
        }
    }
    (caught, caught_finer, lost)
}

#[test]
fn a_finer_grid_finds_no_catch_that_was_missed() {
    let (caught, _, lost) = lost(90);
    assert!(caught > 30, "the throws are too hard to tell: {caught} caught");
    assert!(lost.is_empty(), "{lost:?}");
}

/// The whole of it:
/// `cargo test --release --workspace --test it search_passes::a_thousand -- --ignored --nocapture`.
#[test]
#[ignore = "takes a minute"]
fn a_thousand_throws_lose_nothing() {
    let (caught, caught_finer, lost) = lost(1000);
    println!("{caught} of 1000 caught, {caught_finer} on the finer grid, lost: {lost:?}");
    assert!(lost.is_empty());
}
