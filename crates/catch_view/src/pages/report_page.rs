//! An evaluation as one page: rates against the published ones, misses by reason, prediction, computing time.

mod misses;
mod rows;

use std::{collections::BTreeMap, fmt::Write};

use crate::pages::{document, packed::text_in_html};
use catch_body::statistics::{quantile, sorted};
use catch_lab::{
    VERSION,
    evaluation::{
        Row,
        cell_summary::CellSummary,
        published::{published_rate, published_rates},
        summary_table::{HEADINGS, NUMBERS, lines, repeated_throws},
    },
    referee::{LEADS_S, Measures},
    trial::stopwatch::{StageTimes, Stopwatch},
};
use rows::{Mark, Scale, row};

pub use misses::{MOST_MISSES, Miss, record_misses};

pub(super) use misses::recorded;

/// Chooses light or dark before anything is drawn.
const THEME: &str = include_str!("report_page/theme.html");
const REPORT_STYLE: &str = include_str!("report_page/report.css");

/// Data of a report.
#[derive(Debug)]
pub struct Report<'a> {
    /// Name of the scenario.
    pub scenario: &'a str,
    /// Seed of everything random.
    pub seed: u64,
    /// Objects with their throws.
    pub cells: &'a [CellSummary],
    /// All trials.
    pub rows: &'a [Row],
    /// Wall times of the stages, where they are known.
    pub stopwatch: &'a Stopwatch,
    /// Missed throws that can be looked at, by the index of their row.
    pub pages: &'a BTreeMap<usize, Miss>,
}

/// The page of an evaluation.
pub fn page(report: &Report) -> String {
    let title = format!("{} · {} throws", report.scenario, report.rows.len());
    let sections = [head(report), caught(report), misses(report), prediction(report), computing(report), table(report)];
    report_document(&title, &sections.concat())
}

/// A page that looks like a report.
pub(super) fn report_document(title: &str, sections: &str) -> String {
    document(title, "report", REPORT_STYLE, &[THEME, sections].concat())
}

fn name_of(cell: &CellSummary) -> String {
    format!("{}, {}", cell.object, cell.throw).replace('_', " ")
}

fn percent(fraction: f64) -> String {
    format!("{:.1} %", fraction * 100.0)
}

fn head(report: &Report) -> String {
    let caught = report.rows.iter().filter(|row| row.verdict.caught).count();
    let as_paper = report.rows.iter().filter(|row| row.verdict.caught_paper).count();
    let broken: usize = report.rows.iter().map(|row| row.verdict.limit_violations).sum();
    let figures = [
        (format!("{caught} of {}", report.rows.len()), "caught and held"),
        (percent(caught as f64 / report.rows.len().max(1) as f64), "of all throws"),
        (as_paper.to_string(), "within 2.5 cm (the paper's measure)"),
        (broken.to_string(), "limits of the arm broken"),
    ];
    let figures: String = figures.iter().map(|(value, label)| format!("<div><b>{value}</b>{label}</div>")).collect();
    format!(
        "<h1>Scenario {}</h1><p class=\"faint\">seed {}, CatchingBot {VERSION}</p><div class=\"big\">{figures}</div>\n",
        text_in_html(report.scenario),
        report.seed,
    )
}

fn caught(report: &Report) -> String {
    let rates = published_rates();
    let mut html =
        "<h2>Caught</h2><p class=\"faint\">The bar is the fraction that was caught and held, the line across it its \
                    95&nbsp;% interval (Wilson) where throws differ."
            .to_owned();
    if report.cells.iter().any(|cell| published_rate(&rates, cell).is_some()) {
        html +=
            " The orange mark is the paper's Table I: its fixed throws, its measure, and no limit on the arm's torque.";
    }
    if let Some(repeated) = repeated_throws(report.cells) {
        let _ = write!(html, " {}", text_in_html(&repeated));
    }
    html += "</p>\n";
    for cell in report.cells {
        let fraction = cell.caught as f64 / cell.trials.max(1) as f64;
        let mut marks = vec![Mark::Bar(0.0, fraction)];
        marks.extend(cell.wilson95.map(|[low, high]| Mark::Range(low, high)));
        marks.extend(published_rate(&rates, cell).map(Mark::Paper));
        html += &row(&name_of(cell), &marks, &format!("{} of {}", cell.caught, cell.trials), false);
    }
    html + &Scale::FRACTION.axis()
}

fn misses(report: &Report) -> String {
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for reason in report.rows.iter().filter_map(|row| row.verdict.reason) {
        *reasons.entry(reason.to_string()).or_default() += 1;
    }
    let mut html = "<h2>Missed</h2>\n".to_owned();
    if reasons.is_empty() {
        return html + "<p>Nothing.</p>\n";
    }
    let mut sorted: Vec<_> = reasons.into_iter().collect();
    sorted.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let most = sorted[0].1 as f64;
    for (reason, count) in &sorted {
        html += &row(reason, &[Mark::Bad(0.0, *count as f64 / most)], &count.to_string(), false);
    }
    html += "<ul>";
    for (i, row) in report.rows.iter().enumerate().filter(|(_, row)| !row.verdict.caught) {
        let name = row.scene.label();
        let reason = row.verdict.reason.map(|it| it.to_string()).unwrap_or_default();
        let name = match report.pages.get(&i) {
            Some(Miss { page, picture }) => format!(
                "<a href=\"{}\"><img alt=\"\" src=\"data:image/png;base64,{picture}\">{}</a>",
                text_in_html(page),
                text_in_html(&name)
            ),
            None => text_in_html(&name),
        };
        let _ = write!(html, "<li>{name} <span class=\"faint\">{}</span></li>", text_in_html(&reason));
    }
    html + "</ul>\n"
}

/// Median, spread and largest of some errors as a row of marks; none without errors.
fn errors_row(label: &str, errors_mm: &[f64], scale: &Scale) -> Option<String> {
    let errors_mm = sorted(errors_mm.iter().copied());
    let [Some(low), Some(middle), Some(high), Some(most)] =
        [0.1, 0.5, 0.9, 1.0].map(|fraction| quantile(&errors_mm, fraction))
    else {
        return None;
    };
    let marks = [
        Mark::Range(scale.place(low), scale.place(high)),
        Mark::Most(scale.place(most)),
        Mark::Dot(scale.place(middle)),
    ];
    Some(row(label, &marks, &format!("{middle:.3} mm"), true))
}

fn prediction(report: &Report) -> String {
    let errors_mm = |rows: &dyn Fn(&Row) -> bool, pick: &dyn Fn(&Measures) -> Option<f64>| -> Vec<f64> {
        let of_cell = report.rows.iter().filter(|row| rows(row));
        of_cell.filter_map(|row| pick(&row.verdict.measures)).map(|metres| metres * 1e3).collect()
    };
    let mut html = "<h2>Prediction</h2><p class=\"faint\">How far off the place of the catch was predicted, ever closer to it, \
                    and by the last prediction object by object: the dot is the median, the line from the 10th to the 90th \
                    percentile, the tick the largest.</p>\n"
        .to_owned();
    let mut over_time: Vec<(String, Vec<f64>)> = Vec::new();
    for (i, lead_s) in LEADS_S.iter().enumerate() {
        let label = format!("{:.0} ms before, all", lead_s * 1e3);
        over_time.push((label, errors_mm(&|_| true, &|measures| measures.prediction_errors_m[i])));
    }
    for cell in report.cells {
        let of_cell = |row: &Row| row.scene.object == cell.object && row.scene.throw == cell.throw;
        over_time.push((name_of(cell), errors_mm(&of_cell, &|measures| measures.prediction_error_m)));
    }
    let all: Vec<f64> = over_time.iter().flat_map(|(_, errors)| errors.iter().copied()).collect();
    let scale = Scale::decades(&all, "mm");
    for (label, errors) in &over_time {
        html += &errors_row(label, errors, &scale).unwrap_or_default();
    }
    html + &scale.axis()
}

fn computing(report: &Report) -> String {
    let stages = report.stopwatch.summary();
    if stages.is_empty() {
        return String::new();
    }
    let all: Vec<f64> = stages.iter().flat_map(|(_, it)| [it.p50_ms.max(SHORTEST_MS), it.max_ms]).collect();
    let scale = Scale::decades(&all, "ms");
    let mut html = "<h2>Computing</h2><p class=\"faint\">Wall time of each stage, where it ran: the hills show how often it took how \
                    long, the dot is the median, the line reaches to the 99th percentile, the tick is the longest. A <i>tick</i> is all that \
                    the brain does in one step of 10&nbsp;ms, which is next to nothing where no image has come.</p>\n"
        .to_owned();
    for (stage, StageTimes { p50_ms, p99_ms, max_ms, .. }) in stages {
        let [p50, p99, most] = [p50_ms, p99_ms, max_ms].map(|ms| scale.place(ms));
        let mut marks = hills(report.stopwatch.laps_ms(stage), &scale);
        marks.extend([Mark::Range(p50, p99), Mark::Most(most), Mark::Dot(p50)]);
        html += &row(&stage.replace('_', " "), &marks, &format!("{} / {} ms", short(p50_ms), short(p99_ms)), true);
    }
    html + &scale.axis()
}

/// Wall times below are not told apart.
const SHORTEST_MS: f64 = 0.01;
/// Parts that a distribution is drawn with.
const PARTS: usize = 60;

/// A time in few digits.
fn short(ms: f64) -> String {
    if ms < SHORTEST_MS { format!("<{SHORTEST_MS}") } else { format!("{ms:.*}", if ms < 10.0 { 2 } else { 0 }) }
}

/// Histogram of the times, as heights along the scale.
fn hills(laps_ms: impl Iterator<Item = (f64, usize)>, scale: &Scale) -> Vec<Mark> {
    let mut counts = [0; PARTS];
    for (ms, count) in laps_ms {
        counts[((scale.place(ms) * PARTS as f64) as usize).min(PARTS - 1)] += count;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let place = |i: usize| i as f64 / PARTS as f64;
    let parts = counts.iter().enumerate().filter(|(_, count)| **count > 0);
    parts.map(|(i, count)| Mark::Part(place(i), place(i + 1), *count as f64 / most)).collect()
}

fn table(report: &Report) -> String {
    let row = |tag: &str, cells: &[String]| {
        let class = |i: usize| if NUMBERS.contains(&i) { " class=\"n\"" } else { "" };
        let cell = |(i, it): (usize, &String)| format!("<{tag}{}>{}</{tag}>", class(i), text_in_html(it));
        format!("<tr>{}</tr>\n", cells.iter().enumerate().map(cell).collect::<String>())
    };
    let lines: String = lines(report.cells).iter().map(|it| row("td", it)).collect();
    let headings = row("th", &HEADINGS.map(str::to_owned));
    format!("<h2>In numbers</h2><div class=\"scroll\"><table>{headings}{lines}</table></div>\n")
}
