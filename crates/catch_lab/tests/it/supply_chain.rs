//! Rules for the dependencies, from `deny.toml`: their licences go with this project's, and they come from
//! one registry.

use std::process::Command;

use serde_json::Value;

use crate::source::{read, root};

fn packages() -> Vec<Value> {
    let metadata = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(metadata.status.success(), "{}", String::from_utf8_lossy(&metadata.stderr));
    let metadata: Value = serde_json::from_slice(&metadata.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

/// Returns whether a licence expression can be met by allowed licences only.
fn is_allowed(expression: &str, allowed: &[&str]) -> bool {
    let plain = expression.replace(['(', ')'], "").replace('/', " OR ");
    plain.split(" AND ").all(|part| part.split(" OR ").any(|licence| allowed.contains(&licence.trim())))
}

#[test]
fn licences_and_sources_are_those_of_the_settings() {
    let settings: toml::Table = read(&root().join("deny.toml")).parse().unwrap();
    let list = |value: &'static str, field: &str| -> Vec<String> {
        let list = settings[value][field].as_array().unwrap();
        list.iter().map(|it| it.as_str().unwrap().to_owned()).collect()
    };
    let (allowed, registries) = (list("licenses", "allow"), list("sources", "allow-registry"));
    let allowed: Vec<&str> = allowed.iter().map(String::as_str).collect();
    let packages = packages();
    assert!(packages.len() > 100);
    for package in &packages {
        let (name, licence) = (&package["name"], package["license"].as_str().unwrap_or("none"));
        assert!(is_allowed(licence, &allowed), "{name} has the licence {licence}");
        let source = package["source"].as_str().map(|it| it.trim_start_matches("registry+"));
        assert!(source.is_none_or(|it| registries.iter().any(|known| known == it)), "{name} comes from {source:?}");
        if source.is_none() {
            let is_told = |field: &str| package[field].as_str().is_some_and(|it| !it.is_empty());
            assert!(is_told("description") && is_told("license"), "{name} needs a description and a licence");
            assert!(!package["keywords"].as_array().unwrap().is_empty(), "{name} needs keywords");
        }
    }
    assert!(!is_allowed("GPL-3.0", &allowed) && is_allowed("(MIT OR GPL-3.0) AND Unicode-3.0", &allowed));
}

/// A test that runs after a build compiles no dependency once more: both have the same features of each. Nor
/// does what is built of the whole workspace after what is built by default.
#[test]
fn tests_add_no_features_to_dependencies() {
    let tree = |which: &[&str], kinds: &str| -> Vec<String> {
        let output = Command::new(env!("CARGO"))
            .args(["tree", "--locked", "--offline", "--prefix", "none", "--no-dedupe"])
            .args(which)
            .args(["-e", kinds, "-f", "{p} {f}"])
            .current_dir(root())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        let mut lines: Vec<String> = text.lines().filter(|line| !line.contains("(/")).map(str::to_owned).collect();
        lines.sort_unstable();
        lines.dedup();
        lines
    };
    let [run, built] = [&[][..], &["--workspace"]].map(|which| tree(which, "normal,build"));
    let tested = tree(&["--workspace"], "normal,build,dev");
    for (before, after) in [(run, &built), (built.clone(), &tested)] {
        let once_more: Vec<&String> = before.iter().filter(|line| !after.contains(line)).collect();
        assert!(once_more.is_empty(), "these are compiled once more, with other features: {once_more:#?}");
    }
}
