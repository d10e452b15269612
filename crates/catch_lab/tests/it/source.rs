//! Rust sources as the tidy tests read them.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// Root of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap().to_path_buf()
}

/// All Rust files below a folder of the workspace.
pub fn rust_files(folder: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    collect(&root().join(folder), &mut files);
    assert!(!files.is_empty(), "no Rust file in {folder}");
    files.sort();
    files
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|it| it == "rs") {
            files.push(path);
        }
    }
}

/// A file's text.
pub fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|fault| panic!("{}: {fault}", path.display()))
}

/// Returns whether a file holds nothing but tests or examples: it lies in a folder of them, or its parent
/// says `#[cfg(test)] mod …;`.
pub fn is_test_file(path: &Path) -> bool {
    if path.iter().any(|folder| folder == "tests" || folder == "benches" || folder == "examples") {
        return true;
    }
    let folder = path.parent().unwrap();
    // A file of a test module is a test file, too.
    let owner = folder.with_extension("rs");
    if owner.is_file() && is_test_file(&owner) {
        return true;
    }
    let parents = [folder.join("mod.rs"), folder.join("lib.rs"), folder.join("main.rs"), folder.with_extension("rs")];
    let name = path.file_stem().unwrap().to_str().unwrap();
    let declared = [format!("#[cfg(test)]\nmod {name};"), format!("#[cfg(test)]\npub(crate) mod {name};")];
    parents.iter().filter_map(|it| fs::read_to_string(it).ok()).any(|text| declared.iter().any(|it| text.contains(it)))
}

/// The text without its inline test modules: from `#[cfg(test)]` and a `mod … {` to the brace that closes it
/// in the first column, as rustfmt places it.
pub fn without_test_modules(text: &str) -> String {
    let mut kept = Vec::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let opens = |next: &&str| next.contains("mod ") && next.ends_with('{');
        if line == "#[cfg(test)]" && lines.peek().is_some_and(opens) {
            lines.by_ref().find(|line| *line == "}");
        } else {
            kept.push(line);
        }
    }
    kept.join("\n")
}

/// The text without comments. Strings that contain `//` lose their rest, which is good enough here.
pub fn without_comments(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// The string literals of a text without comments. Escaped quotes end one early, which is good enough here.
pub fn string_literals(code: &str) -> Vec<&str> {
    code.lines().flat_map(|line| line.split('"').skip(1).step_by(2)).collect()
}

#[test]
fn test_modules_are_cut_out() {
    let text =
        "fn a() {}\n#[cfg(test)]\npub(crate) mod tests {\n    fn b() {\n    }\n}\nfn c() {}\n#[cfg(test)]\nmod more;";
    assert_eq!(without_test_modules(text), "fn a() {}\nfn c() {}\n#[cfg(test)]\nmod more;");
}

#[test]
fn literals_are_found_outside_comments() {
    let code = without_comments("let a = \"one\"; // \"two\"\nlet b = (\"three\", \"four\");");
    assert_eq!(string_literals(&code), ["one", "three", "four"]);
}
