//! The rules of prose: sentences are short, words are those of the field, links lead somewhere, and every
//! page is in the contents.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    source::{read, root},
    standard_terms::GIVEN_UP,
};

/// The longest sentence, and the mean of a page, in words.
const LONGEST: usize = 40;
const MEAN: f64 = 18.0;
/// Pages with fewer sentences have no mean to speak of.
const FEW_SENTENCES: usize = 8;
const README_WORDS: usize = 900;

/// Words in a row that the docs have given up besides those of identifiers, and what stands for them.
const GIVEN_UP_IN_DOCS: &[(&str, &str)] = &[
    ("put off", "failure penalty"),
    ("puts off", "failure penalty"),
    ("on the brink", "marginal"),
    ("out of its mind", "diverged"),
    ("ways of holding", "grasp candidates"),
    ("until lately", "the present state"),
    ("as it was before", "the present state"),
    ("an earlier state", "the present state"),
];

/// Every page for people: at the root, and below `docs`.
fn pages() -> Vec<PathBuf> {
    let at_root = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|name| root().join(name));
    let mut pages: Vec<PathBuf> = at_root.into_iter().chain(below(&root().join("docs"))).collect();
    pages.sort();
    pages
}

fn below(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => below(&path),
            false => Vec::from_iter(path.extension().is_some_and(|it| it == "md").then_some(path)),
        })
        .collect()
}

/// A page's text without blocks of code.
fn without_blocks(text: &str) -> String {
    let mut inside = false;
    let outside = |line: &&str| {
        let is_fence = line.trim_start().starts_with("```");
        inside ^= is_fence;
        !inside && !is_fence
    };
    text.lines().filter(outside).collect::<Vec<_>>().join("\n")
}

/// The sentences of a page: no tables, headings, quotes or pictures; code stands as one letter, a link as its
/// text.
fn sentences(text: &str) -> Vec<String> {
    let prose = without_blocks(text);
    let prose = prose.lines().filter(|line| !line.trim_start().starts_with(['|', '#', '!', '>']));
    let mut paragraphs = vec![String::new()];
    for line in prose {
        let line = line.trim();
        let item = line.trim_start_matches(|it: char| it.is_ascii_digit() || it == '*' || it == '-');
        let begins_item = item.len() < line.len() && item.trim_start_matches(['.', ')']).starts_with(' ');
        if line.is_empty() || begins_item {
            paragraphs.push(String::new());
        }
        let paragraph = paragraphs.last_mut().unwrap();
        paragraph.push(' ');
        paragraph.push_str(if begins_item { item } else { line });
    }
    paragraphs.iter().flat_map(|paragraph| split(&link_texts(&spans(paragraph)))).collect()
}

/// The text with each span of code as one letter.
fn spans(text: &str) -> String {
    text.split('`').enumerate().map(|(i, part)| if i % 2 == 0 { part } else { "x" }).collect()
}

/// The text with each link as its text.
fn link_texts(text: &str) -> String {
    let mut parts = text.split("](");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        plain.push_str(part.split_once(')').map_or(part, |(_, rest)| rest));
    }
    plain.replace('[', "")
}

/// A sentence ends in `.`, `!` or `?` before a capital letter, a bracket or a quotation mark.
fn split(paragraph: &str) -> Vec<String> {
    let mut sentences = vec![String::new()];
    for word in paragraph.split_whitespace() {
        let sentence = sentences.last_mut().unwrap();
        let begins = word.starts_with(|it: char| it.is_ascii_uppercase() || "(“\"".contains(it));
        if begins && sentence.ends_with(['.', '!', '?']) {
            sentences.push(word.to_owned());
        } else {
            sentence.push(' ');
            sentence.push_str(word);
        }
    }
    sentences
}

/// Words begin with a letter and go on with letters, digits, hyphens and apostrophes.
fn words(sentence: &str) -> usize {
    let mut inside = false;
    let begins = |letter: char| {
        let before = inside;
        inside = if inside { letter.is_alphanumeric() || "_'-".contains(letter) } else { letter.is_ascii_alphabetic() };
        inside && !before
    };
    sentence.chars().map(begins).filter(|it| *it).count()
}

#[test]
fn sentences_are_short() {
    let mut faults = Vec::new();
    for page in pages() {
        let sentences: Vec<(usize, String)> =
            sentences(&read(&page)).into_iter().map(|it| (words(&it), it)).filter(|(words, _)| *words > 2).collect();
        let long = sentences.iter().filter(|(words, _)| *words > LONGEST);
        faults.extend(long.map(|(words, sentence)| format!("{}: {words} words:{sentence}", page.display())));
        let mean = sentences.iter().map(|(words, _)| *words as f64).sum::<f64>() / sentences.len() as f64;
        if sentences.len() >= FEW_SENTENCES && mean > MEAN {
            faults.push(format!("{}: {mean:.1} words a sentence", page.display()));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn words_that_were_given_up_stay_out_of_docs() {
    let mut faults = Vec::new();
    for page in pages().into_iter().filter(|page| !page.ends_with("glossary.md")) {
        let text = link_texts(&spans(&without_blocks(&read(&page)))).to_lowercase();
        // Words in a row have no punctuation between them.
        let text = text.replace(|it: char| !it.is_alphanumeric() && !it.is_whitespace(), " . ");
        let text = format!(" {} ", text.split_whitespace().collect::<Vec<_>>().join(" "));
        let given_up = GIVEN_UP.iter().chain(GIVEN_UP_IN_DOCS).map(|(word, instead)| (word.replace('_', " "), instead));
        let found =
            given_up.filter(|(word, _)| text.contains(&format!(" {word} ")) || text.contains(&format!(" {word}s ")));
        faults.extend(found.map(|(word, instead)| format!("{}: {instead}, not {word}", page.display())));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_readme_is_short() {
    let words = read(&root().join("README.md")).split_whitespace().count();
    assert!(words <= README_WORDS, "{words} words");
}

#[test]
fn links_lead_somewhere() {
    let mut faults = Vec::new();
    for page in pages() {
        for link in links(&read(&page)) {
            let (path, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if path.is_empty() { page.clone() } else { page.parent().unwrap().join(path) };
            let is_there =
                target.exists() && (anchor.is_empty() || anchors(&read(&target)).iter().any(|it| it == anchor));
            if !is_there {
                faults.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Returns the targets of the links of a page, without those to other hosts.
fn links(text: &str) -> Vec<String> {
    let text = without_blocks(text);
    let targets = text.split("](").skip(1).filter_map(|part| part.split_once(')')).map(|(target, _)| target.to_owned());
    targets.filter(|target| !target.contains("://")).collect()
}

/// The anchors of a page's headings, as GitHub and mdBook make them.
fn anchors(text: &str) -> Vec<String> {
    let headings = without_blocks(text);
    let headings = headings.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_matches(['#', ' ']));
    let anchor = |heading: &str| -> String {
        let kept = heading.to_lowercase().replace(' ', "-");
        kept.chars().filter(|it| it.is_alphanumeric() || "-_".contains(*it)).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn every_page_is_in_the_contents() {
    let docs = root().join("docs");
    let contents = links(&read(&docs.join("SUMMARY.md")));
    for page in below(&docs) {
        let name = page.strip_prefix(&docs).unwrap().to_str().unwrap();
        assert!(name == "SUMMARY.md" || contents.iter().any(|it| it == name), "docs/SUMMARY.md lacks {name}");
    }
}

#[test]
fn sentences_and_words_are_found() {
    let text = "# No sentence\n\nOne `a b` two. Three [four](five) six?\n* Seven\n```\ncode\n```\n| table |\n";
    let found: Vec<String> =
        sentences(text).iter().map(|it| it.trim().to_owned()).filter(|it| !it.is_empty()).collect();
    assert_eq!(found, ["One x two.", "Three four six?", "Seven"]);
    assert_eq!(words("Gauss–Newton's 24 half-steps of 2 mm"), 5);
    assert_eq!(anchors("## Gripper, throws & air"), ["gripper-throws--air"]);
}
