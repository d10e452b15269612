//! The driver as a program: `catchingbot drive` and `catchingbot doctor` start it with a task.

use std::process::ExitCode;

fn main() -> ExitCode {
    catch_driver::program::main::<catch_ros2::Ros2>()
}
