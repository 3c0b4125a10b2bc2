//! `_gerono`: the compiled module of the Python package `gerono`.
//!
//! Flights in process release Python's lock; only a controller written in Python takes it, once a step. Samples are passed
//! to Python as arrays of 64-bit words without a copy; the package views them as structured arrays.

#![expect(
    clippy::needless_pass_by_value,
    reason = "functions called from Python own their arguments"
)]

mod controller;
mod elementary;
mod errors;
mod flight;
mod interruptible;
mod log;
mod memory;
mod scenario;
mod side_by_side;
mod simulation;
mod sweep;

use pyo3::prelude::*;

/// Parts of the package `gerono`.
#[pymodule]
mod _gerono {
    #[pymodule_export]
    use crate::elementary::elementary_functions;
    #[pymodule_export]
    use crate::errors::ScenarioError;
    #[pymodule_export]
    use crate::flight::Flight;
    #[pymodule_export]
    use crate::log::Log;
    #[pymodule_export]
    use crate::scenario::Scenario;
    #[pymodule_export]
    use crate::side_by_side::{
        PreparedScenario, observe_samples, start_side_by_side, step_side_by_side, view_side_by_side,
    };
    #[pymodule_export]
    use crate::simulation::{Simulation, Snapshot};
    #[pymodule_export]
    use crate::sweep::{run_sweep, sweep_with};
    use pyo3::prelude::*;

    /// Returns the message definition of every topic, by its name.
    #[pyfunction]
    fn definitions() -> Vec<(&'static str, String)> {
        let definition = |topic: shared_types::Topic| (topic.name(), topic.msg_definition());
        shared_types::Topic::ALL.map(definition).into()
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
