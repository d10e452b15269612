//! Plots of an evaluation as SVG, for papers.

use std::{error::Error, path::Path};

use catch_body::statistics::sorted;
use plotters::{coord::Shift, prelude::*};

use crate::pages::report_page::Report;
use catch_lab::evaluation::{
    cell_summary::CellSummary,
    published::{published_rate, published_rates},
};
use catch_recording::whole_file;

type Failure = Box<dyn Error>;
/// Drawing area of a plot.
type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const SIZE: (u32, u32) = (640, 360);
const OURS: RGBColor = RGBColor(28, 109, 208);
const THEIRS: RGBColor = RGBColor(217, 72, 15);

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

/// Bars with their intervals, the published rates beside them.
fn caught(report: &Report, root: &Canvas) -> Result<(), Failure> {
    let cells = report.cells;
    let mut chart = ChartBuilder::on(root)
        .margin(12)
        .margin_top(30)
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
            let line = vec![(left + 0.34, low * 100.0), (left + 0.34, high * 100.0)];
            chart.draw_series([PathElement::new(line, BLACK.stroke_width(2))])?;
        }
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
    Ok(())
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
    // Without any error there is still a plot, an empty one.
    let (low, high) = if low <= high { (low, high) } else { (0.1, 1.0) };
    let mut chart = ChartBuilder::on(root)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(44)
        .build_cartesian_2d((low * 0.8..high * 1.25).log_scale(), 0.0..100.0)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("prediction off by at most, mm")
        .y_desc("throws, %")
        .draw()?;
    for (i, (name, errors)) in curves.iter().enumerate().filter(|(_, (_, errors))| !errors.is_empty()) {
        let colour = Palette99::pick(i).to_rgba();
        let fraction = |rank: usize| 100.0 * rank as f64 / errors.len() as f64;
        let steps = errors.iter().enumerate().flat_map(|(k, error)| [(*error, fraction(k)), (*error, fraction(k + 1))]);
        chart
            .draw_series(LineSeries::new(steps.collect::<Vec<_>>(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.2))
        .draw()?;
    Ok(())
}
