//! Pages and pictures written for people, checked without a browser.

use std::{fs, path::Path};

use catch_view::{pages::catch_page, playback::Playback};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

/// A recording of a throw in `folder`, of the paper unless the options name a scenario.
fn record(folder: &Path, options: &[&str]) -> Value {
    let scenario = if options.contains(&"--scenario") { &[][..] } else { &["--scenario", "paper"] };
    let output = catchingbot(&[&["catch", "--json", "--out", folder.to_str().unwrap()], scenario, options].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

fn read(document: &Value) -> Playback {
    Playback::read(Path::new(document["recording"].as_str().unwrap())).unwrap()
}

/// Reads the page's data element.
fn data_of(page: &str) -> Value {
    let text = page.split("<script type=\"application/json\" id=\"data\">").nth(1).unwrap();
    serde_json::from_str(text.split("</script>").next().unwrap()).unwrap()
}

#[test]
fn names_cannot_break_out_of_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let mut playback = read(&record(folder.path(), &[]));
    let clean = catch_page::page(&playback);
    let hostile = "</script></title><script>alert(1)</script><img src=x onerror='alert(2)'>{{data}}\u{2028}<!--";
    playback.header.title = hostile.to_owned();
    let scene = &mut playback.header.simulation.as_mut().unwrap().scene;
    scene.object = hostile.to_owned();
    scene.scenario = hostile.to_owned();
    playback.ending.timeline[0].detail = hostile.to_owned();
    playback.robot.joints[0].name = hostile.to_owned();
    let page = catch_page::page(&playback);
    for mark in ["<script", "</script", "<img", "<!--", "</title"] {
        assert_eq!(page.matches(mark).count(), clean.matches(mark).count(), "{mark}");
    }
    let data = data_of(&page);
    assert_eq!(data["scene"]["object"], hostile);
    assert_eq!(data["events"][0]["detail"], hostile);
    // Whatever the scripts insert they insert as text.
    assert!(!page.contains("innerHTML") && !page.contains("document.write"));
}

#[test]
fn a_page_tells_what_happened() {
    let folder = tempfile::tempdir().unwrap();
    let document = record(folder.path(), &["--object", "pill_bottle"]);
    let page = fs::read_to_string(document["pictures"]["page"].as_str().unwrap()).unwrap();
    let data = data_of(&page);
    assert_eq!(data["caught"], document["caught"]);
    assert_eq!(data["robot"]["joints"].as_array().unwrap().len(), 7);
    let count = |name: &str| data[name].as_array().unwrap().len();
    assert!(count("plans") > 20 && count("candidates") > 20 && count("cameras") == 20);
    let first = data["points"]["first"].as_array().unwrap();
    assert!(first.last().unwrap().as_u64().unwrap() > 5_000, "points of every frame");
    let errors = &data["errors"];
    let last = |name: &str| errors[name].as_array().unwrap().last().unwrap().as_f64().unwrap();
    let measured_mm = document["measures"]["prediction_error_m"].as_f64().unwrap() * 1e3;
    assert!((last("error_mm") - measured_mm).abs() < 1e-6, "the referee and the plot agree");
    assert!(data["stages"]["names"].as_array().unwrap().len() >= 4, "computing times are in the page");
}

#[test]
fn view_writes_the_page_of_a_recording_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let document = record(folder.path(), &[]);
    let output = catchingbot(&["view", "--no-open", document["recording"].as_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let page = stdout(&output).trim().to_owned();
    assert!(page.ends_with("paper-tennis_ball-near-1-0.html"), "{page}");
    assert!(fs::read_to_string(&page).unwrap().contains("tennis ball, near throw"));
    // A page, too, can be viewed.
    assert_eq!(stdout(&catchingbot(&["view", "--no-open", &page])).trim(), page);
}

#[test]
fn what_cannot_be_viewed_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("notes.catch");
    fs::write(&text, "nothing of the kind").unwrap();
    for wrong in [text.as_path(), folder.path(), Path::new("nowhere.catch")] {
        let output = catchingbot(&["view", "--no-open", wrong.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
        let complaint = stderr(&output);
        assert_eq!(complaint.lines().count(), 1, "{complaint}");
        assert!(complaint.contains("recording"), "{complaint}");
    }
}

/// Without the feature, asking for a picture is an error that tells of it.
#[cfg(not(feature = "gif"))]
#[test]
fn a_program_without_pictures_says_so() {
    let output = catchingbot(&["catch", "--gif", "--out", tempfile::tempdir().unwrap().path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--features gif"), "{}", stderr(&output));
}

#[cfg(feature = "gif")]
#[test]
fn the_moving_picture_is_small_and_moves() {
    let folder = tempfile::tempdir().unwrap();
    let document = record(folder.path(), &["--gif"]);
    let file = fs::read(document["pictures"]["picture"].as_str().unwrap()).unwrap();
    assert!(file.len() <= 400_000, "{} bytes", file.len());
    let mut decoder = gif::DecodeOptions::new().read_info(&file[..]).unwrap();
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    assert!(decoder.global_palette().is_some());
    let (mut images, mut small) = (0, 0);
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        assert!(frame.palette.is_none(), "one palette for all");
        images += 1;
        small += usize::from(2 * usize::from(frame.width) * usize::from(frame.height) < width * height);
    }
    assert!(images > 30, "{images} images");
    assert!(small > images / 4, "only what changed is in the file: {small} of {images} images are small");
}

/// A small evaluation with a missed throw: the arm's waiting pose is one from which nothing is within reach.
fn evaluate(folder: &Path) -> String {
    let scenario = folder.join("far_away.toml");
    let text = stdout(&catchingbot(&["list", "--show", "paper"]));
    let ready = text.lines().find(|line| line.starts_with("ready_rad")).unwrap();
    let away = "ready_rad = [2.8, 1.2, 1.1, -1.5, 1.6, 1.4, 0.2]";
    fs::write(&scenario, text.replace(ready, away).replace("name = \"paper\"", "name = \"away\"")).unwrap();
    let out = folder.join("results");
    let output = catchingbot(&[
        "eval",
        "--trials",
        "2",
        "--scenario",
        scenario.to_str().unwrap(),
        "--throw",
        "near_sampled",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    out.to_str().unwrap().to_owned()
}

#[test]
fn an_evaluation_writes_a_report_with_a_page_for_each_miss() {
    let folder = tempfile::tempdir().unwrap();
    let out = evaluate(folder.path());
    let page = stdout(&catchingbot(&["view", "--no-open", &out])).trim().to_owned();
    assert!(page.ends_with("report.html"), "{page}");
    let report = fs::read_to_string(&page).unwrap();
    assert!(report.contains("0 of 2") && report.contains("98.3 %"), "ours beside the published rate");
    let links: Vec<&str> = report.split("<a href=\"").skip(1).filter_map(|it| it.split('"').next()).collect();
    assert_eq!(links.len(), 2);
    for link in links {
        let throw = fs::read_to_string(Path::new(&out).join(link)).unwrap();
        assert_eq!(data_of(&throw)["caught"], false);
    }
}

#[test]
fn two_evaluations_are_compared_throw_by_throw() {
    let folder = tempfile::tempdir().unwrap();
    let missed = evaluate(folder.path());
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let throws = ["--scenario", "paper", "--throw", "near_sampled"];
    let caught = catchingbot(&[&["eval", "--trials", "3", "--out", &at("caught")], &throws[..]].concat());
    assert!(caught.status.success(), "{}", stderr(&caught));
    let arguments = ["view", "--json", "--out", &at("compared"), &at("caught"), &missed];
    let document: Value = serde_json::from_str(&stdout(&catchingbot(&arguments))).unwrap();
    let cell = &document["cells"][0];
    let counts = ["trials", "both", "only_a", "only_b", "neither"].map(|name| cell[name].as_u64().unwrap());
    assert_eq!(counts, [2, 0, 2, 0, 0], "the throws that both have: {document}");
    assert_eq!((cell["difference"].as_f64(), cell["mcnemar_p"].as_f64()), (Some(-1.0), Some(0.5)));
    let page = fs::read_to_string(document["page"].as_str().unwrap()).unwrap();
    let links: Vec<&str> = page.split("<a href=\"").skip(1).filter_map(|it| it.split('"').next()).collect();
    assert_eq!(links.len(), 2);
    for link in links {
        let pair = fs::read(Path::new(&at("compared")).join(link)).unwrap();
        assert!(pair.len() < 1_000_000, "{} bytes", pair.len());
    }
    // Throws of another seed are others.
    let other = catchingbot(&[&["eval", "--trials", "1", "--seed", "2", "--out", &at("other")], &throws[..]].concat());
    assert!(other.status.success(), "{}", stderr(&other));
    let refused = catchingbot(&["view", "--no-open", &at("caught"), &at("other")]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("one seed"), "{}", stderr(&refused));
}

#[test]
fn new_files_are_right_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    for kind in ["object", "throw", "robot", "gripper", "workcell", "camera", "rig", "scenario"] {
        let name = format!("my_{kind}");
        let output = catchingbot(&["new", kind, &name, "--out", out]);
        assert!(output.status.success(), "{}", stderr(&output));
        let file = if matches!(kind, "robot" | "object") { name.clone() } else { format!("{name}.toml") };
        let path = folder.path().join(file);
        let checked = catchingbot(&["check", "--json", path.to_str().unwrap()]);
        let document: Value = serde_json::from_slice(&checked.stdout).unwrap();
        assert!(checked.status.success() && document["files"][0]["kind"] == kind, "{document}");
        // Nothing is overwritten.
        let again = catchingbot(&["new", kind, &name, "--out", out]);
        assert_eq!(again.status.code(), Some(2));
        assert!(stderr(&again).contains("already there"));
        // The trial that the output suggests.
        let shown = stdout(&output);
        let trial = shown.lines().find_map(|line| line.trim().strip_prefix("try it")).unwrap();
        let arguments: Vec<&str> = trial.split(' ').collect();
        let document = record(folder.path(), &arguments[arguments.len() - 2..]);
        assert_eq!(document["caught"], true, "{kind}: {document}");
    }
    assert_eq!(catchingbot(&["new", "object", "../evil", "--out", out]).status.code(), Some(2));
    let object = folder.path().join("my_object");
    let document = record(folder.path(), &["--object", object.to_str().unwrap()]);
    assert_eq!(document["scene"]["object"], "my_object");
}
