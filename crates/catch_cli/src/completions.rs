//! `catchingbot completions`: completion of arguments for a shell.

use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

use crate::{Arguments, screen};

/// Arguments of `completions`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  catchingbot completions bash > ~/.local/share/bash-completion/completions/catchingbot
  catchingbot completions fish > ~/.config/fish/completions/catchingbot.fish")]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the completions.
///
/// # Errors
/// If standard output is closed.
pub fn run(arguments: &CompletionsArguments) -> anyhow::Result<()> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut Arguments::command(), "catchingbot", &mut script);
    Ok(screen::text(&String::from_utf8_lossy(&script))?)
}
