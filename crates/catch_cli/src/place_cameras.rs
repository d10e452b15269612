//! `catchingbot place-cameras`: where cameras tell most about the throws of a scenario.

use std::{
    fmt::{self, Display},
    io,
    path::PathBuf,
};

use catch_body::{InputError, Pose};
use catch_cell::{CameraModel, rig_to_toml};
use catch_lab::{
    camera_placement::{CLOSING_S, Config, DECISION_S, PlacementStudy, Score},
    scenario::setup::Setup,
};
use catch_recording::whole_file::{COMMAND_LINE, check_new, write_new};
use catch_sim::{
    cameras::{DepthCameras, Readout, Renderer, Scene},
    depth_noise::DepthConfig,
};
use catch_view::pages::placement_page::{self, CameraView};
use clap::Args;
use serde_json::{Value, json};

use super::{ChoiceArguments, MOST, between, whole};
use crate::screen;

/// Cameras of a rig that is compared, at most.
const MOST_COMPARED: usize = 20;

/// Finds camera poses that determine the throws of a scenario best: a rig file, a table, a page
///
/// Cameras hang on the walls and the ceiling of a box, and are aimed at where objects fly. It chooses
/// the cameras whose images determine best where the object will be caught, at two times: when the
/// catch is decided, and when the fingers begin to close. What the waiting arm and the border of an
/// image hide does not count. Cameras that show little of the arm, on which they are calibrated, are
/// left out. All are like the first camera of the scenario's rig:
///
///   catchingbot place-cameras --scenario lab --cameras 2 --out placed
///   catchingbot place-cameras --scenario lab --cameras 3 --from=-1,-1.5,0.5 --to=2,2,1.9 --out placed
///   catchingbot eval --scenario lab --set flight_rig=placed/rig.toml
///
/// The table compares them with the scenario's own rig.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct PlaceCamerasArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    object: Option<String>,
    /// Throw: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    throw: Option<String>,
    /// Number of cameras
    #[arg(long, value_name = "N", default_value_t = Config::default().cameras as u64, value_parser = whole(1, 16))]
    cameras: u64,
    /// Throws that are looked at
    #[arg(long, value_name = "N", default_value_t = Config::default().throws, value_parser = whole(1, 1000))]
    trials: u64,
    /// A corner of the box, in metres; cameras hang on its walls, but not on its floor
    #[arg(long, value_name = "X,Y,Z", value_parser = corner, default_value_t = Corner(Config::default().volume_m[0]), allow_hyphen_values = true)]
    from: Corner,
    /// The opposite corner
    #[arg(long, value_name = "X,Y,Z", value_parser = corner, default_value_t = Corner(Config::default().volume_m[1]), allow_hyphen_values = true)]
    to: Corner,
    /// Distance between neighbouring places on a wall, in metres
    #[arg(long, value_name = "METRES", default_value_t = Config::default().spacing_m, value_parser = between(0.05, 5.0))]
    spacing: f64,
    /// No camera is nearer than this to any flight, in metres
    #[arg(long, value_name = "METRES", default_value_t = Config::default().clear_m, value_parser = between(0.0, 10.0))]
    clear: f64,
    /// No camera shows less of the arm, on which it is calibrated: fraction of the joints within its image
    #[arg(long, value_name = "FRACTION", default_value_t = Config::default().arm_fraction, value_parser = between(0.0, 1.0))]
    arm: f64,
    /// Seed of the throws and of the arm's postures
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
    /// Folder for what is written
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

/// A corner of a box in a cell, as its coordinates are written.
#[derive(Debug, Clone, Copy)]
struct Corner([f64; 3]);

impl Display for Corner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self([x, y, z]) = self;
        write!(f, "{x},{y},{z}")
    }
}

/// Reads three coordinates of a place in a cell.
fn corner(text: &str) -> Result<Corner, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|it| it.trim().parse().ok().filter(|it: &f64| it.abs() <= 50.0)).collect();
    let corner = numbers.and_then(|it| it.try_into().ok());
    corner.map(Corner).ok_or_else(|| "expected three numbers from -50 to 50, such as -1.2,-1.6,0.4".to_owned())
}

/// Standard deviations along each axis of the position at the catch: predicted at the decision, and when the
/// fingers begin to close, median and 90 % of each.
fn sds_m(score: &Score) -> [f64; 4] {
    let decision = |fraction| score.quantile_m(|it| it.decision_sd_m, fraction);
    let closing = |fraction| score.quantile_m(|it| it.closing_sd_m, fraction);
    [decision(0.5), decision(0.9), closing(0.5), closing(0.9)]
}

/// What the cameras of a rig know of the throws, as a document.
pub fn rig_document(rig: &str, score: &Score) -> Value {
    let sds_m = sds_m(score);
    let mut document = json!(score);
    document["rig"] = json!(rig);
    document["cameras"] = json!(score.shown.len());
    document["decision_sd_median_m"] = json!(sds_m[0]);
    document["decision_sd_90_m"] = json!(sds_m[1]);
    document["closing_sd_median_m"] = json!(sds_m[2]);
    document["closing_sd_90_m"] = json!(sds_m[3]);
    document
}

/// Places cameras, writes their rig and a page, and compares them with the scenario's.
///
/// # Errors
/// Faults of the choice, or of writing.
pub fn run(arguments: &PlaceCamerasArguments, json: bool) -> anyhow::Result<()> {
    let out = &arguments.out;
    let (rig_path, page_path) = (out.join("rig.toml"), out.join("cameras.html"));
    check_new([&rig_path, &page_path], "--out")?;
    let setup = Setup::load(&arguments.choice.with(arguments.object.as_deref(), arguments.throw.as_deref()))?;
    let config = Config {
        cameras: arguments.cameras as usize,
        throws: arguments.trials,
        seed: arguments.seed,
        volume_m: [arguments.from.0, arguments.to.0],
        spacing_m: arguments.spacing,
        clear_m: arguments.clear,
        arm_fraction: arguments.arm,
    };
    let Some(kind) = setup.cameras.first() else {
        return Err(InputError::new(COMMAND_LINE, "flight_rig", "no camera", "a rig with cameras").into());
    };
    let bar = screen::spinner("placing cameras");
    let study = PlacementStudy::new(&setup, &config)?;
    let (cameras, candidates) = study.place(kind)?;
    bar.finish_and_clear();
    let score = study.score(&cameras);
    let mut rigs = vec![("placed", score)];
    if setup.cameras.len() <= MOST_COMPARED {
        rigs.push((&setup.scenario.flight_rig, study.score(&setup.cameras)));
    }
    let rig: Vec<_> = cameras.iter().map(|camera| (camera.clone(), None)).collect();
    let about = format!(
        "Cameras placed for the throw {} of the scenario {}, by what {} throws of seed {} tell until {} s and {} s before the catch.",
        setup.scenario.throw, setup.scenario.name, config.throws, config.seed, DECISION_S, CLOSING_S
    );
    let views = views(&setup, &study, &cameras, &rigs[0].1);
    let page = placement_page::page("Placed cameras", &study.flights, &views);
    let files = [(rig_path.clone(), rig_to_toml(&about, &rig).into_bytes()), (page_path.clone(), page.into_bytes())];
    write_new(&files, "--out")?;
    if !json {
        tell(&rigs, &cameras)?;
        screen::fact("rig", &rig_path.display().to_string())?;
        return Ok(screen::fact("what is seen", &page_path.display().to_string())?);
    }
    screen::document(&json!({
        "scenario": setup.scenario.name,
        "seed": config.seed,
        "throws": config.throws,
        "candidates": candidates,
        "rig": rig_path.to_string_lossy(),
        "page": page_path.to_string_lossy(),
        "rigs": rigs.iter().map(|(rig, score)| rig_document(rig, score)).collect::<Vec<_>>(),
    }))
}

fn views<'a>(setup: &Setup, study: &PlacementStudy, cameras: &'a [CameraModel], score: &Score) -> Vec<CameraView<'a>> {
    let renderer = Renderer::new(&setup.robot, &setup.gripper, &setup.object.mesh, false);
    let X_WL = setup.robot.link_poses(&setup.robot.ready_q);
    // The object is where no camera sees it.
    let X_WO = Pose::translation(0.0, 0.0, -1e3);
    let scene = Scene { capture_s: 0.0, X_WL, width_m: setup.gripper.max_width_m, X_WO };
    let exact = DepthCameras::new(cameras, &DepthConfig::default(), 0, 0);
    let exposures = (0..cameras.len()).map(|camera| (camera, 0));
    let images = exact.capture(&renderer, &scene, exposures, Readout::Full, false);
    let of_images = score.shown.iter().zip(&score.arm_shown);
    let view = |((camera, image), (shown, of_arm)): ((&'a CameraModel, _), (&f64, &f64))| CameraView {
        camera,
        summary: format!(
            "{:.0} % of the images show the object. They hold {:.0} % of the arm's joints, over random postures.",
            shown * 100.0,
            of_arm * 100.0
        ),
        sight: study.sight(camera),
        image,
    };
    cameras.iter().zip(images).zip(of_images).map(view).collect()
}

fn tell(rigs: &[(&str, Score)], cameras: &[CameraModel]) -> io::Result<()> {
    screen::line("")?;
    let headings = [
        "rig",
        "cameras",
        "one camera\nshows it, %",
        "two, %",
        "sd at the\ndecision, mm",
        "90 %",
        "at the\nclosing",
        "90 %",
        "expected\ncaught, %",
    ];
    let mut table = screen::table(headings, 1..9);
    let percent = |fraction: f64| format!("{:.0}", fraction * 100.0);
    for (rig, score) in rigs {
        let shown = [score.shown.len().to_string(), percent(score.shown_by_one), percent(score.shown_by_two)];
        let sds_mm = sds_m(score).map(|sd_m| format!("{:.2}", sd_m * 1e3));
        let rate = score.expected_rate.map_or("–".to_owned(), percent);
        table.add_row([rig.to_string()].into_iter().chain(shown).chain(sds_mm).chain([rate]));
    }
    screen::line(&table.trim_fmt())?;
    screen::line("")?;
    let Score { shown, arm_shown, .. } = &rigs[0].1;
    for (i, (camera, (shown, of_arm))) in cameras.iter().zip(shown.iter().zip(arm_shown)).enumerate() {
        let p = camera.X_WC.translation.vector;
        let ahead = camera.X_WC.rotation * nalgebra::Vector3::z();
        let (turned_deg, down_deg) = (libm::atan2(ahead.y, ahead.x).to_degrees(), libm::asin(-ahead.z).to_degrees());
        let place =
            format!("({:.2}, {:.2}, {:.2}) m, looks to {turned_deg:.0}° and {down_deg:.0}° down", p.x, p.y, p.z);
        let shows = format!("shows {:.0} % of the images and {:.0} % of the arm", shown * 100.0, of_arm * 100.0);
        screen::fact(&format!("camera {i}"), &format!("{place}, {shows}"))?;
    }
    Ok(())
}
