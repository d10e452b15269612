//! `catchingbot list`: what is built in.

use std::collections::BTreeMap;

use catch_body::InputError;
use catch_lab::assets::{Asset, KNOWN_FILE, Kind, did_you_mean, nearest};
use catch_recording::whole_file::COMMAND_LINE;
use clap::{Args, Command};
use clap_complete::{Shell, generate};

use crate::screen::{self, FAINT, STRONG};

/// Lists what is built in: scenarios, objects, throws, robots, grippers, workcells and camera rigs
///
/// Examples:
///   catchingbot list --completions bash >> ~/.bash_completion
///   catchingbot list --completions fish > ~/.config/fish/completions/catchingbot.fish
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ListArguments {
    /// Print the file of this scenario, object, throw, robot, gripper, workcell or rig, to read or to start
    /// your own from
    #[arg(long, value_name = "NAME")]
    show: Option<String>,
    /// Print a shell's completions of this program's arguments instead
    #[arg(long, value_enum, value_name = "SHELL", conflicts_with_all = ["show", "json"])]
    completions: Option<Shell>,
}

/// Lists what is built in, or shows one of it; or prints the completions of `program`.
///
/// # Errors
/// A name that is not built in.
pub fn run(arguments: &ListArguments, json: bool, mut program: Command) -> anyhow::Result<()> {
    if let Some(shell) = arguments.completions {
        let mut script = Vec::new();
        generate(shell, &mut program, "catchingbot", &mut script);
        return Ok(screen::text(&String::from_utf8_lossy(&script))?);
    }
    match &arguments.show {
        Some(name) => show(name, json),
        None => list(json),
    }
}

fn list(json: bool) -> anyhow::Result<()> {
    if json {
        let names: BTreeMap<String, Vec<&str>> = Kind::ALL.iter().map(|kind| (kind.plural(), kind.names())).collect();
        return screen::json(&names);
    }
    for kind in Kind::ALL {
        screen::line(&format!("{STRONG}{}{STRONG:#}", kind.plural()))?;
        for name in kind.names() {
            let about = summary(&Asset::built_in(kind, name)?.text);
            screen::line(&format!("  {name:<20}{FAINT}{about}{FAINT:#}"))?;
        }
        screen::line("")?;
    }
    Ok(screen::line("`catchingbot list --show NAME` prints the file of any of them.")?)
}

/// The first sentence of the comment with which a file begins.
fn summary(text: &str) -> String {
    let comment: Vec<&str> = text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim).collect();
    let comment = comment.join(" ");
    let first = comment.split_once(". ").map_or(comment.as_str(), |(first, _)| first).trim_end_matches('.');
    // A `robot.toml` begins with what it is for; the arm's name is in it.
    let arm = first.strip_prefix("What the URDF of the ").and_then(|it| it.strip_suffix(" cannot say"));
    arm.unwrap_or(first).to_owned()
}

fn show(name: &str, json: bool) -> anyhow::Result<()> {
    let mut files = BTreeMap::new();
    for kind in Kind::ALL {
        if kind.names().contains(&name) {
            let asset = Asset::built_in(kind, name)?;
            if kind == Kind::Robot {
                let (file, text) = asset.read_text_beside("robot.urdf")?;
                files.insert(file, text);
            }
            // Truth and knowledge together are a file of an object.
            let known = if kind == Kind::Object {
                format!("\n{}", asset.read_text_beside(KNOWN_FILE)?.1)
            } else {
                String::new()
            };
            files.insert(asset.file, asset.text + &known);
        }
    }
    if files.is_empty() {
        let all: Vec<&str> = Kind::ALL.iter().flat_map(|kind| kind.names()).collect();
        let hint = did_you_mean(nearest(name, &all));
        let expected = format!("one of {}{hint}", all.join(", "));
        return Err(InputError::new(COMMAND_LINE, "--show", format!("`{name}`"), expected).into());
    }
    if json {
        return screen::json(&files);
    }
    for (file, text) in &files {
        if files.len() > 1 {
            screen::line(&format!("{FAINT}==> {file} <=={FAINT:#}"))?;
        }
        screen::text(text)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_sentence_is_the_summary() {
        assert_eq!(summary("# A ball: 1.5 m\n# wide. And more.\nx = 1"), "A ball: 1.5 m wide");
        assert_eq!(summary("x = 1"), "");
    }
}
