//! Scenarios.

use std::path::PathBuf;

use flight::failure::FlightFailure;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use flight::{Outcome, in_process};
use metrics::summary::RunFacts;
use pyo3::prelude::*;
use scenario::Programs;
use shared_types::service::ErasedService;
use shared_types::{ServiceId, Topic};
use std::sync::Arc;

use crate::controller::PythonController;
use crate::errors;
use crate::flight::Flight;
use crate::interruptible::interruptible;
use crate::memory::{Samples, topic_of};
use crate::side_by_side::PreparedScenario;
use crate::simulation::Simulation;

/// A scenario: the file that `gerono run` flies, or its text.
#[pyclass(frozen, module = "gerono", subclass)]
pub(crate) struct Scenario {
    path: PathBuf,
    text: String,
}

impl Scenario {
    /// Returns the scenario with settings and a seed.
    pub(crate) fn load(&self, sets: &[String], seed: Option<u64>) -> PyResult<scenario::Scenario> {
        scenario_file::load_from(&self.path, &self.text, sets, seed).map_err(|error| errors::scenario(&error))
    }

    fn refuse_other_controllers(&self, scenario: &scenario::Scenario, sets: &[String]) -> PyResult<()> {
        if scenario.has_plugin(ServiceId::Controller) {
            return Err(errors::refused(
                "a plug-in and a controller in Python cannot both fly: remove `plugins.controller`, or pass no controller",
            ));
        }
        scenario_file::refuse_own_law(&self.path, &self.text, sets).map_err(|error| errors::scenario(&error))
    }
}

#[pymethods]
impl Scenario {
    #[new]
    #[pyo3(signature = (path, text = None))]
    fn new(path: PathBuf, text: Option<String>) -> PyResult<Self> {
        let text = match text {
            Some(text) => text,
            None => {
                std::fs::read_to_string(&path).map_err(|_| match scenario_file::load(&path, &[], None) {
                    Err(error) => errors::scenario(&error),
                    Ok(_) => errors::other(format!("cannot read {}", path.display())),
                })?
            }
        };
        let scenario = Self { path, text };
        scenario.load(&[], None)?;
        Ok(scenario)
    }

    /// The file of the scenario.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// The text of the scenario.
    #[getter]
    fn text(&self) -> String {
        self.text.clone()
    }

    /// The scenario with settings, as JSON.
    fn _json(&self, sets: Vec<String>, seed: Option<u64>) -> PyResult<String> {
        let scenario = self.load(&sets, seed)?;
        Ok(scenario.to_json())
    }

    fn _fly(
        &self,
        py: Python<'_>,
        sets: Vec<String>,
        seed: Option<u64>,
        topics: Option<Vec<String>>,
        controller: Option<(Py<PyAny>, String)>,
    ) -> PyResult<Flight> {
        let mut scenario = self.load(&sets, seed)?;
        let topics: Option<Vec<Topic>> = topics
            .map(|names| names.iter().map(|name| topic_of(name)).collect::<PyResult<_>>())
            .transpose()?;
        let mut own = None;
        if let Some((controller, name)) = controller {
            self.refuse_other_controllers(&scenario, &sets)?;
            // Recorded in the log.
            scenario.programs = Some(Programs::own_controller(name));
            own = Some(PythonController::new(controller.bind(py))?);
        }
        fly(py, scenario, topics.as_deref(), own)
    }

    /// Refuses settings for a controller in Python that choose another controller or set its gains.
    fn _check_own(&self, sets: Vec<String>, varied: Vec<String>) -> PyResult<()> {
        let scenario = self.load(&sets, None)?;
        self.refuse_other_controllers(&scenario, &[sets, varied].concat())
    }

    fn _start(&self, sets: Vec<String>, seed: Option<u64>) -> PyResult<Simulation> {
        Simulation::new(&self.load(&sets, seed)?)
    }

    /// Reads and checks the scenario with settings, once for many flights without a law.
    fn _prepare(&self, sets: Vec<String>) -> PyResult<PreparedScenario> {
        let scenario = self.load(&sets, None)?;
        self.refuse_other_controllers(&scenario, &sets)?;
        Ok(PreparedScenario(scenario))
    }

    fn __repr__(&self) -> String {
        format!("gerono.Scenario({:?})", self.path.display().to_string())
    }
}

/// Flies in this process, without Python's lock.
fn fly(
    py: Python<'_>,
    scenario: scenario::Scenario,
    topics: Option<&[Topic]>,
    own: Option<PythonController>,
) -> PyResult<Flight> {
    let failed = own.as_ref().map(PythonController::error);
    // A controller in Python is stepped by this thread, where Python's handlers of signals run.
    let is_python = own.is_some();
    let flight = |interrupt: &Interrupt| {
        let schedule = flight::schedule_of(&scenario).map_err(|error| error.to_string())?;
        let mut samples = Samples::new(topics);
        let mut add = |topic: Topic, bytes: &[u8]| samples.add(topic, bytes);
        let mut sink = RecordingSink::new(&scenario, &schedule, None, Arc::default()).with_copy(&mut add);
        if let Some(failed) = &failed {
            sink = sink.until(|| failed.is_set());
        }
        let own = own.map(|own| Box::new(own) as Box<dyn ErasedService>);
        let ending = in_process::fly_with(&scenario, own, &mut sink, interrupt);
        let (summary, _) = sink.finish();
        Ok::<_, String>((ending, summary, samples))
    };
    let flown = if is_python {
        py.detach(|| flight(&Interrupt::never()))
    } else {
        interruptible(py, flight)?
    };
    let (ending, summary, samples) = flown.map_err(errors::other)?;
    if let Some(error) = failed.and_then(|failed| failed.take()) {
        return Err(error);
    }
    let ending = ending.map_err(|failure| errors::flight(&failure))?;
    if let Outcome::Failed(failure) = &ending.outcome
        && failure.not_finite_at().is_none()
    {
        return Err(errors::other(failure));
    }
    let facts = RunFacts {
        host: "inprocess".to_owned(),
        wall_seconds: ending.wall_time.as_secs_f64(),
        ..ending.outcome.facts(FlightFailure::not_finite_at)
    };
    let summary = serde_json::to_string(&summary.finish(facts)).map_err(errors::other)?;
    Ok(Flight::new(scenario, samples, summary))
}
