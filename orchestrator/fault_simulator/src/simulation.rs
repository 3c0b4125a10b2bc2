//! A flight in a history: the supervisor's loop around the decisions, as in `supervisor`, and the checks of the properties.

use std::time::Duration;

use decisions::Phase;
use decisions::conduct::{Conduct, EndRequest};
use decisions::event::{Action, Event, Facts, News};
use decisions::failure::ServiceFailure;
use decisions::moment::Moment;
use decisions::process::{ProcessNumber, Said};
use decisions::restart_policy::{EXTERNAL_LIMIT, FRESH_LIMIT, READY_LIMIT, RestartPolicy};
use decisions::shutdown::Shutdown;
use decisions::supervision::Supervision;
use scenario::{KillSwitchLoss, Scenario};
use shared_types::{FlightPhase, Schedule, ServiceId};

use crate::history::{FOR_EVER, FaultKind, History, Host, MS, Setting, Target};
use crate::machine::{Halt, Machine, Message, NEVER, SERVICES, Simulated, Stage, loop_delay};
use crate::properties::{
    CARE_IS_QUICK_FOR, CARE_PERIOD, LANDED_LIMIT, LONG_CARE_PERIOD, LOOP_PERIOD, Property, STOPPED_LIMIT,
    Violation, absence_limit, is_tight, ns, settling_limit, standby_limit,
};
use crate::world::{Request, World};

/// Maximum back-off of a service.
const LONGEST_PAUSE: Duration = Duration::from_millis(100);

/// Delay from the start command to tick 0, ns.
const COUNTDOWN: u64 = 50 * MS;

/// Number of changes on the machine after which a history is taken for one without an end.
const MAX_CHANGES: u64 = 100_000;

/// Result of a history.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Course {
    /// Hash of all actions and their times.
    pub actions: u64,
    /// Faults that had an effect, by their index in the history.
    pub effective: Vec<bool>,
    /// Number of turns of the loop.
    pub turns: u64,
    /// Number of restarts.
    pub restarts: u32,
    /// Simulated time, ns.
    pub lasted_ns: u64,
    /// What happened, if it is traced.
    pub trace: Vec<String>,
    pub violation: Option<Violation>,
}

/// What the properties need of the past.
#[derive(Debug, Default)]
struct Ledger {
    /// Time since which each service is absent; [`NEVER`] if it is present.
    absent_since: [u64; SERVICES],
    /// Consecutive starts of each service without progress.
    tries: [u32; SERVICES],
    /// Consecutive ends without progress.
    fruitless: [u32; SERVICES],
    /// Last progress.
    progress: [u64; SERVICES],
    tried_at: [u64; SERVICES],
    /// `true` if a process of the service has said so.
    has_failed: [bool; SERVICES],
    has_violated: [bool; SERVICES],
    was_refused: [bool; SERVICES],
    is_not_finite: [bool; SERVICES],
    had_no_fork: bool,
}

/// A flight in a history.
pub struct Simulation<'a, W> {
    history: &'a History,
    scenario: &'a Scenario,
    schedule: &'a Schedule,
    machine: Machine,
    supervision: Supervision,
    conduct: Conduct,
    world: W,
    ledger: Ledger,
    course: Course,
    next_fault: usize,
    quiet_at: u64,
    stalled_until: u64,
    care_since: u64,
    is_disk_full: bool,
    is_end_requested: bool,
    orphan_until: Option<u64>,
    switch_news: Option<bool>,
    has_failed: bool,
    end_requested_at: u64,
    is_traced: bool,
    /// First process of the present orchestrator.
    first_process: usize,
    is_stopping: bool,
    /// Maximum number of consecutive restarts without progress.
    restarts: u32,
    /// Number of changes so far.
    changes: u64,
}

impl<'a, W: World> Simulation<'a, W> {
    pub fn new(history: &'a History, scenario: &'a Scenario, schedule: &'a Schedule, world: W) -> Self {
        let Setting { host, external, .. } = history.setting;
        let quiet_at = history.faults.iter().map(crate::history::Fault::ends_at).max();
        Self {
            history,
            scenario,
            schedule,
            machine: Machine::new(history.seed, host, external, schedule),
            supervision: supervision(history.setting, schedule),
            conduct: Conduct::new(scenario, schedule),
            world,
            ledger: Ledger {
                absent_since: [NEVER; SERVICES],
                ..Ledger::default()
            },
            course: Course {
                effective: vec![false; history.faults.len()],
                ..Course::default()
            },
            next_fault: 0,
            quiet_at: quiet_at.unwrap_or(0),
            stalled_until: 0,
            care_since: NEVER,
            is_disk_full: false,
            is_end_requested: false,
            orphan_until: None,
            switch_news: None,
            has_failed: false,
            end_requested_at: NEVER,
            is_traced: false,
            first_process: 0,
            is_stopping: false,
            restarts: history.setting.restarts,
            changes: 0,
        }
    }

    /// Keeps a readable trace of all events and actions.
    #[must_use]
    pub fn traced(mut self) -> Self {
        self.is_traced = true;
        self
    }

    /// Flies from the first process to the end of the last one.
    pub fn run(mut self) -> Course {
        if self.set_up() {
            match self.history.setting.host {
                Host::RealTime => self.fly_in_real_time(),
                Host::LockStep => self.fly_in_lock_step(),
            }
        }
        if self.is_fine() && !self.supervision_is_gone() {
            self.stop();
        }
        if self.is_fine() {
            self.check_what_is_left();
        }
        self.course.lasted_ns = self.machine.now;
        self.course
    }

    fn supervision_is_gone(&self) -> bool {
        self.orphan_until == Some(NEVER)
    }

    fn is_fine(&self) -> bool {
        self.course.violation.is_none()
    }

    fn now(&self) -> Moment {
        Moment(self.machine.now)
    }

    #[cold]
    fn violate(&mut self, property: Property, what: String) {
        let at_ns = self.machine.now;
        if self.is_traced {
            self.note(&format!("VIOLATION of {property:?}: {what}"));
        }
        self.course.violation.get_or_insert(Violation {
            property,
            at_ns,
            what,
        });
    }

    #[cold]
    fn note(&mut self, text: &str) {
        let at = self.machine.now as f64 / 1e6;
        self.course.trace.push(format!("{at:11.4} ms  {text}"));
    }

    // --- The loop --------------------------------------------------------------------------------------------------

    /// Starts all services. Returns whether the flight begins.
    fn set_up(&mut self) -> bool {
        for _ in ServiceId::ALL {
            self.supervision.start_next(self.now(), self.scenario);
            self.perform_all();
            if self.take_losses() {
                return false;
            }
        }
        while !self.supervision.is_ready() {
            self.supervision.look(self.now(), &self.machine);
            self.perform_all();
            self.watch(LOOP_PERIOD);
            if self.take_losses() || !self.is_fine() {
                return false;
            }
            if self.machine.now > ns(READY_LIMIT) + self.quiet_at + 5_000 * MS {
                self.violate(
                    Property::SetUpEnds,
                    "it is neither ready nor has failed".to_owned(),
                );
            }
        }
        self.machine.start_ns = self.machine.now + COUNTDOWN;
        self.supervision.go();
        self.perform_all();
        self.note_presence();
        self.is_fine()
    }

    /// Handles the news. Returns whether a service is lost.
    fn take_losses(&mut self) -> bool {
        let mut is_lost = false;
        for news in self.supervision.take_news() {
            if let News::Lost(failure) = news {
                self.check_verdict(&failure);
                is_lost = true;
            }
        }
        is_lost
    }

    fn fly_in_real_time(&mut self) {
        let last_ns = self.schedule.last_tick() * self.schedule.tick_ns();
        loop {
            self.course.turns += 1;
            let since_end = self
                .machine
                .now
                .saturating_sub(self.machine.start_ns.saturating_add(last_ns));
            let since_end = Duration::from_nanos(since_end);
            if !self.is_fine() || self.conduct.is_over(&self.supervision, since_end, &self.machine) {
                return;
            }
            self.check_end(since_end);
            if std::mem::take(&mut self.is_end_requested) {
                let request = self.conduct.request_end();
                self.obey(request);
            }
            self.react_to_switch();
            let period = self.period();
            self.watch(period);
            if let Some(until) = self.orphan_until {
                self.change_orchestrators(until);
                if self.supervision_is_gone() {
                    return;
                }
            }
            let now = self.now();
            let tick = self.machine.tick();
            let hung = self.conduct.look(&mut self.supervision, now, tick, &self.machine);
            if self.is_traced && !hung.is_empty() {
                self.note(&format!("hang: {hung:?}"));
            }
            self.perform_all();
            if self.take_losses() {
                self.fail();
            }
            self.tell_world();
            let elapsed = self.machine.now.saturating_sub(self.machine.start_ns);
            let frame = self.world.newest_frame();
            self.conduct.observe_motors(frame.as_ref(), elapsed, true);
            if std::mem::take(&mut self.is_disk_full) {
                self.fail();
            }
            self.check_absences();
            self.check_settling();
        }
    }

    fn fly_in_lock_step(&mut self) {
        while self.is_fine() {
            self.course.turns += 1;
            if (0..SERVICES).all(|service| self.machine.has_flown_all(service)) || self.is_end_requested {
                return;
            }
            let period = self.period();
            self.watch(period);
            self.supervision.look(self.now(), &self.machine);
            self.perform_all();
            // The host sees in the samples of a program that it has not finished, and ends the run.
            let has_early_program = self.supervision.external_services().any(|service| {
                let at = self.machine.newest[service.index()];
                let is_done = at.is_some_and(|at| self.machine.processes[at].stage == Stage::Finished);
                self.supervision.is_finished(service) && !is_done
            });
            if self.take_losses() || self.is_disk_full || has_early_program {
                self.has_failed = true;
                return;
            }
            self.check_settling();
        }
    }

    fn period(&mut self) -> u64 {
        if !self.supervision.needs_care() {
            self.care_since = NEVER;
            return LOOP_PERIOD;
        }
        if self.care_since == NEVER {
            self.care_since = self.machine.now;
        }
        match self.machine.now - self.care_since < CARE_IS_QUICK_FOR {
            true => CARE_PERIOD,
            false => LONG_CARE_PERIOD,
        }
    }

    /// Stops everything.
    fn stop(&mut self) {
        self.is_stopping = true;
        let mut since = self.machine.now;
        if self.is_traced {
            self.note("stop");
        }
        self.supervision.stop(self.now());
        self.perform_all();
        while self.is_fine() && !self.supervision.has_stopped(self.now()) {
            self.course.turns += 1;
            self.watch(LOOP_PERIOD);
            self.supervision.look(self.now(), &self.machine);
            self.perform_all();
            self.take_losses();
            // Time in which nothing could be done does not count.
            since = since.max(self.stalled_until);
            if self.machine.now > since + STOPPED_LIMIT + self.history.setting.loop_delay_ns {
                self.violate(Property::EverythingStops, "processes are waited for".to_owned());
            }
        }
        self.check_exits();
    }

    fn fail(&mut self) {
        self.has_failed = true;
        if let Some(request) = self.conduct.fail() {
            if self.is_traced {
                self.note("the flight has failed");
            }
            self.obey(request);
        }
    }

    fn obey(&mut self, request: EndRequest) {
        self.end_requested_at = self.end_requested_at.min(self.machine.now);
        if request == EndRequest::Land {
            self.tell_world();
            self.world.ask(Request::Land);
        }
    }

    fn react_to_switch(&mut self) {
        if let Some(is_lost) = self.switch_news.take() {
            self.conduct.note_kill_switch(is_lost);
        }
        let may_fly = self.world.phase() != FlightPhase::Disarmed;
        match self.conduct.reaction_to_loss(may_fly) {
            Some(KillSwitchLoss::Land) => {
                let request = self.conduct.request_end();
                self.obey(request);
            }
            Some(KillSwitchLoss::Kill) => self.world.ask(Request::Kill),
            Some(KillSwitchLoss::Ignore) | None => {}
        }
    }

    /// Waits for events, up to a time, and handles them.
    fn watch(&mut self, period: u64) {
        let deadline = self.machine.now + period;
        let has_been_quick = self.course.turns;
        while self.machine.events.is_empty() {
            let next = self.next_change();
            if next > deadline {
                break;
            }
            self.advance(next);
        }
        let wake = match self.machine.events.is_empty() {
            true => deadline,
            false => self.machine.now,
        };
        let delay = loop_delay(
            self.history.seed,
            has_been_quick,
            self.history.setting.loop_delay_ns,
        );
        let mut turn_at = (wake + delay).max(self.stalled_until);
        loop {
            let next = self.next_change();
            if next > turn_at {
                break;
            }
            self.advance(next);
            turn_at = turn_at.max(self.stalled_until);
        }
        self.machine.now = turn_at.max(self.machine.now);
        while let Some((at, event)) = self.machine.events.pop_front() {
            self.deliver(at, event);
        }
    }

    fn next_change(&self) -> u64 {
        let fault = self.history.faults.get(self.next_fault);
        let fault = fault.map_or(NEVER, |fault| fault.at_ns);
        fault
            .max(self.machine.now)
            .min(self.machine.next_event().max(self.machine.now))
    }

    /// Lets the next change happen.
    fn advance(&mut self, at_ns: u64) {
        self.changes += 1;
        if self.changes > MAX_CHANGES {
            // Let time pass, so that all loops end.
            self.machine.now += 100_000 * MS;
            self.violate(Property::FlightEnds, "too much happens".to_owned());
        }
        self.tell_world();
        let fault = self.history.faults.get(self.next_fault);
        if fault.is_some_and(|fault| fault.at_ns <= at_ns) {
            self.machine.now = self.machine.now.max(at_ns);
            self.strike();
        } else {
            self.machine.advance(at_ns);
        }
        self.note_presence();
    }

    fn tell_world(&mut self) {
        if self.machine.now >= self.machine.start_ns {
            // The flight of the services ends with their last step.
            let tick = self.machine.tick().min(self.schedule.last_tick() + 1);
            self.world.advance_to(tick, &self.machine.present());
        }
    }

    /// Hands an event to the decisions.
    fn deliver(&mut self, at: usize, event: Event) {
        let process = &self.machine.processes[at];
        if at < self.first_process && !process.is_end_told && process.service.is_none() {
            return;
        }
        let number = process.number;
        let external_service = self.supervision.external_service_of(number);
        let is_its_turn =
            |said| external_service.is_none_or(|service| self.supervision.is_its_turn(service, said));
        let event = match event {
            Event::Said(said) if !is_its_turn(&said) => Event::Violated("speaks out of turn".to_owned()),
            event => event,
        };
        self.keep_account(at, &event);
        self.handle(number, event);
    }

    fn handle(&mut self, number: ProcessNumber, event: Event) {
        if self.is_traced {
            let service = self.machine.processes[self.machine.index_of(number)].service;
            let service = service.map_or("standby", |service| ServiceId::ALL[service].name());
            self.note(&format!("{service} {}: {event:?}", number.0));
        }
        self.supervision.handle(self.now(), number, event, &self.machine);
        self.perform_all();
    }

    // --- The actions -----------------------------------------------------------------------------------------------

    fn perform_all(&mut self) {
        let actions = self.supervision.take_actions();
        for &action in &actions {
            self.check_action(action);
        }
        for action in actions {
            self.perform(action);
        }
    }

    fn perform(&mut self, action: Action) {
        self.hash(action);
        if self.is_traced && !matches!(action, Action::RefillReserve | Action::Wake | Action::CleanUp) {
            self.note(&format!("    {action:?}"));
        }
        match action {
            Action::Start { process, role } => {
                let service = role.map(|role| role.service.index());
                self.check_start(process, service);
                let asked_at = self.machine.now;
                match self.machine.start(process, role) {
                    Some(pid) => {
                        self.count_start(service, asked_at);
                        self.handle(process, Event::Started { pid });
                    }
                    None => {
                        self.ledger.had_no_fork = true;
                        self.handle(process, Event::NotStarted("no more processes".to_owned()));
                    }
                }
                self.note_presence();
            }
            Action::Become { process, role } => {
                // A standby process that the system did not start may get its role before that is known.
                let known = self.machine.known_index_of(process);
                let service = Some(role.service.index());
                self.check_start(process, service);
                if known.is_none_or(|at| !self.machine.processes[at].was_not_started) {
                    self.count_start(service, self.machine.now);
                }
                self.send(process, Message::Become(role));
                self.handle(process, Event::Asked);
            }
            Action::MakePorts { process } => self.send(process, Message::MakePorts),
            Action::Go {
                process,
                service,
                is_restarted,
            } => {
                self.tell_world();
                if is_restarted {
                    self.course.restarts += 1;
                    self.world.replace(service, self.machine.next_tick(service));
                }
                self.send(process, Message::Go { is_restarted });
                self.note_presence();
            }
            Action::Beat { process } => self.send(process, Message::Beat),
            Action::Connect { process, birth } => self.send(process, Message::Connect { birth }),
            Action::Stop { process } => self.send(process, Message::Stop),
            Action::SendMissed { process, .. } => {
                // Its channel may be full of them: that is only tried again.
                self.machine.send(process, Message::Missed);
            }
            Action::Kill { process } => {
                let at = self.machine.index_of(process);
                self.check_kill(at);
                if let Some(service) = self.machine.processes[at].service {
                    self.ledger.has_violated[service] |= self.machine.is_external(at);
                }
                self.machine.kill(at);
                self.note_presence();
            }
            Action::Announce { birth } => self.machine.announce(birth),
            Action::MarkGone { .. }
            | Action::CatchUp { .. }
            | Action::ForgetReceivers { .. }
            | Action::CleanUp
            | Action::Wake
            | Action::LendReserve
            | Action::RefillReserve
            | Action::SetStopping => {}
        }
    }

    fn send(&mut self, process: ProcessNumber, message: Message) {
        if !self.machine.send(process, message) {
            let at = self.machine.index_of(process);
            self.machine.processes[at].is_faulty = true;
            self.handle(process, Event::Deaf);
        }
    }

    fn hash(&mut self, action: Action) {
        let (kind, number) = match action {
            Action::Start { process, .. } => (1, process.0),
            Action::Become { process, .. } => (2, process.0),
            Action::MakePorts { process } => (3, process.0),
            Action::Go { process, .. } => (4, process.0),
            Action::Beat { process } => (5, process.0),
            Action::Connect { process, .. } => (6, process.0),
            Action::Stop { process } => (7, process.0),
            Action::Kill { process } => (8, process.0),
            Action::Announce { birth } => (9, birth),
            Action::CatchUp { .. } => (10, 0),
            Action::SendMissed { process, .. } => (11, process.0),
            Action::MarkGone { service } => (12, service.index() as u32),
            Action::ForgetReceivers { service } => (13, service.index() as u32),
            Action::CleanUp | Action::Wake | Action::LendReserve | Action::RefillReserve => return,
            Action::SetStopping => (14, 0),
        };
        for word in [kind, u64::from(number), self.machine.now] {
            self.course.actions =
                (self.course.actions.rotate_left(5) ^ word).wrapping_mul(0x517C_C1B7_2722_0A95);
        }
    }

    // --- The faults ------------------------------------------------------------------------------------------------

    fn strike(&mut self) {
        let index = self.next_fault;
        let fault = self.history.faults[index];
        self.next_fault += 1;
        let now = self.machine.now;
        let until = now.saturating_add(fault.for_ns);
        if self.is_traced {
            self.note(&format!("FAULT {fault:?}"));
        }
        // It may be later than planned: the supervisor may have been busy.
        if fault.for_ns != FOR_EVER {
            self.quiet_at = self.quiet_at.max(until);
        }
        self.quiet_at = self.quiet_at.max(now);
        let newest = match fault.target {
            Target::Service(service) => self.machine.newest[usize::from(service)],
            Target::Standby => self.machine.standby(),
            Target::Machine => None,
        };
        let has_effect = match (newest, fault.kind) {
            (Some(at), kind) => self.machine.strike(at, kind, fault.for_ns),
            (None, FaultKind::KillsTakeLong) => {
                self.machine.kills_take_until = match fault.for_ns {
                    FOR_EVER => NEVER,
                    _ => self.machine.kills_take_until.max(until),
                };
                true
            }
            (None, FaultKind::NoForks) => {
                self.machine.no_forks_until = until;
                true
            }
            (None, FaultKind::SlowForks) => {
                self.machine.slow_forks_until = until;
                true
            }
            (None, FaultKind::SupervisorStalls) => {
                self.stalled_until = self.stalled_until.max(until);
                true
            }
            (None, FaultKind::MachineStalls) => {
                self.stalled_until = self.stalled_until.max(until);
                for at in self.machine.living.clone() {
                    self.machine.halt(at, Halt::Starving, until);
                    let ends_at = &mut self.machine.processes[at].ends_at;
                    *ends_at = (*ends_at).max(until);
                }
                true
            }
            (None, FaultKind::DiskFull) => {
                self.is_disk_full = true;
                true
            }
            (None, FaultKind::RequestsEnd) => {
                self.is_end_requested = true;
                true
            }
            (None, FaultKind::Arms) => {
                self.world.ask(Request::Arm);
                true
            }
            (None, FaultKind::SwitchLost | FaultKind::SwitchFound) => {
                self.switch_news = Some(fault.kind == FaultKind::SwitchLost);
                self.scenario.operator.is_some()
            }
            (None, FaultKind::OrchestratorDies) => {
                let flies =
                    self.machine.start_ns != NEVER && !self.is_stopping && self.orphan_until.is_none();
                if flies {
                    self.orphan_until = Some(until);
                }
                flies
            }
            (None, _) => false,
        };
        self.course.effective[index] = has_effect;
    }

    /// Lets the orchestrator die and another one take over at a time.
    fn change_orchestrators(&mut self, until: u64) {
        self.check_exits();
        // What does not fly ends with it; so do programs.
        for at in self.machine.living.clone() {
            let process = &self.machine.processes[at];
            let is_orphan =
                process.stage == Stage::Flying && !process.was_killed && !self.machine.is_external(at);
            if !is_orphan {
                self.machine.remove(at);
            }
        }
        self.machine.forget_numbers();
        loop {
            let next = self.next_change();
            if next > until {
                break;
            }
            self.advance(next);
            self.machine.events.clear();
        }
        self.machine.now = self.machine.now.max(until).max(self.stalled_until);
        // What is stopped does not come, and is killed.
        for at in self.machine.living.clone() {
            let process = &self.machine.processes[at];
            if process.halt.is_some() || process.stage != Stage::Flying || process.service.is_none() {
                self.machine.remove(at);
            }
        }
        self.machine.events.clear();
        self.orphan_until = None;
        self.first_process = self.machine.processes.len();
        // It does not know those of the first one.
        self.restarts = RestartPolicy::default().limit;
        self.supervision = supervision(
            Setting {
                restarts: self.restarts,
                ..self.history.setting
            },
            self.schedule,
        );
        self.conduct = Conduct::new(self.scenario, self.schedule);
        let is_landing = self.end_requested_at != NEVER;
        self.ledger.tries = [0; SERVICES];
        self.ledger.fruitless = [0; SERVICES];
        self.supervision.continue_flight();
        if self.is_traced {
            self.note("another orchestrator takes over");
        }
        for service in ServiceId::ALL {
            let orphan = self.machine.newest[service.index()]
                .filter(|&at| self.machine.processes[at].stage == Stage::Flying);
            if let Some(at) = orphan {
                let pid = self.machine.processes[at].pid;
                let number = self.supervision.adopt_next(self.now(), self.scenario, pid);
                self.machine.adopt(at, number);
                self.perform_all();
            } else {
                self.supervision.start_next(self.now(), self.scenario);
                self.perform_all();
            }
            if self.take_losses() {
                // The take-over has failed: the services land by themselves.
                self.orphan_until = Some(NEVER);
                return;
            }
        }
        self.conduct.inherit(is_landing);
        self.has_failed = false;
        self.note_presence();
    }

    // --- The properties --------------------------------------------------------------------------------------------

    /// Records the events that the properties are judged by.
    fn keep_account(&mut self, at: usize, event: &Event) {
        let service = self.machine.processes[at].service;
        match (event, service) {
            (Event::Ended(_), _) => {
                self.machine.processes[at].is_end_told = true;
                if let Some(service) = service {
                    let until = self.machine.steps_until(ServiceId::ALL[service]);
                    let ledger = &mut self.ledger;
                    ledger.fruitless[service] = match until > ledger.progress[service] {
                        true => 0,
                        false => ledger.fruitless[service] + 1,
                    };
                    if until > ledger.progress[service] {
                        ledger.tries[service] = 0;
                    }
                    ledger.progress[service] = ledger.progress[service].max(until);
                    ledger.has_violated[service] |= self.machine.is_external(at);
                }
            }
            (Event::Said(Said::Failed { .. }) | Event::Unreadable(_), Some(service)) => {
                self.ledger.has_failed[service] = true;
                self.ledger.has_violated[service] = true;
            }
            (Event::Said(Said::Refused { .. }), Some(service)) => {
                self.ledger.was_refused[service] = true;
                self.ledger.has_failed[service] = true;
            }
            (Event::Said(Said::NonFinite(_)), Some(service)) => self.ledger.is_not_finite[service] = true,
            (Event::HungUp, Some(service)) if self.machine.is_external(at) => {
                self.ledger.has_violated[service] = true;
            }
            (Event::Violated(_), Some(service)) => self.ledger.has_violated[service] = true,
            _ => {}
        }
    }

    /// [`Property::NoActionOnEnded`]: an action names a process that lives, as far as the decisions know.
    fn check_action(&mut self, action: Action) {
        let process = match action {
            Action::Become { process, .. }
            | Action::MakePorts { process }
            | Action::Go { process, .. }
            | Action::Beat { process }
            | Action::Connect { process, .. }
            | Action::Stop { process }
            | Action::Kill { process }
            | Action::SendMissed { process, .. } => process,
            _ => return,
        };
        let Some(at) = self.machine.known_index_of(process) else {
            // It is started by an action before this one.
            return;
        };
        if self.machine.processes[at].is_end_told {
            self.violate(Property::NoActionOnEnded, format!("{action:?}"));
        }
    }

    /// [`Property::SuccessorWaitsForEnd`], [`Property::AtMostOneStandby`], [`Property::RestartsAreBounded`].
    fn check_start(&mut self, process: ProcessNumber, service: Option<usize>) {
        let Some(service) = service else {
            if self.machine.standby().is_some() {
                self.violate(Property::AtMostOneStandby, format!("{process:?} is another one"));
            }
            return;
        };
        if let Some(previous) = self.machine.newest[service]
            && self.machine.processes[previous].stage != Stage::Ended
        {
            let what = format!("{process:?} while {previous} lives");
            self.violate(Property::SuccessorWaitsForEnd, what);
        }
        let now = self.machine.now;
        let tries = self.ledger.tries[service] + 1;
        let pause = ns(LONGEST_PAUSE);
        // The first process is none of them. If no restarts are permitted, progress does not matter.
        let follows =
            self.machine.newest[service].is_some_and(|at| !self.machine.processes[at].was_not_started);
        let is_beyond = tries > self.restarts + 1 || (self.restarts == 0 && follows);
        let is_soon = now < self.ledger.tried_at[service] + pause;
        if is_beyond && (!self.has_failed || is_soon) {
            let what = format!(
                "start {tries} of {} in a row without progress",
                ServiceId::ALL[service]
            );
            self.violate(Property::RestartsAreBounded, what);
        }
    }

    /// Counts a process that the system has started for a service, with the time at which it was asked for.
    fn count_start(&mut self, service: Option<usize>, asked_at: u64) {
        if let Some(service) = service {
            self.ledger.tries[service] += 1;
            self.ledger.tried_at[service] = asked_at;
        }
    }

    /// [`Property::PunctualIsNotKilled`].
    fn check_kill(&mut self, at: usize) {
        let process = &self.machine.processes[at];
        let is_spared = process.is_faulty || process.service.is_none();
        if is_spared || process.stage == Stage::Ended {
            return;
        }
        let waited = self.machine.now - process.asked_at;
        let is_late = !matches!(process.stage, Stage::Flying | Stage::Finished)
            && process.starved_ns > 0
            && waited > ns(FRESH_LIMIT);
        // A process that only waits for the others is one that nothing was done to.
        let is_stopped_late = self.is_stopping && process.starved_ns > 0;
        // After a failure, programs end with the run in lock step.
        if !is_late && !is_stopped_late {
            let what = format!(
                "process {} of {:?}, {:?}, was asked {:.3} ms ago",
                process.number.0,
                process.service.map(|service| ServiceId::ALL[service]),
                process.stage,
                waited as f64 / 1e6
            );
            self.violate(Property::PunctualIsNotKilled, what);
        }
    }

    /// [`Property::VerdictIsTrue`].
    fn check_verdict(&mut self, failure: &ServiceFailure) {
        let of = |name: &str| ServiceId::from_name(name).map(ServiceId::index);
        let ledger = &self.ledger;
        let restarts = self.restarts;
        let is_true = match failure {
            ServiceFailure::Died { service, times, .. } => of(service).is_some_and(|service| {
                // A process that was killed and does not end counts as well.
                let newest = self.machine.newest[service].map(|at| &self.machine.processes[at]);
                let is_stuck = newest.is_some_and(|process| process.was_killed && !process.is_end_told);
                let fruitless = ledger.fruitless[service] + u32::from(is_stuck);
                restarts == 0 || (fruitless > restarts && *times > restarts)
            }),
            ServiceFailure::GaveUp { service, .. } => {
                of(service).is_some_and(|service| ledger.has_failed[service])
            }
            ServiceFailure::NotReady { .. } => self.machine.now > ns(READY_LIMIT),
            ServiceFailure::ExternalService { service, .. } => of(service)
                .is_some_and(|service| ledger.has_violated[service] || self.machine.now > ns(EXTERNAL_LIMIT)),
            ServiceFailure::NonFinite(_) => ledger.is_not_finite.contains(&true),
            ServiceFailure::Refused(_) => ledger.was_refused.contains(&true),
            ServiceFailure::NotStarted(_) => ledger.had_no_fork,
            ServiceFailure::Stuck { service, limit, .. } => of(service).is_some_and(|service| {
                let newest = self.machine.newest[service].map(|at| &self.machine.processes[at]);
                newest.is_some_and(|process| {
                    process.was_killed && process.stage != Stage::Ended && self.machine.now > ns(*limit)
                })
            }),
        };
        if self.is_traced {
            self.note(&format!("lost: {failure}"));
        }
        if !is_true {
            self.violate(Property::VerdictIsTrue, failure.to_string());
        }
    }

    fn note_presence(&mut self) {
        let now = self.machine.now;
        if now < self.machine.start_ns {
            return;
        }
        let present = self.machine.present();
        for (service, is_present) in present.into_iter().enumerate() {
            let since = &mut self.ledger.absent_since[service];
            match (is_present, *since) {
                (true, NEVER) => {}
                (true, began) => {
                    *since = NEVER;
                    self.check_absence(service, began);
                }
                (false, NEVER) => *since = now,
                (false, _) => {}
            }
        }
    }

    fn check_absences(&mut self) {
        if !is_tight(self.history) {
            return;
        }
        for service in 0..SERVICES {
            let since = self.ledger.absent_since[service];
            if since != NEVER {
                self.check_absence(service, since);
            }
        }
    }

    /// [`Property::ServiceReturnsInTime`].
    fn check_absence(&mut self, service: usize, since: u64) {
        if !is_tight(self.history) || self.is_stopping {
            return;
        }
        let fault = &self.history.faults[0];
        let limit = absence_limit(
            fault,
            self.history.setting,
            service,
            self.machine.longest_period(),
        );
        let absent = self.machine.now - since;
        if absent > limit {
            let what = format!(
                "{} was absent for {:.3} ms, and may be for {:.3} ms",
                ServiceId::ALL[service],
                absent as f64 / 1e6,
                limit as f64 / 1e6
            );
            self.violate(Property::ServiceReturnsInTime, what);
        }
    }

    /// [`Property::FaultsAreOvercome`], [`Property::StandbyReturns`]; requests the end once nothing more will happen.
    fn check_settling(&mut self) {
        let now = self.machine.now;
        let last_ns = self.schedule.last_tick() * self.schedule.tick_ns();
        let is_past = self.history.setting.host == Host::RealTime && now > self.machine.start_ns + last_ns;
        if self.next_fault < self.history.faults.len() || now <= self.quiet_at || is_past {
            return;
        }
        let is_up = |service: ServiceId| {
            let at = self.machine.newest[service.index()];
            let stage = at.map(|at| &self.machine.processes[at]);
            stage.is_some_and(Simulated::is_stepping_or_done)
                && self.supervision.phase_of(service) != Phase::Dying
        };
        let is_stuck = |service: ServiceId| {
            let at = self.machine.newest[service.index()];
            at.is_some_and(|at| {
                let process = &self.machine.processes[at];
                process.was_killed && process.ends_at == NEVER
            })
        };
        let down = ServiceId::ALL.into_iter().find(|&service| !is_up(service));
        let is_excused = down.is_some_and(is_stuck) && self.end_requested_at != NEVER;
        if let Some(service) = down
            && !is_excused
        {
            if now > self.quiet_at + settling_limit(self.history) {
                let what = format!("{service} is {:?}", self.supervision.phase_of(service));
                self.violate(Property::FaultsAreOvercome, what);
            }
            return;
        }
        if down.is_none() && !self.supervision.needs_care() && !self.machine.has_prepared_standby() {
            if now > self.quiet_at + standby_limit(self.history) {
                self.violate(Property::StandbyReturns, "there is none".to_owned());
            }
            return;
        }
        // The operator has seen enough.
        if self.end_requested_at == NEVER {
            self.is_end_requested = true;
            self.end_requested_at = now;
        }
    }

    /// [`Property::FlightEnds`].
    fn check_end(&mut self, since_end: Duration) {
        let now = self.machine.now;
        let requested_at = self.end_requested_at;
        let landed_within = self.world.longest_landing_ns().saturating_add(LANDED_LIMIT);
        let is_overdue = requested_at != NEVER
            && self.conduct.shutdown() != Shutdown::None
            && now > requested_at.max(self.quiet_at).saturating_add(landed_within);
        let longest = Duration::from_secs(10) + Duration::from_nanos(2 * LOOP_PERIOD);
        let is_past = since_end > longest && now > self.quiet_at + 100 * MS;
        if is_overdue || is_past {
            self.violate(Property::FlightEnds, "it goes on".to_owned());
        }
    }

    /// [`Property::ExitIsRecordedOnce`].
    fn check_exits(&mut self) {
        let exits = self.supervision.exits();
        let mut what = None;
        for process in &self.machine.processes {
            if process.was_not_started {
                continue;
            }
            let own = exits.iter().filter(|(_, pid, _)| *pid == process.pid);
            let count = own.clone().count();
            let service = process.service.map(|service| ServiceId::ALL[service]);
            let is_of_it = own.clone().all(|(whose, ..)| *whose == service);
            // A standby process that ends with the run is not worth a record.
            let is_recorded = process.service.is_some() || !self.is_stopping;
            let is_due = process.is_end_told && self.machine.is_numbered(process) && is_recorded;
            if count > 1 || (is_due && count == 0) || !is_of_it {
                what = Some(format!(
                    "process {} (PID {}) of {service:?} is recorded {count} times",
                    process.number.0, process.pid
                ));
                break;
            }
        }
        if let Some((whose, pid, exit)) = exits.iter().find(|(_, pid, _)| *pid < 1000) {
            what = Some(format!(
                "an end of PID {pid} of {whose:?} is recorded: {}",
                exit.description
            ));
        }
        if let Some(what) = what {
            self.violate(Property::ExitIsRecordedOnce, what);
        }
    }

    /// [`Property::NothingIsLeftBehind`], [`Property::VehicleIsSafe`].
    fn check_what_is_left(&mut self) {
        let left = self.machine.living.iter().find(|&&at| {
            let process = &self.machine.processes[at];
            let ends = process.was_killed || matches!(process.stage, Stage::Ending | Stage::Closed);
            !ends
        });
        if let Some(&at) = left
            && !self.supervision_is_gone()
        {
            let process = &self.machine.processes[at];
            let what = format!("process {} ({:?})", process.number.0, process.stage);
            self.violate(Property::NothingIsLeftBehind, what);
        }
        if let Err(what) = self.world.judge() {
            self.violate(Property::VehicleIsSafe, what);
        }
    }
}

fn supervision(setting: Setting, schedule: &Schedule) -> Supervision {
    let policy = RestartPolicy {
        limit: setting.restarts,
        longest_pause: LONGEST_PAUSE,
    };
    Supervision::new(schedule, setting.host == Host::RealTime, [policy; SERVICES])
}
