//! Reliability diagrams: how many positions lie in the ellipsoids that predictions claim, by time to go.

use anyhow::Result;
use catch_bot::trajectory_prediction::FlightTrajectory;
use catch_cell::{Brain, Cell, Command};
use catch_lab::{
    assets::Kind,
    flights::flight_misses::{Miss, Misses, QUANTILES, Reliability, with_all},
    parallel,
    referee::true_com_O,
    scenario::setup::Setup,
};

use crate::{
    Options, rates,
    results::{Entry, Table},
};

/// Time after the release for which positions are predicted, in seconds: shortly before objects are caught.
const PREDICTED_FOR_S: f64 = 0.6;
/// Times from the prediction to that instant, in seconds.
const TO_GO_S: [f64; 4] = [0.4, 0.3, 0.2, 0.1];

/// The scenarios that have noisy cameras.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    let mut tables = Vec::new();
    for scenario in ["honest", "honest-aero"] {
        let mut of_objects = Vec::new();
        for object in Kind::Object.names() {
            let setup = rates::setup(scenario, object)?;
            setup.prepare();
            let throws =
                parallel::map(usize::try_from(options.trials)?, |index| simulated(&setup, options.seed, index as u64));
            let misses = std::array::from_fn(|at| throws.iter().flatten().map(|it| it[at]).collect());
            of_objects.push(misses);
        }
        let of_objects = with_all(Kind::Object.names().into_iter().map(str::to_owned), of_objects);
        tables.push(table(&format!("Simulated, `{scenario}`"), &TO_GO_S.map(|it| format!("{it} s to go")), of_objects));
    }
    Ok(tables)
}

/// The misses of one throw by time to go; `None` where something touched the object.
fn simulated(setup: &Setup, seed: u64, index: u64) -> Option<[Option<Miss>; 4]> {
    let (mut arena, mut brain) = (setup.arena(seed, index), setup.brain(seed, index));
    let mut flights: [Option<FlightTrajectory>; 4] = Default::default();
    loop {
        let Ok(observation) = arena.sense();
        if observation.time_s > PREDICTED_FOR_S - 0.005 {
            break;
        }
        // The arm stands still: the cameras alone are told where to look.
        let command = Command { windows: brain.tick(&observation, &mut ()).windows, ..Command::default() };
        for (flight, to_go_s) in flights.iter_mut().zip(TO_GO_S) {
            if observation.time_s < PREDICTED_FOR_S - to_go_s + 0.005 {
                flight.clone_from(&brain.report().flight);
            }
        }
        let Ok(()) = arena.act(&command);
    }
    let (truth, com_O) = (arena.truth(), true_com_O(setup));
    let then = truth.samples.last().filter(|_| truth.samples.iter().all(|it| !it.contact.any()))?;
    Some(flights.map(|flight| {
        let flight = flight?;
        let error = then.X_WO.translation.vector - (flight.pose_at(then.time_s) * com_O).coords;
        let covariance = flight.covariance_at(then.time_s).fixed_view::<3, 3>(0, 0).into_owned();
        Some(Miss { error, covariance })
    }))
}

/// A line for each object, with a cell for each time.
fn table(title: &str, times: &[String; 4], of_objects: Vec<(String, Misses)>) -> Table {
    let claimed = QUANTILES.map(|(claimed, _)| format!("{:.0}", 100.0 * claimed)).join("/");
    let columns = ["object", "predicted", "throws", "without", "error, cm", &format!("in {claimed} %")];
    let mut table = Table::new(title, &columns).across("predicted");
    for (object, misses) in of_objects {
        for (time, misses) in times.iter().zip(&misses) {
            let Reliability { throws, failed, median_m, p95_m, covered } = Reliability::of(misses);
            let errors = [median_m, p95_m].into_iter().filter(|it| it.is_finite()).map(|it| 100.0 * it).collect();
            let covered = covered.map(|it| format!("{:.1}", 100.0 * it)).join("/");
            let counts = [throws, failed].map(Entry::Count);
            let labels = [&object, time].map(Entry::text);
            table.rows.push([&labels[..], &counts, &[Entry::Spread(errors), Entry::Text(covered)]].concat());
        }
    }
    table
}
