//! The pages of `docs/reference` that are generated from doc comments, defaults, ranges and the command
//! line's own help. They are compared here, and written anew by
//! `UPDATE=1 cargo test --release -p catch_cli --test it reference`.

mod doc_comments;
mod sections;

use std::{
    collections::BTreeMap,
    env,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use catch_lab::{
    assets::{Asset, Origin},
    scenario::Scenario,
};
use clap::Command;
use doc_comments::{Field, Item, items, snake};
use parquet::{
    basic::{ConvertedType, Type},
    file::reader::{FileReader, SerializedFileReader},
};
use sections::{ELSEWHERE, FILES, REACH, RECORDINGS, RELEASE, ROWS, SCENARIO, STATUSES, Section};
use toml::{Table, Value};

const GENERATED: &str = "This page is generated from the sources; changes by hand get lost.";
/// A scenario that leaves everything out that has a default.
const LEAST: &str = "name = ''\ndescription = ''\nrobot = ''\ngripper = ''\nobject = ''\nthrow = ''\ncamera = ''\nflight_rig = ''\nreference_rig = ''";

#[test]
fn commands_are_as_the_program_has_them() {
    let mut page = format!("# Commands\n\n{GENERATED} The program prints the same with `--help`.\n");
    let mut command = catch_cli::command().term_width(100);
    command.build();
    push_command(&mut page, &command, "catchingbot");
    is_current("commands.md", &page);
}

fn push_command(page: &mut String, command: &Command, name: &str) {
    let help = command.clone().render_long_help().to_string();
    let help: Vec<&str> = help.lines().map(str::trim_end).collect();
    let _ = write!(page, "\n## {name}\n\n```text\n{}\n```\n", help.join("\n"));
    for inner in command.get_subcommands().filter(|it| it.get_name() != "help") {
        push_command(page, inner, &format!("{name} {}", inner.get_name()));
    }
}

#[test]
fn settings_are_as_the_sources_have_them() {
    let about = "Every setting of a scenario, with its default and the values that it may have. A setting is a field of a TOML file, \
                 or an argument: `--set arena.friction=0.3`. What a file leaves out has the default; the built-in scenarios set some \
                 of them otherwise (`catchingbot list --show paper`). Without a default a setting is required, or optional and unset.";
    is_current("scenario.md", &tables("Scenario", about, SCENARIO));
}

#[test]
fn files_are_as_the_sources_have_them() {
    let about = "Every field of the TOML files of robots, grippers, workcells, objects, throws and rigs, and of what `learn` writes. \
                 `catchingbot check FILE` tells what is wrong with one, and `catchingbot list --show NAME` prints those that are built in.";
    is_current("files.md", &tables("Files", about, FILES));
}

#[test]
fn statuses_are_as_the_sources_have_them() {
    let about = "Words that results, recordings and the story use.";
    is_current("statuses.md", &tables("Statuses and reasons", about, STATUSES));
}

#[test]
fn recordings_are_as_the_sources_have_them() {
    let about = "A recording (`*.catch`) is a gzip file of MessagePack maps with named fields, one after the other: a header, one tick \
                 for each decision of the brain, and an ending. In a recording of a real cell the parts that only a simulation knows \
                 are absent. `zcat FILE | msgpack2json -c` reads it. The same scene gives the same bytes.";
    is_current("recordings.md", &tables("Recordings", about, RECORDINGS));
}

/// No file of a user has a table that no page shows.
#[test]
fn every_table_of_a_file_is_on_a_page() {
    let on_pages = SCENARIO.iter().chain(FILES).map(|it| it.source);
    let shown: Vec<(&str, &str)> = on_pages.chain(ELSEWHERE.iter().copied()).collect();
    for file in sources() {
        let name = file.strip_prefix(root().join("crates")).unwrap().to_str().unwrap().to_owned();
        for item in items(&fs::read_to_string(&file).unwrap()).into_iter().filter(|it| it.is_strict) {
            let is_shown = shown.iter().any(|(file, shown)| *file == name && *shown == item.name);
            assert!(is_shown, "{name}: {} stands on no page of docs/reference; see sections.rs", item.name);
        }
    }
}

/// Rust sources of all crates, modules for tests aside.
fn sources() -> Vec<PathBuf> {
    fn below(folder: &Path) -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.flat_map(|path| if path.is_dir() { below(&path) } else { vec![path] }).collect()
    }
    let crates = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path().join("src"));
    crates
        .filter(|it| it.is_dir())
        .flat_map(|it| below(&it))
        .filter(|it| it.extension().is_some_and(|it| it == "rs"))
        .collect()
}

/// A page with a table for each section.
fn tables(title: &str, about: &str, sections: &[Section]) -> String {
    let ranges = ranges();
    let mut page = format!("# {title}\n\n{GENERATED}\n\n{about}\n");
    for section in sections {
        let item = item(section.source);
        assert!(!item.doc.is_empty(), "{:?} says nothing of itself", section.source);
        let _ = write!(page, "\n## {}\n\n{}\n", section.heading, plain(&item.doc));
        let rows: Vec<[String; 5]> = item.fields.iter().map(|field| row(section, field, &ranges)).collect();
        let titles = ["", "type", "default", "range", "meaning"];
        let kept: Vec<usize> =
            (0..titles.len()).filter(|i| [0, 4].contains(i) || rows.iter().any(|row| !row[*i].is_empty())).collect();
        let line = |cells: Vec<&str>| format!("| {} |\n", cells.join(" | "));
        page.push('\n');
        page.push_str(&line(kept.iter().map(|i| titles[*i]).collect()));
        page.push_str(&line(kept.iter().map(|_| "---").collect()));
        for row in &rows {
            page.push_str(&line(kept.iter().map(|i| row[*i].as_str()).collect()));
        }
    }
    page
}

fn row(section: &Section, field: &Field, ranges: &BTreeMap<String, String>) -> [String; 5] {
    let (file, item) = section.source;
    assert!(!field.doc.is_empty(), "{file}: {item}.{} says nothing of itself", field.name);
    let path = if section.path.is_empty() { field.name.clone() } else { format!("{}.{}", section.path, field.name) };
    let has_defaults = !section.path.is_empty() || section.heading == "The file";
    let default = has_defaults.then(|| default(&path, section.with)).flatten();
    let range = field.quantity.as_ref().map_or_else(String::new, |name| ranges[name].clone());
    let default = default.map_or(String::new(), |it| format!("`{it}`"));
    let mut holds = kind(&field.kind);
    if SCENARIO.iter().any(|it| it.heading == path && has_defaults) {
        holds = format!("[{holds}](#{})", path.replace('.', ""));
    }
    [format!("`{}`", field.name), holds, default, range, plain(&field.doc).replace('|', "\\|")]
}

/// Describes the values of a field, in words.
fn kind(rust: &str) -> String {
    let inside = |name: &str| rust.strip_prefix(name)?.strip_prefix('<')?.strip_suffix('>');
    if let Some(inner) = inside("Option") {
        return format!("{}, optional", kind(inner));
    }
    if let Some(inner) = inside("Stated") {
        return kind(inner);
    }
    if let Some(inner) = inside("Vec") {
        return format!("list of {}", plural(&kind(inner)));
    }
    if let Some((inner, length)) = rust.strip_prefix('[').and_then(|it| it.strip_suffix(']')?.rsplit_once("; ")) {
        // `free_flight::PARAMETERS`.
        let length = if length == "PARAMETERS" { "19" } else { length };
        return format!("{length} {}", plural(&kind(inner)));
    }
    let known = match rust {
        "f64" | "f32" => "number",
        "usize" | "u8" | "u32" | "u64" => "whole number",
        "bool" => "true or false",
        "String" => "text",
        "" => "",
        "Pose" => "pose",
        "JointVector" => "joint values",
        "Span" => "2 numbers",
        "Drawn" => "number or `{ min, max }`",
        "GripperDriveKind" => "`ideal`, `real` or `position`",
        "GripperTrigger" => "`command` or `proximity`",
        "Method" => "`ours` or `paper`",
        "Clock" | "DepthModel" | "Combine" => "name, or table",
        _ => "table",
    };
    known.to_owned()
}

fn plural(kind: &str) -> String {
    match kind {
        "true or false" | "joint values" => kind.to_owned(),
        _ if kind.starts_with(|it: char| it.is_ascii_digit()) => format!("lists of {kind}"),
        "text" => "texts".to_owned(),
        _ if kind.starts_with("list of") => kind.replacen("list", "lists", 1),
        _ => format!("{kind}s"),
    }
}

/// Doc comments without links of rustdoc.
fn plain(doc: &str) -> String {
    let mut text = String::new();
    let mut rest = doc;
    while let Some((before, link)) = rest.split_once('[') {
        text.push_str(before);
        let is_link = link.starts_with('`') || link.split_once("](").is_some_and(|(name, _)| !name.contains(']'));
        let Some((name, after)) = link.split_once(']').filter(|_| is_link) else {
            text.push('[');
            rest = link;
            continue;
        };
        text.push_str(name);
        rest = after.strip_prefix('(').and_then(|it| it.split_once(')')).map_or(after, |(_, after)| after);
    }
    text.push_str(rest);
    text
}

/// A scenario of which nothing is said but what must be.
fn least() -> Scenario {
    let (name, file) = (String::new(), "least".to_owned());
    Scenario::of_asset(&Asset { name, file, text: LEAST.to_owned(), origin: Origin::BuiltIn(PathBuf::new()) }).unwrap()
}

/// The default of a setting, which has none or is a table of its own otherwise.
fn default(path: &str, with: &str) -> Option<String> {
    let settings = if with.is_empty() { vec![] } else { vec![with.to_owned()] };
    let scenario = least().with_settings(&settings).unwrap();
    let scenario = Table::try_from(scenario).unwrap();
    let mut found = &Value::Table(scenario);
    for key in path.split('.') {
        found = found.get(key)?;
    }
    let is_left_out = LEAST.lines().any(|line| line.split(" = ").next() == Some(path));
    (!is_left_out && !found.is_table()).then(|| found.to_string())
}

/// The ranges of checked quantities, by the functions that read them.
fn ranges() -> BTreeMap<String, String> {
    let source = fs::read_to_string(root().join("crates/catch_body/src/quantity.rs")).unwrap();
    let range = |line: &str| {
        let (names, range) = line.trim().split_once(" = ")?;
        let (range, unit) = range.strip_suffix("\";")?.split_once(" \"")?;
        let (least, most) = range.split_once(" to ")?;
        let number =
            |text: &str| text.parse().map(|it: f64| if it.abs() < 1e6 { it.to_string() } else { format!("{it:e}") });
        let (name, _) = names.split_once(' ')?;
        Some((name.to_owned(), format!("{} to {} {unit}", number(least).ok()?, number(most).ok()?).trim().to_owned()))
    };
    source.lines().filter_map(range).collect()
}

#[test]
fn columns_are_those_of_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let output = crate::catchingbot(&["eval", "--scenario", "paper", "--trials", "1", "--out", out.to_str().unwrap()]);
    assert!(output.status.success(), "{}", crate::stderr(&output));
    let file = fs::File::open(out.join("trials.parquet")).unwrap();
    let reader = SerializedFileReader::new(file).unwrap();
    let fields: Vec<Field> = ROWS.iter().flat_map(|source| item(*source).fields).collect();
    let (reach, release) = (item(REACH).fields, item(RELEASE).fields);
    let mut page = format!(
        "# Columns\n\n{GENERATED}\n\nColumns of `trials.parquet` and `trials.csv`, one row per trial. Lengths are in metres, angles in \
         radians, times in seconds of the cell's clock, as the names say; ratios are of the arm's limits. An empty value was not measured, \
         such as the error of a prediction that there was not. Lines of `trials.jsonl` have the same fields, and `first_violation`; \
         what was drawn for the throw stands there under `conditions`, as in [recordings](recordings.md#conditions-of-object-and-flight).\n\n\
         | column | type | meaning |\n| --- | --- | --- |\n"
    );
    for column in reader.metadata().file_metadata().schema_descr().columns() {
        let name = column.name();
        let kind = match (column.physical_type(), column.converted_type()) {
            (Type::BYTE_ARRAY, _) => "text",
            (Type::BOOLEAN, _) => "true or false",
            (Type::DOUBLE, _) => "number",
            (Type::INT64 | Type::INT32, ConvertedType::NONE | ConvertedType::UINT_64 | ConvertedType::INT_64) => {
                "whole number"
            }
            other => panic!("{name}: {other:?}"),
        };
        let of = |fields: &[Field], name: &str| fields.iter().find(|it| it.name == name).map(|it| plain(&it.doc));
        let lead = name.strip_prefix("prediction_error_").and_then(|it| it.strip_suffix("ms_before_m"));
        let meaning = match (name.strip_prefix("reach_"), lead) {
            (Some(reached), _) => of(&reach, reached)
                .map(|it| format!("{it} Only misses have it; it is empty where the oracle found no catch.")),
            (_, Some(lead)) => Some(format!(
                "How far off the object's position at the catch was predicted {lead} ms before the catch."
            )),
            _ => of(&fields, name)
                .or_else(|| component(name, |field| of(&release, field).or_else(|| of(&fields, field)))),
        };
        let meaning = meaning.unwrap_or_else(|| panic!("{name} says nothing of itself")).replace('|', "\\|");
        let _ = writeln!(page, "| `{name}` | {kind} | {meaning} |");
    }
    is_current("columns.md", &page);
}

/// The meaning of a column that is one component of a field: which, and of what.
fn component(name: &str, of: impl Fn(&str) -> Option<String>) -> Option<String> {
    let (field, axis) = match name.strip_prefix("release_") {
        None => ("wind_mps", name.strip_prefix("wind_")?.strip_suffix("_mps")?),
        Some(name) if name.starts_with('q') => ("orientation_xyzw", &name[1..]),
        Some(name) if name.starts_with("spin_") => ("spin_radps", name[5..].strip_suffix("_radps")?),
        Some(name) if name.starts_with('v') => ("velocity_mps", name[1..].strip_suffix("_mps")?),
        Some(name) => ("position_m", name.strip_suffix("_m")?),
    };
    Some(format!("{} Component {axis}.", of(field)?))
}

fn item((file, name): (&str, &str)) -> Item {
    let source = fs::read_to_string(root().join("crates").join(file)).unwrap_or_else(|fault| panic!("{file}: {fault}"));
    items(&source).into_iter().find(|it| it.name == name).unwrap_or_else(|| panic!("{file} has no {name}"))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}

/// Compares a page with what it should be, or writes it.
fn is_current(name: &str, page: &str) {
    let path = root().join("docs/reference").join(name);
    if env::var_os("UPDATE").is_some() {
        fs::write(&path, page).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    let differs = page.lines().zip(found.lines().chain([""])).find(|(expected, found)| expected != found);
    let how = "write it anew: UPDATE=1 cargo test --release -p catch_cli --test it reference";
    assert!(found == page, "docs/reference/{name} is not current ({differs:?}); {how}");
}

#[test]
fn links_of_rustdoc_become_plain() {
    assert_eq!(
        plain("A [`Header`], [here](crate::x), and [1, 2]; `snake` is not."),
        "A `Header`, here, and [1, 2]; `snake` is not."
    );
    assert_eq!(snake("OutOfReach"), "out_of_reach");
}
