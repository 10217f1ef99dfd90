//! How a program ends.

use std::{fmt::Display, process::ExitCode};

/// Tells an error, and that there was one.
pub fn of<E: Display>(result: Result<(), E>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
