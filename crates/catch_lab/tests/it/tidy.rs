//! The architecture, as tests: each states an invariant of ARCHITECTURE.md.

use std::{
    collections::{BTreeMap, BTreeSet},
    process::Command,
};

use catch_lab::assets::Kind;
use serde_json::Value;

use crate::source::{is_test_file, read, root, rust_files, string_literals, without_comments, without_test_modules};

/// Crate → the crates of the workspace that it may depend on, for its tests, too.
const CRATES: &[(&str, &[&str])] = &[
    ("catch_quantity", &[]),
    ("catch_body", &["catch_quantity"]),
    ("catch_cell", &["catch_body"]),
    ("catch_bot", &["catch_body", "catch_cell"]),
    ("catch_calibration", &["catch_body", "catch_cell", "catch_bot"]),
    ("catch_paper", &["catch_body", "catch_cell", "catch_bot"]),
    ("catch_sim", &["catch_body", "catch_cell"]),
    ("catch_recording", &["catch_body", "catch_cell", "catch_bot", "catch_paper"]),
    (
        "catch_lab",
        &["catch_body", "catch_cell", "catch_bot", "catch_calibration", "catch_paper", "catch_recording", "catch_sim"],
    ),
    ("catch_import", &["catch_body", "catch_cell", "catch_bot", "catch_recording", "catch_sim", "catch_lab"]),
    (
        "catch_view",
        &["catch_body", "catch_cell", "catch_bot", "catch_calibration", "catch_recording", "catch_sim", "catch_lab"],
    ),
    (
        "catch_cli",
        &[
            "catch_body",
            "catch_cell",
            "catch_bot",
            "catch_calibration",
            "catch_paper",
            "catch_recording",
            "catch_sim",
            "catch_lab",
            "catch_import",
            "catch_view",
        ],
    ),
    (
        "catch_py",
        &["catch_body", "catch_cell", "catch_bot", "catch_recording", "catch_lab", "catch_import", "catch_view"],
    ),
    (
        "catch_experiments",
        &[
            "catch_body",
            "catch_cell",
            "catch_bot",
            "catch_calibration",
            "catch_paper",
            "catch_recording",
            "catch_sim",
            "catch_lab",
            "catch_import",
            "catch_view",
        ],
    ),
];

/// Modules of the brain in the order in which data flows; a module may use only those above it, and nothing
/// of the crate's root.
const STAGES: &[&str] = &[
    "perception",
    "trajectory_prediction",
    "grasp_selection",
    "trajectory_optimization",
    "control",
    "preparation",
    "tracker",
];
/// Modules that stand on the whole brain: they use its root and everything below.
const ABOVE_THE_BRAIN: &[&str] = &["cycle"];
/// Crates, and folders of the brain, whose modules use each other in no circle.
const WITHOUT_CIRCLES: &[&str] = &[
    "catch_body/src",
    "catch_cell/src",
    "catch_bot/src",
    "catch_bot/src/perception",
    "catch_bot/src/trajectory_prediction",
    "catch_bot/src/grasp_selection",
    "catch_bot/src/trajectory_optimization",
    "catch_bot/src/control",
    "catch_calibration/src",
    "catch_paper/src",
    "catch_recording/src",
    "catch_sim/src",
    "catch_lab/src",
    "catch_import/src",
    "catch_view/src",
    "catch_cli/src",
    "catch_experiments/src",
    "catch_py/src",
];

const MAX_LINES: usize = 350;
const MOST_COLUMNS: usize = 110;
const BANNED_NAMES: &[&str] = &["utils", "util", "helpers", "helper", "common", "misc", "types"];

/// Parts of the standard library that the brain and the models that it uses must not touch: clocks, files,
/// the environment.
const BANNED_MODULES: &[&str] = &["fs", "time", "env", "net", "process", "thread"];
/// Names that the brain must not use besides: global random state, output, clocks.
const BANNED_IN_BRAIN: &[&str] = &[
    "std::io",
    "thread_local!",
    "Instant",
    "SystemTime",
    "rand::rng",
    "thread_rng",
    "from_os_rng",
    "RandomState",
    "HashMap::new",
    "println!",
    "eprintln!",
];

#[test]
fn the_brain_and_the_simulator_never_meet() {
    for (name, found) in crate_graph() {
        let (_, allowed) =
            CRATES.iter().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("a new crate: {name}"));
        for other in found {
            assert!(allowed.contains(&other.as_str()), "{name} must not depend on {other}");
        }
    }
}

/// The crates below a driver of a real arm, its recordings and the brain need no physics engine.
#[test]
fn no_physics_engine_stands_below_the_contract() {
    for name in ["catch_cell", "catch_bot", "catch_recording"] {
        let tree = Command::new(env!("CARGO"))
            .args(["tree", "--package", name, "--edges", "normal", "--prefix", "none", "--offline"])
            .current_dir(root())
            .output()
            .unwrap();
        assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
        let tree = String::from_utf8(tree.stdout).unwrap();
        assert!(tree.contains("catch_body") && !tree.contains("rapier"), "{tree}");
    }
}

/// Crate → the crates of the workspace that it depends on, by their real names whatever they are called
/// inside.
fn crate_graph() -> BTreeMap<String, BTreeSet<String>> {
    let metadata = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(metadata.status.success(), "{}", String::from_utf8_lossy(&metadata.stderr));
    let metadata: Value = serde_json::from_slice(&metadata.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let name = |it: &Value| it["name"].as_str().unwrap().to_owned();
    let members: BTreeSet<String> = packages.iter().map(name).collect();
    assert_eq!(members.len(), CRATES.len());
    let dependencies =
        |package: &Value| package["dependencies"].as_array().unwrap().iter().map(name).collect::<BTreeSet<_>>();
    packages
        .iter()
        .map(|package| (name(package), dependencies(package).intersection(&members).cloned().collect()))
        .collect()
}

#[test]
fn data_flows_one_way() {
    let found: BTreeSet<String> = modules("catch_bot/src").into_keys().collect();
    let known = STAGES.iter().chain(ABOVE_THE_BRAIN).map(|it| (*it).to_owned()).collect();
    assert_eq!(found, known, "modules of the brain and their order");
    let below = |(module, _): &(String, BTreeSet<String>)| !ABOVE_THE_BRAIN.contains(&module.as_str());
    for (module, used) in modules("catch_bot/src").into_iter().filter(below) {
        let rank = STAGES.iter().position(|it| *it == module).unwrap();
        for used in used {
            let is_before = STAGES[..=rank].contains(&used.as_str());
            assert!(is_before, "{module} uses {used}, which does not come before it");
        }
    }
}

#[test]
fn modules_use_each_other_in_no_circle() {
    for folder in WITHOUT_CIRCLES {
        let mut left = modules(folder);
        // Whoever uses nothing that is left is taken away; what remains goes in circles.
        loop {
            let known: BTreeSet<String> = left.keys().cloned().collect();
            let before = left.len();
            left.retain(|module, used| used.iter().any(|it| it != module && known.contains(it)));
            if left.len() == before {
                break;
            }
        }
        assert!(left.is_empty(), "{folder}: {:?}", left.keys());
    }
}

/// Modules directly below a crate's root or another folder, and what each uses of the others there, its tests
/// aside.
fn modules(folder: &str) -> BTreeMap<String, BTreeSet<String>> {
    let within = folder.split_once("/src").map_or("", |(_, within)| within);
    let path = format!("crate{}::", within.replace('/', "::"));
    let folder = format!("crates/{folder}");
    let mut found: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for file in rust_files(&folder).into_iter().filter(|file| !is_test_file(file)) {
        let below = file.strip_prefix(root().join(&folder)).unwrap();
        let module = below.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned();
        if ["lib", "main", "mod"].contains(&module.as_str()) {
            continue;
        }
        let code = without_comments(&without_test_modules(&read(&file)));
        let used = found.entry(module).or_default();
        used.extend(paths_below(&path, &code));
        if !within.is_empty() {
            used.extend(paths_below(&"super::".repeat(below.iter().count()), &code));
        }
    }
    found
}

/// Modules directly below `crate::` or another root that a text names, in paths like `crate::a::b` and
/// `crate::{a, b::{c, d}}`.
fn paths_below(root: &str, code: &str) -> Vec<String> {
    let code: String = code.split_whitespace().collect::<Vec<_>>().join(" ");
    let identifier =
        |text: &str| text.trim_start().chars().take_while(|it| it.is_alphanumeric() || *it == '_').collect();
    let mut found: Vec<String> = Vec::new();
    for (at, _) in code.match_indices(root) {
        let path = &code[at + root.len()..];
        let Some(group) = path.strip_prefix('{') else {
            found.push(identifier(path));
            continue;
        };
        let (mut depth, mut start) = (0, 0);
        for (i, letter) in group.char_indices() {
            match letter {
                '{' => depth += 1,
                '}' if depth == 0 => {
                    found.push(identifier(&group[start..i]));
                    break;
                }
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    found.push(identifier(&group[start..i]));
                    start = i + 1;
                }
                _ => {}
            }
        }
    }
    // After the last comma of a group there is nothing.
    found.retain(|it| !it.is_empty());
    found
}

#[test]
fn module_paths_are_found_in_groups() {
    let code = "use crate::{a::{b, c}, d};\nfn f(x: crate::e::F) {}";
    assert_eq!(paths_below("crate::", code), ["a", "d", "e"]);
}

#[test]
fn the_brain_reads_no_clock_and_no_file() {
    for name in ["catch_bot", "catch_calibration", "catch_paper", "catch_body", "catch_cell"] {
        for file in rust_files(&format!("crates/{name}/src")).into_iter().filter(|file| !is_test_file(file)) {
            let code = without_comments(&without_test_modules(&read(&file)));
            for used in paths_below("std::", &code) {
                assert!(!BANNED_MODULES.contains(&used.as_str()), "{}: std::{used}", file.display());
            }
            for banned in
                BANNED_IN_BRAIN.iter().filter(|_| ["catch_bot", "catch_calibration", "catch_paper"].contains(&name))
            {
                assert!(!code.contains(banned), "{}: {banned}", file.display());
            }
        }
    }
}

/// A kill or a full disk leaves no half of a file, whoever wrote it.
#[test]
fn files_are_written_in_one_place() {
    let crates = ["recording", "lab", "import", "view", "cli", "py"];
    for folder in crates.map(|it| format!("crates/catch_{it}/src")) {
        for path in rust_files(&folder).iter().filter(|path| !path.ends_with("whole_file.rs") && !is_test_file(path)) {
            let text = without_test_modules(&read(path));
            for word in ["fs::write(", "File::create(", "File::create_new("] {
                assert!(!text.contains(word), "{}: {word}; use whole_file", path.display());
            }
        }
    }
}

#[test]
fn files_are_short_and_honestly_named() {
    for file in rust_files("crates") {
        let stem = file.file_stem().unwrap().to_str().unwrap();
        assert!(!BANNED_NAMES.contains(&stem), "{}: name it after its subject", file.display());
        let code = without_comments(&without_test_modules(&read(&file)));
        let lines = code.lines().filter(|line| !line.trim().is_empty()).count();
        assert!(lines <= MAX_LINES || is_test_file(&file), "{}: {lines} lines", file.display());
    }
}

/// Tables, formulas and examples in comments keep their lines.
#[test]
fn comments_are_narrow() {
    for file in rust_files("crates") {
        let (text, mut is_example) = (read(&file), false);
        for line in text.lines() {
            let Some((marker, comment)) = line.trim_start().split_once(' ') else { continue };
            if !["//", "///", "//!"].contains(&marker) {
                is_example = false;
                continue;
            }
            is_example ^= comment.starts_with("```");
            let columns = line.chars().count();
            let is_kept = is_example || comment.starts_with(['|', ' ', '{']);
            assert!(columns <= MOST_COLUMNS || is_kept, "{}: {columns} columns: {line}", file.display());
        }
    }
}

/// A type that names a quantity is checked against it only if the attribute stands above.
#[test]
fn fields_of_a_quantity_are_read_within_it() {
    for file in rust_files("crates") {
        let code = without_comments(&read(&file));
        let mut is_checked = false;
        for line in code.lines().map(str::trim) {
            is_checked |= line.starts_with("#[quantity::checked");
            // Constants are in capitals, functions are called.
            let is_type = |name: &str| {
                let end = name.find(|it: char| !it.is_alphanumeric() && it != '_').unwrap_or(name.len());
                name.starts_with(|it: char| it.is_lowercase()) && !name[end..].starts_with(['(', ':', '!'])
            };
            let mut named =
                [": quantity::", "(quantity::", ", quantity::"].iter().flat_map(|it| line.split(it).skip(1));
            assert!(is_checked || !named.any(is_type), "{}: {line}", file.display());
            is_checked &= line != "}";
        }
    }
}

/// No robot, gripper, object or camera rig is named in Rust: they are files. Texts for people may name them
/// as examples.
#[test]
fn things_are_not_named_in_rust() {
    let kinds = [Kind::Robot, Kind::Gripper, Kind::Object, Kind::Rig];
    let names: Vec<&str> = kinds.iter().flat_map(|kind| kind.names()).collect();
    for file in rust_files("crates").into_iter().filter(|file| !is_test_file(file)) {
        let code = without_comments(&without_test_modules(&read(&file)));
        for literal in string_literals(&code) {
            let named = names.iter().find(|name| literal == **name);
            assert!(named.is_none(), "{}: \"{literal}\" is an asset's name", file.display());
        }
    }
}
