//! Exit codes of the programs.

use std::{fmt::Display, process::ExitCode};

/// Prints an error, and returns the exit code.
pub fn of<E: Display>(result: Result<(), E>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
