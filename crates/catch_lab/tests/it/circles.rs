//! No circle of files in any crate: not only the modules below a crate's root but all of them.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
};

use crate::source::{is_test_file, read, root, rust_files, without_comments, without_test_modules};

/// The crates by their folders.
fn crates() -> Vec<String> {
    let folders = fs::read_dir(root().join("crates")).unwrap();
    folders.map(|it| it.unwrap().file_name().into_string().unwrap()).collect()
}

/// A module may use what is in the file above it, and that file what is in those below it: they are one
/// thing.
#[test]
fn files_use_each_other_in_no_circle() {
    for name in crates() {
        let files = files(&name);
        let is_one = |a: &str, b: &str| a.starts_with(&format!("{b}::")) || b.starts_with(&format!("{a}::"));
        let mut left: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for (file, code) in &files {
            let used = paths(file, code).into_iter().filter_map(|path| {
                let known = (1..=path.len()).rev().map(|length| path[..length].join("::"));
                known.into_iter().find_map(|it| files.get_key_value(&it))
            });
            let used = used.map(|(used, _)| used.as_str()).filter(|used| *used != file && !is_one(used, file));
            left.insert(file, used.collect());
        }
        assert!(files.is_empty() || left.values().map(BTreeSet::len).sum::<usize>() > 3, "{name}: no use is found");
        // Whoever uses nothing that is left is taken away; what remains goes in circles.
        loop {
            let known: BTreeSet<&str> = left.keys().copied().collect();
            let before = left.len();
            left.retain(|_, used| used.iter().any(|it| known.contains(it)));
            if left.len() == before {
                break;
            }
        }
        assert!(left.is_empty(), "{name}: {left:#?}");
    }
}

/// Each file's module path and its code without tests, the crate's root aside.
fn files(name: &str) -> BTreeMap<String, String> {
    let folder = root().join(format!("crates/{name}/src"));
    let files = rust_files(&format!("crates/{name}/src")).into_iter().filter(|file| !is_test_file(file));
    let module = |file: std::path::PathBuf| {
        let below = file.strip_prefix(&folder).unwrap().with_extension("");
        let path: Vec<&str> = below.iter().map(|it| it.to_str().unwrap()).collect();
        let code = without_comments(&without_test_modules(&read(&file)));
        (!["lib", "main"].contains(&path[0])).then(|| (path.join("::"), code))
    };
    files.filter_map(module).collect()
}

/// Paths below `crate::` and `super::` that a file names, from the crate's root on.
fn paths(file: &str, code: &str) -> Vec<Vec<String>> {
    let code: String = code.split_whitespace().collect::<Vec<_>>().join(" ");
    let above: Vec<String> = file.split("::").map(str::to_owned).collect();
    let mut found = Vec::new();
    for (root, prefix) in [("crate::", &[][..]), ("super::", &above[..above.len() - 1])] {
        for (at, _) in code.match_indices(root) {
            flatten(prefix, &code[at + root.len()..], &mut found);
        }
    }
    found
}

/// Follows a path like `a::b` or a group like `{a, b::{c, d}}`; returns what stands behind it.
fn flatten<'a>(prefix: &[String], code: &'a str, found: &mut Vec<Vec<String>>) -> &'a str {
    let code = code.trim_start();
    if let Some(mut rest) = code.strip_prefix('{') {
        loop {
            rest = flatten(prefix, rest, found).trim_start();
            match rest.strip_prefix(',') {
                Some(next) => rest = next,
                None => return rest.strip_prefix('}').unwrap_or(rest),
            }
        }
    }
    let end = code.find(|it: char| !it.is_alphanumeric() && it != '_').unwrap_or(code.len());
    let (name, rest) = code.split_at(end);
    let path = [prefix, &[name.to_owned()]].concat();
    if let Some(rest) = rest.strip_prefix("::") {
        return flatten(&path, rest, found);
    }
    found.push(path);
    rest
}

#[test]
fn paths_are_found_in_groups() {
    let found = paths("x::y", "use crate::{a::{b, c}, d,};\nfn f(x: super::E) {}");
    let found: Vec<String> = found.iter().map(|it| it.join("::")).collect();
    assert_eq!(found, ["a::b", "a::c", "d", "", "x::E"]);
}
