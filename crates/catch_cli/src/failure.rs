//! Failures as a script reads them: with `--json` each is one document of one shape, whatever command it was
//! and whatever went wrong.

use std::{error::Error, io, process::ExitCode};

use catch_body::InputError;
use catch_recording::whole_file::COMMAND_LINE;
use clap::error::ContextKind;
use serde::Serialize;

use crate::screen;

/// Failure of a command. A command that has more to report has these fields in its own document.
#[derive(Debug, Serialize)]
pub struct Failure {
    /// The message that is on standard error, too.
    pub error: String,
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

    /// Arguments that are wrong.
    pub fn of_arguments(fault: &clap::Error) -> Self {
        use ContextKind::{
            InvalidArg, InvalidSubcommand, InvalidValue, PriorArg, SuggestedArg, SuggestedSubcommand, SuggestedValue,
            ValidSubcommand, ValidValue,
        };
        let first = |kinds: &[ContextKind]| kinds.iter().find_map(|kind| fault.get(*kind)).map(ToString::to_string);
        let field = first(&[InvalidArg, InvalidSubcommand]).unwrap_or_else(|| "arguments".to_owned());
        let expected = (fault.source().map(ToString::to_string))
            .or_else(|| first(&[ValidValue, ValidSubcommand, SuggestedValue, SuggestedArg, SuggestedSubcommand]))
            .or_else(|| first(&[PriorArg]).map(|other| format!("not both it and {other}")))
            .unwrap_or_else(|| "what --help says".to_owned());
        let text = fault.render().to_string();
        let error = text.trim_start_matches("error: ").trim_end().to_owned();
        let found = first(&[InvalidValue]).or_else(|| error.lines().next().map(str::to_owned)).unwrap_or_default();
        Self::of_faults(error, [InputError::new(COMMAND_LINE, field, found, expected)])
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
