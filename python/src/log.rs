//! Logs of simulated and real flights, also those that were never closed.

use std::path::{Path, PathBuf};

use numpy::PyArray1;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use run_log::LogReader;
use run_log::run_folder::log_meant_by;

use crate::memory::{Samples, topic_of};

/// The log of a flight.
#[pyclass(frozen, module = "gerono", subclass)]
pub(crate) struct Log {
    path: PathBuf,
    scenario: String,
    recovery: Option<String>,
}

#[pymethods]
impl Log {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let path = log_meant_by(&path);
        let reader = open(&path)?;
        Ok(Self {
            scenario: reader.manifest().scenario.to_json(),
            recovery: {
                let recoveries: Vec<_> = reader.recoveries().iter().map(ToString::to_string).collect();
                (!recoveries.is_empty()).then(|| recoveries.join("\n"))
            },
            path,
        })
    }

    /// The file of the log.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// The loss of data, if the log was recovered.
    #[getter]
    fn recovery(&self) -> Option<String> {
        self.recovery.clone()
    }

    fn _scenario(&self) -> &str {
        &self.scenario
    }

    fn _words<'py>(
        &self,
        py: Python<'py>,
        topic: &str,
    ) -> PyResult<(Bound<'py, PyArray1<u64>>, Option<String>)> {
        let topic = topic_of(topic)?;
        let (mut samples, damage) = py.detach(|| {
            let mut reader = open(&self.path)?;
            let mut samples = Samples::new(Some(&[topic]));
            loop {
                match reader.next_sample() {
                    Ok(Some(logged)) => samples.add(logged.topic, logged.bytes),
                    Ok(None) => return Ok::<_, PyErr>((samples, None)),
                    // The samples before the damage are complete.
                    Err(error) => return Ok((samples, Some(error.to_string()))),
                }
            }
        })?;
        Ok((samples.take(py, topic), damage))
    }
}

fn open(path: &Path) -> PyResult<LogReader> {
    LogReader::open(path).map_err(|error| PyOSError::new_err(error.to_string()))
}
