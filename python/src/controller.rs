//! A controller written in Python, as a service of a flight.

use std::sync::{Arc, Mutex};

use numpy::{PyArray1, PyArrayMethods};
use plugin::float_mode::FloatMode;
use pyo3::prelude::*;
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, ServiceId};
use zerocopy::IntoBytes;

/// Controller of a flight, called through a `gerono.controller.Bridge`: arrays for inputs and outputs, and a step.
pub(crate) struct PythonController {
    step: Py<PyAny>,
    pack: Py<PyAny>,
    unpack: Py<PyAny>,
    now: Py<PyArray1<u64>>,
    inputs: Vec<Py<PyArray1<u64>>>,
    /// Command, adaptation, errors and telemetry.
    outputs: Vec<Py<PyArray1<u64>>>,
    /// Size of the state, in numbers.
    state: usize,
    error: Error,
}

/// First error of a step, shared with the host.
#[derive(Clone, Default)]
pub(crate) struct Error(Arc<Mutex<Option<PyErr>>>);

impl Error {
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<PyErr>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    pub(crate) fn is_set(&self) -> bool {
        self.lock().is_some()
    }

    pub(crate) fn take(&self) -> Option<PyErr> {
        self.lock().take()
    }

    fn set(&self, error: PyErr) {
        self.lock().get_or_insert(error);
    }
}

impl PythonController {
    pub(crate) fn new(bridge: &Bound<'_, PyAny>) -> PyResult<Self> {
        let array = |name: &str| -> PyResult<Py<PyArray1<u64>>> {
            Ok(bridge.getattr(name)?.cast_into::<PyArray1<u64>>()?.unbind())
        };
        let arrays = |name: &str| -> PyResult<Vec<Py<PyArray1<u64>>>> {
            let list = bridge.getattr(name)?;
            list.try_iter()?
                .map(|array| Ok(array?.cast_into::<PyArray1<u64>>()?.unbind()))
                .collect()
        };
        Ok(Self {
            step: bridge.getattr("step")?.unbind(),
            pack: bridge.getattr("pack")?.unbind(),
            unpack: bridge.getattr("unpack")?.unbind(),
            now: array("now_words")?,
            inputs: arrays("input_words")?,
            outputs: arrays("output_words")?,
            state: bridge.getattr("state_size")?.extract()?,
            error: Error::default(),
        })
    }

    /// Returns the slot for the first error.
    pub(crate) fn error(&self) -> Error {
        self.error.clone()
    }

    fn call(
        &self,
        py: Python<'_>,
        now: &Now,
        inputs: &[InputView<'_>],
        outputs: &mut [OutputSlot<'_>],
    ) -> PyResult<()> {
        let times = [now.tick, seconds(now.time_ns), seconds(now.elapsed_ns)];
        write(self.now.bind(py), times.as_bytes())?;
        let mut arrived = 0;
        for (index, (view, array)) in inputs.iter().zip(&self.inputs).enumerate() {
            if let Some(bytes) = view.bytes {
                write(array.bind(py), bytes)?;
                arrived |= 1 << index;
            }
        }
        for (slot, array) in outputs.iter_mut().zip(&self.outputs) {
            if let Some(bytes) = slot.bytes.as_deref() {
                write(array.bind(py), bytes)?;
            }
        }
        let mode = FloatMode::current();
        let stepped = self.step.call1(py, (arrived,));
        if FloatMode::current() != mode {
            mode.set();
            stepped?;
            return Err(crate::errors::other(
                "the controller changed the floating-point mode in its step, which would change the last bits of all numbers; \
                 restore the mode, or do not flush subnormal numbers to zero",
            ));
        }
        stepped?;
        for (slot, array) in outputs.iter_mut().zip(&self.outputs) {
            if let Some(bytes) = slot.bytes.as_deref_mut() {
                let array = array.bind(py).try_readonly()?;
                let written = array.as_slice()?.as_bytes();
                // The host writes the header.
                let header = size_of::<shared_types::Header>();
                bytes[header..].copy_from_slice(&written[header..]);
            }
        }
        Ok(())
    }
}

fn seconds(time_ns: u64) -> u64 {
    shared_types::service::seconds(time_ns).to_bits()
}

fn write(array: &Bound<'_, PyArray1<u64>>, bytes: &[u8]) -> PyResult<()> {
    let mut array = array.try_readwrite()?;
    array.as_slice_mut()?.as_mut_bytes()[..bytes.len()].copy_from_slice(bytes);
    Ok(())
}

impl ErasedService for PythonController {
    fn id(&self) -> ServiceId {
        ServiceId::Controller
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        if self.error.is_set() {
            return;
        }
        if let Err(error) = Python::attach(|py| self.call(py, now, inputs, outputs)) {
            self.error.set(error);
        }
    }

    fn state_size(&self) -> usize {
        self.state * size_of::<f64>()
    }

    fn save_with(&self, write: &mut dyn FnMut(&[u8])) {
        let packed = Python::attach(|py| -> PyResult<Vec<f64>> { self.pack.call0(py)?.extract(py) });
        match packed {
            Ok(state) if state.len() == self.state => write(state.as_bytes()),
            Ok(_) => {
                self.error.set(crate::errors::other(
                    "the size of the controller's state has changed",
                ));
                write(vec![0; self.state_size()].as_slice());
            }
            Err(error) => {
                self.error.set(error);
                write(vec![0; self.state_size()].as_slice());
            }
        }
    }

    fn restore(&mut self, bytes: &[u8]) {
        let state: Vec<f64> = bytes
            .as_chunks::<8>()
            .0
            .iter()
            .map(|word| f64::from_ne_bytes(*word))
            .collect();
        let restored = Python::attach(|py| self.unpack.call1(py, (state,)).map(drop));
        if let Err(error) = restored {
            self.error.set(error);
        }
    }
}
