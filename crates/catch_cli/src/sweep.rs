//! `catchingbot eval --sweep distance,speed`: the catch rate over distance and speed, for both methods.

use anyhow::Context;
use catch_body::InputError;
use catch_lab::scenario::brain::Method;
use catch_lab::{
    VERSION,
    assets::COMMAND_LINE,
    evaluation::{
        Cell, Evaluation,
        results::Results,
        statistics::{CellSummary, median},
    },
    export::plots,
    scenario::setup::Setup,
    sweep::{self, DISTANCES_M, SPEEDS_MPS},
};
use serde::Serialize;

use super::eval::{EvalArguments, threads};
use crate::screen::{self, FAINT, STRONG};

/// The JSON document.
#[derive(Serialize)]
struct Document {
    version: &'static str,
    seed: u64,
    first: u64,
    distances_m: [f64; 7],
    speeds_mps: [f64; 7],
    methods: Vec<Grid>,
}

/// What one method made of the grid.
#[derive(Serialize)]
struct Grid {
    method: Method,
    /// Row by row of the distances, one entry per speed; `None` where a throw at that speed does not get there.
    cells: Vec<Vec<Option<Field>>>,
}

/// One distance and speed.
#[derive(Serialize)]
struct Field {
    #[serde(flatten)]
    summary: CellSummary,
    /// How far the object would have been from where the plan wants it in the gripper, in the middle.
    median_grasp_offset_m: Option<f64>,
}

/// Runs the grid for every method that was asked for.
///
/// # Errors
/// Faults in the arguments and files; results that cannot be written.
pub fn run(arguments: &EvalArguments) -> anyhow::Result<()> {
    let methods = arguments.choice.method().map_or(vec![Method::Ours, Method::Paper], |method| vec![method]);
    let mut document = Document {
        version: VERSION,
        seed: arguments.seed,
        first: arguments.first,
        distances_m: DISTANCES_M,
        speeds_mps: SPEEDS_MPS,
        methods: Vec::new(),
    };
    for method in methods {
        let grid = of_method(arguments, method)?;
        if !arguments.json {
            print(&grid, arguments)?;
        }
        if arguments.plots {
            let path = arguments.out.join(method.to_string()).join("sweep.svg");
            let rate = |row: usize, column: usize| {
                let field = grid.cells[row][column].as_ref()?;
                Some(field.summary.caught as f64 / field.summary.trials.max(1) as f64)
            };
            plots::heat_map(&path, &DISTANCES_M, &SPEEDS_MPS, &rate)
                .map_err(|fault| anyhow::anyhow!("{fault}"))
                .with_context(|| format!("{}", path.display()))?;
        }
        document.methods.push(grid);
    }
    if arguments.json {
        screen::json(&document)?;
    }
    Ok(())
}

fn of_method(arguments: &EvalArguments, method: Method) -> anyhow::Result<Grid> {
    let one = |names: &[String], field: &str| match names {
        [] => Ok(None),
        [name] => Ok(Some(name.clone())),
        more => Err(InputError::new(COMMAND_LINE, field, format!("{} of them", more.len()), "one at most in a sweep")),
    };
    let (object, throw) = (one(&arguments.object, "--object")?, one(&arguments.throw, "--throw")?);
    let choice = arguments.choice.with(object.as_deref(), throw.as_deref());
    let setup = Setup::load(&catch_lab::scenario::setup::Choice { method: Some(method), ..choice })?;
    let grid = DISTANCES_M.iter().flat_map(|&distance_m| SPEEDS_MPS.map(|speed_mps| (distance_m, speed_mps)));
    let thrown = |(distance_m, speed_mps)| {
        let throw = sweep::throw(&setup, distance_m, speed_mps)?;
        Some(Cell::new(setup.with_throw(sweep::name(distance_m, speed_mps), throw)))
    };
    let cells: Vec<Cell> = grid.filter_map(thrown).collect();
    if cells.is_empty() {
        let expected = "one that passes the arm within two seconds";
        return Err(InputError::new(COMMAND_LINE, "--throw", setup.scenario.throw, expected).into());
    }
    let evaluation = Evaluation { cells, seed: arguments.seed, first: arguments.first, trials: arguments.trials };
    let out = arguments.out.join(method.to_string());
    let (mut results, mut rows) = Results::open(&out, &evaluation, arguments.resume)?;
    let bar = screen::progress_bar(evaluation.len(), "trials");
    bar.set_position(rows.len() as u64);
    evaluation.run(rows.len(), threads(arguments), &mut |row, _| {
        results.add(&row)?;
        bar.inc(1);
        rows.push(row);
        Ok(())
    })?;
    bar.finish_and_clear();
    results.finish(&rows)?;

    let mut summaries = evaluation.identity().summarize(&rows);
    let mut field = |distance_m: f64, speed_mps: f64| {
        let name = sweep::name(distance_m, speed_mps);
        let at = summaries.iter().position(|it| it.throw == name)?;
        let offsets = rows.iter().filter(|row| row.scene.throw == name);
        let offsets = offsets.filter_map(|row| row.verdict.measures.grasp_offset_m).collect();
        Some(Field { summary: summaries.swap_remove(at), median_grasp_offset_m: median(offsets) })
    };
    let cells = DISTANCES_M.iter().map(|&distance| SPEEDS_MPS.iter().map(|&speed| field(distance, speed)).collect());
    Ok(Grid { method, cells: cells.collect() })
}

fn print(grid: &Grid, arguments: &EvalArguments) -> std::io::Result<()> {
    screen::line("")?;
    let trials = arguments.trials;
    let name = grid.method;
    screen::line(&format!(
        "  {STRONG}{name}{STRONG:#}: caught of {trials}, and how far off the object was in the hand"
    ))?;
    let speeds: Vec<String> = SPEEDS_MPS.iter().map(|speed| format!("{:>14}", format!("{speed} m/s"))).collect();
    screen::line(&format!("  {:>8}{}", "", speeds.concat()))?;
    for (distance, row) in DISTANCES_M.iter().zip(&grid.cells) {
        let field = |field: &Option<Field>| match field {
            None => format!("{:>14}", "–"),
            Some(Field { summary, median_grasp_offset_m }) => {
                let off = median_grasp_offset_m.map_or("–".to_owned(), |it| format!("{:.0} mm", it * 1e3));
                format!("{:>14}", format!("{} · {off}", summary.caught))
            }
        };
        let fields: Vec<String> = row.iter().map(field).collect();
        screen::line(&format!("  {:>8}{}", format!("{distance} m"), fields.concat()))?;
    }
    screen::line(&format!("  {FAINT}–: a throw at this speed does not get there{FAINT:#}"))
}
