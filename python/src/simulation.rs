//! A flight that is flown step by step, with commands from outside.

use std::sync::{Arc, Mutex, PoisonError};

use flight::failure::{FlightFailure, Suspects};
use flight::in_process;
use host::in_process::{FlightError, FlightState, InProcess, TickSink};
use metrics::summary::{FlightSummary, cause_in_words};
use numpy::PyArray1;
use plugin::float_mode::StandardFloatMode;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use shared_types::samples::ControlCommand;
use shared_types::service::{ErasedService, InputView, OutputSlot, seconds};
use shared_types::{Now, ServiceId, Topic};
use zerocopy::FromBytes;

use crate::errors;
use crate::memory::topic_of;

/// A flight between two steps of its controller.
#[pyclass(module = "gerono", subclass)]
pub(crate) struct Simulation {
    host: Mutex<InProcess>,
    command: Arc<Mutex<Command>>,
    judge: FlightSummary,
    tick_ns: u64,
    is_done: bool,
    /// `true` once a step has failed: the flight has stopped within a tick, and can only continue from a restored state.
    has_failed: bool,
    /// The scenario as JSON: a state can only be restored in a flight of the same scenario.
    scenario: Arc<str>,
}

/// State of a simulation, which can be restored any number of times.
#[pyclass(frozen, module = "gerono")]
pub(crate) struct Snapshot {
    state: FlightState,
    judge: FlightSummary,
    is_done: bool,
    scenario: Arc<str>,
}

/// Command that acts until the next step.
#[derive(Clone, Copy, Debug, Default)]
struct Command {
    thrust: f64,
    torque_body: [f64; 3],
    rates_body: [f64; 3],
    mode: u32,
}

/// Controller that publishes the command passed to `step`.
struct ExternalCommand(Arc<Mutex<Command>>);

impl ErasedService for ExternalCommand {
    fn id(&self) -> ServiceId {
        ServiceId::Controller
    }

    fn step(&mut self, _now: &Now, _inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        if let Some(bytes) = outputs[0].bytes.as_deref_mut() {
            let given = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let command = ControlCommand::mut_from_bytes(bytes).expect("the first output is the command");
            command.thrust = given.thrust;
            command.torque_body = given.torque_body;
            command.rates_body = given.rates_body;
            command.mode = given.mode;
        }
    }

    fn state_size(&self) -> usize {
        0
    }

    fn save_with(&self, write: &mut dyn FnMut(&[u8])) {
        write(&[]);
    }

    fn restore(&mut self, _bytes: &[u8]) {}
}

/// Judges the flight.
struct Judge<'a>(&'a mut FlightSummary);

impl TickSink for Judge<'_> {
    type Error = std::convert::Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.observe(topic, bytes);
        Ok(())
    }
}

impl Simulation {
    pub(crate) fn new(scenario: &scenario::Scenario) -> PyResult<Self> {
        let mut host = in_process::host(scenario).map_err(|failure| errors::flight(&failure))?;
        let command = Arc::new(Mutex::new(Command {
            mode: if scenario.controller.rates.is_some() {
                ControlCommand::MODE_RATES
            } else {
                ControlCommand::MODE_TORQUE
            },
            ..Command::default()
        }));
        host.replace(Box::new(ExternalCommand(Arc::clone(&command))));
        let judge = FlightSummary::new(scenario, host.schedule());
        let mut simulation = Self {
            tick_ns: host.schedule().tick_ns(),
            host: Mutex::new(host),
            command,
            judge,
            is_done: false,
            has_failed: false,
            scenario: serde_json::to_string(scenario).map_err(errors::other)?.into(),
        };
        simulation.advance()?;
        Ok(simulation)
    }

    fn host(&mut self) -> &mut InProcess {
        self.host.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    fn refuse_failed(&self) -> PyResult<()> {
        match self.has_failed {
            true => Err(errors::other(
                "a step has failed: restore a snapshot, or start another flight",
            )),
            false => Ok(()),
        }
    }

    /// Flies one period of the controller with a command.
    pub(crate) fn fly_period(
        &mut self,
        thrust: f64,
        torque_body: [f64; 3],
        rates_body: [f64; 3],
    ) -> PyResult<()> {
        self.refuse_failed()?;
        {
            let mut command = self.command.lock().unwrap_or_else(PoisonError::into_inner);
            (command.thrust, command.torque_body, command.rates_body) = (thrust, torque_body, rates_body);
        }
        self.advance()
    }

    /// Returns the newest sample of a topic, if one has been published.
    pub(crate) fn newest(&mut self, topic: Topic) -> Option<&[u8]> {
        self.host().newest(topic)
    }

    /// Returns whether the vehicle is lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.judge.loss().is_some()
    }

    /// Flies to the next step of the controller.
    fn advance(&mut self) -> PyResult<()> {
        let _mode = StandardFloatMode::enter();
        let Self {
            host,
            judge,
            is_done,
            has_failed,
            ..
        } = self;
        let host = host.get_mut().unwrap_or_else(PoisonError::into_inner);
        match host.fly_to(ServiceId::Controller, &mut Judge(judge)) {
            Ok(continues) => *is_done = !continues,
            Err(FlightError::NonFinite(found)) => {
                (*is_done, *has_failed) = (true, true);
                let suspects = Suspects::of([ServiceId::Controller], &found);
                return Err(errors::other(FlightFailure::NonFinite(found, suspects)));
            }
            Err(FlightError::Sink(never)) => match never {},
        }
        Ok(())
    }
}

#[pymethods]
impl Simulation {
    /// Time of the controller's next step, s.
    #[getter]
    pub(crate) fn time(&mut self) -> f64 {
        let tick = self.host().next_tick();
        seconds(tick * self.tick_ns)
    }

    /// Whether the flight has ended.
    #[getter]
    pub(crate) fn done(&self) -> bool {
        self.is_done
    }

    /// Why and when the vehicle was lost, if it was.
    #[getter]
    fn lost(&self) -> Option<String> {
        let mut loss = self.judge.loss()?.clone();
        loss.cause = cause_in_words(loss.stopped_by);
        Some(format!("{loss}, at {} s", loss.time))
    }

    #[pyo3(signature = (thrust, torque_body = [0.0; 3], rates_body = [0.0; 3]))]
    fn _step(
        &mut self,
        py: Python<'_>,
        thrust: f64,
        torque_body: [f64; 3],
        rates_body: [f64; 3],
    ) -> PyResult<()> {
        py.detach(|| self.fly_period(thrust, torque_body, rates_body))
    }

    fn _newest<'py>(&mut self, py: Python<'py>, topic: &str) -> PyResult<Option<Bound<'py, PyArray1<u64>>>> {
        let topic = topic_of(topic)?;
        let bytes = self.host().newest(topic);
        let words = |bytes: &[u8]| {
            bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|word| u64::from_ne_bytes(*word))
                .collect()
        };
        Ok(bytes.map(|bytes| PyArray1::from_vec(py, words(bytes))))
    }

    /// Return the exact state of the whole flight.
    fn save(&mut self) -> PyResult<Snapshot> {
        self.refuse_failed()?;
        Ok(Snapshot {
            state: self.host().save(),
            judge: self.judge.clone(),
            is_done: self.is_done,
            scenario: Arc::clone(&self.scenario),
        })
    }

    /// Restore a state of this flight, earlier or later: of the same scenario with the same settings and the same seed.
    fn restore(&mut self, snapshot: &Snapshot) -> PyResult<()> {
        if snapshot.scenario != self.scenario {
            return Err(PyValueError::new_err(
                "the snapshot is of a flight of another scenario, or with other settings or another seed",
            ));
        }
        self.has_failed = false;
        self.host().restore(&snapshot.state);
        self.judge = snapshot.judge.clone();
        self.is_done = snapshot.is_done;
        Ok(())
    }
}
