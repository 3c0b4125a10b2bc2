//! What ends a command early.

use miette::Report;

use crate::exit::Exit;
use crate::terminal::printable_lines;

/// What ends a command early: what to tell the user and the exit code.
#[derive(Debug)]
pub struct Failure {
    /// What to tell the user.
    pub report: Report,
    /// The exit code.
    pub exit: Exit,
}

impl Failure {
    /// What an error makes of a command.
    #[must_use]
    pub fn new(exit: Exit, error: impl std::fmt::Display) -> Self {
        Self {
            report: report_of(&error),
            exit,
        }
    }
}

/// What a terminal is told of an error.
#[must_use]
pub fn report_of(error: &impl std::fmt::Display) -> Report {
    Report::msg(printable_lines(&error.to_string()).into_owned())
}
