//! Flies a scenario in this process.

use std::time::Instant;

use host::in_process::{FlightError, InProcess, TickSink};
use scenario::Scenario;

use super::{Ending, FlightFailure, Outcome};
use command_line::interrupt::Interrupt;

/// Flies `scenario` to its end, or until `interrupt` is raised, and hands everything to `sink`.
///
/// # Errors
/// [`FlightFailure::Setup`] if the scenario cannot be flown at all.
pub fn fly<S: TickSink>(
    scenario: &Scenario,
    sink: &mut S,
    interrupt: &Interrupt,
) -> Result<Ending, FlightFailure>
where
    FlightFailure: From<S::Error>,
{
    super::refuse_unsimulated_poses(scenario)?;
    super::refuse_programs(scenario)?;
    let schedule = super::schedule_of(scenario)?;
    let services = registry::build_all(scenario).map_err(FlightFailure::setup)?;
    let mut host = InProcess::new(schedule, services);
    let mut sink = Interruptible {
        sink,
        interrupt,
        ticks: 0,
    };
    let started = Instant::now();
    let result = host.fly(&mut sink);
    let outcome = match result {
        Err(FlightError::NonFinite(found)) => Outcome::Failed(found.into()),
        Err(FlightError::Sink(error)) => Outcome::Failed(error.into()),
        Ok(()) => match interrupt.signal() {
            Some(signal) if sink.ticks <= host.schedule().last_tick() => Outcome::Interrupted { signal },
            _ => Outcome::Completed,
        },
    };
    Ok(Ending {
        outcome,
        ticks: sink.ticks,
        wall_time: started.elapsed(),
        warnings: Vec::new(),
        restarts: Vec::new(),
        timing: None,
        laboratory: None,
    })
}

/// Ends the flight on request.
struct Interruptible<'a, S> {
    sink: &'a mut S,
    interrupt: &'a Interrupt,
    ticks: u64,
}

impl<S: TickSink> TickSink for Interruptible<'_, S> {
    type Error = S::Error;

    #[inline]
    fn sample(&mut self, topic: shared_types::Topic, bytes: &[u8]) -> Result<(), Self::Error> {
        self.sink.sample(topic, bytes)
    }

    #[inline]
    fn end_tick(&mut self, tick: u64) -> Result<std::ops::ControlFlow<()>, Self::Error> {
        self.ticks = tick + 1;
        let flow = self.sink.end_tick(tick)?;
        Ok(if self.interrupt.signal().is_some() {
            std::ops::ControlFlow::Break(())
        } else {
            flow
        })
    }
}
