//! Failures as a script reads them: with `--json` each is one document of one shape, whatever command it was
//! and whatever went wrong.

use std::{error::Error, io, process::ExitCode};

use catch_body::InputError;
use catch_recording::whole_file::COMMAND_LINE;
use clap::{
    Command,
    error::{ContextKind, ContextValue, ErrorKind},
};
use serde::Serialize;

use crate::screen;

/// Failure of a command. A command that has more to report has these fields in its own document.
#[derive(Debug, Serialize, thiserror::Error)]
#[error("{error}")]
pub struct Failure {
    /// The message that is on standard error, too.
    error: String,
    /// The program's exit code: 2 for wrong input, 1 for anything else.
    exit_code: u8,
    /// Faults of the input; empty where there are none.
    faults: Vec<InputError>,
}

impl Failure {
    /// Wrong input with these faults.
    pub fn of_faults(error: String, faults: impl IntoIterator<Item = InputError>) -> Self {
        Self { error, exit_code: 2, faults: faults.into_iter().collect() }
    }

    /// A command that failed.
    pub fn of_command(fault: &anyhow::Error) -> Self {
        let error = format!("{fault:#}").trim_end().to_owned();
        match fault.downcast_ref::<InputError>() {
            Some(of_input) => {
                let exit_code = if of_input.of_output { 1 } else { 2 };
                Self { exit_code, ..Self::of_faults(error, of_input.clone().all()) }
            }
            None => {
                let of_place = fault.chain().filter_map(|it| it.downcast_ref::<io::Error>()).next();
                let is_input = of_place.is_some_and(|it| !InputError::unwritten("", it, "").of_output);
                Self { exit_code: if is_input { 2 } else { 1 }, ..Self::of_faults(error, []) }
            }
        }
    }

    /// Arguments that are wrong, of a command that has others.
    pub fn of_arguments(fault: &clap::Error, command: &Command) -> Self {
        use ContextKind::{InvalidArg, InvalidSubcommand, InvalidValue, PriorArg, ValidValue};
        let texts = |kind| match fault.get(kind) {
            Some(ContextValue::Strings(all)) => all.clone(),
            Some(one) => vec![one.to_string()],
            None => Vec::new(),
        };
        let text = fault.render().to_string();
        let error = text.trim_start_matches("error: ").trim_end().to_owned();
        let value = texts(InvalidValue).into_iter().find(|it| !it.is_empty());
        let prior = texts(PriorArg);
        let commands = || command.get_subcommands().map(|it| it.get_name().to_owned());
        let told = |argument: &String| {
            let (found, expected) = match fault.kind() {
                ErrorKind::UnknownArgument | ErrorKind::InvalidSubcommand => {
                    let own = command.get_arguments().filter(|it| !it.is_global_set()).filter_map(|it| it.get_long());
                    let options = own.chain(["json"]).map(|it| format!("--{it}"));
                    ("an unknown argument".to_owned(), one_of(options.chain(commands())))
                }
                ErrorKind::MissingSubcommand => ("nothing".to_owned(), one_of(commands())),
                ErrorKind::ArgumentConflict if prior.contains(argument) => {
                    ("it twice".to_owned(), "it once".to_owned())
                }
                // An option of the throw that the program makes without a command, before one.
                ErrorKind::ArgumentConflict if texts(InvalidSubcommand).contains(argument) => {
                    ("options before it".to_owned(), format!("`{argument}` first, and then its options"))
                }
                ErrorKind::ArgumentConflict => {
                    let others = prior.iter().map(|it| name(it)).collect::<Vec<_>>().join(", ");
                    (format!("it beside {others}"), format!("it or {others}, not both"))
                }
                ErrorKind::TooManyValues => (value.clone().unwrap_or_default(), "no more values".to_owned()),
                _ => {
                    // The parsers of this program say what they expected; the others read numbers.
                    let by_parser = fault.source().map(ToString::to_string);
                    let by_parser = by_parser.map(|it| it.strip_prefix("expected ").unwrap_or("a number").to_owned());
                    let values = texts(ValidValue);
                    let expected = by_parser.or_else(|| (!values.is_empty()).then(|| one_of(values)));
                    let found = value.clone().unwrap_or_else(|| "nothing".to_owned());
                    (found, expected.unwrap_or_else(|| format!("a value: {argument}")))
                }
            };
            InputError::new(COMMAND_LINE, name(argument), found, expected)
        };
        let mut arguments = [texts(InvalidArg), texts(InvalidSubcommand)].concat();
        if arguments.is_empty() || fault.kind() == ErrorKind::MissingSubcommand {
            arguments.clear();
            arguments.push("COMMAND".to_owned());
        }
        let faults: Vec<InputError> = arguments.iter().map(told).collect();
        Self::of_faults(error, faults)
    }

    /// Says it on standard error and, where JSON is asked for, as a document on standard output.
    pub fn tell(&self, as_json: bool) -> ExitCode {
        screen::error(&self.error);
        if as_json {
            // Nobody is left to be told if this fails, too.
            let _ = screen::document(self);
        }
        ExitCode::from(self.exit_code)
    }
}

/// Name of an argument without the form of its value: `--out` of `--out <DIR>`, `FILE` of `<FILE>...`.
fn name(argument: &str) -> &str {
    argument.split(' ').next().unwrap_or_default().trim_end_matches("...").trim_matches(['<', '>', '[', ']'])
}

fn one_of(names: impl IntoIterator<Item = String>) -> String {
    format!("one of {}", names.into_iter().map(|it| format!("`{it}`")).collect::<Vec<_>>().join(", "))
}
