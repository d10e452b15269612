//! `catchingbot completions`: completion of arguments for a shell.

use clap::{Args, Command};
use clap_complete::{Shell, generate};

use crate::screen;

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

/// Prints the completions of `program`.
///
/// # Errors
/// If standard output is closed.
pub fn run(arguments: &CompletionsArguments, mut program: Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut program, "catchingbot", &mut script);
    Ok(screen::text(&String::from_utf8_lossy(&script))?)
}
