//! Texts of a [`abi::Setup`]: the scenario and its parameters for a library.

use std::cell::Cell;
use std::ffi::CString;

use scenario::Scenario;

use crate::abi;
use crate::math::MATH;

/// Texts of a [`abi::Setup`].
pub(crate) struct SetupTexts {
    scenario: CString,
    names: Vec<CString>,
    values: Vec<f64>,
    asked: Vec<Cell<u8>>,
}

impl SetupTexts {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let json = serde_json::to_string(scenario).expect("a scenario has only string keys");
        let parameters = scenario.plugins.as_ref().map(|plugins| &plugins.parameters);
        let parameters = parameters.into_iter().flatten();
        // JSON escapes zero bytes, and the check of the scenario refuses names with one.
        let (names, values): (Vec<_>, Vec<_>) = parameters
            .filter_map(|(name, &value)| Some((CString::new(name.as_str()).ok()?, value)))
            .unzip();
        Self {
            scenario: CString::new(json).expect("JSON has no zero bytes"),
            asked: vec![Cell::new(0); names.len() + 1],
            names,
            values,
        }
    }

    /// Calls `act` with the setup.
    pub(crate) fn with<R>(&self, act: impl FnOnce(&abi::Setup) -> R) -> R {
        let parameters: Vec<_> = self
            .names
            .iter()
            .zip(&self.values)
            .map(|(name, &value)| abi::Parameter {
                name: name.as_ptr(),
                value,
            })
            .collect();
        act(&abi::Setup {
            scenario: self.scenario.as_ptr(),
            parameters: parameters.as_ptr(),
            parameter_count: parameters.len(),
            asked: self.asked.as_ptr(),
            math: &raw const MATH,
        })
    }

    /// Returns the names of the parameters that the library has not requested; none for a library that sets no marks.
    pub(crate) fn unasked(&self) -> Vec<String> {
        let (of_any, asked) = self
            .asked
            .split_last()
            .expect("there is one more than parameters");
        let names = self.names.iter().zip(asked);
        names
            .filter(|(_, asked)| of_any.get() != 0 && asked.get() == 0)
            .map(|(name, _)| name.to_string_lossy().into_owned())
            .collect()
    }
}
