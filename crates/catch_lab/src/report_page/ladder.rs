//! The ladder as a page: how many throws are caught as one assumption after the other falls.

use super::{
    PAGE, REPORT_STYLE, percent,
    rows::{Mark, Scale, row},
};
use crate::{
    VERSION,
    catch_page::{STYLE, fill},
    ladder::StepSummary,
    packed::text_in_html,
    statistics::CellSummary,
};

/// The page of a ladder.
pub fn ladder_page(seed: u64, steps: &[StepSummary]) -> String {
    let trials: usize = steps.iter().flat_map(|step| &step.objects).map(|it| it.trials).sum();
    let mut body = format!(
        "<h1>From the paper to an honest arena</h1><p class=\"faint\">{trials} throws, seed {seed}, CatchingBot {VERSION}</p>\n\
         <p class=\"faint\">Each step takes one assumption of the paper away. The bar is the share of the throws within reach that \
         was caught and held, the dark line its 95 % interval (Wilson) where throws differ. Throws that no arm of this kind could have reached in time, by \
         the oracle, are counted apart.</p>\n"
    );
    let objects: Vec<&str> =
        steps.first().into_iter().flat_map(|it| &it.objects).map(|it| it.object.as_str()).collect();
    let (alone, climb): (Vec<&StepSummary>, Vec<_>) = steps.iter().partition(|step| step.step.starts_with("only-"));
    for (heading, steps) in [("One after the other", climb), ("One at a time", alone)] {
        if steps.is_empty() {
            continue;
        }
        body += &format!("<h2>{heading}</h2>\n");
        for (i, object) in objects.iter().enumerate() {
            body += &format!("<h3>{}</h3>\n", text_in_html(&object.replace('_', " ")));
            for step in &steps {
                if let Some(it) = step.objects.get(i) {
                    body += &rung(step, it);
                }
            }
            body += &Scale::SHARE.axis();
        }
    }
    body += &table(steps);
    let style = format!("{STYLE}{REPORT_STYLE}");
    fill(PAGE, &[("title", &format!("Ladder · {trials} throws")), ("style", &style), ("body", &body)])
}

fn rung(step: &StepSummary, it: &CellSummary) -> String {
    let within_reach = it.trials - it.out_of_reach;
    let mut marks = vec![Mark::Bar(0.0, it.caught as f64 / within_reach.max(1) as f64)];
    marks.extend(it.wilson95_within_reach.map(|[low, high]| Mark::Range(low, high)));
    row(&step.step.replace('-', " "), &marks, &format!("{} of {within_reach}", it.caught), false)
}

/// All figures, step by step.
fn table(steps: &[StepSummary]) -> String {
    let mut html = "<h2>In numbers</h2><div class=\"scroll\"><table><tr><th>step</th><th>removes</th><th>object</th>\
                    <th class=\"n\">caught</th><th class=\"n\">within reach</th><th class=\"n\">share</th>\
                    <th class=\"n\">limits broken</th><th>misses</th></tr>\n"
        .to_owned();
    for (step, it) in steps.iter().flat_map(|step| step.objects.iter().map(move |it| (step, it))) {
        let within_reach = it.trials - it.out_of_reach;
        let reasons: Vec<String> = it.reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
        let share = percent(it.caught as f64 / within_reach.max(1) as f64);
        html += &format!(
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{within_reach}</td><td class=\"n\">{share}</td>\
             <td class=\"n\">{}</td><td>{}</td></tr>\n",
            text_in_html(&step.step),
            text_in_html(step.removes),
            text_in_html(&it.object),
            it.caught,
            it.limit_violations,
            text_in_html(&reasons.join(", ")),
        );
    }
    html + "</table></div>\n"
}
