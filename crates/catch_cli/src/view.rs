//! `catchingbot view`: a throw, two of them, or a report in the browser.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_lab::evaluation::results::{self, REPORT_FILE};
use catch_recording::{
    EXTENSION,
    whole_file::{self, COMMAND_LINE, make_writable},
};
use catch_view::{
    export::mcap_file::{self, Images},
    pages::{catch_page, pair_page},
    playback::Playback,
};
use clap::Args;

use crate::{compare, opening, screen};

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// A recording (*.catch) of a simulated throw or of a real cell, a page, or a folder of results with a
    /// report; two recordings are shown on one slider, two folders of `eval` are compared throw by throw
    #[arg(value_name = "FILE", required = true, num_args = 1..=2)]
    file: Vec<PathBuf>,
    /// Write the page and print its path, but open no browser
    #[arg(long)]
    no_open: bool,
    /// Folder for what is written [default: beside the recording; of a comparison out/compared]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    files: FileArguments,
}

/// Further files that are written beside a recording.
#[derive(Debug, Args)]
pub struct FileArguments {
    /// Write a small moving picture, if the program was built with `--features gif`
    #[arg(long)]
    gif: bool,
    /// Write an MCAP file for Foxglove or Rerun; it has as many depth images as fit into 3 MB, or all of them
    #[arg(long, value_name = "IMAGES", num_args = 0..=1, require_equals = true, default_missing_value = "some", value_parser = ["some", "all"])]
    mcap: Option<String>,
}

impl FileArguments {
    /// Returns whether any file is asked for.
    pub fn any(&self) -> bool {
        self.gif || self.mcap.is_some()
    }

    /// Refuses what this program cannot write.
    ///
    /// # Errors
    /// A picture without the feature `gif`.
    pub fn check(&self) -> Result<(), InputError> {
        if cfg!(feature = "gif") || !self.gif {
            return Ok(());
        }
        let (found, expected) = ("a program without its GIF maker", "one that was built with `--features gif`");
        Err(InputError::new(COMMAND_LINE, "--gif", found, expected))
    }

    /// Writes what was asked for beside a file, which need not exist; returns the files by their kinds.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, beside: &Path, playback: &Playback) -> anyhow::Result<BTreeMap<&'static str, PathBuf>> {
        let mut written = BTreeMap::new();
        let mut write = |kind: &'static str, extension: &str, content: &[u8]| {
            let path = beside.with_extension(extension);
            whole_file::write(&path, content)?;
            written.insert(kind, path);
            anyhow::Ok(())
        };
        #[cfg(feature = "gif")]
        if self.gif {
            write("picture", "gif", &catch_view::export::gif_picture::gif(playback)?)?;
        }
        if let Some(images) = &self.mcap {
            let images = if images == "all" { Images::All } else { Images::Some };
            let (content, images_every) = mcap_file::mcap(playback, images)?;
            write("mcap", "mcap", &content)?;
            if images_every > 1 {
                screen::note(&format!(
                    "The MCAP file has the images of one tick in {images_every}, which keeps it small; --mcap=all writes all."
                ));
            }
        }
        Ok(written)
    }
}

/// Writes the page of a recording, and other files if asked for, beside it and opens the page.
///
/// # Errors
/// A file that is neither a complete recording nor a page; a page that cannot be written.
pub fn run(arguments: &ViewArguments, json: bool) -> anyhow::Result<()> {
    arguments.files.check()?;
    let page = match &arguments.file[..] {
        [a, b] if results::is_in(a) && results::is_in(b) => {
            let folder = arguments.out.as_deref().unwrap_or(Path::new(compare::FOLDER));
            let page = compare::run([a, b], folder, json)?;
            if json {
                return Ok(());
            }
            page
        }
        _ if json => {
            let found = "no two folders of results";
            return Err(InputError::new(COMMAND_LINE, "--json", found, "two evaluations to compare").into());
        }
        [a, b] => page_of_pair([a, b], arguments)?,
        [file, ..] => page_of(file, arguments)?,
        [] => return Ok(()),
    };
    if arguments.no_open {
        return Ok(screen::line(&page.display().to_string())?);
    }
    show(&page)
}

/// Opens a page in a browser and prints its path.
///
/// # Errors
/// If nothing can be printed.
pub fn show(page: &Path) -> anyhow::Result<()> {
    if !opening::has_display() {
        screen::line("There is no display here; open this file in a browser elsewhere:")?;
    } else if !opening::open(page) {
        screen::line("No browser could be started; open this file yourself:")?;
    }
    Ok(screen::line(&page.display().to_string())?)
}

/// Writes the page of two recordings beside the first one.
fn page_of_pair(recordings: [&Path; 2], arguments: &ViewArguments) -> anyhow::Result<PathBuf> {
    if arguments.files.any() {
        return Err(InputError::new(COMMAND_LINE, "FILE", "two", "one recording, for --gif and --mcap").into());
    }
    let [a, b] = recordings.map(Playback::read);
    let (a, b) = (a?, b?);
    let names = recordings.map(|it| it.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    let folder = arguments.out.as_deref().or(recordings[0].parent()).unwrap_or(Path::new(""));
    check_writable(folder, arguments)?;
    let page = folder.join(format!("{}-pair.html", names[0]));
    let [first, second] = if names[0] == names[1] { ["A", "B"] } else { [&*names[0], &names[1]] };
    whole_file::write(&page, pair_page::page([(first, &a), (second, &b)]))?;
    Ok(page)
}

/// Tells where the page cannot be written.
fn check_writable(folder: &Path, arguments: &ViewArguments) -> Result<(), InputError> {
    let asked_by = if arguments.out.is_some() { "--out" } else { "FILE" };
    make_writable(folder, asked_by)
        .map_err(|it| InputError { expected: format!("{}, such as --out DIR", it.expected), ..it })
}

fn page_of(file: &Path, arguments: &ViewArguments) -> anyhow::Result<PathBuf> {
    let ViewArguments { files, out, .. } = arguments;
    let is_page = file.is_file() && file.extension().is_some_and(|it| it == "html");
    if (files.any() || out.is_some()) && (file.is_dir() || is_page) {
        let found = file.display().to_string();
        return Err(InputError::new(COMMAND_LINE, "FILE", found, "a recording, for --gif, --mcap and --out").into());
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
    let playback = Playback::read(file)?;
    let beside = out.as_ref().map_or(file.to_owned(), |folder| folder.join(file.file_name().unwrap_or_default()));
    check_writable(beside.parent().unwrap_or(Path::new("")), arguments)?;
    for path in files.write(&beside, &playback)?.values() {
        screen::line(&path.display().to_string())?;
    }
    write_page(&beside, &playback)
}

/// Writes the page of a recording beside it.
///
/// # Errors
/// If it cannot be written.
pub fn write_page(recording: &Path, playback: &Playback) -> anyhow::Result<PathBuf> {
    let page = recording.with_extension("html");
    whole_file::write(&page, catch_page::page(playback))?;
    Ok(page)
}
