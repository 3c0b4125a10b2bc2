//! Sweeps from Python.

use std::path::PathBuf;

use pyo3::prelude::*;
use sweep::definition::Entry;
use sweep::error::SweepError;
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
    .map_err(|error| errors::sweep(&error))
}

/// As [`run_sweep`], with controllers written in Python: `make` gets the name of a law and returns the controller of one
/// flight, or None for a built-in law.
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
    let mut last: Option<Error> = None;
    let flown = py.detach(|| {
        let mut own = |entry: &Entry| {
            let made = Python::attach(|py| {
                // Flights of built-in laws run no Python code that would see Ctrl-C.
                py.check_signals()?;
                make_own(make.bind(py), &entry.name)
            });
            let made = made.map_err(|error| {
                let message = error.to_string();
                raised.get_or_insert(error);
                SweepError::trouble(message)
            })?;
            Ok(made.map(|(controller, name)| {
                let error = controller.error();
                last = Some(error.clone());
                OwnController {
                    name,
                    service: Box::new(controller),
                    has_failed: Box::new(move || error.is_set()),
                }
            }))
        };
        sweep::library::run_with(text, scenario_path, scenario_text, &folder, &mut own)
    });
    let failed = last.and_then(|error| error.take());
    match (raised.or(failed), flown) {
        (Some(error), _) => Err(error),
        (None, Err(error)) => Err(errors::sweep(&error)),
        (None, Ok(())) => Ok(()),
    }
}

/// Calls `make`, which returns None, or a bridge and the name of its controller.
fn make_own(make: &Bound<'_, PyAny>, law: &str) -> PyResult<Option<(PythonController, String)>> {
    let made = make.call1((law,))?;
    if made.is_none() {
        return Ok(None);
    }
    let (bridge, name): (Bound<'_, PyAny>, String) = made.extract()?;
    Ok(Some((PythonController::new(&bridge)?, name)))
}
