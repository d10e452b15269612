//! Figures of the docs as SVG, drawn from the files and formulas that they show.

use std::{fmt::Write as _, fs, path::Path};

use anyhow::Result;
use catch_bot::trajectory_optimization::reachability::ReachableSet;
use catch_lab::scenario::setup::{Choice, Setup};

const BLUE: &str = "#1f6feb";
const ORANGE: &str = "#d9730d";
const GREY: &str = "#57606a";
const PALE: &str = "#eaeef2";

/// Writes all figures into a folder.
pub fn write(folder: &Path) -> Result<()> {
    for (name, svg) in all()? {
        fs::write(folder.join(name), svg)?;
    }
    Ok(())
}

fn all() -> Result<[(&'static str, String); 4]> {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() })?;
    Ok([
        ("crates.svg", crates()),
        ("tick.svg", tick()),
        ("gripper_frame.svg", gripper_frame(&setup)),
        ("reach.svg", reach(&setup)),
    ])
}

/// A drawing on white, in pixels.
struct Drawing {
    body: String,
    size: (f64, f64),
}

impl Drawing {
    fn new(width: f64, height: f64) -> Self {
        Self { body: String::new(), size: (width, height) }
    }

    fn rectangle(&mut self, [x, y, width, height]: [f64; 4], fill: &str) {
        let _ = writeln!(
            self.body,
            r##"<rect x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" rx="4" fill="{fill}" stroke="{GREY}"/>"##
        );
    }

    fn line(&mut self, points: &[(f64, f64)], stroke: &str, dashes: &str) {
        let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let points = points.join(" ");
        let _ = writeln!(
            self.body,
            r##"<polyline points="{points}" fill="none" stroke="{stroke}" stroke-width="1.6" stroke-dasharray="{dashes}"/>"##
        );
    }

    fn arrow(&mut self, from: (f64, f64), to: (f64, f64), stroke: &str) {
        let (x, y) = (to.0 - from.0, to.1 - from.1);
        let length = libm::hypot(x, y).max(1e-9);
        let (x, y) = (x / length * 7.0, y / length * 7.0);
        self.line(&[from, to], stroke, "");
        self.line(
            &[(to.0 - x - y / 2.0, to.1 - y + x / 2.0), to, (to.0 - x + y / 2.0, to.1 - y - x / 2.0)],
            stroke,
            "",
        );
    }

    fn circle(&mut self, (x, y): (f64, f64), radius: f64, stroke: &str) {
        let _ = writeln!(
            self.body,
            r##"<circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" fill="none" stroke="{stroke}" stroke-width="1.6"/>"##
        );
    }

    /// Text whose `anchor` (start, middle or end) is at a point.
    fn text(&mut self, (x, y): (f64, f64), anchor: &str, colour: &str, text: &str) {
        let _ = writeln!(
            self.body,
            r##"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}" fill="{colour}">{text}</text>"##
        );
    }

    fn svg(self) -> String {
        let Self { body, size: (width, height) } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n{body}</svg>\n"
        )
    }
}

/// The crates: each stands on those below it that a line leads to.
fn crates() -> String {
    let boxes = [
        ("catch_cli", "the command line", (130.0, 20.0)),
        ("catch_py", "the Python package", (340.0, 20.0)),
        ("catch_experiments", "writes docs/results", (550.0, 20.0)),
        ("catch_import", "what users bring", (225.0, 105.0)),
        ("catch_view", "pages, other formats", (455.0, 105.0)),
        ("catch_lab", "trials, referee, evaluation", (340.0, 190.0)),
        ("catch_recording", "throws on disk", (110.0, 275.0)),
        ("catch_calibration", "where cameras stand", (340.0, 275.0)),
        ("catch_paper", "the paper's method", (110.0, 360.0)),
        ("catch_bot", "the brain", (260.0, 445.0)),
        ("catch_sim", "the arena", (570.0, 315.0)),
        ("catch_cell", "the contract", (340.0, 530.0)),
        ("catch_body", "robots, shapes", (340.0, 615.0)),
    ];
    let (width, height) = (190.0, 50.0);
    let mut drawing = Drawing::new(680.0, 685.0);
    let place = |name: &str| boxes.iter().find(|(it, ..)| *it == name).map_or((0.0, 0.0), |(.., place)| *place);
    let uses = [
        ("catch_cli", "catch_import"),
        ("catch_cli", "catch_view"),
        ("catch_py", "catch_import"),
        ("catch_py", "catch_view"),
        ("catch_experiments", "catch_import"),
        ("catch_import", "catch_lab"),
        ("catch_view", "catch_lab"),
        ("catch_lab", "catch_recording"),
        ("catch_lab", "catch_calibration"),
        ("catch_lab", "catch_sim"),
        ("catch_recording", "catch_paper"),
        ("catch_paper", "catch_bot"),
        ("catch_calibration", "catch_bot"),
        ("catch_bot", "catch_cell"),
        ("catch_sim", "catch_cell"),
        ("catch_cell", "catch_body"),
    ];
    for (upper, lower) in uses {
        let ((from_x, from_y), (to_x, to_y)) = (place(upper), place(lower));
        drawing.arrow((from_x, from_y + height), (to_x, to_y), GREY);
    }
    for (name, what, (x, y)) in boxes {
        drawing.rectangle([x - width / 2.0, y, width, height], PALE);
        drawing.text((x, y + 21.0), "middle", "black", name);
        drawing.text((x, y + 39.0), "middle", GREY, what);
    }
    drawing.svg()
}

/// One tick on the cell's clock.
fn tick() -> String {
    let mut drawing = Drawing::new(720.0, 250.0);
    let x = |time_ms: f64| 90.0 + time_ms * 11.0;
    for (row, name) in [(60.0, "cameras"), (120.0, "brain"), (180.0, "arm")] {
        drawing.text((75.0, row + 5.0), "end", "black", name);
        drawing.line(&[(x(0.0), row), (x(55.0), row)], PALE, "");
    }
    for time_ms in [0.0, 10.0, 20.0] {
        drawing.rectangle([x(time_ms) - 3.0, 50.0, 6.0, 20.0], BLUE);
        drawing.arrow((x(time_ms), 72.0), (x(time_ms + 15.0), 106.0), BLUE);
    }
    drawing.text((x(0.0), 40.0), "middle", BLUE, "capture");
    drawing.text((x(30.0), 90.0), "start", BLUE, "image latency");
    drawing.rectangle([x(15.0), 108.0, x(20.0) - x(15.0), 24.0], PALE);
    drawing.text((x(26.0), 146.0), "start", ORANGE, "expected latency");
    drawing.text((x(15.0), 100.0), "start", "black", "tick");
    drawing.arrow((x(20.0), 132.0), (x(27.0), 166.0), ORANGE);
    drawing.line(&[(x(0.0), 180.0), (x(27.0), 180.0)], GREY, "5 4");
    drawing.line(&[(x(27.0), 180.0), (x(55.0), 180.0)], ORANGE, "");
    drawing.text((x(8.0), 200.0), "start", GREY, "executing trajectory");
    drawing.text((x(28.0), 200.0), "start", ORANGE, "new one: same q, q̇, q̈ at its start, ends at rest");
    drawing.arrow((x(0.0), 230.0), (x(55.0), 230.0), GREY);
    drawing.text((x(55.0), 245.0), "end", GREY, "time on the cell's clock");
    drawing.svg()
}

/// The gripper of the default scenario from above, to scale, around a ball.
fn gripper_frame(setup: &Setup) -> String {
    let gripper = &setup.gripper;
    let mut drawing = Drawing::new(560.0, 420.0);
    let scale = 2200.0;
    // x of G to the right, y up.
    let at = |x_m: f64, y_m: f64| (280.0 + x_m * scale, 340.0 - y_m * scale);
    let block = |drawing: &mut Drawing, centre: (f64, f64), size: [f64; 3]| {
        let (x, y) = at(centre.0 - size[0] / 2.0, centre.1 + size[1] / 2.0);
        drawing.rectangle([x, y, size[0] * scale, size[1] * scale], PALE);
    };
    block(&mut drawing, (0.0, 0.0), gripper.body_size_m);
    let finger = gripper.finger_size_m;
    let centre_x_m = gripper.max_width_m / 2.0 + finger[0] / 2.0;
    for side in [-1.0, 1.0] {
        block(&mut drawing, (side * centre_x_m, gripper.finger_centre_y_m), finger);
        let (x, y) = at(side * (centre_x_m + 0.014), gripper.finger_centre_y_m);
        drawing.arrow((x, y), (x - side * 24.0, y), ORANGE);
    }
    let radius_m = setup.object.bounding_radius_m;
    let (x, y) = at(0.0, gripper.grasp_centre_y_m);
    drawing.circle((x, y), radius_m * scale, BLUE);
    drawing.circle((x, y), 3.0, "black");
    drawing.arrow((x, 25.0), (x, y - radius_m * scale - 4.0), BLUE);
    drawing.text((x + 8.0, 40.0), "start", BLUE, "approach, relative to the gripper");
    drawing.text((x, y + 20.0), "middle", "black", "grasp centre");
    let origin = at(0.0, 0.0);
    drawing.arrow(origin, (origin.0 + 55.0, origin.1), "black");
    drawing.arrow(origin, (origin.0, origin.1 - 55.0), "black");
    drawing.text((origin.0 + 60.0, origin.1 + 5.0), "start", "black", "x");
    drawing.text((origin.0 - 8.0, origin.1 - 45.0), "end", "black", "y");
    drawing.text((origin.0 - 8.0, origin.1 + 16.0), "end", "black", "G");
    let (left, y) = at(-gripper.max_width_m / 2.0, -0.022);
    let (right, _) = at(gripper.max_width_m / 2.0, 0.0);
    drawing.arrow(((left + right) / 2.0, y), (left, y), GREY);
    drawing.arrow(((left + right) / 2.0, y), (right, y), GREY);
    drawing.text(
        ((left + right) / 2.0, y + 16.0),
        "middle",
        GREY,
        &format!("aperture, at most {:.0} mm", gripper.max_width_m * 1e3),
    );
    drawing.svg()
}

/// Plot of the reachable set of the default arm's first joint from rest, over time.
fn reach(setup: &Setup) -> String {
    let joint = &setup.robot.joints[0];
    let mut drawing = Drawing::new(640.0, 360.0);
    let at = |time_s: f64, displacement_rad: f64| (70.0 + time_s * 900.0, 170.0 - displacement_rad * 170.0);
    let ends = |time_s: f64| {
        let (velocity, acceleration) = (joint.limits.velocity, joint.limits.acceleration);
        ReachableSet { start_velocity: 0.0, velocity, acceleration, time_s }.displacements()
    };
    let times: Vec<f64> = (0..=60).map(|i| f64::from(i) * 0.01).collect();
    let highest: Vec<(f64, f64)> = times.iter().map(|&time_s| at(time_s, ends(time_s).high)).collect();
    let lowest: Vec<(f64, f64)> = times.iter().map(|&time_s| at(time_s, ends(time_s).low)).collect();
    drawing.line(&highest, BLUE, "");
    drawing.line(&lowest, BLUE, "");
    for time_s in [0.2, 0.4] {
        let interval = ends(time_s);
        drawing.line(&[at(time_s, interval.low), at(time_s, interval.high)], ORANGE, "4 3");
        let (x, y) = at(time_s, interval.low);
        let label = format!("± {:.2} rad in {time_s} s", interval.high);
        drawing.text((x - 6.0, y + 16.0), "end", ORANGE, &label);
    }
    let (velocity, acceleration) = (joint.limits.velocity, joint.limits.acceleration);
    drawing.text(
        (85.0, 30.0),
        "start",
        "black",
        &format!("joint 1 from rest: V = {velocity:.2} rad/s, A = {acceleration:.2} rad/s²"),
    );
    drawing.text((85.0, 50.0), "start", GREY, "accelerate with A, then go on with V: ½·A·t², later V·t − V²/2A");
    drawing.arrow(at(0.0, 0.0), (at(0.62, 0.0).0, at(0.0, 0.0).1), GREY);
    drawing.arrow(at(0.0, -1.0), at(0.0, 0.97), GREY);
    drawing.text((at(0.62, 0.0).0, at(0.0, 0.0).1 - 8.0), "end", GREY, "time");
    drawing.text((at(0.0, 0.0).0 - 8.0, 20.0), "end", GREY, "rad");
    for value in [-0.5, 0.5] {
        let (x, y) = at(0.0, value);
        drawing.text((x - 8.0, y + 5.0), "end", GREY, &format!("{value}"));
    }
    drawing.svg()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_the_docs_are_current() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/pictures");
        for (name, svg) in all().unwrap() {
            let found = fs::read_to_string(folder.join(name)).unwrap_or_default();
            assert!(found == svg, "{name}: cargo run --release -p catch_experiments -- figures");
        }
    }
}
