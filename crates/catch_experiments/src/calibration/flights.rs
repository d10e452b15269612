//! Refinement by flights of a calibration on the arm.

use catch_body::Pose;
use catch_calibration::{
    Calibration,
    flights::{Flight, FlightStatus, refine},
};
use catch_lab::scenario::setup::{Setup, calibration::observe_flights};
use nalgebra::Point3;

use super::{Condition, Outcome, outcome};
use crate::{
    results::Entry,
    spread::{median, percent, spread},
};

/// Flights of each draw.
const FLIGHTS: usize = 20;
/// Draws that are refined: it takes longer than all else.
pub const DRAWS: u64 = 8;

/// One calibration before and after the flights.
pub struct Refined {
    before: Stage,
    after: Stage,
    is_refined: bool,
    sightings: usize,
    variance_factor: f64,
    tilt_deg: [f64; 2],
    tilt_sd_deg: f64,
}

/// Picks one of the two.
type StageOf = fn(&Refined) -> &Stage;

struct Stage {
    cameras: Vec<Outcome>,
    /// Distance between the positions at which two cameras see a point, for each pair.
    apart_m: Vec<f64>,
}

impl Stage {
    fn new(setup: &Setup, calibration: &Calibration) -> Self {
        let cameras =
            calibration.cameras.iter().zip(&setup.cameras).map(|(it, truth)| outcome(it, truth, 0.0)).collect();
        let p_W: Point3<f64> = setup.robot.gripper_pose(&setup.robot.ready_q).translation.vector.into();
        let seen = |(X_WC, X_WT): (&Pose, &Pose)| X_WC * X_WT.inverse_transform_point(&p_W);
        let poses = calibration.cameras.iter().map(|it| &it.X_WC).zip(setup.cameras.iter().map(|it| &it.X_WC));
        let seen: Vec<Point3<f64>> = poses.map(seen).collect();
        let pairs = (0..seen.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        Self { cameras, apart_m: pairs.map(|(i, j)| (seen[i] - seen[j]).norm()).collect() }
    }
}

/// Refines a calibration by flights in a scene whose clocks are off; they are `observed` once for all
/// conditions.
pub fn refined(
    setup: &Setup,
    (mut calibration, clocks): (Calibration, &[f64]),
    scene: (u64, u64),
    observed: &mut Option<Vec<Flight>>,
) -> Refined {
    // The arena's clocks are right: what remains of the offsets is the calibration's error.
    calibration.cameras.iter_mut().zip(clocks).for_each(|(camera, clock_s)| camera.time_offset_s -= clock_s);
    let flights = observed.get_or_insert_with(|| observe_flights(setup, &calibration, &setup.cameras, FLIGHTS, scene));
    let found = refine(&calibration, flights);
    Refined {
        before: Stage::new(setup, &calibration),
        after: Stage::new(setup, &found.calibration),
        is_refined: found.status == FlightStatus::Refined,
        sightings: found.sightings,
        variance_factor: found.variance_factor,
        tilt_deg: found.tilt_rad.map(f64::to_degrees),
        tilt_sd_deg: found.tilt_sd_rad[0].max(found.tilt_sd_rad[1]).to_degrees(),
    }
}

/// A row of what the arm told, and one of what flights made of it.
pub fn rows(condition: Condition, draws: &[&Refined]) -> Vec<Vec<(&'static str, Entry)>> {
    if draws.is_empty() {
        return Vec::new();
    }
    let stages: [(&str, StageOf); 2] = [("arm", |it| &it.before), ("arm and flights", |it| &it.after)];
    let row = |(name, stage): (&str, StageOf)| {
        let cameras: Vec<&Outcome> = draws.iter().flat_map(|it| &stage(it).cameras).collect();
        let values = |of: fn(&Outcome) -> f64| cameras.iter().map(|it| of(it)).collect::<Vec<f64>>();
        let of_draw = |of: fn(&Refined) -> f64| draws.iter().map(|it| of(it)).collect::<Vec<f64>>();
        let apart: Vec<f64> = draws.iter().flat_map(|it| &stage(it).apart_m).copied().collect();
        let tilts: Vec<f64> = draws.iter().flat_map(|it| it.tilt_deg).map(f64::abs).collect();
        vec![
            ("cameras", Entry::Count(condition.cameras)),
            ("condition", Entry::text(condition.about)),
            ("calibrated on", Entry::text(name)),
            ("draws", Entry::Count(draws.len())),
            ("refined, %", percent(draws.iter().filter(|it| it.is_refined).count(), draws.len())),
            ("position, mm", spread(&values(|it| it.position_m), 1e3)),
            ("rotation, °", spread(&values(|it| it.rotation_deg), 1.0)),
            ("time, ms", spread(&values(|it| it.time_s.abs()), 1e3)),
            ("apart, mm", spread(&apart, 1e3)),
            ("coverage, %", percent(cameras.iter().filter(|it| it.is_covered).count(), cameras.len())),
            ("claimed, mm", median(&values(|it| it.position_sd_m), 1e3)),
            ("claimed, °", median(&values(|it| it.rotation_sd_deg), 1.0)),
            ("sightings", median(&of_draw(|it| it.sightings as f64), 1.0)),
            ("variance factor", median(&of_draw(|it| it.variance_factor), 1.0)),
            ("tilt, °", median(&tilts, 1.0)),
            ("claimed, °", median(&of_draw(|it| it.tilt_sd_deg), 1.0)),
        ]
    };
    stages.map(row).into()
}
