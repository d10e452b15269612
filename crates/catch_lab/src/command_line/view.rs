//! `catchingbot view`: a throw or a report in the browser.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    catch_page,
    playback::Playback,
    recording::EXTENSION,
    results::{REPORT_FILE, make_writable},
};
use clap::Args;

use crate::screen;

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// A recording written by `catchingbot catch`, a page, or a folder of results with a report
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Write the page and print its path, but open no browser
    #[arg(long)]
    no_open: bool,
}

/// Writes the page of a recording beside it and opens it.
///
/// # Errors
/// A file that is neither a complete recording nor a page; a page that cannot be written.
pub fn run(arguments: &ViewArguments) -> anyhow::Result<()> {
    let page = page_of(&arguments.file)?;
    if arguments.no_open {
        return Ok(screen::line(&page.display().to_string())?);
    }
    if !open(&page) {
        screen::line("No browser could be started; open this file yourself:")?;
    }
    Ok(screen::line(&page.display().to_string())?)
}

fn page_of(file: &Path) -> anyhow::Result<PathBuf> {
    if file.is_dir() {
        let report = file.join(REPORT_FILE);
        if report.is_file() {
            return Ok(report);
        }
        let expected = format!("a recording (*.{EXTENSION}), or a folder of results with a {REPORT_FILE}");
        return Err(
            InputError::new(file.display().to_string(), "the folder", format!("no {REPORT_FILE}"), expected).into()
        );
    }
    if file.is_file() && file.extension().is_some_and(|it| it == "html") {
        return Ok(file.to_owned());
    }
    if file.is_file() {
        make_writable(file.parent().unwrap_or(Path::new("")), "FILE")?;
    }
    write_page(file, &Playback::read(file)?)
}

/// Writes the page of a recording beside it.
///
/// # Errors
/// If it cannot be written.
pub fn write_page(recording: &Path, playback: &Playback) -> anyhow::Result<PathBuf> {
    let page = recording.with_extension("html");
    fs::write(&page, catch_page::page(playback)).with_context(|| format!("{}", page.display()))?;
    Ok(page)
}

/// Asks the system to show a file; whether there was anybody to ask.
fn open(page: &Path) -> bool {
    // An absolute path cannot be taken for an option.
    let page = fs::canonicalize(page).unwrap_or_else(|_| page.to_owned());
    let openers: &[&[&str]] = if cfg!(target_os = "macos") {
        &[&["open"]]
    } else if cfg!(target_os = "windows") {
        &[&["explorer"]]
    } else {
        &[&["xdg-open"], &["gio", "open"], &["wslview"], &["sensible-browser"]]
    };
    let quiet = |opener: &&[&str]| {
        let [program, options @ ..] = opener else { return false };
        let mut command = Command::new(program);
        command.args(options).arg(&page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().is_ok()
    };
    openers.iter().any(quiet)
}
