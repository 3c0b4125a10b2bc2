//! Flights in lock step: one process for each service, and this process as supervisor and recorder.

mod stall;
mod watchers;

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use host::in_process::TickSink;
use runtime::control::Host;
use runtime::ports::Delivery;
use runtime::wait_policy::BLOCK_ALWAYS;
use scenario::Scenario;

use super::deployment::Deployment;
use super::recorder::{Progress, Recorder};
use super::run_context::RunContext;
use super::supervision::{News, RESTART_POLL_PERIOD, SupervisionObserver, Supervisor};
use super::{Ending, Outcome, RunFailure};
use command_line::progress::Messages;
use decisions::event::Action;
use flight::failure::FlightFailure;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use stall::StallWatch;
use watchers::Watchers;

/// Period of the recorder: within it, the fastest flight fills a tenth of its buffers.
const RECORDER_PERIOD: Duration = Duration::from_millis(1);

/// As [`fly`], into a recording. Not generic, so that it is optimised as the services are, whatever its callers are.
///
/// # Errors
/// As [`fly`].
pub fn record(
    scenario: &Scenario,
    deployment: &Deployment,
    sink: &mut RecordingSink<'_>,
    interrupt: &Interrupt,
    messages: &Messages,
    observer: &mut dyn SupervisionObserver,
) -> Result<Ending, RunFailure> {
    fly(scenario, deployment, sink, interrupt, messages, observer)
}

/// Flies `scenario` to its end or until `interrupt`, and passes all samples to `sink`. `messages` are shown at once.
///
/// # Errors
/// [`RunFailure`] if the run cannot be set up. A failure in flight is in the [`Ending`].
pub fn fly<S: TickSink>(
    scenario: &Scenario,
    deployment: &Deployment,
    sink: &mut S,
    interrupt: &Interrupt,
    messages: &Messages,
    observer: &mut dyn SupervisionObserver,
) -> Result<Ending, RunFailure>
where
    RunFailure: From<S::Error>,
{
    super::refuse_unsimulated_poses(scenario)?;
    let context = RunContext::prepare(scenario, deployment)?;
    let recorder = Recorder::new(context.subscribe(Delivery::Lossless)?, &context.schedule);
    let mut recorder = recorder.distrust(context.scenario.external_services(), &context.schedule);
    let mut supervisor = context.start_supervisor(deployment, Host::LockStep)?;
    let block = supervisor.page().control_block();
    recorder.publish_ids(block);
    if !deployment.yielding {
        block.block_only.store(BLOCK_ALWAYS, Ordering::Relaxed);
    }
    let warnings = context.await_ready(&mut supervisor)?;
    observer.ready(&supervisor, context.cores.ring);

    let started = Instant::now();
    // Must come before `go`: samples of services that exit before the connection would be lost.
    recorder.connect().map_err(RunFailure::setup)?;
    supervisor.go();
    observer.changed(&supervisor);
    let mut flight = Flight {
        supervisor,
        recorder,
        observer,
        messages,
        stall: StallWatch::new(started),
        watchers: Watchers::open(&context.root, &context.scenario, &context.schedule),
    };
    let outcome = flight
        .supervise(sink, interrupt)
        .unwrap_or_else(|failure| Outcome::Failed(failure.suspecting(context.scenario.foreign_services())));
    let wall_time = started.elapsed();
    let outcome = wind_up(&mut flight.supervisor, &mut flight.recorder, sink, outcome);
    flight.observer.ended(&flight.supervisor, &outcome);
    Ok(Ending {
        outcome,
        ticks: flight.recorder.ticks(),
        wall_time,
        warnings,
        restarts: flight.supervisor.restarts().to_vec(),
        timing: None,
        laboratory: None,
    })
}

/// State of a flight.
struct Flight<'a> {
    supervisor: Supervisor<'a>,
    recorder: Recorder,
    observer: &'a mut dyn SupervisionObserver,
    messages: &'a Messages,
    stall: StallWatch,
    watchers: Watchers<'a>,
}

impl Flight<'_> {
    /// Records, watches and restarts services until the flight ends.
    fn supervise<S: TickSink>(&mut self, sink: &mut S, interrupt: &Interrupt) -> Result<Outcome, RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        let mut next_health = Instant::now() + Duration::from_secs(1);
        loop {
            let progress = self.recorder.drain(sink)?;
            if progress == Progress::Done {
                return Ok(Outcome::Completed);
            }
            self.check_external_services(progress)?;
            self.observer.progressed(&self.supervisor, self.recorder.ticks());
            self.watchers.serve(&self.supervisor, &self.recorder);
            if let Some(signal) = interrupt.signal() {
                return Ok(Outcome::Interrupted { signal });
            }
            let period = match progress {
                Progress::Behind => Duration::ZERO,
                _ if self.supervisor.needs_care() => RESTART_POLL_PERIOD,
                _ => RECORDER_PERIOD,
            };
            self.supervisor.watch(period);
            self.look()?;
            self.report_stall();
            if Instant::now() >= next_health {
                self.supervisor.wake_all();
                self.supervisor.remove_unfinished();
                self.observer.health(&self.supervisor);
                next_health += Duration::from_secs(1);
            }
        }
    }

    /// Restarts services, and hands over what they have missed.
    fn look(&mut self) -> Result<(), RunFailure> {
        let needs_care = self.supervisor.needs_care();
        if needs_care {
            self.recorder.receive()?;
        }
        let mut announced = Ok(());
        for action in self.supervisor.look() {
            match action {
                Action::Announce { birth } => {
                    announced = announced.and(self.supervisor.announce(birth, &mut self.recorder));
                }
                Action::CatchUp { service } => self.supervisor.catch_up(service, &self.recorder),
                action => self.supervisor.perform(action),
            }
        }
        announced?;
        for news in self.supervisor.take_news() {
            self.handle(news)?;
        }
        if needs_care {
            self.observer.changed(&self.supervisor);
            self.supervisor.hand_over(&self.recorder)?;
        }
        Ok(())
    }

    /// Records the progress of external services; fails if one has finished without publishing all its samples.
    fn check_external_services(&self, progress: Progress) -> Result<(), RunFailure> {
        self.supervisor
            .note_external_services_steps(|external_service| self.recorder.newest_of(external_service));
        for external_service in self.supervisor.supervision().external_services() {
            // Everything published before its message has been received by now.
            if progress == Progress::Waiting
                && self.supervisor.supervision().is_finished(external_service)
                && self.recorder.waits_for(external_service)
            {
                return Err(self.supervisor.blame_for_missing(external_service));
            }
        }
        Ok(())
    }

    /// Reports the services that the flight waits for, if it has waited for long.
    fn report_stall(&mut self) {
        let ticks = self.recorder.ticks();
        let awaited = || stall::awaited(&self.supervisor, ticks);
        if let Some(text) = self.stall.check(Instant::now(), ticks, awaited) {
            self.watchers
                .events
                .keep(self.watchers.time(&self.recorder), &text);
            self.messages.show(text);
        }
    }

    fn handle(&mut self, news: News) -> Result<(), RunFailure> {
        match news {
            News::Lost(failure) => return Err(failure.into()),
            News::Died { pid } => {
                self.observer.changed(&self.supervisor);
                let time = self.watchers.time(&self.recorder);
                if let Some(text) = self.supervisor.supervision().death_of(pid) {
                    self.watchers.events.keep(time, &text);
                }
            }
            News::Ready(service, _) => {
                let time = self.watchers.time(&self.recorder);
                let name = self.supervisor.name_of(service);
                self.watchers
                    .events
                    .keep(time, &format!("`{name}` was restarted"));
            }
            News::Finished(_) => {}
        }
        Ok(())
    }
}

/// Stops the services and records the complete ticks that they have published.
fn wind_up<S: TickSink>(
    supervisor: &mut Supervisor<'_>,
    recorder: &mut Recorder,
    sink: &mut S,
    outcome: Outcome,
) -> Outcome
where
    RunFailure: From<S::Error>,
{
    supervisor.stop();
    let takes_no_more = |failure: &RunFailure| {
        use RunFailure::{Diverged, Flight, Lost, NotDue};
        matches!(
            failure.itself(),
            Flight(FlightFailure::Log(_)) | Lost { .. } | Diverged { .. } | NotDue { .. }
        )
    };
    match outcome {
        Outcome::Completed => Outcome::Completed,
        // The sink has failed, or samples are wrong.
        Outcome::Failed(failure) if takes_no_more(&failure) => Outcome::Failed(failure),
        outcome => match recorder.drain_all(sink) {
            Ok(()) => outcome,
            // The first failure is reported, unless the end was requested.
            Err(failure) => match outcome {
                Outcome::Failed(first) => Outcome::Failed(first),
                Outcome::Completed | Outcome::Interrupted { .. } => Outcome::Failed(failure),
            },
        },
    }
}
