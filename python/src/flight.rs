//! Flights in this process.

use std::path::PathBuf;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use run_log::{Compression, LogError, Manifest, RunLogWriter};
use shared_types::Topic;
use zerocopy::FromBytes;

use crate::errors;
use crate::memory::{self, Samples, topic_of};

/// A flight: its samples and its summary.
#[pyclass(module = "gerono", subclass)]
pub(crate) struct Flight {
    scenario: scenario::Scenario,
    has_all: bool,
    names: Vec<&'static str>,
    /// Arrays that own the samples, created at the first access.
    arrays: Vec<Option<Py<PyArray1<u64>>>>,
    samples: Samples,
    summary: String,
}

impl Flight {
    pub(crate) fn new(scenario: scenario::Scenario, samples: Samples, summary: String) -> Self {
        Self {
            scenario,
            has_all: samples.has_all(),
            names: samples.names(),
            arrays: Topic::ALL.map(|_| None).into(),
            samples,
            summary,
        }
    }

    fn array(&mut self, py: Python<'_>, topic: Topic) -> Py<PyArray1<u64>> {
        let array = &mut self.arrays[topic.index()];
        array
            .get_or_insert_with(|| self.samples.take(py, topic).unbind())
            .clone_ref(py)
    }

    /// Passes the samples of all topics to `read`.
    fn with_all<R>(&mut self, py: Python<'_>, read: impl FnOnce(&[(Topic, &[u64])]) -> R) -> PyResult<R> {
        if !self.has_all {
            return Err(PyValueError::new_err(
                "not all topics were recorded: fly without `topics`",
            ));
        }
        let arrays = Topic::ALL.map(|topic| (topic, self.array(py, topic)));
        let borrowed: Vec<(Topic, PyReadonlyArray1<'_, u64>)> = arrays
            .iter()
            .map(|(topic, array)| (*topic, array.bind(py).readonly()))
            .collect();
        let slices: Result<Vec<(Topic, &[u64])>, _> = borrowed
            .iter()
            .map(|(topic, array)| array.as_slice().map(|slice| (*topic, slice)))
            .collect();
        Ok(read(&slices.map_err(errors::other)?))
    }
}

#[pymethods]
impl Flight {
    /// Names of the topics that have samples.
    #[getter]
    fn topics(&self) -> Vec<&'static str> {
        self.names.clone()
    }

    fn _words(&mut self, py: Python<'_>, topic: &str) -> PyResult<Py<PyArray1<u64>>> {
        let topic = topic_of(topic)?;
        Ok(self.array(py, topic))
    }

    fn _summary(&self) -> &str {
        &self.summary
    }

    /// Hash over all messages, as `gerono digest` prints it.
    #[getter]
    fn digest(&mut self, py: Python<'_>) -> PyResult<String> {
        self.with_all(py, memory::digest)
    }

    /// Write the log `run.mcap` into a folder, byte for byte that of `gerono run`.
    fn save(&mut self, py: Python<'_>, folder: PathBuf) -> PyResult<PathBuf> {
        std::fs::create_dir_all(&folder)?;
        if std::fs::read_dir(&folder)?.next().is_some() {
            let reason = format!("{} is not empty; name another folder", folder.display());
            return Err(pyo3::exceptions::PyFileExistsError::new_err(reason));
        }
        let path = folder.join("run.mcap");
        let manifest = Manifest::new(&self.scenario);
        let written = self.with_all(py, |samples| {
            let mut log = RunLogWriter::create_result(&path, &manifest, Compression::None)?;
            memory::in_order(samples, |topic, bytes, ends_tick| {
                if ends_tick {
                    log.end_tick(
                        u64::read_from_bytes(bytes).expect("the end of a tick comes with its number"),
                    )
                } else {
                    log.write(topic, bytes)
                }
            })?;
            log.finish().map(drop)
        })?;
        written.map_err(|error: LogError| pyo3::exceptions::PyOSError::new_err(error.to_string()))?;
        result_file::write(&folder.join("summary.json"), &self.summary, &[])?;
        Ok(path)
    }
}
