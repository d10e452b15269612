//! The ladder as a page: how many throws are caught as one assumption after the other falls.

use std::fmt::Write;

use super::{
    PAGE, REPORT_STYLE, percent,
    rows::{Mark, track},
};
use crate::{
    VERSION,
    catch_page::{STYLE, fill},
    ladder::StepSummary,
    packed::text_in_html,
    statistics::CellSummary,
};

/// The page of a ladder, which lies beside the folders of its steps; each of those has a report of its own named `report`.
pub fn ladder_page(seed: u64, steps: &[StepSummary], report: &str) -> String {
    let trials: usize = steps.iter().flat_map(|step| &step.objects).map(|it| it.trials).sum();
    let (alone, climb): (Vec<&StepSummary>, Vec<_>) = steps.iter().partition(|step| step.step.starts_with("only-"));
    let mut body = format!(
        "<h1>From the paper to an honest arena</h1><p class=\"faint\">{trials} throws, seed {seed}, CatchingBot {VERSION}</p>\n{}\
         <p class=\"faint\">Each step takes one assumption of the paper away. The bar is the fraction of the throws within reach that \
         was caught and held, the line across it its 95&nbsp;% interval (Wilson) where throws differ. Throws that no arm of this kind \
         could have reached in time, by the oracle, are counted apart. Each step leads to its report, with its misses.</p>\n",
        figures(&climb),
    );
    for (heading, steps) in [("One after the other", climb), ("One at a time, all others kept", alone)] {
        if let Some(first) = steps.first() {
            let _ = write!(
                body,
                "<h2>{heading}</h2>\n<div class=\"ladder\" style=\"--objects:{}\">\n",
                first.objects.len()
            );
            let name = |it: &CellSummary| format!("<b>{}</b>", text_in_html(&it.object.replace('_', " ")));
            let names: String = first.objects.iter().map(name).collect();
            let _ = writeln!(body, "<div class=\"rung head\"><span></span>{names}</div>");
            steps.iter().for_each(|step| body += &rung(step, report));
            body += "</div>\n";
        }
    }
    body += &table(steps);
    let style = format!("{STYLE}{REPORT_STYLE}");
    fill(PAGE, &[("title", &format!("Ladder · {trials} throws")), ("style", &style), ("body", &body)])
}

/// The ends of the climb in large figures.
fn figures(climb: &[&StepSummary]) -> String {
    let fraction = |step: &StepSummary| {
        let sum = |of: &dyn Fn(&CellSummary) -> usize| step.objects.iter().map(of).sum::<usize>();
        percent(sum(&|it| it.caught) as f64 / sum(&within_reach).max(1) as f64)
    };
    let broken: usize = climb.iter().flat_map(|step| &step.objects).map(|it| it.limit_violations).sum();
    let mut figures = Vec::new();
    if let [first, .., last] = climb {
        figures.push((fraction(first), "caught under the paper's assumptions"));
        figures.push((fraction(last), "caught under none of them"));
    }
    figures.push((broken.to_string(), "limits of the arm broken"));
    let figures: String = figures.iter().map(|(value, label)| format!("<div><b>{value}</b>{label}</div>")).collect();
    format!("<div class=\"big\">{figures}</div>\n")
}

/// Of which throws the fraction is taken: those within reach, or all where that is not known.
fn within_reach(it: &CellSummary) -> usize {
    it.within_reach().unwrap_or(it.trials)
}

fn fraction_of(it: &CellSummary) -> f64 {
    it.caught as f64 / within_reach(it).max(1) as f64
}

/// A step: what it removes, and a bar for each object.
fn rung(step: &StepSummary, report: &str) -> String {
    let bars = step.objects.iter().map(|it| {
        let mut marks = vec![Mark::Bar(0.0, fraction_of(it))];
        marks.extend(it.wilson95_within_reach.map(|[low, high]| Mark::Range(low, high)));
        format!("<div>{}<span class=\"value\">{} of {}</span></div>", track(&marks, false), it.caught, within_reach(it))
    });
    let about = match step.removes {
        "nothing" => "as the paper".to_owned(),
        removes => format!("removes {removes}"),
    };
    format!(
        "<div class=\"rung\"><span><a href=\"{}/{report}\">{}</a><small>{}</small></span>{}</div>\n",
        text_in_html(&step.step),
        text_in_html(&step.step.replace('-', " ")),
        text_in_html(&about),
        bars.collect::<String>(),
    )
}

/// All figures, step by step.
fn table(steps: &[StepSummary]) -> String {
    let mut html = "<h2>In numbers</h2><div class=\"scroll\"><table><tr><th>step</th><th>object</th>\
                    <th class=\"n\">caught</th><th class=\"n\">within reach</th><th class=\"n\">fraction</th><th class=\"n\">95 %</th>\
                    <th class=\"n\">out of reach</th><th class=\"n\">limits broken</th><th>misses</th></tr>\n"
        .to_owned();
    for (step, it) in steps.iter().flat_map(|step| step.objects.iter().map(move |it| (step, it))) {
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
            removes: "the vacuum",
            objects: vec![CellSummary::of(object, "near", &[], false)],
        }
    }

    #[test]
    fn every_step_has_its_bar_and_its_link() {
        let page = ladder_page(1, &["01-paper", "02-drag", "only-drag"].map(|name| step(name, "ball")), "report.html");
        assert_eq!(page.matches("class=\"bar\"").count(), 3);
        for name in ["01-paper", "02-drag", "only-drag"] {
            assert_eq!(page.matches(&format!("href=\"{name}/report.html\"")).count(), 1, "{name}");
        }
        // Steps alone are no part of the climb.
        let alone = page.find("One at a time").unwrap();
        assert!(page.find("02 drag").unwrap() < alone && page.find("only drag").unwrap() > alone);
    }

    #[test]
    fn names_cannot_break_out_of_the_page() {
        let clean = ladder_page(1, &[step("01-paper", "ball")], "report.html");
        let hostile = "\"><script>alert(1)</script><img src=x onerror='alert(2)'>";
        let page = ladder_page(1, &[step(hostile, hostile)], "report.html");
        for mark in ["<script", "</script", "<img", "href="] {
            assert_eq!(page.matches(mark).count(), clean.matches(mark).count(), "{mark}");
        }
    }
}
