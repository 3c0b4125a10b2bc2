//! Flies a scenario in this process.

use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;
use std::time::Instant;

use host::in_process::{FlightError, InProcess, TickSink};
use host::watchdog::{self, Work};
use plugin::float_mode::StandardFloatMode;
use scenario::Scenario;
use shared_types::service::ErasedService;

use crate::failure::{FlightFailure, Suspects};
use crate::interrupt::Interrupt;
use crate::recording_sink::RecordingSink;
use crate::{Ending, Outcome};

/// Exit code of a process whose flight failed.
const FLIGHT_FAILED: u8 = 3;

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
    if let Some(reason) = crate::programs_of_its_own(scenario) {
        return Err(FlightFailure::setup(reason));
    }
    fly_with(scenario, None, sink, interrupt)
}

/// As [`fly`], into a recording. Not generic, so that it is optimised as the services are, whatever its callers are.
///
/// # Errors
/// As [`fly`].
pub fn record(
    scenario: &Scenario,
    sink: &mut RecordingSink<'_>,
    interrupt: &Interrupt,
) -> Result<Ending, FlightFailure> {
    fly(scenario, sink, interrupt)
}

/// As [`fly`], with a service of the caller's in place of Gerono's own.
///
/// # Errors
/// As [`fly`].
pub fn fly_with<S: TickSink>(
    scenario: &Scenario,
    own: Option<Box<dyn ErasedService>>,
    sink: &mut S,
    interrupt: &Interrupt,
) -> Result<Ending, FlightFailure>
where
    FlightFailure: From<S::Error>,
{
    let _mode = StandardFloatMode::enter();
    let watches = scenario.has_plugins();
    let mut host = if watches {
        // The state before the first step is saved here.
        caught(|| host(scenario))??
    } else {
        host(scenario)?
    };
    let callers = own.as_ref().map(|own| own.id());
    if let Some(own) = own {
        host.replace(own);
    } else if !watches {
        host = host.in_batches();
    }
    let mut sink = Interruptible {
        sink,
        interrupt,
        ticks: 0,
        watches,
    };
    let started = Instant::now();
    let result = if watches {
        fly_plugins(&mut host, &mut sink)
    } else {
        host.fly(&mut sink).map_err(Stop::Host)
    };
    let outcome = match result {
        Err(Stop::Failed(failure)) => Outcome::Failed(failure),
        Err(Stop::Host(FlightError::NonFinite(found))) => {
            let foreign = scenario.foreign_services().chain(callers);
            let suspects = Suspects::of(foreign, &found);
            Outcome::Failed(FlightFailure::NonFinite(found, suspects))
        }
        Err(Stop::Host(FlightError::Sink(error))) => Outcome::Failed(error.into()),
        Ok(()) => match interrupt.signal() {
            Some(signal) if sink.ticks <= host.schedule().last_tick() => Outcome::Interrupted { signal },
            _ => Outcome::Completed,
        },
    };
    // The thread of a `destroy` that does not return is left to itself: the flight was flown, and its log is whole.
    drop(host);
    let warnings = plugin::loader::take_hung_destroy();
    Ok(Ending {
        outcome,
        ticks: sink.ticks,
        wall_time: started.elapsed(),
        warnings: warnings.into_iter().collect(),
    })
}

/// Returns the host of a flight of `scenario`, before its first tick.
///
/// # Errors
/// [`FlightFailure::Setup`] if the scenario cannot be flown at all.
pub fn host(scenario: &Scenario) -> Result<InProcess, FlightFailure> {
    if let Some(reason) = crate::unsimulated_poses(scenario) {
        return Err(FlightFailure::setup(reason));
    }
    if let Some(problem) = scenario.missing_arm_request() {
        return Err(FlightFailure::setup(format!(
            "{}: {}",
            problem.reason, problem.fix
        )));
    }
    let schedule = crate::schedule_of(scenario)?;
    let services = registry::build_all(scenario).map_err(FlightFailure::Refused)?;
    Ok(InProcess::new(schedule, services))
}

/// Flies with code that is not Gerono's own: it may panic, which fails the flight, or never return from a step.
fn fly_plugins<S: TickSink>(
    host: &mut InProcess,
    sink: &mut Interruptible<'_, S>,
) -> Result<(), Stop<S::Error>> {
    static WATCHED: Once = Once::new();
    let mut watched = Ok(());
    let check = |too_long: Option<Work>| {
        if too_long.is_some() {
            give_up();
        }
    };
    WATCHED.call_once(|| watched = watchdog::watch(check));
    watched.map_err(|error| Stop::Failed(FlightFailure::setup(error)))?;
    watchdog::work(Work::Step);
    let flown = caught(|| host.fly(sink));
    watchdog::idle();
    flown.map_err(Stop::Failed)?.map_err(Stop::Host)
}

/// Calls code that is not Gerono's own, whose panic is a failure of the flight.
fn caught<T>(act: impl FnOnce() -> T) -> Result<T, FlightFailure> {
    with_plugins(act).map_err(FlightFailure::Plugin)
}

/// Runs services of which some are plug-ins.
///
/// # Errors
/// The words of a panic: what a plug-in did wrong.
pub fn with_plugins<R>(act: impl FnOnce() -> R) -> Result<R, String> {
    catch_unwind(AssertUnwindSafe(act)).map_err(|panic| {
        let words = panic.downcast::<String>();
        words.map_or_else(|_| "a service panicked".to_owned(), |words| *words)
    })
}

/// Reason why a flight stopped before its end.
enum Stop<E> {
    Host(FlightError<E>),
    Failed(FlightFailure),
}

/// Ends the process: the thread that flies is inside of the library, and no other way leads out of it.
fn give_up() -> ! {
    // A full disk behind standard error changes no exit code.
    let _ = writeln!(
        std::io::stderr(),
        "a step of a plug-in has not returned for 20 s; the log ends before it (`gerono recover`)"
    );
    plugin::end_process(FLIGHT_FAILED)
}

/// Ends the flight on request.
struct Interruptible<'a, S> {
    sink: &'a mut S,
    interrupt: &'a Interrupt,
    ticks: u64,
    /// `true` if the watchdog is to see that steps return.
    watches: bool,
}

impl<S: TickSink> TickSink for Interruptible<'_, S> {
    type Error = S::Error;

    fn wants(&self, topic: shared_types::Topic) -> bool {
        self.sink.wants(topic)
    }

    #[inline]
    fn sample(&mut self, topic: shared_types::Topic, bytes: &[u8]) -> Result<(), Self::Error> {
        self.sink.sample(topic, bytes)
    }

    #[inline]
    fn end_tick(&mut self, tick: u64) -> Result<std::ops::ControlFlow<()>, Self::Error> {
        self.ticks = tick + 1;
        if self.watches {
            watchdog::work(Work::Step);
        }
        let flow = self.sink.end_tick(tick)?;
        Ok(if self.interrupt.signal().is_some() {
            std::ops::ControlFlow::Break(())
        } else {
            flow
        })
    }
}
