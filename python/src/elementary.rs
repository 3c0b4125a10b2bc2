//! Elementary functions with the same bytes on every machine.

use std::ffi::CString;

use plugin::math::{BINARY, UNARY};
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict};

/// Returns the functions of one and of two arguments, by their names.
#[pyfunction]
pub fn elementary_functions(python: Python<'_>) -> PyResult<(Bound<'_, PyDict>, Bound<'_, PyDict>)> {
    let (one, two) = (PyDict::new(python), PyDict::new(python));
    // Leaked once, when the module is imported.
    let c_name = |name: &str| &*Box::leak(CString::new(name).expect("a name").into_boxed_c_str());
    for &(name, function) in UNARY {
        let callable = PyCFunction::new_closure(
            python,
            Some(c_name(name)),
            None,
            move |arguments, _| -> PyResult<f64> {
                let (x,): (f64,) = arguments.extract()?;
                Ok(function(x))
            },
        )?;
        one.set_item(name, callable)?;
    }
    for &(name, function) in BINARY {
        let callable = PyCFunction::new_closure(
            python,
            Some(c_name(name)),
            None,
            move |arguments, _| -> PyResult<f64> {
                let (x, y): (f64, f64) = arguments.extract()?;
                Ok(function(x, y))
            },
        )?;
        two.set_item(name, callable)?;
    }
    Ok((one, two))
}
