//! A study as a page: how many throws are caught in each of its steps.

use std::fmt::Write;

use super::{
    percent, report_document,
    rows::{Mark, track},
};
use crate::pages::packed::text_in_html;
use catch_lab::{
    VERSION,
    evaluation::cell_summary::CellSummary,
    study::{ObjectSummary, Outline, StepSummary},
};

/// The page of a study, which lies beside the folders of its steps; each of those has a report of its own
/// named `report`.
pub fn study_page(outline: &Outline, steps: &[StepSummary], report: &str) -> String {
    let trials: usize = steps.iter().flat_map(|step| &step.objects).map(|it| it.all.trials).sum();
    let (alone, cumulative): (Vec<&StepSummary>, Vec<_>) = steps.iter().partition(|step| step.alone);
    let (name, about) = (text_in_html(&outline.study), text_in_html(&outline.description));
    let mut body = format!(
        "<h1>{about}</h1><p class=\"faint\">study {name}, {trials} throws, seed {}, CatchingBot {VERSION}</p>\n{}\
         <p class=\"faint\">The bar is the fraction of the throws within reach that was caught and held, the line across it its \
         95&nbsp;% interval (Wilson) where throws differ. Throws that no arm of this kind could have reached in time, by the oracle, \
         are counted apart. Each step leads to its report, with its misses.</p>\n",
        outline.seed,
        figures(steps, &cumulative),
    );
    for (heading, steps) in [("One after the other", cumulative), ("One at a time", alone)] {
        if let Some(first) = steps.first() {
            let _ =
                write!(body, "<h2>{heading}</h2>\n<div class=\"study\" style=\"--objects:{}\">\n", first.objects.len());
            let name = |it: &ObjectSummary| format!("<b>{}</b>", text_in_html(&it.all.object.replace('_', " ")));
            let names: String = first.objects.iter().map(name).collect();
            let _ = writeln!(body, "<div class=\"step head\"><span></span>{names}</div>");
            steps.iter().for_each(|step| body += &bars(step, report));
            body += "</div>\n";
        }
    }
    body += &table(steps);
    report_document(&format!("{} · {trials} throws", outline.study), &body)
}

/// The ends of what is cumulative, in large figures.
fn figures(steps: &[StepSummary], cumulative: &[&StepSummary]) -> String {
    let fraction = |step: &StepSummary| {
        let sum = |of: &dyn Fn(&CellSummary) -> usize| step.objects.iter().map(|it| of(&it.all)).sum::<usize>();
        percent(sum(&|it| it.caught) as f64 / sum(&within_reach).max(1) as f64)
    };
    let mut figures = Vec::new();
    if let [first, .., last] = cumulative {
        let caught = |step: &StepSummary| (fraction(step), format!("caught at {}", text_in_html(&label(step))));
        figures.extend([caught(first), caught(last)]);
    }
    let broken: usize = steps.iter().flat_map(|step| &step.objects).map(|it| it.all.limit_violations).sum();
    figures.push((broken.to_string(), "limits of the arm broken".to_owned()));
    let figures: String = figures.iter().map(|(value, label)| format!("<div><b>{value}</b>{label}</div>")).collect();
    format!("<div class=\"big\">{figures}</div>\n")
}

fn label(step: &StepSummary) -> String {
    step.step.replace('-', " ")
}

/// Number of throws of which the fraction is taken: those within reach, or all where that is not known.
fn within_reach(it: &CellSummary) -> usize {
    it.within_reach().unwrap_or(it.trials)
}

fn fraction_of(it: &CellSummary) -> f64 {
    it.caught as f64 / within_reach(it).max(1) as f64
}

/// A step: what it changes, and a bar for each object.
fn bars(step: &StepSummary, report: &str) -> String {
    let bars = step.objects.iter().map(|ObjectSummary { all: it, .. }| {
        let mut marks = vec![Mark::Bar(0.0, fraction_of(it))];
        marks.extend(it.wilson95_within_reach.map(|[low, high]| Mark::Range(low, high)));
        format!("<div>{}<span class=\"value\">{} of {}</span></div>", track(&marks, false), it.caught, within_reach(it))
    });
    format!(
        "<div class=\"step\"><span><a href=\"{}/{report}\">{}</a><small>{}</small></span>{}</div>\n",
        text_in_html(&step.step),
        text_in_html(&label(step)),
        text_in_html(&step.about),
        bars.collect::<String>(),
    )
}

/// All figures, step by step.
fn table(steps: &[StepSummary]) -> String {
    let mut html = "<h2>In numbers</h2><div class=\"scroll\"><table><tr><th>step</th><th>object</th>\
                    <th class=\"n\">caught</th><th class=\"n\">within reach</th><th class=\"n\">fraction</th><th class=\"n\">95 %</th>\
                    <th class=\"n\">out of reach</th><th class=\"n\">limits broken</th><th>misses</th></tr>\n"
        .to_owned();
    for (step, it) in steps.iter().flat_map(|step| step.objects.iter().map(move |it| (step, &it.all))) {
        let reasons: Vec<String> = it.reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
        let numbers = [
            it.caught.to_string(),
            within_reach(it).to_string(),
            percent(fraction_of(it)),
            super::interval(it.wilson95_within_reach),
            it.out_of_reach.map_or("–".to_owned(), |count| count.to_string()),
            it.limit_violations.to_string(),
        ];
        let numbers: String = numbers.iter().map(|it| format!("<td class=\"n\">{it}</td>")).collect();
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{}</td>{numbers}<td class=\"long\">{}</td></tr>",
            text_in_html(&step.step),
            text_in_html(&it.object),
            text_in_html(&reasons.join(", ")),
        );
    }
    html + "</table></div>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(name: &str, object: &str) -> StepSummary {
        StepSummary {
            step: name.to_owned(),
            about: "removes the vacuum".to_owned(),
            alone: name.starts_with("only"),
            objects: vec![ObjectSummary { all: CellSummary::of(object, "near", &[], false), grid: None }],
        }
    }

    fn page(name: &str, steps: &[StepSummary]) -> String {
        let (version, study, description) = (VERSION.to_owned(), name.to_owned(), name.to_owned());
        let outline = Outline { version, study, description, seed: 1, throw_grid: None, steps: Vec::new() };
        study_page(&outline, steps, "report.html")
    }

    #[test]
    fn every_step_has_its_bar_and_its_link() {
        let page = page("mine", &["01-paper", "02-drag", "only-drag"].map(|name| step(name, "ball")));
        assert_eq!(page.matches("class=\"bar\"").count(), 3);
        for name in ["01-paper", "02-drag", "only-drag"] {
            assert_eq!(page.matches(&format!("href=\"{name}/report.html\"")).count(), 1, "{name}");
        }
        // Steps alone stand apart.
        let alone = page.find("One at a time").unwrap();
        assert!(page.find("02 drag").unwrap() < alone && page.find("only drag").unwrap() > alone);
    }

    #[test]
    fn names_cannot_break_out_of_the_page() {
        let clean = page("mine", &[step("01-paper", "ball")]);
        let hostile = "\"><script>alert(1)</script><img src=x onerror='alert(2)'>";
        let page = page(hostile, &[step(hostile, hostile)]);
        for mark in ["<script", "</script", "<img", "href="] {
            assert_eq!(page.matches(mark).count(), clean.matches(mark).count(), "{mark}");
        }
    }
}
