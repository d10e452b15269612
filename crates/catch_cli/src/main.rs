//! `catchingbot`: throws things at a simulated robot arm that catches them, and tells how it went.

use std::process::ExitCode;

fn main() -> ExitCode {
    catch_cli::main()
}
