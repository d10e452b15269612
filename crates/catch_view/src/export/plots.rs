//! Plots of an evaluation as SVG, for papers.

use std::{error::Error, path::Path};

use catch_body::statistics::sorted;
use plotters::{coord::Shift, prelude::*};

use crate::pages::report_page::Report;
use catch_lab::{
    VERSION,
    evaluation::{
        cell_summary::CellSummary,
        published::{published_rate, published_rates},
    },
};
use catch_recording::whole_file;

type Failure = Box<dyn Error>;
/// Drawing area of a plot.
type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const SIZE: (u32, u32) = (640, 360);
/// Colours that the colour-blind tell apart, of Okabe and Ito, *Color Universal Design*, 2008.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    BLACK,
];
const OURS: RGBColor = COLOURS[0];
const THEIRS: RGBColor = COLOURS[1];
/// Half the width of an interval's caps, in bars.
const CAP: f64 = 0.05;
/// Room below a plot for its note.
const NOTE_PX: u32 = 26;

/// Writes the rates of catching as `caught.svg` and the prediction errors as `prediction.svg`.
///
/// # Errors
/// Files that cannot be written.
pub fn write(report: &Report, folder: &Path) -> Result<Vec<std::path::PathBuf>, Failure> {
    let paths = ["caught.svg", "prediction.svg"].map(|name| folder.join(name));
    let width = SIZE.0.max(70 + 130 * report.cells.len() as u32);
    draw(&paths[0], (width, SIZE.1), |root| caught(report, root))?;
    draw(&paths[1], SIZE, |root| prediction(report, root))?;
    Ok(paths.to_vec())
}

/// Writes a picture when it is complete.
fn draw(path: &Path, size: (u32, u32), paint: impl FnOnce(&Canvas) -> Result<(), Failure>) -> Result<(), Failure> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        paint(&root)?;
        root.present()?;
    }
    Ok(whole_file::write(path, svg)?)
}

fn name_of(cell: &CellSummary) -> String {
    format!("{} {}", cell.object, cell.throw).replace('_', " ")
}

/// What the throws are, below a plot.
fn note(report: &Report, root: &Canvas, intervals: &str) -> Result<(), Failure> {
    let Report { scenario, seed, rows, .. } = report;
    let text = format!("Scenario {scenario}, seed {seed}, {} throws{intervals}; CatchingBot {VERSION}", rows.len());
    let below = (12, root.dim_in_pixel().1 as i32 - 20);
    Ok(root.draw(&Text::new(text, below, ("sans-serif", 11).into_font().color(&BLACK.mix(0.7))))?)
}

/// Bars with their intervals, the published rates beside them.
fn caught(report: &Report, root: &Canvas) -> Result<(), Failure> {
    let cells = report.cells;
    let mut chart = ChartBuilder::on(root)
        .margin(12)
        .margin_top(44)
        .margin_bottom(NOTE_PX)
        .x_label_area_size(34)
        .y_label_area_size(44)
        .build_cartesian_2d(0.0..cells.len() as f64, 0.0..100.0)?;
    let label = |x: &f64| {
        cells.get(*x as usize).filter(|_| x.fract() > 0.4 && x.fract() < 0.6).map(name_of).unwrap_or_default()
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(cells.len() * 2 + 1)
        .x_label_formatter(&label)
        .y_label_formatter(&|y| format!("{y:.0}"))
        .y_desc("caught, %")
        .draw()?;
    let rates = published_rates();
    for (i, cell) in cells.iter().enumerate() {
        let (left, fraction) = (i as f64, 100.0 * cell.caught as f64 / cell.trials.max(1) as f64);
        chart.draw_series([Rectangle::new([(left + 0.18, 0.0), (left + 0.5, fraction)], OURS.filled())])?;
        if let Some([low, high]) = cell.wilson95 {
            let at = |x: f64, rate: f64| (left + 0.34 + x, rate * 100.0);
            let lines = [[at(0.0, low), at(0.0, high)], [at(-CAP, low), at(CAP, low)], [at(-CAP, high), at(CAP, high)]];
            chart.draw_series(lines.map(|line| PathElement::new(line.to_vec(), BLACK.stroke_width(2))))?;
        }
        let (x, y) = chart.backend_coord(&(left + 0.18, 100.0));
        let count = format!("{} of {}", cell.caught, cell.trials);
        root.draw(&Text::new(count, (x, y - 16), ("sans-serif", 12).into_font()))?;
        if let Some(rate) = published_rate(&rates, cell) {
            chart.draw_series([Rectangle::new(
                [(left + 0.5, 0.0), (left + 0.82, rate * 100.0)],
                THEIRS.mix(0.75).filled(),
            )])?;
        }
    }
    // A key, where there is something to tell apart.
    if cells.iter().any(|cell| published_rate(&rates, cell).is_some()) {
        for (x, colour, name) in [(60, OURS.to_rgba(), "here"), (130, THEIRS.mix(0.75), "paper, Table I")] {
            root.draw(&Rectangle::new([(x, 9), (x + 12, 19)], colour.filled()))?;
            root.draw(&Text::new(name, (x + 18, 8), ("sans-serif", 12).into_font()))?;
        }
    }
    note(report, root, ", 95 % intervals (Wilson)")
}

/// The fraction of throws whose prediction at the catch was off by at most so much, cell by cell.
fn prediction(report: &Report, root: &Canvas) -> Result<(), Failure> {
    let curves: Vec<(String, Vec<f64>)> = report
        .cells
        .iter()
        .map(|cell| {
            let rows =
                report.rows.iter().filter(|row| row.scene.object == cell.object && row.scene.throw == cell.throw);
            let errors_m = rows.filter_map(|row| row.verdict.measures.prediction_error_m);
            (name_of(cell), sorted(errors_m.map(|metres| (metres * 1e3).max(1e-4))))
        })
        .collect();
    let all = || curves.iter().flat_map(|(_, errors)| errors.iter().copied());
    let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
    // Without any error there is still a plot, an empty one. Whole decades have their ticks.
    let (low, high) = if low <= high { (low, high) } else { (0.1, 1.0) };
    let [low, high] = [libm::log10(low * 0.9).floor(), libm::log10(high * 1.1).ceil()].map(libm::exp10);
    let mut chart = ChartBuilder::on(root)
        .margin(12)
        .margin_bottom(NOTE_PX)
        .x_label_area_size(40)
        .y_label_area_size(44)
        .build_cartesian_2d((low..high).log_scale(), 0.0..100.0)?;
    chart
        .configure_mesh()
        .light_line_style(BLACK.mix(0.07))
        .y_max_light_lines(1)
        .y_label_formatter(&|y| format!("{y:.0}"))
        .x_desc("prediction off by at most, mm")
        .y_desc("throws, %")
        .draw()?;
    for (i, (name, errors)) in curves.iter().enumerate().filter(|(_, (_, errors))| !errors.is_empty()) {
        let colour = COLOURS[i % COLOURS.len()].to_rgba();
        let fraction = |rank: usize| 100.0 * rank as f64 / errors.len() as f64;
        let steps = errors.iter().enumerate().flat_map(|(k, error)| [(*error, fraction(k)), (*error, fraction(k + 1))]);
        chart
            .draw_series(LineSeries::new(steps.collect::<Vec<_>>(), colour.stroke_width(2)))?
            .label(format!("{name}, n = {}", errors.len()))
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.2))
        .draw()?;
    note(report, root, "")
}
