//! Output on the terminal. Colours only where the output is a terminal; results on standard output, faults on
//! standard error.

use std::{
    io::{self, IsTerminal, Write},
    ops::Range,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use anstyle::{AnsiColor, Style};
use catch_body::input_error::steers_text;
use catch_lab::VERSION;
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, TableComponent, presets};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use signal_hook::consts::SIGINT;

/// Style of results that are good.
pub const GOOD: Style = AnsiColor::Green.on_default().bold();
/// Style of results that are bad.
pub const BAD: Style = AnsiColor::Red.on_default().bold();
/// Style of emphasized text.
pub const STRONG: Style = Style::new().bold();
/// Style of secondary text.
pub const FAINT: Style = Style::new().dimmed();

/// Width of the column of labels.
const LABEL_WIDTH: usize = 24;

/// Prints a message at Ctrl-C, which then ends the program as ever. The message is printed once.
pub fn at_interrupt(said: String) {
    let pressed = Arc::new(AtomicBool::new(false));
    let is_pressed = pressed.clone();
    let wait = move || {
        while !is_pressed.load(Ordering::Relaxed) {
            thread::sleep(LOOKS_EVERY);
        }
        let _ = writeln!(anstream::stderr().lock(), "\n{said}");
        std::process::exit(INTERRUPTED);
    };
    // If nobody can wait, or no handler can be set, the program ends without a word.
    if thread::Builder::new().spawn(wait).is_ok() {
        let _ = signal_hook::flag::register(SIGINT, pressed);
    }
}

/// Period of the check for Ctrl-C.
const LOOKS_EVERY: Duration = Duration::from_millis(50);
/// Exit code of a program that an interrupt ended: 128 and the signal's number.
const INTERRUPTED: i32 = 130;

/// A command line of this program that can be pasted into a shell: as the program was called, its arguments
/// quoted where they need it.
pub fn command(arguments: &[&str]) -> String {
    // cargo sets this for what it runs, whose file is on no search path.
    let by_cargo = std::env::var_os("CARGO_MANIFEST_DIR").is_some();
    let program = if by_cargo { "cargo run --release --" } else { "catchingbot" };
    let quoted = arguments.iter().map(|it| quoted(it));
    std::iter::once(program.to_owned()).chain(quoted).collect::<Vec<_>>().join(" ")
}

/// An argument as a POSIX shell reads it back.
fn quoted(argument: &str) -> String {
    let is_plain = |it: char| it.is_alphanumeric() || "_-./+=:,@%".contains(it);
    if !argument.is_empty() && argument.chars().all(is_plain) {
        argument.to_owned()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}

/// Columns of the terminal that results appear on, if it is one.
pub fn width() -> Option<u16> {
    io::stdout().is_terminal().then(terminal_size::terminal_size).flatten().map(|(width, _)| width.0)
}

/// Prints one line of results.
///
/// # Errors
/// If standard output is closed.
pub fn line(text: &str) -> io::Result<()> {
    writeln!(anstream::stdout().lock(), "{}", harmless(text))
}

/// Prints text as it is.
///
/// # Errors
/// If standard output is closed.
pub fn text(text: &str) -> io::Result<()> {
    anstream::stdout().lock().write_all(harmless(text).as_bytes())
}

/// Prints a label and what belongs to it.
///
/// # Errors
/// If standard output is closed.
pub fn fact(label: &str, value: &str) -> io::Result<()> {
    line(&format!("  {FAINT}{label:<LABEL_WIDTH$}{FAINT:#}{value}"))
}

/// Prints one JSON document.
///
/// # Errors
/// If standard output is closed.
pub fn json(document: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(document)?;
    Ok(line(&text)?)
}

/// Prints a result as one JSON document, which begins with the version of the program.
///
/// # Errors
/// As [`json`].
pub fn document(result: &impl Serialize) -> anyhow::Result<()> {
    #[derive(Serialize)]
    struct Document<'a, T> {
        version: &'static str,
        #[serde(flatten)]
        result: &'a T,
    }
    json(&Document { version: VERSION, result })
}

/// A table with headings, whose columns in the range `numbers` stand to the right.
pub fn table<T: Into<Cell>>(headings: impl IntoIterator<Item = T>, numbers: Range<usize>) -> Table {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Disabled);
    table.remove_style(TableComponent::HorizontalLines).remove_style(TableComponent::MiddleIntersections);
    table.set_header(headings.into_iter().collect::<Vec<T>>());
    for column in numbers {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    if let Some(width) = width() {
        table.set_content_arrangement(ContentArrangement::Dynamic).set_width(width);
    }
    table
}

/// A bar on standard error for `total` of `things`; it shows itself on a terminal only.
pub fn progress_bar(total: usize, things: &str) -> ProgressBar {
    let template = format!("{{bar:30}} {{pos}}/{{len}} {things}, {{per_sec}}, {{eta}} left, {{msg}}");
    let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(total as u64).with_style(style)
}

/// Says on standard error what takes a while until the bar is finished; it shows itself on a terminal only.
pub fn spinner(what: &str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(what.to_owned());
    // A ticking bar has a thread of its own, for which the system must have room.
    if thread::Builder::new().spawn(|| ()).is_ok_and(|probe| probe.join().is_ok()) {
        bar.enable_steady_tick(Duration::from_millis(100));
    }
    bar
}

/// Says something that is no result, on standard error.
pub fn note(text: &str) {
    // Nobody is left to be told that it cannot be written.
    let _ = writeln!(anstream::stderr().lock(), "{}", harmless(text));
}

/// Says what went wrong, on standard error.
pub fn error(message: &str) {
    // Nobody is left to be told if this fails.
    let _ = writeln!(anstream::stderr().lock(), "{BAD}error:{BAD:#} {}", harmless(message));
}

/// The styles of this program, as a terminal is told them.
const STYLES: [&str; 5] = ["\x1b[0m", "\x1b[1m", "\x1b[2m", "\x1b[31m", "\x1b[32m"];

/// A text in which nothing but this program's own styles commands a terminal: what files say is shown, not
/// obeyed.
fn harmless(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(it) = rest.chars().next() {
        let style = STYLES.into_iter().find(|style| rest.starts_with(style));
        let length = style.map_or(it.len_utf8(), str::len);
        if style.is_some() || matches!(it, '\n' | '\t') || !steers_text(it) {
            shown += &rest[..length];
        } else {
            shown.extend(it.escape_unicode());
        }
        rest = &rest[length..];
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_our_styles_reach_the_terminal() {
        let ours = format!("{BAD}no{BAD:#} {GOOD}yes{GOOD:#} {STRONG}a{STRONG:#}{FAINT}b{FAINT:#}\n\tc, °");
        assert_eq!(harmless(&ours), ours);
        assert_eq!(
            harmless("a\x1b]0;b\x07c\x1b[2Jd\u{9b}e\u{202e}f\r"),
            "a\\u{1b}]0;b\\u{7}c\\u{1b}[2Jd\\u{9b}e\\u{202e}f\\u{d}"
        );
    }

    #[test]
    fn arguments_are_quoted_for_a_shell() {
        assert_eq!(quoted("out/paper-1.catch"), "out/paper-1.catch");
        assert_eq!(quoted("my results/it's"), "'my results/it'\\''s'");
        assert_eq!(quoted("$(rm)"), "'$(rm)'");
        assert_eq!(quoted(""), "''");
    }
}
