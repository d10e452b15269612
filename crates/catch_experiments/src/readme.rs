//! README's table of catch rates, from the result pages.

use std::{fs, path::Path};

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::results::{Entry, Table};

#[derive(Deserialize)]
struct Listed {
    objects: Vec<String>,
    line: Vec<Line>,
}

#[derive(Deserialize)]
struct Line {
    page: String,
    /// Part of the title of the page's table.
    table: String,
    condition: Vec<String>,
    /// Arm, hand and cameras.
    name: String,
}

#[derive(Deserialize)]
struct Page {
    tables: Vec<Table>,
}

/// Head of the table, before the objects.
const HEAD: &str = "| arm | hand | cameras | throws of each |";

/// Brings the table of README up to date with the pages.
pub fn update(pages: &Path) -> Result<()> {
    let readme = fs::read_to_string("README.md").context("README.md")?;
    fs::write("README.md", updated(&readme, pages)?).context("README.md")
}

/// README with its table, which ends at an empty line, as the pages in a folder have it.
fn updated(readme: &str, pages: &Path) -> Result<String> {
    let Listed { objects, line } = toml::from_str(include_str!("readme.toml")).context("readme.toml")?;
    let begin = readme.find(HEAD).with_context(|| format!("README.md: found no table `{HEAD}`"))?;
    let end = readme[begin..].find("\n\n").map_or(readme.len(), |length| begin + length);
    let names: String = objects.iter().map(|it| format!(" {}, % |", it.replace('_', " "))).collect();
    let mut table = format!("{HEAD}{names}\n|{}", "---|".repeat(4 + objects.len()));
    for line in &line {
        let found = objects.iter().map(|object| rate(line, object, pages)).collect::<Result<Vec<_>>>()?;
        let cells: String = found.iter().map(|[_, caught]| format!(" {caught} |")).collect();
        table += &format!("\n| {} | {} |{cells}", line.name, found[0][0]);
    }
    Ok([&readme[..begin], &table, &readme[end..]].concat())
}

/// Trials and rate of a line's condition with an object.
fn rate(line: &Line, object: &str, pages: &Path) -> Result<[String; 2]> {
    let file = pages.join(format!("{}.json", line.page));
    let text = fs::read(&file).with_context(|| file.display().to_string())?;
    let Page { tables } = serde_json::from_slice(&text).with_context(|| file.display().to_string())?;
    let words = || line.condition.iter().map(String::as_str).chain([object]);
    let is_meant = |row: &&Vec<Entry>| words().zip(*row).all(|(word, entry)| *entry == Entry::text(word));
    let found = tables.iter().filter(|it| it.title.contains(&line.table)).find_map(|table| {
        let row = table.rows.iter().find(is_meant)?;
        let cell = |name: &str| table.columns.iter().zip(row).find(|it| it.0 == name).map(|it| it.1.markdown());
        Some([cell("trials")?, cell("caught, %")?])
    });
    found.with_context(|| format!("{}: found no rate of {:?} with {object}", file.display(), line.condition))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_readme_has_the_rates_of_the_pages() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let readme = fs::read_to_string(root.join("README.md")).unwrap();
        let updated = updated(&readme, &root.join("docs/results")).unwrap();
        assert!(readme == updated, "`catch_experiments -- readme` makes:\n{updated}");
    }
}
