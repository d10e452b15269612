//! Detection delay of near cameras for a thrown object, and false detections of a person who walks.

use anyhow::Result;
use catch_cell::{Brain, CameraModel, Cell};
use catch_lab::{
    assets::Kind,
    parallel,
    scenario::setup::{Setup, calibration::true_cameras},
};
use catch_sim::{Arena, Release, TruthSample};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::{
    Findings, Options,
    near_rates::{rigs, setup},
    results::{Entry, Table},
    spread::{percent, quantiles},
};

/// An object that is nearer to a camera than this, and wholly in its image, has entered its view.
const ENTERED_M: f64 = 3.0;
/// A pose that is farther off is none of the object.
const RIGHT_M: f64 = 0.15;
/// Time after which a flight is over, in seconds.
const LONGEST_S: f64 = 1.2;
/// Duration without any flight, in seconds.
const EMPTY_S: f64 = 1.0;
/// Position of the object meanwhile, out of the cameras' range.
const OUT_OF_SIGHT_M: [f64; 3] = [45.0, 45.0, 0.3];
/// Person who walks: near enough to pass between cameras and arm, and past a camera.
const PERSON: &str = "arena.person={ nearest_m = { min = 1.0, max = 3.0 }, speed_mps = { min = 0.6, max = 1.8 } }";

const LEGEND: &str = "The scenario honest with near stereo cameras that run freely, without labels, calibrated as on the page of the \
[near rates](near-rates.md). *Entering*: for the first time two cameras have the whole object in their images, not farther than 3 m away. Where there \
is but one camera, it is that one; what is between does not count. Frames are intervals of a camera, 11 ms; what was found before has none. *Nothing \
flies* in scenes of one second. The brain knows one of the three objects. In each scene somebody else walks along a line that passes the base at 1 to \
3 m. The speed is 0.6 to 1.8 m/s. Legs and arms swing. An observation has the images of 10 ms. A false start is a motion that the arm was sent; it \
ends the scene.";

/// Finds the time at which an object enters the view of `needed` cameras.
fn entered_s(cameras: &[CameraModel], needed: usize, radius_m: f64, samples: &[TruthSample]) -> Option<f64> {
    let sees = |camera: &&CameraModel, sample: &TruthSample| {
        let p_C = camera.X_WC.inverse_transform_point(&sample.X_WO.translation.vector.into());
        let margin_px = radius_m * camera.focal_px / p_C.z;
        let within = |at: f64, size: u32| at > margin_px && at < f64::from(size) - margin_px;
        let is_shown = |uv: nalgebra::Point2<f64>| within(uv.x, camera.width_px) && within(uv.y, camera.height_px);
        p_C.coords.norm() < ENTERED_M && camera.project(&p_C).is_some_and(is_shown)
    };
    let entered = samples.iter().find(|sample| cameras.iter().filter(|it| sees(it, sample)).count() >= needed);
    entered.map(|sample| sample.time_s)
}

/// Returns the time at which a throw entered the view, and the capture time of its first right pose.
fn found(setup: &Setup, seed: u64, index: u64) -> (Option<f64>, Option<f64>) {
    let (mut arena, mut brain) = (setup.arena(seed, index), setup.brain(seed, index));
    let cameras = true_cameras(setup, seed, index);
    let mut found_s = None;
    while arena.time_s() < LONGEST_S && found_s.is_none() {
        let Ok(observation) = arena.sense();
        brain.tick(&observation, &mut ());
        let truth = &arena.truth().samples;
        found_s = brain.report().pose.and_then(|pose| {
            let sample = truth.iter().find(|sample| sample.time_s >= pose.capture_s - 1e-6)?;
            let off_m = (sample.X_WO.translation.vector - pose.X_WO.translation.vector).norm();
            (off_m < RIGHT_M).then_some(pose.capture_s)
        });
        let was_touched = truth.iter().any(|sample| sample.contact.any());
        if was_touched {
            break;
        }
    }
    let needed = cameras.len().min(2);
    let radius_m = setup.object.bounding_radius_m;
    // Found without any images of the time after: the flight goes on to see when it would have entered.
    while arena.time_s() < LONGEST_S && entered_s(&cameras, needed, radius_m, &arena.truth().samples).is_none() {
        let Ok(_) = arena.sense();
    }
    (entered_s(&cameras, needed, radius_m, &arena.truth().samples), found_s)
}

/// Counts of a brain in a scene in which nothing flies.
#[derive(Debug, Clone, Copy, Default)]
struct Empty {
    observations: usize,
    images: usize,
    /// Number of observations with a pose.
    poses: usize,
    started: bool,
}

fn empty(setup: &Setup, seed: u64, index: u64) -> Empty {
    let release = Release {
        p_WO: Point3::from(OUT_OF_SIGHT_M),
        v_WO: Vector3::zeros(),
        q_WO: UnitQuaternion::identity(),
        omega_WO: Vector3::zeros(),
        path: None,
    };
    let mut arena = Arena::new(setup.equipment(), &release, &setup.robot.ready_q, seed, index);
    let mut brain = setup.brain(seed, index);
    let mut all = Empty::default();
    while arena.time_s() < EMPTY_S && !all.started {
        let Ok(observation) = arena.sense();
        all.images += observation.frames.len();
        all.observations += usize::from(!observation.frames.is_empty());
        let command = brain.tick(&observation, &mut ());
        let report = brain.report();
        all.poses += usize::from(report.pose.is_some());
        all.started = report.status.is_new_motion();
        let Ok(()) = arena.act(&command);
    }
    all
}

/// Rigs by objects, and rigs with a person and without.
pub fn run(options: &Options) -> Result<Findings> {
    let columns = ["rig", "object", "throws", "entered", "found, %", "frames, p50", "p95", "within 3, %"];
    let mut soon = Table::new("Found after entering the view at 3 m", &columns);
    let columns = ["rig", "scenes", "observations", "images", "observations with a pose", "false starts"];
    let mut none = Table::new("A person walks, and nothing flies", &columns);
    let trials = options.trials as usize;
    for rig in rigs() {
        for object in Kind::Object.names() {
            let setup = setup(&rig, object, &[])?;
            setup.prepare();
            let rate_hz = setup.cameras[0].rate_hz.unwrap_or(setup.scenario.arena.frame_rate_hz);
            let all = parallel::map(trials, |index| found(&setup, options.seed, index as u64));
            let entered: Vec<(f64, Option<f64>)> =
                all.iter().filter_map(|(at, found)| Some(((*at)?, *found))).collect();
            let frames =
                entered.iter().map(|(at, found)| found.map_or(f64::INFINITY, |it| (it - at).max(0.0) * rate_hz));
            let frames: Vec<f64> = frames.collect();
            let was_found: Vec<f64> = frames.iter().copied().filter(|it| it.is_finite()).collect();
            let [median, most] = quantiles(&was_found, [0.5, 0.95], 1.0);
            soon.rows.push(vec![
                Entry::text(&rig),
                Entry::text(object),
                Entry::Count(trials),
                Entry::Count(entered.len()),
                percent(was_found.len(), entered.len()),
                median,
                most,
                percent(frames.iter().filter(|it| **it <= 3.0).count(), frames.len()),
            ]);
        }
        let setups = Kind::Object.names().into_iter().map(|object| setup(&rig, object, &[PERSON]));
        let setups: Vec<Setup> = setups.collect::<Result<_>>()?;
        setups.iter().for_each(Setup::prepare);
        let scene = |index: usize| empty(&setups[index % setups.len()], options.seed, index as u64);
        let all = parallel::map(trials, scene);
        let sum = |of: fn(&Empty) -> usize| Entry::Count(all.iter().map(of).sum());
        none.rows.push(vec![
            Entry::text(&rig),
            Entry::Count(trials),
            sum(|it| it.observations),
            sum(|it| it.images),
            sum(|it| it.poses),
            sum(|it| usize::from(it.started)),
        ]);
    }
    Ok(Findings { legend: LEGEND, tables: vec![soon, none] })
}
