//! Two evaluations of the same throws as one page: counts, and a link to each throw in which they differ.

use std::{
    collections::BTreeMap,
    fmt::Write,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_lab::{
    VERSION,
    assets::Origin,
    evaluation::{
        Identity,
        comparison::{Comparison, Counts, Pair},
    },
    parallel,
    scenario::setup::{Choice, Setup},
};
use catch_recording::whole_file;

use super::{
    packed::text_in_html,
    pair_page,
    report_page::{recorded, report_document},
};

/// Pairs that get a page, the first ones in which the evaluations differ.
pub const MOST_PAIRS: usize = 20;
/// Folder of the pairs' pages beside the comparison.
const FOLDER: &str = "pairs";

/// Throws the first pairs that differ once more, on so many threads, and writes a page of each; returns the
/// pages' paths relative to `folder` by the index of their pair.
///
/// # Errors
/// Scenarios that cannot be made from what their results say; files that cannot be written.
pub fn record_pairs(
    comparison: &Comparison,
    names: [&str; 2],
    threads: usize,
    folder: &Path,
) -> Result<BTreeMap<usize, String>, InputError> {
    let differs = |(_, pair): &(usize, &Pair)| pair.caught[0] != pair.caught[1];
    let pairs: Vec<(usize, &Pair)> = comparison.pairs.iter().enumerate().filter(differs).take(MOST_PAIRS).collect();
    let written = parallel::map_on(threads, pairs.len(), |at| {
        let (i, pair) = pairs[at];
        let [a, b] = [0, 1].map(|side| {
            let identity = &comparison.identities[side];
            let setup = setup_of(identity, pair)?;
            recorded(&setup, (identity.seed, pair.index), &folder.join(FOLDER).join(["a", "b"][side]))
        });
        let ((_, a), (_, b)) = (a?, b?);
        let name = format!("{}-{}-{}.html", pair.object, pair.throw, pair.index).replace(['/', '\\'], "_");
        whole_file::write(&folder.join(FOLDER).join(&name), pair_page::page([(names[0], &a), (names[1], &b)]))?;
        Ok((i, format!("{FOLDER}/{name}")))
    });
    written.into_iter().collect()
}

/// The setup of a pair's throw in an evaluation.
fn setup_of(identity: &Identity, pair: &Pair) -> Result<Setup, InputError> {
    let fits = |it: &&catch_lab::scenario::Scenario| it.object == pair.object && it.throw == pair.throw;
    let scenario = identity.cells.iter().find(fits).unwrap_or(&identity.cells[0]).clone();
    let name = scenario.name.clone();
    Setup::of_scenario(scenario, &name, &Origin::Disk(PathBuf::new()), &Choice::default())
}

/// The page of a comparison; `pages` are those of its pairs.
pub fn page(comparison: &Comparison, names: [&str; 2], pages: &BTreeMap<usize, String>) -> String {
    let [a, b] = names.map(text_in_html);
    let scenarios = comparison.identities.each_ref().map(|it| text_in_html(&it.cells[0].name));
    let mut html = format!(
        "<h1>{a} and {b}</h1><p class=\"faint\">scenarios {} and {}, seed {}, CatchingBot {VERSION}</p>\n\
         <p class=\"faint\">The same throws, paired. The difference is the rate of the second less that of the first, with its \
         95&nbsp;% interval from the throws that differ; <i>p</i> is McNemar's exact test.</p>\n\
         <div class=\"scroll\"><table><tr><th>object, throw</th><th class=\"n\">throws</th><th class=\"n\">both</th>\
         <th class=\"n\">only {a}</th><th class=\"n\">only {b}</th><th class=\"n\">neither</th><th class=\"n\">difference</th>\
         <th class=\"n\">95&nbsp;%</th><th class=\"n\">p</th></tr>\n",
        scenarios[0], scenarios[1], comparison.identities[0].seed,
    );
    for (name, it) in comparison.counts() {
        let cells: String = figures(&it).map(|cell| format!("<td class=\"n\">{cell}</td>")).concat();
        let _ = writeln!(html, "<tr><td>{}</td>{cells}</tr>", text_in_html(&name.replace('_', " ")));
    }
    html += "</table></div>\n";
    for (heading, caught) in
        [(format!("Only {a}"), [true, false]), (format!("Only {b}"), [false, true]), ("Neither".to_owned(), [false; 2])]
    {
        let _ = writeln!(html, "<h2>{heading}</h2><ul>");
        for (i, pair) in comparison.pairs.iter().enumerate().filter(|(_, pair)| pair.caught == caught) {
            let name = text_in_html(&format!("{}, throw {}", pair.name(), pair.index).replace('_', " "));
            let name =
                pages.get(&i).map_or(name.clone(), |page| format!("<a href=\"{}\">{name}</a>", text_in_html(page)));
            let reasons: Vec<String> = pair.reasons.iter().flatten().map(|it| text_in_html(&it.to_string())).collect();
            let _ = write!(html, "<li>{name} <span class=\"faint\">{}</span></li>", reasons.join("; "));
        }
        html += "</ul>\n";
    }
    report_document(&format!("{} and {}", names[0], names[1]), &html)
}

/// The throws of both, and how they differ: the columns of a comparison.
pub fn figures(it: &Counts) -> [String; 8] {
    let [throws, both, only_a, only_b, neither] =
        [it.trials, it.both, it.only_a, it.only_b, it.neither].map(|count| count.to_string());
    let points = |difference: f64| format!("{:+.1}", difference * 100.0).replace('-', "−");
    let [low, high] = it.difference95.map(points);
    let (difference, interval) = (points(it.difference) + " %", format!("{low} – {high} %"));
    [throws, both, only_a, only_b, neither, difference, interval, format!("{:.2}", it.mcnemar_p)]
}
