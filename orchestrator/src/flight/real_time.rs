//! Flies a scenario as processes in real time: one a service, and this one, which supervises and records.
//!
//! Nobody waits for this process: services step by the clock and publish whether anybody listens or not. A service that
//! dies is noticed at once, one that hangs when it has not stepped for too long; both are born again with what they
//! knew after their last step, and fly on with the newest that comes.

mod answers;
mod desk;
mod ending;
mod heartbeat;
mod laboratory;
mod monitor;
mod recorder;
mod succession;

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::Host;
use runtime::flight_clock::{FlightClock, monotonic_ns};
use runtime::in_process::TickSink;
use runtime::ports::Delivery;
use runtime::step_log::StepRecord;
use shared_types::samples::RcFrame;
use shared_types::scenario::Scenario;
use shared_types::schedule::Edge;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{Schedule, ServiceId, Topic};

use self::desk::Desk;
use self::ending::Wish;
use self::heartbeat::Heartbeats;
use self::laboratory::Laboratory;
use self::monitor::Monitor;
use self::recorder::{Recorder, SETTLING_NS};
pub use self::succession::Succession;
use super::crew::{BIRTH_PERIOD, Crew, CrewEvent, CrewObserver};
use super::deployment::Deployment;
use super::site::Site;
use super::{Ending, FlightFailure, Outcome};
use crate::interrupt::Interrupt;
use crate::live::snapshot::LiveEvent;
use crate::log::{CaptureFigures, LinkFigures};
use crate::summary::timing::{TimingReport, Unrecorded};

/// How often the recorder looks: a fast flight fills a hundredth of its buffers meanwhile.
const RECORDER_PERIOD: Duration = Duration::from_millis(10);

/// From the decision to fly until tick 0 begins: everybody has been told by then.
const COUNTDOWN: Duration = Duration::from_millis(50);

/// Events that are kept for people at other terminals.
const EVENTS: usize = 50;

/// What happens in a flight in real time, for whoever keeps a record of the machine.
pub trait StepObserver: CrewObserver {
    /// Tick 0 begins, or began, at this time of `CLOCK_MONOTONIC`, ns.
    fn flight_begins_at(&mut self, start_ns: u64);
    /// A service has stepped; its inputs as the schedule sees them.
    fn step(&mut self, service: ServiceId, record: &StepRecord, inputs: &[Edge]);
    /// People have done something.
    fn note(&mut self, text: &str);
    /// A service hung and was killed.
    fn hung(&mut self, service: ServiceId);
    /// How the cameras of a laboratory fare, about once a second and at the end.
    fn capture(&mut self, figures: &CaptureFigures);
    /// How the radio link of a laboratory fares, about once a second and at the end.
    fn link(&mut self, figures: &LinkFigures);
    /// How well the flight kept time.
    fn timing(&mut self, report: &TimingReport);
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
    observer: &mut dyn StepObserver,
) -> Result<Ending, FlightFailure>
where
    FlightFailure: From<S::Error>,
{
    let site = Site::prepare(scenario, deployment)?;
    let mut recorder = Recorder::new(site.subscribe(Delivery::NewestWins)?, 0);
    let mut desk = Desk::open(&site.root).map_err(FlightFailure::setup)?;
    let mut crew = site.start_crew(deployment, Host::RealTime)?;
    let warnings = site.await_ready(&mut crew)?;
    observer.ready(&crew, site.cores.ring);
    recorder.connect().map_err(FlightFailure::setup)?;

    let clock = FlightClock::starting_in(COUNTDOWN, site.schedule.tick_ns());
    crew.page()
        .words()
        .start_ns
        .store(clock.start_ns, Ordering::Release);
    observer.flight_begins_at(clock.start_ns);
    crew.go()?;
    let flight = Flight::new(&site, clock, crew, recorder, observer);
    Ok(flight.conduct(sink, interrupt, &mut desk, warnings))
}

/// Takes over a flight whose orchestrator is gone, and hands everything from then on to `sink`.
///
/// # Errors
/// [`FlightFailure`] if it cannot be taken over. A failure in flight is the ending's outcome.
pub fn take_over<S: TickSink>(
    succession: Succession,
    sink: &mut S,
    interrupt: &Interrupt,
    observer: &mut dyn StepObserver,
) -> Result<Ending, FlightFailure>
where
    FlightFailure: From<S::Error>,
{
    let Succession {
        site,
        shared,
        survivors,
        clock,
        first_tick,
    } = succession;
    let mut recorder = Recorder::new(site.listen_in()?, first_tick);
    let mut desk = Desk::open(&site.root).map_err(FlightFailure::setup)?;
    let crew = site.adopt_crew(shared, survivors)?;
    recorder.connect().map_err(FlightFailure::setup)?;
    observer.flight_begins_at(clock.start_ns);
    observer.ready(&crew, site.cores.ring);
    observer.note("another orchestrator has taken over");
    let mut flight = Flight::new(&site, clock, crew, recorder, observer);
    flight.monitor.begin_now(flight.crew.step_log());
    Ok(flight.conduct(sink, interrupt, &mut desk, Vec::new()))
}

/// A flight under way.
struct Flight<'a> {
    schedule: &'a Schedule,
    clock: FlightClock,
    crew: Crew<'a>,
    recorder: Recorder,
    monitor: Monitor,
    heartbeats: Heartbeats,
    observer: &'a mut dyn StepObserver,
    scenario: &'a Scenario,
    laboratory: Laboratory<'a>,
    /// What is wanted of the flight.
    wish: Wish,
    /// The signal by which somebody wanted its end.
    signal: Option<i32>,
    /// The last events, for people at other terminals.
    events: VecDeque<LiveEvent>,
}

impl<'a> Flight<'a> {
    fn new(
        site: &'a Site,
        clock: FlightClock,
        crew: Crew<'a>,
        recorder: Recorder,
        observer: &'a mut dyn StepObserver,
    ) -> Self {
        let schedule = &site.schedule;
        let settings = site.scenario.real_time.unwrap_or_default();
        Self {
            heartbeats: Heartbeats::new(schedule, nanoseconds(settings.hang_limit) / schedule.tick_ns()),
            monitor: Monitor::new(schedule),
            schedule,
            clock,
            crew,
            recorder,
            observer,
            scenario: &site.scenario,
            laboratory: Laboratory::of(&site.scenario),
            wish: Wish::FlyOn,
            signal: None,
            events: VecDeque::new(),
        }
    }

    /// Sees the flight to its end.
    fn conduct<S: TickSink>(
        mut self,
        sink: &mut S,
        interrupt: &Interrupt,
        desk: &mut Desk,
        warnings: Vec<String>,
    ) -> Ending
    where
        FlightFailure: From<S::Error>,
    {
        let from = self.recorder.ticks();
        let outcome = self
            .supervise(sink, interrupt, desk)
            .unwrap_or_else(Outcome::Failed);
        let begun = self.clock.begins_at(from);
        let wall_time = Duration::from_nanos(monotonic_ns().saturating_sub(begun));
        let outcome = self.wind_up(sink, outcome);
        self.finish(outcome, wall_time, warnings)
    }

    /// Records, watches and mends until the flight is over, one way or the other.
    fn supervise<S: TickSink>(
        &mut self,
        sink: &mut S,
        interrupt: &Interrupt,
        desk: &mut Desk,
    ) -> Result<Outcome, FlightFailure>
    where
        FlightFailure: From<S::Error>,
    {
        let mut next_health = Instant::now() + Duration::from_secs(1);
        loop {
            let words = self.crew.page().words();
            words
                .orchestrator_alive_ns
                .store(monotonic_ns(), Ordering::Relaxed);
            if self.crew.has_finished() {
                return Ok(Outcome::Completed);
            }
            if let Some(signal) = interrupt.take() {
                self.signal = Some(signal);
                self.wish = self.wish.then_end(self.phase(), words);
            }
            if self.wish.is_fulfilled(self.phase(), self.is_at_rest()) {
                let interrupted = self.signal.map(|signal| Outcome::Interrupted { signal });
                return Ok(interrupted.unwrap_or(Outcome::Completed));
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
                self.crew.mend()?;
                self.crew.resume_in_real_time()?;
                self.observer.changed(&self.crew);
            } else {
                self.crew.keep_spare();
            }
            self.record(sink)?;
            self.observer.progressed(&self.crew, self.recorder.ticks());
            self.replace_the_hung();
            desk.serve(|question| self.answer(question));
            if Instant::now() >= next_health {
                self.crew.remove_unfinished();
                self.observer.health(&self.crew);
                self.observe_laboratory();
                self.tell_of_laboratory();
                self.monitor.end_window();
                next_health += Duration::from_secs(1);
            }
        }
    }

    fn attend_to(&mut self, event: CrewEvent) -> Result<(), FlightFailure> {
        match event {
            CrewEvent::Lost(failure) => return Err(failure),
            CrewEvent::Died => {
                self.observer.changed(&self.crew);
                if let Some((Some(service), pid, exit)) = self.crew.exits().last() {
                    let text = format!("`{service}` (process {pid}) died: {}", exit.description);
                    self.remember(text);
                }
            }
            CrewEvent::Ready(service, _) => self.remember(format!("`{service}` flies again")),
            CrewEvent::Finished(_) => {}
        }
        Ok(())
    }

    /// Keeps an event for people at other terminals.
    fn remember(&mut self, text: String) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(LiveEvent {
            time: seconds(self.clock.elapsed_ns()),
            text,
        });
    }

    /// Tells of something that people have done.
    fn tell(&mut self, text: &str) {
        self.observer.note(text);
        self.remember(text.to_owned());
    }

    /// Whether the last frame lets the motors rest.
    fn is_at_rest(&self) -> bool {
        let frame = self.recorder.newest::<RcFrame>();
        frame.is_none_or(|frame| frame.failsafe.is_set())
    }

    /// Takes what has been published and told, and writes the ticks that have settled.
    fn record<S: TickSink>(&mut self, sink: &mut S) -> Result<(), FlightFailure>
    where
        FlightFailure: From<S::Error>,
    {
        self.recorder.receive()?;
        self.crew
            .note_guests_steps(|guest| self.recorder.newest_of(guest));
        self.observe_steps();
        let settled_ns = self.clock.elapsed_ns().saturating_sub(SETTLING_NS);
        let settled = (settled_ns / self.clock.tick_ns).min(self.schedule.last_tick() + 1);
        Ok(self.recorder.write_before(settled, sink)?)
    }

    fn observe_steps(&mut self) {
        let Self {
            monitor,
            observer,
            crew,
            ..
        } = self;
        monitor.collect(crew.step_log(), |service, record, inputs| {
            observer.step(service, record, inputs);
        });
    }

    fn observe_laboratory(&mut self) {
        let words = self.crew.page().words();
        if let Some(figures) = self.laboratory.capture(words) {
            self.observer.capture(&figures);
        }
        if let Some(figures) = self.laboratory.link(words) {
            self.observer.link(&figures);
        }
    }

    fn tell_of_laboratory(&mut self) {
        let words = self.crew.page().words();
        for text in self.laboratory.news(words, self.clock.elapsed_ns()) {
            self.tell(&text);
        }
    }

    fn replace_the_hung(&mut self) {
        let now = self.clock.tick().min(self.schedule.last_tick());
        let crew = &self.crew;
        let hanging = self
            .heartbeats
            .hanging(now, crew.page().words(), |service| crew.flies(service));
        for service in hanging {
            self.observer.hung(service);
            self.crew.kill(service);
            self.remember(format!("`{service}` hangs and is replaced"));
        }
    }

    /// Ends the services and records what they had published.
    fn wind_up<S: TickSink>(&mut self, sink: &mut S, outcome: Outcome) -> Outcome
    where
        FlightFailure: From<S::Error>,
    {
        self.crew.stop();
        if let Outcome::Failed(FlightFailure::Log(_)) = outcome {
            return outcome;
        }
        for service in ServiceId::ALL {
            self.crew.step_log().finish_for_the_dead(service);
        }
        self.observe_steps();
        let flown = ServiceId::ALL.map(|service| {
            let cell = &self.crew.page().words().cells[service.index()];
            cell.steps_until.load(Ordering::Relaxed)
        });
        let until = flown.into_iter().max().unwrap_or_default();
        let written = self
            .recorder
            .receive()
            .and_then(|()| Ok(self.recorder.write_before(until, sink)?));
        match (written, outcome) {
            (Ok(()), outcome) | (Err(_), outcome @ Outcome::Failed(_)) => outcome,
            (Err(failure), _) => Outcome::Failed(failure),
        }
    }

    fn finish(mut self, outcome: Outcome, wall_time: Duration, warnings: Vec<String>) -> Ending {
        self.observe_laboratory();
        let unrecorded = unrecorded(self.schedule, &self.monitor, &self.recorder);
        let mut report = TimingReport {
            unrecorded,
            ..self.monitor.finish()
        };
        // Nobody has timed the steps of guests.
        let is_guest = |name: &str| self.crew.guests().any(|guest| guest.name() == name);
        report.services.retain(|timing| !is_guest(timing.service));
        self.observer.timing(&report);
        self.observer.ended(&self.crew, &outcome);
        Ending {
            outcome,
            ticks: self.recorder.ticks(),
            wall_time,
            warnings,
            rebirths: self.crew.rebirths().to_vec(),
            timing: Some(report),
            laboratory: self.laboratory.report(self.crew.page().words()),
        }
    }
}

/// Topics that a service publishes at every step and of which fewer samples were received than it did steps.
fn unrecorded(schedule: &Schedule, monitor: &Monitor, recorder: &Recorder) -> Vec<Unrecorded> {
    let of_topic = |topic: Topic| {
        let publisher = topic.publisher()?;
        let every_step = schedule.publications(topic).rate == schedule.service_rate(publisher);
        let steps = monitor.steps(publisher);
        let samples = steps.saturating_sub(recorder.received(topic));
        (every_step && samples > 0).then_some(Unrecorded {
            topic: topic.name(),
            samples,
        })
    };
    Topic::ALL.into_iter().filter_map(of_topic).collect()
}
