//! The processes of a run: started, watched, restarted after deaths, and stopped.
//!
//! After a death in flight, another process resumes from the last checkpoint. A service that dies repeatedly at the same
//! tick is given up: its crash is a function of its inputs, so the next process would crash as well. In normal operation
//! a standby process waits to take the role of the next service that dies.
//!
//! A process is replaced only once it has ended: until then its ports are its own, and it may write a checkpoint.

use std::time::Duration;

use host::step::{NonFinite, Timetable};
use metrics::summary::restart::Restart;
use scenario::Scenario;
use shared_types::{Schedule, ServiceId};

use crate::event::{Action, Event, Facts, News};
use crate::failure::ServiceFailure;
use crate::member::{Member, Phase};
use crate::moment::Moment;
use crate::process::{Exit, Process, ProcessNumber, Role, Said};
use crate::restart_policy::{
    AFTER_CLOSING, END_LIMIT, EXTERNAL_LIMIT, MISSED_LIMIT, READY_LIMIT, RestartPolicy, STOP_LIMIT,
    STUCK_LIMIT, doubled, external_start_limit,
};
use crate::standby::Standby;

/// What is wrong with a service that has not finished.
const EARLY: &str = "says that it has finished, and has steps to do";

pub type RestartPolicies = [RestartPolicy; ServiceId::ALL.len()];

/// Decisions on all service processes of a run.
#[derive(Clone, Debug)]
pub struct Supervision {
    schedule: Schedule,
    timetables: Vec<Timetable>,
    policies: RestartPolicies,
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
    births: u32,
    pub(crate) exits: Vec<(Option<ServiceId>, u32, Exit)>,
    restarts: Vec<Restart>,
    actions: Vec<Action>,
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

    /// Forgets all processes without stopping them: without an orchestrator they land by themselves.
    pub fn release_all(&mut self) {
        self.members.clear();
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

    fn send_go(&mut self, at: usize, is_restarted: bool) {
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

    /// Returns whether an external service may send this message now.
    #[must_use]
    pub fn is_its_turn(&self, number: ProcessNumber, said: &crate::process::Said) -> bool {
        let mut members = self.members.iter();
        members
            .find(|member| member.process.number == number)
            .is_none_or(|member| !member.is_external || member.is_its_turn(said))
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
        if process.outlives(now, end_limit) && !process.is_stuck && !self.is_stopping {
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
            if member.is_over() {
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
    fn can_be_followed(&self) -> bool {
        self.is_real_time && self.is_in_flight
    }

    fn note_not_started(&mut self, at: usize, now: Moment, reason: String) {
        let pause = self.longest_pause(at);
        let member = &mut self.members[at];
        member.process.has_ended = true;
        member.phase = Phase::Dead(now + pause);
        self.news.push(News::Lost(ServiceFailure::NotStarted(reason)));
    }

    /// Records the end of a process once. Returns how it ended, and the number that is not finite for which it did.
    fn record_exit(&mut self, at: usize, mut exit: Exit, facts: &dyn Facts) -> (Exit, Option<NonFinite>) {
        let member = &mut self.members[at];
        if member.process.is_recorded {
            return (exit, None);
        }
        member.process.is_recorded = true;
        let (not_finite, words) = member.take_last_words(facts.steps_until(member.service));
        if let Some(words) = words {
            exit.description = words;
        }
        match member.blamed.take() {
            Some(what) => exit.description = format!("killed, because it {what}"),
            None => member.deaths += 1,
        }
        let record = (Some(member.service), member.process.pid, exit.clone());
        self.exits.push(record);
        (exit, not_finite)
    }

    /// Handles the end of a process: records it, and decides on a restart.
    fn reap(&mut self, at: usize, now: Moment, exit: Exit, facts: &dyn Facts) {
        let service = self.members[at].service;
        // Only now: until its end the process may have written another checkpoint.
        let (next_tick, flown_until) = (facts.next_tick(service), facts.steps_until(service));
        let can_be_followed = self.can_be_followed();
        let (exit, not_finite) = self.record_exit(at, exit, facts);
        let member = &mut self.members[at];
        let pid = member.process.pid;
        if member.is_over() || self.is_stopping {
            return;
        }
        if member.is_external && !can_be_followed {
            let failure = member.violation(end_of_external_service(member, &exit));
            let lost = member.give_up(failure);
            self.act(Action::MarkGone { service });
            self.news.push(lost);
            return;
        }
        member.fruitless = if flown_until > member.flown_until {
            0
        } else {
            member.fruitless + 1
        };
        // A process that repeats steps is behind its predecessor.
        member.flown_until = flown_until.max(member.flown_until);
        let timetable = &self.timetables[at];
        let after = timetable.steps.first_at_or_after(flown_until);
        let is_planned = flown_until > 0 && timetable.dies_after(flown_until - 1, after);
        let next = timetable.steps.first_at_or_after(next_tick);
        let pause = match is_planned {
            true => Some(Duration::ZERO),
            false => self.policies[at].pause(member.fruitless),
        };
        // From here on, no service in real time waits for the dead one.
        self.actions.push(Action::MarkGone { service });
        let Some(pause) = pause else {
            let died = ServiceFailure::Died {
                service: member.name.to_owned(),
                pid,
                tick: flown_until.saturating_sub(1),
                how: exit.description,
                times: member.fruitless,
            };
            let lost = member.give_up(not_finite.map_or(died, ServiceFailure::from));
            self.news.push(lost);
            return;
        };
        // A death before the first step extends the gap that the death before it began.
        let silent_since = member.silent_since.take();
        let gap_began = member
            .died_at
            .filter(|_| member.is_replacement())
            .or(silent_since);
        member.died_at = (!is_planned).then_some(gap_began.unwrap_or(now));
        member.phase = match next.is_some_and(|next| next <= self.schedule.last_tick()) {
            true => Phase::Dead(now + pause),
            false => Phase::Finished,
        };
        let is_at_once = member.phase == Phase::Dead(now);
        // Must precede the clean-up of its ports: a publisher must not wait for room in the queue of a receiver that
        // never reads.
        self.act(Action::ForgetReceivers { service });
        // If the service restarts at once, `respawn` cleans up.
        if !is_at_once {
            self.act(Action::CleanUp);
        }
        // Services that waited for the dead one check again.
        self.act(Action::Wake);
        self.news.push(News::Died);
    }

    /// Restarts services that were given up, after their longest back-off: a vehicle in the air needs all of them to
    /// land.
    pub fn retry_given_up(&mut self, now: Moment) {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::GivenUp {
                continue;
            }
            self.kill(at, now);
            let service = self.members[at].service;
            self.act(Action::MarkGone { service });
            self.act(Action::ForgetReceivers { service });
            let pause = self.longest_pause(at);
            self.members[at].phase = Phase::Dead(now + pause);
        }
    }

    fn longest_pause(&self, at: usize) -> Duration {
        self.policies[at].longest_pause
    }

    /// Gives a service another process: the standby process, or a new one.
    fn respawn(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &self.members[at];
        let role = Role {
            service: member.service,
            deaths: member.deaths,
        };
        // The standby process has built the internal services, not the external one.
        let standby = match member.is_external {
            true => None,
            false => self.take_standby(role),
        };
        let (process, was_prepared) = match standby {
            Some((mut process, was_prepared)) => {
                process.asked_at = now;
                let activity = facts.activity(process.number);
                process.delayed_before_ns = activity.map_or(0, |activity| activity.run_delay_ns);
                (process, was_prepared)
            }
            None => (self.start_process(now, Some(role)), false),
        };
        let number = process.number;
        self.members[at].begin(process, was_prepared);
        // Done while the process loads or opens its topics.
        self.act(Action::CleanUp);
        self.act(Action::LendReserve);
        self.act(Action::MakePorts { process: number });
        self.act(Action::Wake);
    }

    /// Sends a service that restarts in real time what it has missed. One that does not take it in time flies without.
    fn send_missed(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &mut self.members[at];
        let since = *member.missed_since.get_or_insert(now);
        if now.since(since) > MISSED_LIMIT {
            return self.resume_in_real_time(at, now, facts);
        }
        let action = Action::SendMissed {
            process: member.process.number,
            service: member.service,
        };
        self.act(action);
    }

    /// Lets a service that restarted in real time fly on with the newest samples.
    fn resume_in_real_time(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        if self.members[at].phase == Phase::Ready && self.is_in_flight {
            self.members[at].phase = Phase::Flying;
            self.note_restart(at, now, facts);
            self.send_go(at, true);
        }
    }

    /// Lets services that restarted in lock step fly on, once all others are connected to their ports: a sample
    /// published before would be lost for an unconnected consumer.
    fn resume_in_lock_step(&mut self, now: Moment, facts: &dyn Facts) {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::Ready {
                continue;
            }
            let Some((birth, announced_at)) = self.members[at].birth else {
                self.announce(at, now);
                continue;
            };
            let is_unconnected = |member: &&Member| {
                let flies = matches!(member.phase, Phase::Flying | Phase::CatchingUp);
                flies && facts.restarts_seen(member.service) < birth
            };
            let unconnected: Vec<_> = self.members.iter().filter(is_unconnected).collect();
            if unconnected.is_empty() {
                self.members[at].phase = Phase::CatchingUp;
                self.note_restart(at, now, facts);
                let service = self.members[at].service;
                self.act(Action::CatchUp { service });
                self.send_go(at, true);
                continue;
            }
            let mut late = unconnected.iter();
            let late = late.find(|member| member.is_external && now.since(announced_at) > EXTERNAL_LIMIT);
            if let Some(member) = late {
                let limit = EXTERNAL_LIMIT.as_secs();
                let what =
                    format!("has not answered `Connect` within {limit} s, and no service can fly on before");
                self.news.push(News::Lost(member.violation(what)));
            }
        }
    }

    /// Publishes the ports of a restarted service.
    fn announce(&mut self, at: usize, now: Moment) {
        self.births += 1;
        let birth = self.births;
        self.members[at].birth = Some((birth, now));
        self.act(Action::Announce { birth });
        let external = self.members.iter();
        let external = external.filter(|member| member.is_external && !member.process.has_ended);
        let external: Vec<_> = external.map(|member| member.process.number).collect();
        for process in external {
            self.act(Action::Connect { process, birth });
        }
        self.act(Action::Wake);
    }

    fn note_restart(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let member = &self.members[at];
        if let Some(died_at) = member.died_at {
            self.restarts.push(Restart {
                service: member.service,
                name: member.name,
                pid: member.process.pid,
                tick: facts.steps_until(member.service).checked_sub(1),
                lost_seconds: now.since(died_at).as_secs_f64(),
            });
        }
    }

    /// Records the restart of a service that became ready before the flight.
    pub fn note_restart_of(&mut self, service: ServiceId, now: Moment, facts: &dyn Facts) {
        self.note_restart(service.index(), now, facts);
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

fn end_of_external_service(member: &Member, exit: &Exit) -> String {
    let how = &exit.description;
    if member.has_flown {
        format!(
            "ended: {how}; an external service has no checkpoint, so that it cannot be restarted in lock-step"
        )
    } else if member.phase == Phase::Ready {
        format!("ended before the flight began: {how}")
    } else {
        format!("ended before it was ready: {how}")
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

    /// Returns whether a process has no task any more: it has ended, or nobody remembers it.
    #[must_use]
    pub fn has_ended(&self, number: ProcessNumber) -> bool {
        let own = self.members.iter().map(|member| &member.process);
        let mut living = own
            .filter(|process| !process.has_ended)
            .map(|process| process.number);
        !living.any(|other| other == number) && !self.standby.knows(number)
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

    /// Describes the last exit, if it was that of a service.
    #[must_use]
    pub fn last_death(&self) -> Option<String> {
        let (service, pid, exit) = self.exits.last()?;
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
        let next = steps.first_at_or_after(facts.steps_until(service));
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
