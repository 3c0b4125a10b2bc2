//! Sweeps from Python.

use std::path::PathBuf;

use pyo3::prelude::*;
use sweep::flight::OwnController;

use crate::controller::{Error, PythonController};
use crate::errors;
use crate::interruptible::interruptible;

/// Fly a sweep in this process on all cores, or on a given number, and merge it. Ctrl-C keeps the rows that were flown.
#[pyfunction]
pub(crate) fn run_sweep(
    py: Python<'_>,
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: PathBuf,
    jobs: Option<usize>,
) -> PyResult<()> {
    interruptible(py, |interrupt| {
        sweep::library::run(text, scenario_path, scenario_text, &folder, jobs, interrupt)
    })?
    .map_err(|failure| errors::of_command(&failure))
}

/// As [`run_sweep`], with a controller that `make` makes for every flight.
#[pyfunction]
pub(crate) fn sweep_with(
    py: Python<'_>,
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: PathBuf,
    make: Py<PyAny>,
) -> PyResult<()> {
    let mut raised = None;
    let flown = py.detach(|| {
        let mut last: Option<Error> = None;
        let mut own = || {
            // A flight that its controller has failed ends the sweep.
            if let Some(error) = last.as_ref().and_then(Error::take) {
                let message = error.to_string();
                raised.get_or_insert(error);
                return Err(command_line::failure::Failure::trouble(message));
            }
            let made = Python::attach(|py| PythonController::new(make.bind(py).call0()?.as_any()));
            made.map_err(|error| {
                let message = error.to_string();
                raised.get_or_insert(error);
                command_line::failure::Failure::trouble(message)
            })
            .map(|controller| {
                let error = controller.error();
                last = Some(error.clone());
                OwnController {
                    service: Box::new(controller),
                    has_failed: Box::new(move || error.is_set()),
                }
            })
        };
        let flown = sweep::library::run_with(text, scenario_path, scenario_text, &folder, &mut own);
        let failed = last.and_then(|error| error.take());
        (flown, failed)
    });
    let (flown, failed) = flown;
    let raised = raised.or(failed);
    match (raised, flown) {
        (Some(error), _) => Err(error),
        (None, Err(failure)) => Err(errors::of_command(&failure)),
        (None, Ok(())) => Ok(()),
    }
}
