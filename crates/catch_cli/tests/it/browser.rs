//! The pages in a real browser: they open from a disk, complain about nothing, ask no network for anything,
//! and move.
//!
//! Needs Chromium (Debian: `apt-get install chromium`); without it these tests say so and pass, but fail in
//! CI. Screenshots stay in `target/tmp/screenshots`.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{catchingbot, skipped_without, stderr};

/// A browser, if there is one.
fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH").unwrap_or_default()).collect();
    let found =
        names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|it| it.is_file());
    if found.is_none() {
        skipped_without("Chromium, in which the pages open (Debian: apt-get install chromium)");
    }
    found
}

struct Browser {
    program: PathBuf,
    profile: tempfile::TempDir,
}

impl Browser {
    fn find() -> Option<Self> {
        Some(Self { program: chromium()?, profile: tempfile::tempdir().unwrap() })
    }

    /// Runs the browser on a page; returns what it printed, and what the page wrote to its console.
    fn run(&self, options: &[&str], page: &Path, address: &str) -> (String, Vec<String>) {
        let output = Command::new(&self.program)
            .args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--hide-scrollbars", "--virtual-time-budget=5000", "--enable-logging=stderr", "--v=0"])
            .arg(format!("--user-data-dir={}", self.profile.path().display()))
            .args(options)
            .arg(format!("file://{}#{address}", page.display()))
            .output()
            .unwrap();
        let log = String::from_utf8_lossy(&output.stderr).into_owned();
        let console = log.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect();
        (String::from_utf8_lossy(&output.stdout).into_owned(), console)
    }

    /// A picture of the page, kept under `name`; the page must not have complained.
    fn screenshot(&self, page: &Path, address: &str, [width, height]: [u32; 2], name: &str) -> Vec<u8> {
        let path = screenshots().join(format!("{name}.png"));
        let (screenshot, size) =
            (format!("--screenshot={}", path.display()), format!("--window-size={width},{height}"));
        let (_, console) = self.run(&[&screenshot, &size], page, address);
        assert!(console.is_empty(), "{name}: {console:?}");
        fs::read(&path).unwrap()
    }
}

/// Folder of the screenshots.
fn screenshots() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("screenshots");
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// The page of a throw in `folder`.
fn page_of_a_throw(folder: &Path) -> PathBuf {
    let output =
        catchingbot(&["catch", "--scenario", "paper", "--object", "banana", "--out", folder.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    folder.join("paper-banana-near-1-0.html")
}

/// No address of anything else stands in a page.
fn assert_refers_to_nothing(page: &str) {
    let page = page.replace("src=\"data:image/png;base64,", "");
    for reference in ["http:", "https:", "src=", "url(", "@import", "import(", "fetch(", "XMLHttp", "WebSocket"] {
        assert!(!page.contains(reference), "the page contains {reference}");
    }
}

/// Stands before the scripts of a page: what waits for a frame is done at once, so that no browser, however
/// slow, is asked before.
const AT_ONCE: &str = "<script>window.requestAnimationFrame = (draw) => draw(performance.now());</script></head>";

/// Moves the slider and counts the pixels that change, the thrown object taken away; writes what it found
/// into the page.
const DRIVER: &str = "<script>{
  const found = document.body.dataset;
  for (const [name] of LAYERS) toggle(name, false);
  scene.surfaces.splice(0, Infinity, ...scene.surfaces.filter((it) => it.of !== 'object'));
  const at = (time) => {
    $('time').value = time; $('time').dispatchEvent(new Event('input'));
    const pixels = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels); return pixels;
  };
  const changed = (a, b) => { let n = 0; for (let i = 0; i < a.length; i += 4) if (a[i] !== b[i] || a[i + 1] !== b[i + 1]) n++; return n; };
  const [early, late, again] = [at(0.1), at(0.6), at(0.1)];
  found.arm = changed(early, late); found.back = changed(early, again);
  dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' })); found.clock = $('clock').textContent;
  const before = camera.azimuth;
  for (const [type, x] of [['pointerdown', 300], ['pointermove', 360], ['pointerup', 360]])
    canvas.dispatchEvent(new PointerEvent(type, { clientX: x, clientY: 300, pointerId: 1, buttons: 1, bubbles: true }));
  found.turned = before - camera.azimuth; found.requests = performance.getEntriesByType('resource').length; found.error = gl.getError();
}</script></body>";

/// Counts pixels of the object's colour at the catch: in the whole picture, with nothing but the object, and
/// in the close-up. Then every key and button is reached.
const CATCH_DRIVER: &str = "<script>{
  const found = document.body.dataset;
  for (const [name] of LAYERS) toggle(name, name === 'obstacles');
  const object = (view) => {
    seek(data.flight_end_s); draw(now, 1);
    const [x, y, width, height] = view, pixels = new Uint8Array(width * height * 4);
    gl.readPixels(x, canvas.height - y - height, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let count = 0;
    for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 2] < 0.6 * pixels[i] && pixels[i + 1] > 0.6 * pixels[i]) count++;
    return count;
  };
  const inset = $('inset'); seek(data.flight_end_s);
  const corner = [inset.offsetLeft, inset.offsetTop, inset.offsetWidth, inset.offsetHeight], whole = [0, 0, canvas.width, canvas.height];
  found.near = object(corner); found.seen = object(whole) - found.near;
  const all = [...scene.surfaces];
  scene.surfaces.splice(0, all.length, ...all.filter((it) => it.of === 'object'));
  found.alone = object(whole) - object(corner);
  scene.surfaces.splice(0, Infinity, ...all);
  for (const key of ['c', '?', 'n', 'p', '1', '7']) dispatchEvent(new KeyboardEvent('keydown', { key }));
  found.follows = camera.follows; found.keys = !$('keys').hidden; found.layer = layers.truth;
  writeAddress(); found.address = location.hash;
  const focusable = (it) => it.tabIndex >= 0;
  found.unreached = [...document.querySelectorAll('button, select, input, [onclick], #events li')].filter((it) => !focusable(it)).length;
  found.error = gl.getError();
}</script></body>";

/// The value that the driver wrote into a page under `name`.
fn found(dom: &str, name: &str) -> String {
    let value = dom.split(&format!("data-{name}=\"")).nth(1).and_then(|rest| rest.split('"').next());
    value.unwrap_or_else(|| panic!("the page did not come to data-{name}")).to_owned()
}

#[test]
fn the_page_of_a_throw_opens_from_a_disk_and_its_slider_moves_the_arm() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = page_of_a_throw(folder.path());
    let text = fs::read_to_string(&page).unwrap();
    assert!(text.len() < 1_000_000, "{} bytes", text.len());
    assert_refers_to_nothing(&text);

    let desktop = [1360, 850];
    let early = browser.screenshot(&page, "t=0.1", desktop, "catch-0.1");
    let late = browser.screenshot(&page, "t=0.6", desktop, "catch-0.6");
    assert!(early != late, "the address moves the slider");
    browser.screenshot(&page, "t=0.6&theme=dark&layers=truth,predicted,plan,grasps,cameras", desktop, "catch-dark");
    browser.screenshot(&page, "t=0.6", [412, 915], "catch-phone");

    let driven = folder.path().join("driven.html");
    fs::write(&driven, text.replace("</head>", AT_ONCE).replace("</body>", DRIVER)).unwrap();
    let (dom, console) = browser.run(&["--dump-dom", "--window-size=1360,850"], &driven, "t=0");
    // Reading pixels back is what stalls here.
    assert!(console.iter().all(|line| line.contains("GPU stall")), "{console:?}");
    let arm: usize = found(&dom, "arm").parse().unwrap();
    assert!(arm > 5_000, "only {arm} pixels changed with the slider");
    assert_eq!(found(&dom, "back"), "0", "the same time gives the same picture");
    assert_eq!(found(&dom, "clock"), "0.110 s");
    assert!(found(&dom, "turned").parse::<f64>().unwrap() > 0.1, "dragging turns the camera");
    assert_eq!(found(&dom, "requests"), "0");
    assert_eq!(found(&dom, "error"), "0");
}

#[test]
fn the_catch_is_seen_without_touching_the_camera() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let thrown = catchingbot(&["catch", "--workcell", "table_and_fence", "--json", "--out", out]);
    let document: serde_json::Value = serde_json::from_slice(&thrown.stdout).unwrap();
    let page = PathBuf::from(document["pictures"]["page"].as_str().unwrap());
    browser.screenshot(&page, &format!("t={}", document["contact_s"]), [1360, 850], "contact");
    let driven = folder.path().join("driven.html");
    let text = fs::read_to_string(&page).unwrap();
    fs::write(&driven, text.replace("</head>", AT_ONCE).replace("</body>", CATCH_DRIVER)).unwrap();
    let (dom, console) = browser.run(&["--dump-dom", "--window-size=1360,850"], &driven, "t=0&theme=light");
    assert!(console.iter().all(|line| line.contains("GPU stall")), "{console:?}");
    let count = |name: &str| found(&dom, name).parse::<f64>().unwrap();
    assert!(count("near") >= 5_000.0, "{} pixels in the close-up", count("near"));
    assert!(count("seen") >= 0.4 * count("alone") && count("alone") > 100.0, "{} of {}", count("seen"), count("alone"));
    assert_eq!(["follows", "keys", "layer"].map(|name| found(&dom, name)), ["true", "true", "true"]);
    assert_eq!([found(&dom, "unreached"), found(&dom, "error")], ["0", "0"]);
    assert!(["t=", "camera=", "layers=", "follow"].iter().all(|part| found(&dom, "address").contains(part)));
}

#[test]
fn two_throws_move_on_one_slider() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = page_of_a_throw(folder.path());
    let recording = page.with_extension("catch");
    let recording = recording.to_str().unwrap();
    let viewed = catchingbot(&["view", "--no-open", recording, recording]);
    assert!(viewed.status.success(), "{}", stderr(&viewed));
    let pair = PathBuf::from(String::from_utf8(viewed.stdout).unwrap().trim());
    let text = fs::read_to_string(&pair).unwrap();
    assert!(text.len() < 1_000_000, "{} bytes", text.len());
    assert_refers_to_nothing(&text);
    browser.screenshot(&pair, "", [1360, 850], "pair");
    let driven = folder.path().join("driven.html");
    let driver = "<script>addEventListener('load', () => setTimeout(() => {
        frames[0].contentWindow.setPlaying(false); frames[0].contentWindow.seek(0.5);
        setTimeout(() => { document.body.dataset.clock = frames[1].contentDocument.getElementById('clock').textContent; }, 1000);
    }, 1000));</script></body>";
    fs::write(&driven, text.replace("</body>", driver)).unwrap();
    let (dom, console) = browser.run(&["--dump-dom", "--window-size=1360,850"], &driven, "");
    assert!(console.is_empty(), "{console:?}");
    assert_eq!(found(&dom, "clock"), "0.500 s");
}

#[test]
fn the_report_opens_from_a_disk() {
    let Some(browser) = Browser::find() else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let evaluated = catchingbot(&[
        "eval",
        "--scenario",
        "paper",
        "--trials",
        "2",
        "--throw",
        "near",
        "--throw",
        "far",
        "--out",
        out,
    ]);
    assert!(evaluated.status.success(), "{}", stderr(&evaluated));
    let report = folder.path().join("report.html");
    assert_refers_to_nothing(&fs::read_to_string(&report).unwrap());
    let light = browser.screenshot(&report, "", [1000, 1200], "report");
    let dark = browser.screenshot(&report, "theme=dark", [1000, 1200], "report-dark");
    assert!(light != dark);
    browser.screenshot(&report, "", [412, 915], "report-phone");
}
