//! `catchingbot catch`: one throw.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use anyhow::Context;
use catch_cell::LimitViolation;
use catch_lab::{
    evaluation::summary_table,
    recording::recorded_throw::{RecordedThrow, record},
    referee::{Verdict, reason::Reason},
    scenario::setup::{Scene, Setup},
    trial::stopwatch::Stopwatch,
};
use catch_recording::{
    MOST_UNPACKED_BYTES,
    timeline::{Entry, Event},
    whole_file::make_writable,
};
use catch_view::playback::Playback;
use clap::Args;
use serde_json::json;

use super::{ThrowArguments, view};
use crate::{
    calibrate,
    screen::{self, BAD, FAINT, GOOD, STRONG},
    watch::Watch,
};

/// Arguments of `catch`.
#[derive(Debug, Args)]
pub struct CatchArguments {
    #[command(flatten)]
    thrown: ThrowArguments,
    /// Folder for what is written
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Open the page in a browser
    #[arg(long, conflicts_with = "json")]
    open: bool,
    /// Open a page that follows the run, on this machine only
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    files: view::FileArguments,
}

/// One throw: its story, the outcome, a recording.
///
/// # Errors
/// Faults in the arguments and files; a folder that cannot be written.
pub fn run(arguments: &CatchArguments, json: bool) -> anyhow::Result<()> {
    let CatchArguments { thrown: thrown @ ThrowArguments { seed, index, .. }, out, open, watch, files } = arguments;
    let setup = thrown.setup()?;
    let scene = setup.scene(*seed, *index);
    // What cannot be written is reported before anything is thrown.
    files.check()?;
    make_writable(out, "--out")?;

    let watch = Watch::start(*watch, &format!("Scenario {}", scene.scenario), Some(1))?;
    let aloud = !json;
    if aloud {
        title(&setup, &scene)?;
    }
    calibrate::before_throws(&setup, *seed, aloud)?;
    let RecordedThrow { recording, timeline, verdict, conditions, stopwatch, images_until_s } =
        record(&setup, *seed, *index, out, &mut |entry| if aloud { tell(entry) } else { Ok(()) })
            .with_context(|| format!("the recording in {}", out.display()))?;
    let playback = Playback::read(&recording)?;
    let mut written = files.write(&recording, &playback)?;
    let page = view::write_page(&recording, &playback)?;
    written.insert("page", page.clone());
    if let Some(watch) = watch {
        let page = page.clone();
        watch.thrown(scene.label(), verdict.reason, move || Ok(fs::read_to_string(&page)?));
        watch.end();
    }

    if aloud {
        summary(&setup, &scene, &verdict, &stopwatch, &recording)?;
        if let Some(until_s) = images_until_s {
            let most = MOST_UNPACKED_BYTES >> 20;
            screen::fact("its images", &format!("until {until_s:.3} s: a recording holds {most} MiB"))?;
        }
        for (kind, path) in &written {
            screen::fact(kind, &path.display().to_string())?;
        }
        screen::line("")?;
        return if *open { view::show(&page) } else { tell_how_to_open(&page) };
    }
    let pictures: BTreeMap<_, _> = written.iter().map(|(kind, path)| (kind, path.to_string_lossy())).collect();
    let mut document = json!({
        "caught": verdict.caught,
        "caught_paper": verdict.caught_paper,
        "reason": verdict.reason,
        "limit_violations": verdict.limit_violations,
        "motion_excursions": verdict.motion_excursions,
        "scene": scene,
        "conditions": conditions,
        "catch_time_s": verdict.catch_time_s,
        "contact_s": verdict.contact_s,
        "measures": verdict.measures,
        "timeline": timeline,
        "stages": BTreeMap::from_iter(stopwatch.summary()),
        "recording": recording.to_string_lossy(),
        "pictures": pictures,
        "scenario": setup.scenario,
    });
    if let Some(until_s) = images_until_s {
        document["images_until_s"] = until_s.into();
    }
    screen::document(&document)
}

/// Prints the command that opens the page.
fn tell_how_to_open(page: &Path) -> anyhow::Result<()> {
    let command = screen::command(&["view", &page.to_string_lossy()]);
    Ok(screen::line(&format!("  {STRONG}See it{STRONG:#}: {command}"))?)
}

fn title(setup: &Setup, scene: &Scene) -> io::Result<()> {
    let Scene { scenario, object, throw, seed, index } = scene;
    screen::line(&format!(
        "\n  {STRONG}{object}, {throw} throw{STRONG:#} {FAINT}· scenario {scenario}, seed {seed}, throw {index}{FAINT:#}"
    ))?;
    screen::line(&format!("  {FAINT}{}{FAINT:#}\n", setup.equipment_and_assumptions()))
}

fn tell(entry: &Entry) -> io::Result<()> {
    let style = match entry.event {
        Event::Held => GOOD,
        Event::Missed => BAD,
        _ => STRONG,
    };
    let Entry { time_s, event, detail, .. } = entry;
    screen::line(&format!("  {FAINT}{time_s:>6.3} s{FAINT:#}  {style}{:<16}{style:#}  {detail}", event.label()))
}

fn summary(setup: &Setup, scene: &Scene, verdict: &Verdict, stopwatch: &Stopwatch, recording: &Path) -> io::Result<()> {
    let millimetres = |value: Option<f64>| match value.map(|metres| metres * 1e3) {
        None => "unknown".to_owned(),
        Some(mm) if mm < 10.0 => format!("{mm:.2} mm"),
        Some(mm) => format!("{mm:.0} mm"),
    };
    let measures = &verdict.measures;
    let object = &scene.object;
    screen::line("")?;
    match verdict.reason {
        None => screen::line(&format!("  {GOOD}Caught.{GOOD:#} The {object} stayed in the hand."))?,
        Some(reason) => screen::line(&format!("  {BAD}Not caught:{BAD:#} {reason}."))?,
    }
    screen::line("")?;
    if let Some(widths) = setup.without_grasps().filter(|_| verdict.reason == Some(Reason::NoGrasp)) {
        screen::fact("nothing to hold by", &widths)?;
    }
    screen::fact(
        "within 2.5 cm",
        &format!("{} (the paper's measure)", if verdict.caught_paper { "yes" } else { "no" }),
    )?;
    if verdict.catch_time_s.is_some() {
        let off = [
            ("prediction", measures.prediction_error_m, "at the catch"),
            ("hand", measures.tracking_error_m, "from its plan"),
            ("grasp", measures.grasp_offset_m, "from where the plan holds the object"),
        ];
        for (what, error_m, at) in off.into_iter().filter(|(_, error_m, _)| error_m.is_some()) {
            screen::fact(what, &format!("off by {} {at}", millimetres(error_m)))?;
        }
    }
    if let Some(travel_rad) = measures.joint_travel_rad {
        screen::fact("arm", &format!("{travel_rad:.2} rad over all joints from its ready pose to the catch"))?;
    }
    let clearances = [measures.min_self_clearance_m, measures.min_floor_clearance_m].map(millimetres);
    screen::fact(
        "clearance",
        &format!("{} from itself, {} from the floor and obstacles", clearances[0], clearances[1]),
    )?;
    limits(verdict)?;
    for (stage, times) in stopwatch.summary() {
        let [usual, most] = [times.p50_ms, times.max_ms].map(summary_table::shown_ms);
        screen::fact(stage, &format!("{usual} (median), {most} at most"))?;
    }
    screen::fact("recording", &recording.display().to_string())
}

/// Prints the broken limits of the arm in commands, the effect of the impact on the motion, and whether the
/// maker's controller would have stopped.
fn limits(verdict: &Verdict) -> io::Result<()> {
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let measures = &verdict.measures;
    let at_most = |velocity: f64, torque: f64| {
        format!("at most {} of a joint's velocity, {} of its torque", percent(velocity), percent(torque))
    };
    let broken = match verdict.first_violation {
        None => "no limit broken".to_owned(),
        Some(LimitViolation { joint, kind, ratio, time_s }) => {
            let (count, kind) = (verdict.limit_violations, format!("{kind:?}").to_lowercase());
            let (joint, ratio) = (joint + 1, percent(ratio));
            format!("{BAD}{count} limits broken{BAD:#}, first by joint {joint} at {time_s:.3} s: {ratio} of its {kind}")
        }
    };
    let in_flight = at_most(measures.flight_velocity_ratio, measures.flight_torque_ratio);
    screen::fact("commanded", &format!("{broken}; until the contact {in_flight}"))?;
    if verdict.contact_s.is_none() {
        return Ok(());
    }
    let after = at_most(measures.peak_velocity_ratio, measures.peak_torque_ratio);
    let exceeded = match verdict.motion_excursions {
        0 => "no limit exceeded".to_owned(),
        1 => "1 limit exceeded".to_owned(),
        count => format!("{count} limits exceeded"),
    };
    screen::fact("impact included", &format!("{exceeded} by the motion; {after} asked"))?;
    let Some(ratio) = measures.contact_stop_ratio else { return Ok(()) };
    let part = measures.contact_stop_joint.map_or("the hand".to_owned(), |joint| format!("joint {joint}"));
    let would =
        if ratio > 1.0 { format!("{BAD}would have stopped{BAD:#}") } else { "would not have stopped".to_owned() };
    screen::fact("its controller", &format!("{would}: a contact of {} of its threshold at {part}", percent(ratio)))
}
