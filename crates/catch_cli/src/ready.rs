//! `catchingbot ready`: the best waiting pose for a distribution of throws.

use catch_body::InputError;
use catch_lab::{reachability::ready::Corridor, scenario::setup::Setup};
use catch_recording::whole_file::COMMAND_LINE;
use clap::Args;
use serde_json::json;

use super::{ChoiceArguments, MOST, each_or_default, whole};
use crate::screen;

/// Finds the best waiting pose of an arm for a distribution of throws
///
/// What is printed is the line `ready_rad = [..]` for a scenario's file, or for the robot.toml of
/// an own robot. The search begins at the present pose and keeps it where it finds none that is
/// better. What the pose is worth is told by as many throws of the next seed, too.
///
/// Example:
///   catchingbot ready --scenario honest --object tennis_ball --object banana --trials 8 --tries 400
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ReadyArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object to catch; may be repeated [default: the scenario's]
    #[arg(long = "object", value_name = "NAME|FILE")]
    objects: Vec<String>,
    /// Throw to wait for; may be repeated [default: the scenario's]
    #[arg(long = "throw", value_name = "NAME|FILE")]
    throws: Vec<String>,
    /// Throws of each object and kind that the pose is chosen for
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole(1, 10_000))]
    trials: u64,
    /// Poses that are tried
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = whole(1, 10_000_000))]
    tries: u64,
    /// Seed of the throws and of the poses
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
}

/// Searches from the scenario's present pose and prints what it finds.
///
/// # Errors
/// Faults of the choice, or of writing the answer.
pub fn run(arguments: &ReadyArguments, json: bool) -> anyhow::Result<()> {
    let mut setups = Vec::new();
    for object in each_or_default(&arguments.objects) {
        for throw in each_or_default(&arguments.throws) {
            setups.push(Setup::load(&arguments.choice.with(object.as_deref(), throw.as_deref()))?);
        }
    }
    let corridor = Corridor::new(&setups, arguments.trials, arguments.seed);
    let dof = setups[0].robot.dof();
    let tries = arguments.tries as usize;
    let bar = screen::progress_bar(tries, "poses");
    let best = corridor.search(&setups[0].robot.ready_q, tries, arguments.seed, &mut |tried, best| {
        bar.set_position(tried as u64);
        bar.set_message(format!("{} of {} throws within reach, cost {:.3}", best.caught, best.throws, best.cost));
    });
    bar.finish_and_clear();
    let Some(best) = best else { anyhow::bail!("no pose was found in which the arm is clear of itself and the floor") };
    if best.caught == 0 {
        let found = format!("no pose in {tries} tries from which any of the {} throws is within reach", best.throws);
        let expected = "throws that pass within the arm's reach, or more --tries";
        return Err(InputError::new(COMMAND_LINE, "--throw", found, expected).into());
    }
    let corridor = Corridor::new(&setups, arguments.trials, arguments.seed.wrapping_add(1));
    let others = corridor.value(&best.q, f64::INFINITY).expect("the arm can stand where it was found to");
    let within_reach = corridor.within_reach(&best.q);
    let ready_rad = &best.q.as_slice()[..dof];
    if json {
        return screen::document(&json!({
            "scenario": setups[0].scenario,
            "ready_rad": ready_rad,
            "within_reach": best.caught,
            "throws": best.throws,
            "mean_cost": best.cost,
            "median_travel_rad": best.travel_rad,
            "other_throws": {
                "within_reach_by_oracle": within_reach,
                "within_reach": others.caught,
                "throws": others.throws,
            },
        }));
    }
    let numbers: Vec<String> = ready_rad.iter().map(|value| format!("{value:.3}")).collect();
    screen::line(&format!("ready_rad = [{}]", numbers.join(", ")))?;
    Ok(screen::line(&format!(
        "# {} of {} throws within reach; median over them of the largest joint's travel to the catch {:.2} rad\n\
         # of {} other throws {} are within reach by the oracle, and the planner catches {}",
        best.caught, best.throws, best.travel_rad, others.throws, within_reach, others.caught
    ))?)
}
