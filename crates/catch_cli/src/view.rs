//! `catchingbot view`: a throw or a report in the browser.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    assets::COMMAND_LINE,
    evaluation::results::{REPORT_FILE, make_writable},
    export::{mcap_file, urdf},
    pages::catch_page,
    recording::{EXTENSION, playback::Playback},
};
use clap::Args;

use crate::screen;

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// A recording (*.catch) of a simulated throw or of a real cell, a page, or a folder of results with a report
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Write the page and print its path, but open no browser
    #[arg(long)]
    no_open: bool,
    #[command(flatten)]
    files: FileArguments,
}

/// What else can be written beside a recording.
#[derive(Debug, Args)]
pub struct FileArguments {
    /// Write a small moving picture, if the program was built with `--features gif`
    #[arg(long)]
    gif: bool,
    /// Write an MCAP file for Foxglove or Rerun, and the robot's URDF beside it
    #[arg(long)]
    mcap: bool,
}

impl FileArguments {
    /// Whether anything is asked for.
    pub fn any(&self) -> bool {
        self.gif || self.mcap
    }

    /// Writes what was asked for beside the recording; returns the files by their kinds.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, recording: &Path, playback: &Playback) -> anyhow::Result<BTreeMap<&'static str, PathBuf>> {
        let mut written = BTreeMap::new();
        let mut write = |kind: &'static str, extension: &str, content: &[u8]| {
            let path = recording.with_extension(extension);
            fs::write(&path, content).with_context(|| format!("{}", path.display()))?;
            written.insert(kind, path);
            anyhow::Ok(())
        };
        if self.gif {
            write("picture", "gif", &gif(playback)?)?;
        }
        if self.mcap {
            write("mcap", "mcap", &mcap_file::mcap(playback)?)?;
            let urdf = urdf::with_visuals(&playback.header.cell.sources.robot_urdf, &playback.robot);
            write("urdf", "urdf", urdf.as_bytes())?;
        }
        Ok(written)
    }
}

#[cfg(feature = "gif")]
fn gif(playback: &Playback) -> anyhow::Result<Vec<u8>> {
    Ok(catch_lab::export::gif_picture::gif(playback)?)
}

#[cfg(not(feature = "gif"))]
fn gif(_: &Playback) -> anyhow::Result<Vec<u8>> {
    let (found, expected) = ("a program without its GIF maker", "one that was built with `--features gif`");
    Err(InputError::new(COMMAND_LINE, "--gif", found, expected).into())
}

/// Writes the page of a recording, and other files if asked for, beside it and opens the page.
///
/// # Errors
/// A file that is neither a complete recording nor a page; a page that cannot be written.
pub fn run(arguments: &ViewArguments) -> anyhow::Result<()> {
    let ViewArguments { file, files, .. } = arguments;
    let page = page_of(file, files)?;
    if arguments.no_open {
        return Ok(screen::line(&page.display().to_string())?);
    }
    if !open(&page) {
        screen::line("No browser could be started; open this file yourself:")?;
    }
    Ok(screen::line(&page.display().to_string())?)
}

fn page_of(file: &Path, files: &FileArguments) -> anyhow::Result<PathBuf> {
    let is_page = file.is_file() && file.extension().is_some_and(|it| it == "html");
    if files.any() && (file.is_dir() || is_page) {
        let found = file.display().to_string();
        return Err(InputError::new(COMMAND_LINE, "FILE", found, "a recording, for --gif and --mcap").into());
    }
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
    if is_page {
        return Ok(file.to_owned());
    }
    if file.is_file() {
        make_writable(file.parent().unwrap_or(Path::new("")), "FILE")?;
    }
    let playback = Playback::read(file)?;
    for path in files.write(file, &playback)?.values() {
        screen::line(&path.display().to_string())?;
    }
    write_page(file, &playback)
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
