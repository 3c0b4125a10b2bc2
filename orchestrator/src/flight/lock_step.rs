//! Flies a scenario as processes in lock-step: one a service, and this one, which supervises and records.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::Start;
use runtime::crash::Crash;
use runtime::deployment::{self, Scheduler};
use runtime::in_process::TickSink;
use runtime::ports::{Member, PortError};
use runtime::wait::BLOCK_ALWAYS;
use shared_types::ServiceId;
use shared_types::scenario::Scenario;

use super::crew::{Crew, CrewEvent, Restarts};
use super::recorder::{Progress, Recorder};
use super::{Ending, FlightFailure, Outcome};
use crate::interrupt::Interrupt;
use crate::run_root::RunRoot;

/// How often the recorder looks: between two looks the fastest flight fills a tenth of its buffers.
const RECORDER_PERIOD: Duration = Duration::from_millis(1);

/// How often it looks while a service is being born again and the flight waits.
pub(super) const BIRTH_PERIOD: Duration = Duration::from_micros(100);

/// How the processes of a run use the machine. Nothing of it changes the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deployment {
    /// Which core the services use.
    pub placement: Placement,
    /// How the services' core is shared.
    pub scheduler: Scheduler,
    /// Whether a waiting service may yield first or always sleeps at once.
    pub yielding: bool,
    /// Deaths that processes shall bring upon themselves: the first of a service upon its first process, and so on.
    pub crashes: Vec<(ServiceId, Crash)>,
    /// How often and how soon each service is started again.
    pub restarts: Restarts,
}

impl Default for Deployment {
    fn default() -> Self {
        Self {
            placement: Placement::AsStated,
            scheduler: Scheduler::Fair,
            yielding: true,
            crashes: Vec::new(),
            restarts: Restarts::default(),
        }
    }
}

impl Deployment {
    /// The scenario with the command line's word in place of its own about cores and priorities.
    pub(super) fn stated_over(&self, scenario: &Scenario) -> Scenario {
        let mut scenario = scenario.clone();
        if let Some(stated) = &mut scenario.deployment {
            if self.placement != Placement::AsStated {
                stated.forget_cores();
            }
            if self.scheduler == Scheduler::Fifo {
                stated.forget_priorities();
            }
        }
        scenario
    }
}

/// What of a deployment could not be had, if the flight may do without it.
///
/// # Errors
/// [`FlightFailure::NotPermitted`] if the scenario says that it may not.
pub fn permitted(is_strict: bool, warnings: Vec<String>) -> Result<Vec<String>, FlightFailure> {
    if is_strict && !warnings.is_empty() {
        return Err(FlightFailure::NotPermitted { refusals: warnings });
    }
    Ok(warnings)
}

/// Which core the services of a run use. Together on one is the fastest way; the recorder takes the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// As the scenario says; where it does not, the one that is idlest as the run begins.
    AsStated,
    /// This one.
    Core(usize),
    /// Wherever the system puts them.
    Anywhere,
}

/// What happens to the processes of a run, for whoever keeps a record of the machine.
pub trait CrewObserver {
    /// The processes have been started and are ready.
    fn ready(&mut self, crew: &Crew<'_>, core: Option<usize>);
    /// Processes may have died, and services may fly again.
    fn changed(&mut self, crew: &Crew<'_>);
    /// About a second of the flight has passed, or it has ended.
    fn health(&mut self, crew: &Crew<'_>);
    /// The flight has ended, and this is how.
    fn ended(&mut self, crew: &Crew<'_>, outcome: &Outcome);
}

/// Flies `scenario` to its end, or until `interrupt` is raised, and hands everything to `sink`.
///
/// # Errors
/// [`FlightFailure`] if the run cannot be set up. A failure in flight is the ending's outcome.
pub fn fly<S: TickSink>(
    scenario: &Scenario,
    deployment: &Deployment,
    sink: &mut S,
    interrupt: &Interrupt,
    observer: &mut dyn CrewObserver,
) -> Result<Ending, FlightFailure>
where
    FlightFailure: From<S::Error>,
{
    let schedule = scenario
        .schedule()
        .map_err(|problems| FlightFailure::Setup(format!("{problems:?}")))?;
    let root = RunRoot::create().map_err(|error| FlightFailure::Setup(error.to_string()))?;
    let scenario = deployment.stated_over(scenario);
    let is_strict = scenario.deployment.as_ref().is_some_and(|stated| stated.strict);
    let cores = Cores::choose(deployment.placement, &scenario);
    cores.keep_off();
    let member = Member::join(&root.configuration(), "orchestrator").map_err(port_failure)?;
    let (mut recorder, _topics) = Recorder::create(&member, &schedule).map_err(port_failure)?;
    let start = Start {
        scenario,
        iceoryx2_configuration: root.configuration(),
        core: cores.ring,
        scheduler: deployment.scheduler,
        role: None,
        real_time: None,
    };
    let mut crew = Crew::start(
        &member,
        root.lock(),
        &schedule,
        start,
        deployment.crashes.clone(),
        deployment.restarts,
    )?;
    let words = crew.page().words();
    recorder.make_known(words);
    if !deployment.yielding {
        words.block_only.store(BLOCK_ALWAYS, Ordering::Relaxed);
    }
    let warnings = permitted(is_strict, crew.await_ready()?)?;
    observer.ready(&crew, cores.ring);

    let started = Instant::now();
    crew.go()?;
    recorder.connect().map_err(port_failure)?;
    observer.changed(&crew);
    let mut flight = Flight {
        crew,
        recorder,
        observer,
    };
    let outcome = flight.supervise(sink, interrupt).unwrap_or_else(Outcome::Failed);
    let wall_time = started.elapsed();
    let outcome = wind_up(&mut flight.crew, &mut flight.recorder, sink, outcome);
    flight.observer.ended(&flight.crew, &outcome);
    Ok(Ending {
        outcome,
        ticks: flight.recorder.ticks(),
        wall_time,
        warnings,
        rebirths: flight.crew.rebirths().to_vec(),
        timing: None,
    })
}

/// A flight under way.
struct Flight<'a> {
    crew: Crew<'a>,
    recorder: Recorder,
    observer: &'a mut dyn CrewObserver,
}

impl Flight<'_> {
    /// Records, watches and mends until the flight is over, one way or the other.
    fn supervise<S: TickSink>(
        &mut self,
        sink: &mut S,
        interrupt: &Interrupt,
    ) -> Result<Outcome, FlightFailure>
    where
        FlightFailure: From<S::Error>,
    {
        let mut next_health = Instant::now() + Duration::from_secs(1);
        loop {
            if self.recorder.drain(sink)? == Progress::Done {
                return Ok(Outcome::Completed);
            }
            if let Some(signal) = interrupt.signal() {
                return Ok(Outcome::Interrupted { signal });
            }
            let period = if self.crew.needs_care() {
                BIRTH_PERIOD
            } else {
                RECORDER_PERIOD
            };
            for event in self.crew.watch(period) {
                self.attend_to(event)?;
            }
            if self.crew.needs_care() {
                self.recorder.receive()?;
                self.crew.mend()?;
                self.crew.resume(&mut self.recorder)?;
                self.observer.changed(&self.crew);
                self.crew.hand_over(&self.recorder)?;
            } else {
                self.crew.keep_spare();
            }
            if Instant::now() >= next_health {
                self.crew.rouse();
                self.observer.health(&self.crew);
                next_health += Duration::from_secs(1);
            }
        }
    }

    fn attend_to(&mut self, event: CrewEvent) -> Result<(), FlightFailure> {
        match event {
            CrewEvent::Lost(failure) => return Err(failure),
            CrewEvent::Died => self.observer.changed(&self.crew),
            CrewEvent::Ready(..) | CrewEvent::Finished(_) => {}
        }
        Ok(())
    }
}

/// Ends the services and records the whole ticks that they had published.
fn wind_up<S: TickSink>(
    crew: &mut Crew<'_>,
    recorder: &mut Recorder,
    sink: &mut S,
    outcome: Outcome,
) -> Outcome
where
    FlightFailure: From<S::Error>,
{
    crew.stop();
    match outcome {
        Outcome::Completed => Outcome::Completed,
        // The sink itself has failed: it takes no more.
        Outcome::Failed(
            failure @ (FlightFailure::Log(_) | FlightFailure::Lost { .. } | FlightFailure::Diverged { .. }),
        ) => Outcome::Failed(failure),
        outcome => match recorder.drain(sink) {
            Ok(_) => outcome,
            // Why the flight ended matters more, unless it was on request.
            Err(failure) => match outcome {
                Outcome::Failed(first) => Outcome::Failed(first),
                Outcome::Completed | Outcome::Interrupted { .. } => Outcome::Failed(failure),
            },
        },
    }
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "used to map errors, which come by value"
)]
pub(super) fn port_failure(error: PortError) -> FlightFailure {
    FlightFailure::Setup(error.to_string())
}

/// Which cores the services and the recorder use.
pub(super) struct Cores {
    /// That of all services that state none of their own.
    pub(super) ring: Option<usize>,
    others: Vec<usize>,
}

impl Cores {
    pub(super) fn choose(placement: Placement, scenario: &Scenario) -> Self {
        let allowed = deployment::allowed_cores();
        let of_all = scenario.deployment.as_ref().and_then(|stated| stated.core);
        let ring = match (placement, of_all) {
            (Placement::AsStated, Some(core)) => Some(core as usize),
            (Placement::AsStated, None) => deployment::idlest(&allowed),
            (Placement::Core(core), _) => Some(core),
            (Placement::Anywhere, _) => None,
        };
        let own = ServiceId::ALL.map(|service| scenario.deployment_of(service).core);
        let taken = |core: usize| Some(core) == ring || own.contains(&u32::try_from(core).ok());
        let others = allowed.into_iter().filter(|&core| !taken(core)).collect();
        Self { ring, others }
    }

    /// Keeps this process off the services' cores, if there is another.
    pub(super) fn keep_off(&self) {
        if !self.others.is_empty() {
            // Only slower if it is refused.
            let _ = deployment::pin_to(&self.others);
        }
    }
}
