//! The processes of a run: started, watched, restarted after deaths, and stopped.
//!
//! After a death in flight, another process resumes from the last checkpoint. A service that dies repeatedly at the same
//! tick is given up: its crash is a function of its inputs, so the next process would crash as well. In normal operation
//! a standby process waits to take the role of the next service that dies.
//!
//! A process is replaced only once it has ended: until then its ports are its own, and it may write a checkpoint.

use std::time::Duration;

use host::step::Timetable;
use metrics::summary::restart::Restart;
use scenario::Scenario;
use shared_types::{Schedule, ServiceId};

use crate::event::{Action, Event, Facts, News};
use crate::failure::ServiceFailure;
use crate::member::{Member, Phase};
use crate::moment::Moment;
use crate::process::{Exit, Process, ProcessNumber, Role, Said};
use crate::restart_policy::{
    AFTER_CLOSING, END_LIMIT, NOT_STARTED_PAUSE, READY_LIMIT, RestartPolicy, STOP_LIMIT, STUCK_LIMIT,
    doubled, external_start_limit,
};
use crate::standby::Standby;

/// What is wrong with a service that has not finished.
const EARLY: &str = "says that it has finished, and has steps to do";

pub type RestartPolicies = [RestartPolicy; ServiceId::ALL.len()];

/// Decisions on all service processes of a run.
#[derive(Clone, Debug)]
pub struct Supervision {
    pub(crate) schedule: Schedule,
    pub(crate) timetables: Vec<Timetable>,
    pub(crate) policies: RestartPolicies,
    pub(crate) is_real_time: bool,
    /// `true` from the start of the flight: the start-up limits of the set-up do not apply any more.
    pub(crate) is_in_flight: bool,
    /// `true` once the end of all services is requested.
    pub(crate) is_stopping: bool,
    stopping_since: Moment,
    pub(crate) members: Vec<Member>,
    pub(crate) standby: Standby,
    /// Number of processes so far.
    started: u32,
    /// Number of restarts that were announced in lock step.
    pub(crate) births: u32,
    pub(crate) exits: Vec<(Option<ServiceId>, u32, Exit)>,
    pub(crate) restarts: Vec<Restart>,
    pub(crate) actions: Vec<Action>,
    pub(crate) news: Vec<News>,
}

impl Supervision {
    /// Creates the supervision of a run that has no processes yet.
    #[must_use]
    pub fn new(schedule: &Schedule, is_real_time: bool, policies: RestartPolicies) -> Self {
        Self {
            schedule: schedule.clone(),
            timetables: ServiceId::ALL
                .map(|service| Timetable::new(schedule, service))
                .into(),
            policies,
            is_real_time,
            is_in_flight: false,
            is_stopping: false,
            stopping_since: Moment::default(),
            members: Vec::new(),
            standby: Standby::default(),
            started: 0,
            births: 0,
            exits: Vec::new(),
            restarts: Vec::new(),
            actions: Vec::new(),
            news: Vec::new(),
        }
    }

    /// Starts a process for the next service, in the order of [`ServiceId::ALL`].
    pub fn start_next(&mut self, now: Moment, scenario: &Scenario) -> ProcessNumber {
        let service = ServiceId::ALL[self.members.len()];
        let process = self.start_process(now, Some(Role { service, deaths: 0 }));
        let number = process.number;
        self.add(service, scenario, process);
        self.act(Action::MakePorts { process: number });
        number
    }

    /// Continues a flight that another orchestrator has begun.
    pub fn continue_flight(&mut self) {
        self.is_in_flight = true;
    }

    /// Takes over the flying process of the next service, which another orchestrator has started.
    pub fn adopt_next(&mut self, now: Moment, scenario: &Scenario, pid: u32) -> ProcessNumber {
        let service = ServiceId::ALL[self.members.len()];
        let mut process = Process::new(self.next_number(), now);
        process.pid = pid;
        let number = process.number;
        self.add(service, scenario, process);
        let member = &mut self.members[service.index()];
        (member.phase, member.has_flown) = (Phase::Flying, true);
        number
    }

    fn add(&mut self, service: ServiceId, scenario: &Scenario, process: Process) {
        let is_external = scenario.program_of(service).is_some();
        let name = scenario.process_name(service);
        self.members
            .push(Member::new(service, name, is_external, process));
    }

    fn next_number(&mut self) -> ProcessNumber {
        self.started += 1;
        ProcessNumber(self.started)
    }

    pub(crate) fn start_process(&mut self, now: Moment, role: Option<Role>) -> Process {
        let process = Process::new(self.next_number(), now);
        self.act(Action::Start {
            process: process.number,
            role,
        });
        process
    }

    pub(crate) fn act(&mut self, action: Action) {
        self.actions.push(action);
    }

    /// Takes the actions that are to be done, in this order, and before the next event is handled.
    pub fn take_actions(&mut self) -> Vec<Action> {
        std::mem::take(&mut self.actions)
    }

    /// Takes the news since the last call.
    pub fn take_news(&mut self) -> Vec<News> {
        std::mem::take(&mut self.news)
    }

    /// Starts the flight of all services, in the order of the ring.
    pub fn go(&mut self) {
        self.is_in_flight = true;
        for at in 0..self.members.len() {
            self.members[at].phase = Phase::Flying;
            self.send_go(at, false);
        }
    }

    pub(crate) fn send_go(&mut self, at: usize, is_restarted: bool) {
        let member = &mut self.members[at];
        member.has_flown = true;
        let go = Action::Go {
            process: member.process.number,
            service: member.service,
            is_restarted,
        };
        self.act(go);
    }

    /// Handles an event of a process.
    pub fn handle(&mut self, now: Moment, number: ProcessNumber, event: Event, facts: &dyn Facts) {
        if self.standby.knows(number) {
            return self.handle_standby(now, number, event);
        }
        let Some(at) = self
            .members
            .iter()
            .position(|member| member.process.number == number)
        else {
            return;
        };
        let can_be_followed = self.can_be_followed();
        if event == Event::Said(Said::Finished) && self.is_early_in_lock_step(at, facts) {
            return self.replace(at, now, EARLY.to_owned());
        }
        let member = &mut self.members[at];
        match event {
            Event::Ended(exit) => {
                let was_handled = matches!(member.phase, Phase::Dead(_)) || member.process.has_ended;
                member.process.has_ended = true;
                if was_handled {
                    self.record_exit(at, exit, facts);
                } else {
                    self.reap(at, now, exit, facts);
                }
            }
            // Only now: the system may take long to start several.
            Event::Started { pid } => (member.process.pid, member.process.asked_at) = (pid, now),
            Event::Asked => member.process.asked_at = now,
            Event::NotStarted(reason) if member.phase == Phase::Starting => {
                self.note_not_started(at, now, reason);
            }
            // What a process says that was killed, or that is not needed, does not count.
            _ if matches!(member.phase, Phase::Dying | Phase::Dead(_) | Phase::GivenUp) => {}
            Event::Said(said) => {
                let steps_until = facts.steps_until(member.service);
                let news = member.hear(said, now, self.is_real_time, steps_until);
                self.news.extend(news);
            }
            // It is killed if it does not end in time.
            Event::Deaf if self.is_stopping => {}
            Event::Deaf if member.phase == Phase::Finished => self.kill(at, now),
            Event::Deaf => self.replace(at, now, "has not read its messages".to_owned()),
            Event::HungUp => {
                member.process.hung_up_at.get_or_insert(now);
            }
            Event::Violated(what) => self.blame_external_service(at, now, what),
            Event::Unreadable(what) if member.is_external => self.blame_external_service(at, now, what),
            Event::Unreadable(reason) if can_be_followed => {
                self.replace(at, now, format!("sent what cannot be read: {reason}"));
            }
            Event::Unreadable(reason) => {
                let service = member.name.to_owned();
                let lost = member.give_up(ServiceFailure::GaveUp { service, reason });
                self.news.push(lost);
            }
            Event::MissedSent => self.resume_in_real_time(at, now, facts),
            Event::NotStarted(_) => {}
        }
    }

    /// Returns the external service whose newest process this is, if it is one.
    #[must_use]
    pub fn external_service_of(&self, number: ProcessNumber) -> Option<ServiceId> {
        let mut members = self.members.iter();
        let member = members.find(|member| member.process.number == number)?;
        member.is_external.then_some(member.service)
    }

    /// Returns whether an external service may send this message now.
    #[must_use]
    pub fn is_its_turn(&self, service: ServiceId, said: &Said) -> bool {
        self.members[service.index()].is_its_turn(said)
    }

    /// Does what is due at this time.
    pub fn look(&mut self, now: Moment, facts: &dyn Facts) {
        self.forget_stuck_standbys(now);
        for at in 0..self.members.len() {
            self.look_at(at, now, facts);
        }
        if self.is_stopping {
            return;
        }
        if self.needs_care() {
            if self.is_in_flight && !self.is_real_time {
                self.resume_in_lock_step(now, facts);
            }
        } else if self.is_in_flight {
            self.act(Action::RefillReserve);
            self.keep_standby(now);
        }
    }

    fn look_at(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &self.members[at];
        let process = &member.process;
        if process.outlives(now, END_LIMIT) && !process.is_recorded {
            match member.phase {
                Phase::Dead(_) => {
                    self.record_exit(at, Exit::stuck(), facts);
                }
                _ => self.reap(at, now, Exit::stuck(), facts),
            }
            return;
        }
        let end_limit = match self.can_be_followed() {
            true => STUCK_LIMIT,
            false => READY_LIMIT,
        };
        let is_needed = !self.is_stopping && !member.is_over();
        if process.outlives(now, end_limit) && !process.is_stuck && is_needed {
            let failure = ServiceFailure::Stuck {
                service: member.name.to_owned(),
                pid: process.pid,
                limit: end_limit,
            };
            self.members[at].process.is_stuck = true;
            self.news.push(News::Lost(failure));
            return;
        }
        let grace = if self.is_stopping {
            STOP_LIMIT
        } else {
            AFTER_CLOSING
        };
        let has_closed = process
            .hung_up_at
            .is_some_and(|closed_at| now.since(closed_at) > grace);
        if has_closed && !process.has_ended && process.killed_at.is_none() {
            let what = "has closed its control channel and did not end".to_owned();
            if self.is_stopping || member.is_over() {
                self.kill(at, now);
            } else {
                self.replace(at, now, what);
            }
            return;
        }
        if self.is_stopping {
            if now.since(self.stopping_since) > STOP_LIMIT {
                self.kill(at, now);
            }
            return;
        }
        match member.phase {
            // A killed process that has not ended yet still owns its ports; a successor could not create them.
            Phase::Dead(again_at) if again_at <= now && process.has_ended => self.respawn(at, now, facts),
            Phase::Starting => self.limit_start(at, now, facts),
            Phase::Ready if self.is_in_flight && self.is_real_time => self.send_missed(at, now, facts),
            _ => {}
        }
    }

    /// Kills the process of a service, unless that was done already.
    pub(crate) fn kill(&mut self, at: usize, now: Moment) {
        let process = &mut self.members[at].process;
        if process.has_ended || process.killed_at.is_some() {
            return;
        }
        process.killed_at = Some(now);
        let process = process.number;
        self.act(Action::Kill { process });
    }

    /// Kills the process of a service for the reason `what`. Its end is handled like a death in flight.
    pub(crate) fn replace(&mut self, at: usize, now: Moment, what: String) {
        let member = &mut self.members[at];
        if member.process.has_ended {
            member.phase = Phase::Dead(now);
            return;
        }
        member.blamed.get_or_insert(what);
        member.phase = Phase::Dying;
        self.kill(at, now);
    }

    /// Replaces the process of a flying service, which has hung for `hung_for`.
    pub fn replace_hung(&mut self, service: ServiceId, now: Moment, hung_for: Duration) {
        if self.flies(service) {
            self.members[service.index()].silent_since = Some(now.before(hung_for));
            self.replace(service.index(), now, "hung".to_owned());
        }
    }

    /// Replaces the process of a service that says that it has finished although it has steps to do.
    pub fn replace_early(&mut self, service: ServiceId, now: Moment, facts: &dyn Facts) {
        let at = service.index();
        if !self.is_finished(service) {
            return;
        }
        if !self.members[at].process.has_ended {
            return self.replace(at, now, EARLY.to_owned());
        }
        // It has ended since: that is a death like others, which the restarts are limited for.
        self.members[at].phase = Phase::Dying;
        let exit = Exit {
            killed: false,
            description: format!("it {EARLY}"),
        };
        self.reap(at, now, exit, facts);
    }

    /// Returns whether a service that flies in lock step has steps to do, by its checkpoint, which includes the last step
    /// before it says so. What is missing of a program is seen in its samples.
    fn is_early_in_lock_step(&self, at: usize, facts: &dyn Facts) -> bool {
        let member = &self.members[at];
        let next = || {
            let steps = &self.timetables[at].steps;
            steps.first_at_or_after(facts.next_tick(member.service))
        };
        let flies = matches!(member.phase, Phase::Flying | Phase::CatchingUp);
        let is_ours = !self.is_real_time && !member.is_external;
        flies && is_ours && next().is_some_and(|next| next <= self.schedule.last_tick())
    }

    /// Kills an external service that has violated the contract. Before the flight and in simulated time this ends the
    /// run; in real time another process replaces it, as after any death.
    fn blame_external_service(&mut self, at: usize, now: Moment, what: String) {
        if self.can_be_followed() {
            return self.replace(at, now, what);
        }
        self.kill(at, now);
        let member = &mut self.members[at];
        let failure = member.violation(what);
        let lost = member.give_up(failure);
        self.news.push(lost);
    }

    /// Returns whether another process may replace an external service.
    pub(crate) fn can_be_followed(&self) -> bool {
        self.is_real_time && self.is_in_flight
    }

    fn note_not_started(&mut self, at: usize, now: Moment, reason: String) {
        let member = &mut self.members[at];
        member.process.has_ended = true;
        // Soon: the vehicle flies without this service.
        member.phase = Phase::Dead(now + NOT_STARTED_PAUSE);
        self.news.push(News::Lost(ServiceFailure::NotStarted(reason)));
    }

    /// Tells all processes to end; those that have not within [`STOP_LIMIT`] are killed.
    pub fn stop(&mut self, now: Moment) {
        if self.is_stopping {
            return;
        }
        (self.is_stopping, self.stopping_since) = (true, now);
        self.end_standby(now);
        if self.members.is_empty() {
            return;
        }
        // The flag must be stored first, then the messages sent, then the services woken: one that wakes up must find
        // the flag.
        self.act(Action::SetStopping);
        for at in 0..self.members.len() {
            let process = &self.members[at].process;
            if !process.has_ended {
                let process = process.number;
                self.act(Action::Stop { process });
            }
        }
        self.act(Action::Wake);
    }

    /// Returns whether all processes have ended, or were killed and exceeded the limit for their end.
    #[must_use]
    pub fn has_stopped(&self, now: Moment) -> bool {
        let is_done = |member: &Member| member.process.has_ended || member.process.outlives(now, END_LIMIT);
        self.members.iter().all(is_done) && self.standby.living().next().is_none()
    }
}

/// What is known of the run.
impl Supervision {
    #[must_use]
    pub fn name_of(&self, service: ServiceId) -> &'static str {
        self.members[service.index()].name
    }

    #[must_use]
    pub fn phase_of(&self, service: ServiceId) -> Phase {
        self.members[service.index()].phase
    }

    /// Returns the newest process of a service.
    #[must_use]
    pub fn process_of(&self, service: ServiceId) -> ProcessNumber {
        self.members[service.index()].process.number
    }

    /// Returns the process of each service, and its PID.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, ProcessNumber, u32)> {
        self.members
            .iter()
            .map(|member| (member.service, member.process.number, member.process.pid))
    }

    /// Returns the exits of processes in their order; those of standby processes have no service.
    #[must_use]
    pub fn exits(&self) -> &[(Option<ServiceId>, u32, Exit)] {
        &self.exits
    }

    #[must_use]
    pub fn restarts(&self) -> &[Restart] {
        &self.restarts
    }

    /// Describes the death of a process; `None` if it was not that of a service.
    #[must_use]
    pub fn death_of(&self, pid: u32) -> Option<String> {
        let (service, _, exit) = self.exits.iter().rfind(|(_, other, _)| *other == pid)?;
        let name = self.name_of((*service)?);
        Some(format!("`{name}` (process {pid}) died: {}", exit.description))
    }

    /// Returns whether every service has created its ports.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.members.iter().all(|member| member.phase == Phase::Ready)
    }

    /// Returns whether a service is dead, restarting, or catching up.
    #[must_use]
    #[inline]
    pub fn needs_care(&self) -> bool {
        let is_settled = |member: &Member| matches!(member.phase, Phase::Flying | Phase::Finished);
        !self.members.iter().all(is_settled)
    }

    /// Returns whether the flight has begun.
    #[must_use]
    pub fn is_in_flight(&self) -> bool {
        self.is_in_flight
    }

    /// Returns whether a service is in flight: neither starting, nor dead, nor finished.
    #[must_use]
    pub fn flies(&self, service: ServiceId) -> bool {
        self.phase_of(service) == Phase::Flying
    }

    /// Returns whether a service has reported the end of its steps.
    #[must_use]
    pub fn is_finished(&self, service: ServiceId) -> bool {
        self.phase_of(service) == Phase::Finished
    }

    /// Returns the services that have not reported the end of their steps.
    pub fn unfinished(&self) -> impl Iterator<Item = ServiceId> {
        let unfinished = self
            .members
            .iter()
            .filter(|member| member.phase != Phase::Finished);
        unfinished.map(|member| member.service)
    }

    /// Returns the services that are replaced by external programs.
    pub fn external_services(&self) -> impl Iterator<Item = ServiceId> {
        let external = self.members.iter().filter(|member| member.is_external);
        external.map(|member| member.service)
    }

    /// Returns the failure of an external service that did `what`.
    #[must_use]
    pub fn violation(&self, service: ServiceId, what: String) -> ServiceFailure {
        self.members[service.index()].violation(what)
    }

    /// Returns whether a service has done its last step.
    #[must_use]
    pub fn has_flown_all(&self, service: ServiceId, facts: &dyn Facts) -> bool {
        let steps = &self.timetables[service.index()].steps;
        // A process that died at its last step may have written the checkpoint, and not the counter.
        let flown_until = facts.steps_until(service).max(facts.next_tick(service));
        let next = steps.first_at_or_after(flown_until);
        next.is_none_or(|next| next > self.schedule.last_tick())
    }

    /// Returns whether a service with steps to do is delayed by the machine or by its restart: it runs, waits for a
    /// processor or for memory, or is restarting.
    #[must_use]
    pub fn is_delayed(&self, facts: &dyn Facts) -> bool {
        let is_delayed = |member: &Member| match member.phase {
            Phase::Finished | Phase::GivenUp => false,
            Phase::Flying => {
                let activity = facts.activity(member.process.number);
                !self.has_flown_all(member.service, facts)
                    && activity.is_some_and(|activity| activity.is_runnable)
            }
            Phase::Starting | Phase::Ready | Phase::CatchingUp | Phase::Dying | Phase::Dead(_) => true,
        };
        self.members.iter().any(is_delayed)
    }

    /// Returns the time limit of an external service's first step; zero for other services.
    #[must_use]
    pub fn first_step_limit(&self, service: ServiceId) -> Duration {
        let member = &self.members[service.index()];
        match member.is_external {
            true => doubled(external_start_limit(member.longest_start), member.fruitless),
            false => Duration::ZERO,
        }
    }
}
