//! Exceptions of Python, with the messages of the command.

use flight::failure::FlightFailure;
use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme};
use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyOSError, PyRuntimeError, PyValueError};
use scenario_file::printable::report_of;
use sweep::error::SweepError;

create_exception!(
    gerono,
    ScenarioError,
    PyValueError,
    "A scenario that cannot be flown: the place, the reason and the fix."
);

/// Returns a diagnostic as text, without colours.
fn text(diagnostic: &dyn Diagnostic) -> String {
    let mut text = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor()).with_width(100);
    match handler.render_report(&mut text, diagnostic) {
        Ok(()) => format!("\n{text}"),
        Err(_) => diagnostic.to_string(),
    }
}

/// Error of a scenario.
pub(crate) fn scenario(error: &scenario_file::ScenarioError) -> PyErr {
    ScenarioError::new_err(text(error))
}

/// Error of a scenario that cannot be flown with the given arguments.
pub(crate) fn refused(message: &str) -> PyErr {
    ScenarioError::new_err(message.to_owned())
}

/// Error of a flight.
pub(crate) fn flight(failure: &FlightFailure) -> PyErr {
    match failure.is_of_setup() {
        true => refused(&failure.to_string()),
        false => other(failure),
    }
}

/// Error of a sweep.
pub(crate) fn sweep(error: &SweepError) -> PyErr {
    let message = text(report_of(error).as_ref());
    match error {
        SweepError::Scenario(error) => scenario(error),
        SweepError::Flight(FlightFailure::Refused(_)) | SweepError::BadInput(_) => {
            ScenarioError::new_err(message)
        }
        SweepError::NotWritten(_) => PyOSError::new_err(message),
        SweepError::Flight(_) | SweepError::Trouble(_) => PyRuntimeError::new_err(message),
    }
}

/// Any other error.
pub(crate) fn other(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}
