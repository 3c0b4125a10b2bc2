//! Flights in real time: one process for each service, and this process as supervisor and recorder.
//!
//! No service waits for this process: services step by the clock, and publishing does not depend on receivers. A dead
//! service is detected at once, a hung one by a timeout; both are restarted from their last checkpoint, and continue
//! with the newest samples.
//!
//! Failure policy: in the air only a landing ends a flight. If the log cannot be written, a service exceeds its
//! restarts, or a port fails, the first failure is stored and reported, a landing is requested, services are restarted
//! until the vehicle has landed, and then the flight ends with that failure ([`decisions::conduct`]).

mod answers;
mod arming;
mod death_notes;
mod kill_switch;
mod laboratory;
mod last_landing;
mod monitor;
mod recorder;
mod response;
mod take_over;
mod tuning;

use std::borrow::Cow;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use host::in_process::TickSink;
use runtime::control::Host;
use runtime::flight_clock::{FlightClock, monotonic_ns};
use runtime::ports::Delivery;
use runtime::shared_page::Request;
use runtime::step_log::StepRecord;
use scenario::Scenario;
use shared_types::samples::{PathReference, RcFrame, RunEvent};
use shared_types::schedule::Edge;
use shared_types::service::seconds;
use shared_types::{FlightPhase, Schedule, ServiceId, Topic};

use self::arming::HandTestFile;
use self::death_notes::DeathNotes;
use self::kill_switch::KillSwitch;
use self::laboratory::Laboratory;
use self::monitor::Monitor;
use self::recorder::{Recorder, SETTLING_NS};
use self::response::WatchedSink;
pub use self::take_over::TakeOver;
use super::control_server::ControlServer;
use super::deployment::Deployment;
use super::run_context::RunContext;
use super::supervision::{News, RESTART_POLL_PERIOD, SupervisionObserver, Supervisor, now};
use super::{Ending, Outcome, RunFailure};
use command_line::progress::Messages;
use decisions::conduct::{Conduct, EndRequest, Unfinished};
use decisions::event::Action;
use decisions::failure::ServiceFailure;
use decisions::shutdown::Shutdown;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use metrics::response::ResponseWatch;
use metrics::summary::timing::{TimingReport, Unrecorded};
use run_client::live_events::LiveEvents;
use run_client::newest::Newest;
use run_log::{CaptureFigures, LinkFigures, LogError};

/// Period of the recorder: within it, a fast flight fills a hundredth of its buffers.
const RECORDER_PERIOD: Duration = Duration::from_millis(10);

/// Delay from the start command to tick 0; long enough to reach every service.
const COUNTDOWN: Duration = Duration::from_millis(50);

/// Observer of a flight in real time, for the record of the machine.
pub trait StepObserver: SupervisionObserver {
    /// Tick 0 begins, or began, at this time of `CLOCK_MONOTONIC`, ns.
    fn flight_begins_at(&mut self, start_ns: u64);
    /// A service has stepped; `inputs` are its edges in the schedule.
    fn step(&mut self, service: ServiceId, record: &StepRecord, inputs: &[Edge]);
    /// Returns the failure of the record, once.
    fn failure(&mut self) -> Option<LogError>;
    /// An event for the record, such as a request of a client.
    fn note(&mut self, text: &str);
    /// A hung service was killed.
    fn hung(&mut self, service: ServiceId);
    /// Records the figures of a laboratory's cameras, about once a second and at the end.
    fn capture(&mut self, figures: &CaptureFigures);
    /// Records the figures of a laboratory's radio link, about once a second and at the end.
    fn link(&mut self, figures: &LinkFigures);
    /// Records the timing of the flight.
    fn timing(&mut self, report: &TimingReport);
}

/// Flies `scenario` to its end or until the interrupt, and passes all samples to `sink`.
///
/// # Errors
/// [`RunFailure`] if the run cannot be set up. A failure in flight is in the [`Ending`].
pub fn fly(
    scenario: &Scenario,
    deployment: &Deployment,
    sink: &mut RecordingSink<'_>,
    clients: &Clients<'_>,
    observer: &mut dyn StepObserver,
) -> Result<Ending, RunFailure> {
    let kill_device = kill_switch::open(scenario)?;
    let context = RunContext::prepare(scenario, deployment)?;
    let mut recorder = Recorder::new(context.subscribe(Delivery::NewestWins)?, 0);
    let mut server = ControlServer::open(&context.root, Host::RealTime).map_err(RunFailure::setup)?;
    let mut supervisor = context.start_supervisor(deployment, Host::RealTime)?;
    let warnings = context.await_ready(&mut supervisor)?;
    observer.ready(&supervisor, context.cores.ring);
    recorder.connect().map_err(RunFailure::setup)?;
    let start = |stated| KillSwitch::start(stated, kill_device, supervisor.page());
    let kill_switch = context.scenario.operator.as_ref().map(start).transpose();
    let kill_switch = kill_switch.map_err(RunFailure::setup)?;

    let clock = FlightClock::starting_in(COUNTDOWN, context.schedule.tick_ns());
    supervisor
        .page()
        .control_block()
        .start_ns
        .store(clock.start_ns, Ordering::Release);
    observer.flight_begins_at(clock.start_ns);
    supervisor.go();
    let recorder = recorder
        .distrust(context.scenario.external_services(), &context.schedule, clock)
        .remember_for_restarts(&context.schedule);
    if scenario
        .flight
        .as_ref()
        .is_some_and(|flight| flight.arm_at.is_none())
    {
        let run = context.root.name();
        let text = format!(
            "The vehicle stands on the ground, disarmed. To take off, in another terminal: gerono arm --run {run}"
        );
        clients.messages.show(text);
    }
    let mut flight = Flight::new(&context, clock, supervisor, recorder, clients, observer);
    flight.kill_switch = kill_switch;
    Ok(flight.conduct(sink, &mut server, warnings))
}

/// Takes over a flight whose orchestrator is gone, and passes all samples from then on to `sink`.
///
/// # Errors
/// [`RunFailure`] if the flight cannot be taken over. A failure in flight is in the [`Ending`].
pub fn take_over(
    take_over: TakeOver,
    sink: &mut RecordingSink<'_>,
    clients: &Clients<'_>,
    observer: &mut dyn StepObserver,
) -> Result<Ending, RunFailure> {
    let TakeOver {
        take_over_lock: _only_one,
        context,
        shared,
        survivors,
        folder,
        clock,
        first_tick,
    } = take_over;
    let mut recorder = Recorder::new(context.subscribe_in_flight()?, first_tick);
    let mut server = ControlServer::open(&context.root, Host::RealTime).map_err(RunFailure::setup)?;
    recorder.connect().map_err(RunFailure::setup)?;
    // Only now: if an earlier step had failed, they would not be restarted. From here on every failure leads to a
    // landing.
    let killed = take_over::kill_unconnected(&folder, &survivors)?;
    let supervisor = context.adopt_supervisor(shared, survivors)?;
    observer.flight_begins_at(clock.start_ns);
    observer.ready(&supervisor, context.cores.ring);
    observer.note("another orchestrator has taken over");
    for pid in killed {
        observer.note(&format!("killed the process {pid}, which has not connected"));
    }
    let recorder = recorder
        .distrust(context.scenario.external_services(), &context.schedule, clock)
        .remember_for_restarts(&context.schedule);
    let mut flight = Flight::new(&context, clock, supervisor, recorder, clients, observer);
    flight.monitor.begin_now(flight.supervisor.step_log());
    flight.inherit_tuning();
    flight.inherit_landing();
    flight.inherit_kill_switch();
    Ok(flight.conduct(sink, &mut server, Vec::new()))
}

/// Terminal of a flight.
pub struct Clients<'a> {
    /// Signals that request the end.
    pub interrupt: &'a Interrupt,
    /// Messages on the terminal.
    pub messages: Messages,
}

/// State of a flight.
struct Flight<'a> {
    schedule: &'a Schedule,
    clock: FlightClock,
    supervisor: Supervisor<'a>,
    recorder: Recorder,
    monitor: Monitor,
    conduct: Conduct,
    observer: &'a mut dyn StepObserver,
    scenario: &'a Scenario,
    /// Folder of the run.
    folder: &'a Path,
    laboratory: Laboratory<'a>,
    /// `None` if the scenario names none.
    hand_test: Option<HandTestFile>,
    clients: &'a Clients<'a>,
    /// Name of the run, as other terminals find it.
    run: String,
    /// Signal that requested the end.
    signal: Option<i32>,
    kill_switch: Option<KillSwitch>,
    /// First failure, reported once the vehicle is on the ground.
    failure: Option<RunFailure>,
    /// Events that are not in the log yet: tick, kind and text.
    pending_events: Vec<(u64, u32, Cow<'static, str>)>,
    /// Scenario with the gains that the operator has changed; `None` before the first change.
    tuned: Option<Scenario>,
    last_action: u8,
    last_decision: (u8, u8),
    /// `true` if the position of an airborne vehicle was unknown at the newest reference.
    was_lost: bool,
    /// Response to the first commands off the ground.
    response: ResponseWatch,
    /// z of the vehicle when it was last on the ground, in {I}, m; 0, the floor, before that.
    ground_z: f64,
    /// z of the vehicle when it was last tracked, m.
    vehicle_z: f64,
    /// Last events, for clients.
    events: LiveEvents,
    death_notes: DeathNotes,
    /// What a request has killed the motors for, in words.
    killed_for: Option<String>,
}

impl<'a> Flight<'a> {
    fn new(
        context: &'a RunContext,
        clock: FlightClock,
        supervisor: Supervisor<'a>,
        recorder: Recorder,
        clients: &'a Clients<'a>,
        observer: &'a mut dyn StepObserver,
    ) -> Self {
        let schedule = &context.schedule;
        Self {
            conduct: Conduct::new(&context.scenario, schedule),
            monitor: Monitor::new(schedule, |service| context.scenario.process_name(service)),
            schedule,
            clock,
            supervisor,
            recorder,
            observer,
            scenario: &context.scenario,
            folder: context.root.folder(),
            laboratory: Laboratory::of(&context.scenario, &context.schedule),
            hand_test: HandTestFile::new(&context.scenario),
            clients,
            run: context.root.name(),
            signal: None,
            kill_switch: None,
            failure: None,
            pending_events: Vec::new(),
            tuned: None,
            last_action: RcFrame::ACTION_NONE,
            last_decision: (PathReference::PHASE_DISARMED, PathReference::CAUSE_NONE),
            was_lost: false,
            response: ResponseWatch::new(&context.scenario),
            ground_z: 0.0,
            vehicle_z: 0.0,
            events: LiveEvents::default(),
            death_notes: DeathNotes::default(),
            killed_for: None,
        }
    }

    /// Conducts the flight to its end.
    fn conduct<S: TickSink>(
        mut self,
        sink: &mut S,
        server: &mut ControlServer,
        mut warnings: Vec<String>,
    ) -> Ending
    where
        RunFailure: From<S::Error>,
    {
        let from = self.recorder.ticks();
        self.supervise(sink, server);
        warnings.append(&mut self.note_unfinished());
        let begun = self.clock.begins_at(from);
        let wall_time = Duration::from_nanos(monotonic_ns().saturating_sub(begun));
        self.wind_up(sink);
        self.finish(wall_time, warnings)
    }

    /// Records, watches and restarts services until the flight ends.
    fn supervise<S: TickSink>(&mut self, sink: &mut S, server: &mut ControlServer)
    where
        RunFailure: From<S::Error>,
    {
        let mut next_health = Instant::now() + Duration::from_secs(1);
        while !self.is_over() {
            let block = self.supervisor.page().control_block();
            block
                .orchestrator_alive_ns
                .store(monotonic_ns(), Ordering::Relaxed);
            if let Some(signal) = self.clients.interrupt.take() {
                self.signal = Some(signal);
                let answer = self.request_end("a signal");
                self.clients.messages.show(answer);
            }
            self.handle_kill_switch();
            self.note_radio_link();
            let period = if self.supervisor.needs_care() {
                RESTART_POLL_PERIOD
            } else {
                RECORDER_PERIOD
            };
            self.supervisor.watch(period);
            self.look();
            if let Err(failure) = self.record(sink) {
                self.fail(failure);
            }
            self.observer.progressed(&self.supervisor, self.recorder.ticks());
            if let Some(error) = self.observer.failure() {
                self.fail(RunFailure::Record(error));
            }
            self.land_before_the_end();
            server.serve(|question| self.answer(question));
            if Instant::now() >= next_health {
                self.supervisor.remove_unfinished();
                if matches!(self.folder.try_exists(), Ok(false)) {
                    self.fail(RunFailure::FolderRemoved(self.folder.to_owned()));
                }
                self.observer.health(&self.supervisor);
                self.observe_laboratory();
                self.announce_laboratory();
                self.show_more_deaths(self.clock.elapsed_ns());
                self.monitor.end_window();
                next_health += Duration::from_secs(1);
            }
        }
    }

    fn is_over(&self) -> bool {
        let supervision = self.supervisor.supervision();
        self.conduct
            .is_over(supervision, self.since_end(), self.supervisor.facts())
    }

    /// Returns the time since the last tick.
    fn since_end(&self) -> Duration {
        let last = self.clock.begins_at(self.schedule.last_tick());
        Duration::from_nanos(monotonic_ns().saturating_sub(last))
    }

    /// Handles services that have not finished in time: the first one with steps to do is the failure of the flight, and
    /// those that have only not ended are warned of.
    fn note_unfinished(&mut self) -> Vec<String> {
        let limit = self.since_end().as_secs();
        let mut warnings = Vec::new();
        let supervision = self.supervisor.supervision();
        for unfinished in self.conduct.unfinished(supervision, self.supervisor.facts()) {
            match unfinished {
                Unfinished::NotEnded(service) => warnings.push(format!(
                    "`{}` has done its last step and not ended for {limit} s, and was killed: a device, or `destroy` of a \
                     plug-in, does not return",
                    supervision.name_of(service)
                )),
                Unfinished::NotDone(service) => {
                    let reason =
                        format!("it had not done its last step {limit} s after the end of the flight");
                    let service = supervision.name_of(service).to_owned();
                    self.failure = Some(ServiceFailure::GaveUp { service, reason }.into());
                    break;
                }
            }
        }
        for warning in &warnings {
            self.observer.note(warning);
        }
        warnings
    }

    /// Stores a failure and requests the end; the first one becomes the outcome of the flight.
    fn fail(&mut self, failure: RunFailure) {
        let Some(request) = self.conduct.fail() else {
            return;
        };
        let failure = failure.suspecting(self.scenario.foreign_services());
        self.record_event(&format!("the flight has failed: {failure}"));
        let words = failure.to_string();
        self.failure = Some(failure);
        let answer = self.answer_to_end(request, "a failure");
        if self.conduct.shutdown() == Shutdown::Land {
            self.clients.messages.show(format!("{words}\n{answer}"));
        }
    }

    /// Requests the end of the flight, after a landing. Returns the message for the user.
    fn request_end(&mut self, reason: impl Into<Cow<'static, str>>) -> String {
        let request = self.conduct.request_end();
        self.answer_to_end(request, reason)
    }

    fn answer_to_end(&mut self, request: EndRequest, reason: impl Into<Cow<'static, str>>) -> String {
        if request == EndRequest::Land {
            self.ask(Request::Land, RunEvent::KIND_OPERATOR_LANDS, reason);
        }
        if self.conduct.permits_end() {
            return "The run ends.".to_owned();
        }
        let warning = self.without_link();
        let warning = warning.map_or_else(String::new, |warning| format!("\nWARNING: {warning}."));
        if self.operator().killed || self.recorder.has_killed() {
            return format!("The motors were killed. The run ends 2 s after that.{warning}");
        }
        let again = match request {
            EndRequest::Land => "The vehicle lands. The run ends 2 s after its motors have stopped.",
            EndRequest::Nothing => "The vehicle is still landing.",
        };
        format!(
            "{again}{warning}\nCtrl-C and `gerono stop` change nothing more.\n\
             To stop the motors in the air: gerono kill --run {}",
            self.run
        )
    }

    fn handle(&mut self, news: News) {
        match news {
            News::Lost(failure) => self.fail(failure.into()),
            News::Died { pid } => {
                self.observer.changed(&self.supervisor);
                if let Some(text) = self.supervisor.supervision().death_of(pid) {
                    self.add_event(&text);
                    self.show_death(&text);
                }
            }
            News::Ready(service, _) => {
                let name = self.supervisor.name_of(service);
                self.add_event(&format!("`{name}` was restarted"));
            }
            News::Finished(_) => {}
        }
    }

    /// Replaces services that hang, and restarts those that have died; after a failure also those that were given up.
    fn look(&mut self) {
        let needs_care = self.supervisor.needs_care();
        // A restarted process receives the samples published before it was ready as messages, and later ones through
        // its ports; and the progress of an external service is that of its samples. A failed port does not prevent the
        // restart of services.
        let supervision = self.supervisor.supervision();
        let needs_samples = needs_care || supervision.external_services().next().is_some();
        if needs_samples && let Err(failure) = self.recorder.receive() {
            self.fail(failure);
        }
        self.note_external_steps();
        let (supervision, facts) = self.supervisor.supervision_mut();
        let hung_services = self.conduct.look(supervision, now(), self.clock.tick(), facts);
        for service in hung_services {
            self.observer.hung(service);
            let name = self.supervisor.name_of(service);
            self.add_event(&format!("`{name}` hangs and is replaced"));
        }
        let (supervisor, recorder) = (&mut self.supervisor, &self.recorder);
        for action in supervisor.take_actions() {
            match action {
                Action::SendMissed { process, service } => {
                    let remembered = |topic, from| recorder.remembered(topic, from).collect();
                    supervisor.send_missed(process, service, &remembered);
                }
                action => supervisor.perform(action),
            }
        }
        for news in self.supervisor.take_news() {
            self.handle(news);
        }
        if needs_care {
            self.observer.changed(&self.supervisor);
        }
    }

    /// Shows on the terminal that the process of a service has died and is replaced, unless many do.
    fn show_death(&mut self, text: &str) {
        let elapsed_ns = self.clock.elapsed_ns();
        if self.death_notes.admits(elapsed_ns) {
            let time = seconds(elapsed_ns);
            let text = format!("{time:.3} s: {text}; another process takes its place");
            self.clients.messages.show_unless_quiet(text);
        }
    }

    /// Shows on the terminal how many more have died.
    fn show_more_deaths(&mut self, elapsed_ns: u64) {
        if let Some(text) = self.death_notes.left_out(elapsed_ns) {
            self.clients.messages.show_unless_quiet(text);
        }
    }

    /// Appends an event for clients.
    fn add_event(&mut self, text: &str) {
        self.events.keep(seconds(self.clock.elapsed_ns()), text);
    }

    /// Records an event, and shows it to clients.
    fn record_event(&mut self, text: &str) {
        self.observer.note(text);
        self.add_event(text);
    }

    /// Records an event, shows it to clients and on the terminal of the run.
    fn announce(&mut self, text: String) {
        self.record_event(&text);
        self.clients.messages.show(text);
    }

    /// Receives samples and step records, and writes the ticks that have settled.
    fn record<S: TickSink>(&mut self, sink: &mut S) -> Result<(), RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        let received = self.recorder.receive();
        let frame = self.recorder.newest::<RcFrame>();
        // If the port of frames has failed, the phase still shows when the vehicle is down.
        let can_receive =
            self.recorder.is_receiving(Topic::RcFrame) || self.phase() == Some(FlightPhase::Disarmed);
        self.conduct
            .observe_motors(frame.as_ref(), self.clock.elapsed_ns(), can_receive);
        self.announce_decisions();
        self.note_external_steps();
        self.observe_steps();
        let settled_ns = self.clock.elapsed_ns().saturating_sub(SETTLING_NS);
        let settled = (settled_ns / self.clock.tick_ns).min(self.schedule.last_tick() + 1);
        self.write_before(settled, sink)?;
        received
    }

    /// Updates the progress of external services from the samples received.
    fn note_external_steps(&self) {
        let newest = |external_service| self.recorder.newest_of(external_service);
        self.supervisor.note_external_services_steps(newest);
    }

    /// Writes the ticks before `tick`, with their events.
    fn write_before<S: TickSink>(&mut self, tick: u64, sink: &mut S) -> Result<(), RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        for (at, kind, text) in self.pending_events.extract_if(.., |(at, ..)| *at < tick) {
            sink.event(at, kind, &text);
        }
        if self.scenario.flight.is_none() {
            return Ok(self.recorder.write_before(tick, sink)?);
        }
        let mut watched = WatchedSink::new(sink, &mut self.response);
        self.recorder.write_before(tick, &mut watched)?;
        if let Some(found) = watched.found() {
            self.react_to_wrong_response(&found);
        }
        Ok(())
    }

    fn observe_steps(&mut self) {
        let Self {
            monitor,
            observer,
            supervisor,
            ..
        } = self;
        monitor.collect(supervisor.step_log(), |service, record, inputs| {
            observer.step(service, record, inputs);
        });
    }

    fn observe_laboratory(&mut self) {
        let block = self.supervisor.page().control_block();
        if let Some(figures) = self.laboratory.capture(block) {
            self.observer.capture(&figures);
        }
        if let Some(figures) = self.laboratory.link(block) {
            self.observer.link(&figures);
        }
    }

    /// Records when the radio link is lost and found again: what the vehicle does meanwhile is not commanded. One that has not taken
    /// off is killed: with the link its motors would come back at the largest thrust, for the law raises it while nothing moves.
    fn note_radio_link(&mut self) {
        let (block, elapsed_ns) = (self.supervisor.page().control_block(), self.clock.elapsed_ns());
        let change = self.laboratory.link_change(block, elapsed_ns);
        let is_over = self.operator().killed || block.stopping.load(Ordering::SeqCst) != 0;
        let is_low = self.phase() == Some(FlightPhase::Armed) || self.is_low();
        if self.laboratory.is_link_long_lost(elapsed_ns) && self.is_armed() && is_low && !is_over {
            let event = "the radio link was lost before the vehicle had taken off";
            self.ask(Request::Kill, RunEvent::KIND_OPERATOR_KILLS, event);
            self.announce(format!("killed: no frame turns the motors again ({event})"));
        }
        let Some(is_lost) = change else {
            return;
        };
        let (kind, text) = if is_lost {
            (RunEvent::KIND_LINK_LOST, "the radio link is lost")
        } else {
            (RunEvent::KIND_LINK_FOUND, "the radio link is found again")
        };
        let tick = self.clock.tick().min(self.schedule.last_tick());
        self.pending_events.push((tick, kind, text.into()));
    }

    fn announce_laboratory(&mut self) {
        let block = self.supervisor.page().control_block();
        let news = self.laboratory.news(block, self.clock.elapsed_ns());
        let flies = !matches!(self.phase(), None | Some(FlightPhase::Disarmed));
        let battery = self.laboratory.check_battery(block, flies);
        for text in news {
            self.announce(text);
        }
        if let Some(text) = battery {
            self.announce(text);
        }
        if flies && self.laboratory.demands_landing() && !self.operator().land {
            self.ask(
                Request::Land,
                RunEvent::KIND_OPERATOR_LANDS,
                "the battery is low: landing",
            );
        }
    }

    /// Stops the services and records what they have published.
    fn wind_up<S: TickSink>(&mut self, sink: &mut S)
    where
        RunFailure: From<S::Error>,
    {
        self.supervisor.stop();
        for service in ServiceId::ALL {
            self.supervisor.step_log().finish_abandoned(service);
        }
        self.observe_steps();
        let flown = ServiceId::ALL.map(|service| {
            let cell = &self.supervisor.page().control_block().cells[service.index()];
            cell.steps_until.load(Ordering::Relaxed)
        });
        // The counters come from services and external programs: they are limited to the schedule.
        let until = flown.into_iter().max().unwrap_or_default();
        let until = until.min(self.schedule.last_tick() + 1);
        let received = self.recorder.receive();
        // Events after the last step are moved to its tick. A change of gains that no step has used did not happen.
        self.pending_events
            .retain(|(at, kind, _)| *at < until || *kind != RunEvent::KIND_OPERATOR_TUNES);
        for (at, ..) in &mut self.pending_events {
            *at = until.saturating_sub(1).min(*at);
        }
        if let Err(failure) = self.write_before(until, sink).and(received) {
            self.failure.get_or_insert(failure);
        }
    }

    fn outcome(&mut self) -> Outcome {
        match (self.failure.take(), self.signal) {
            (Some(failure), _) => Outcome::Failed(failure.suspecting(self.scenario.foreign_services())),
            (None, Some(signal)) if self.supervisor.supervision().unfinished().next().is_some() => {
                Outcome::Interrupted { signal }
            }
            (None, _) => Outcome::Completed,
        }
    }

    fn finish(mut self, wall_time: Duration, mut warnings: Vec<String>) -> Ending {
        let outcome = self.outcome();
        self.observe_laboratory();
        self.show_more_deaths(u64::MAX);
        for refusal in self.recorder.refusals() {
            self.observer.note(&refusal);
            warnings.push(refusal);
        }
        let unrecorded = unrecorded(self.schedule, &self.monitor, &self.recorder);
        let mut report = TimingReport {
            unrecorded,
            ..self.monitor.finish()
        };
        // The steps of external services have no timing records.
        let is_external_service = |name: &str| {
            self.supervisor
                .supervision()
                .external_services()
                .any(|external_service| external_service.name() == name)
        };
        report
            .services
            .retain(|timing| !is_external_service(timing.service));
        self.observer.timing(&report);
        self.observer.ended(&self.supervisor, &outcome);
        Ending {
            outcome,
            ticks: self.recorder.ticks(),
            wall_time,
            warnings,
            restarts: self.supervisor.restarts().to_vec(),
            timing: Some(report),
            laboratory: self.laboratory.report(self.supervisor.page().control_block()),
        }
    }
}

/// Returns the topics with a sample at every step of which fewer samples were received than steps done.
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
