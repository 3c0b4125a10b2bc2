//! The machine: processes from their start to their end, what they say, and what can be seen of them.

use std::collections::VecDeque;

use decisions::event::{Event, Facts};
use decisions::process::{Exit, ProcessNumber, Role, Said};
use host::activity::Activity;
use host::step::NonFinite;
use shared_types::{Schedule, ServiceId};

use crate::history::{FaultKind, Host, MS};
use crate::random::drawn;
use crate::world::Present;

/// Never.
pub(crate) const NEVER: u64 = u64::MAX;

/// Number of services.
pub(crate) const SERVICES: usize = ServiceId::ALL.len();

/// Latencies of an idle machine, ns: the properties' limits follow from their maxima.
pub mod latency {
    use std::ops::RangeInclusive;

    use crate::history::MS;

    /// The system starts a process.
    pub const FORK: RangeInclusive<u64> = 500_000..=3 * MS;
    /// A process with a role loads.
    pub const LOAD: RangeInclusive<u64> = 15 * MS..=40 * MS;
    /// A standby process loads and builds all services.
    pub const LOAD_STANDBY: RangeInclusive<u64> = 20 * MS..=50 * MS;
    /// A program in place of a service loads.
    pub const LOAD_PROGRAM: RangeInclusive<u64> = 50 * MS..=300 * MS;
    /// A process creates its ports.
    pub const PORTS: RangeInclusive<u64> = MS..=8 * MS;
    /// A program does its first step.
    pub const FIRST_STEP: RangeInclusive<u64> = MS..=300 * MS;
    /// A service that restarted in lock step catches up.
    pub const CATCH_UP: RangeInclusive<u64> = 100_000..=5 * MS;
    /// A killed process ends.
    pub const KILL: RangeInclusive<u64> = 20_000..=500_000;
    /// It ends, as it was asked to.
    pub const END: RangeInclusive<u64> = 500_000..=5 * MS;
    /// A process that ends closes its channel before.
    pub const CLOSE: RangeInclusive<u64> = 0..=2 * MS;
}

/// Period of a tick in lock step, ns of the machine.
const LOCK_STEP_TICK: u64 = 100_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// It loads.
    Loading,
    /// A standby process waits for a role.
    AwaitingRole,
    /// It waits until it may create its ports.
    AwaitingPorts,
    /// It creates its ports.
    MakingPorts,
    /// It waits for the flight.
    AwaitingGo,
    /// It catches up (lock step), or does the first step of a program.
    Beginning,
    /// It steps.
    Flying,
    /// It has done its last step, and waits for the end.
    Finished,
    /// It ends.
    Ending,
    /// It has closed its channel.
    Closed,
    Ended,
}

/// Why a process does not go on, the strongest reason first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Halt {
    Stopped,
    Spinning,
    Starving,
}

/// A process.
#[derive(Clone, Debug)]
pub(crate) struct Simulated {
    pub(crate) number: ProcessNumber,
    pub(crate) pid: u32,
    pub(crate) service: Option<usize>,
    pub(crate) stage: Stage,
    /// Time at which the work of the stage is done, unless it is halted.
    next_at: u64,
    pub(crate) halt: Option<Halt>,
    halted_at: u64,
    halted_until: u64,
    /// Time at which it ends, because it was killed.
    pub(crate) ends_at: u64,
    /// Messages that it has not read yet.
    may_make_ports: bool,
    may_go: bool,
    is_restarted: bool,
    is_to_stop: bool,
    is_asked_to_beat: bool,
    is_sent_missed: bool,
    birth_to_see: u32,
    answers_births: bool,
    /// Time until which its channel is full.
    pub(crate) is_deaf_until: u64,
    has_closed: bool,
    /// Processor time and delay up to `counted_at`, ns.
    cpu_ns: u64,
    delay_ns: u64,
    counted_at: u64,
    /// `true` if a fault was done to it.
    pub(crate) is_faulty: bool,
    /// Time in which it was given no processor, ns.
    pub(crate) starved_ns: u64,
    pub(crate) was_killed: bool,
    /// `true` once the supervisor has handled its end.
    pub(crate) is_end_told: bool,
    /// `true` if its start failed.
    pub(crate) was_not_started: bool,
    pub(crate) asked_at: u64,
    /// Time since which it steps.
    flies_from: u64,
}

impl Simulated {
    fn is_external(&self, external: Option<u8>) -> bool {
        self.service.is_some() && self.service == external.map(usize::from)
    }

    fn next_event(&self) -> u64 {
        if self.stage == Stage::Ended {
            return NEVER;
        }
        let own = match self.halt {
            Some(_) => self.halted_until,
            None => self.next_at,
        };
        own.min(self.ends_at)
    }

    pub(crate) fn is_stepping(&self) -> bool {
        self.stage == Stage::Flying && self.halt.is_none()
    }

    pub(crate) fn is_stepping_or_done(&self) -> bool {
        self.is_stepping() || self.stage == Stage::Finished
    }

    /// Share of a processor that it uses now, in sixteenths.
    fn share(&self) -> u64 {
        match (self.halt, self.stage) {
            (Some(Halt::Spinning), _) => 16,
            (Some(_), _) => 0,
            (None, Stage::Loading | Stage::MakingPorts | Stage::Beginning | Stage::Ending) => 16,
            (None, Stage::Flying) => 1,
            (None, _) => 0,
        }
    }

    /// Adds the processor time since the last call.
    fn count(&mut self, now: u64) {
        let passed = now.saturating_sub(self.counted_at);
        self.cpu_ns += passed * self.share() / 16;
        self.counted_at = self.counted_at.max(now);
    }

    fn activity(&self, now: u64) -> Activity {
        let passed = now.saturating_sub(self.counted_at);
        let share = self.share();
        let is_ready = share == 16 || self.halt == Some(Halt::Starving);
        Activity {
            is_runnable: is_ready,
            is_ready,
            cpu_time_ns: self.cpu_ns + passed * share / 16,
            run_delay_ns: self.delay_ns,
        }
    }
}

/// The machine with all processes of a run.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) seed: u64,
    host: Host,
    external: Option<u8>,
    schedule: Schedule,
    periods: [u64; SERVICES],
    pub(crate) now: u64,
    /// All processes of all orchestrators; those that have ended are kept for the properties.
    pub(crate) processes: Vec<Simulated>,
    /// Indices of those that have not ended.
    pub(crate) living: Vec<usize>,
    /// Processes of the present orchestrator, by number - 1.
    by_number: Vec<usize>,
    /// Events that the supervisor has not handled yet.
    pub(crate) events: VecDeque<(usize, Event)>,
    /// Start of tick 0, ns.
    pub(crate) start_ns: u64,
    /// 1 + the last tick at which each service has stepped, up to `counted`.
    steps_until: [u64; SERVICES],
    /// Lies of services about that, until their next step.
    lies: [Option<u64>; SERVICES],
    restarts_seen: [u32; SERVICES],
    /// Index of the newest process of each service.
    pub(crate) newest: [Option<usize>; SERVICES],
    /// Ticks of a flight in lock step, and the time up to which they are counted.
    ring: (u64, u64),
    pub(crate) kills_take_until: u64,
    pub(crate) no_forks_until: u64,
    pub(crate) slow_forks_until: u64,
}

impl Machine {
    pub(crate) fn new(seed: u64, host: Host, external: Option<u8>, schedule: &Schedule) -> Self {
        Self {
            seed,
            host,
            external,
            periods: ServiceId::ALL.map(|service| schedule.service_rate(service).period),
            schedule: schedule.clone(),
            now: 0,
            processes: Vec::with_capacity(32),
            living: Vec::with_capacity(8),
            by_number: Vec::with_capacity(32),
            events: VecDeque::with_capacity(16),
            start_ns: NEVER,
            steps_until: [0; SERVICES],
            lies: [None; SERVICES],
            restarts_seen: [0; SERVICES],
            newest: [None; SERVICES],
            ring: (0, 0),
            kills_take_until: 0,
            no_forks_until: 0,
            slow_forks_until: 0,
        }
    }

    fn drawn(&self, process: usize, purpose: u64, range: std::ops::RangeInclusive<u64>) -> u64 {
        drawn(self.seed, process as u64, purpose, range)
    }

    pub(crate) fn index_of(&self, number: ProcessNumber) -> usize {
        self.by_number[number.0 as usize - 1]
    }

    /// Returns the index of a process that was started.
    pub(crate) fn known_index_of(&self, number: ProcessNumber) -> Option<usize> {
        self.by_number.get(number.0 as usize - 1).copied()
    }

    /// Returns whether a process belongs to the present orchestrator.
    pub(crate) fn is_numbered(&self, process: &Simulated) -> bool {
        let known = self.known_index_of(process.number);
        known.is_some_and(|at| self.processes[at].pid == process.pid)
    }

    /// Returns whether a standby process is prepared.
    pub(crate) fn has_prepared_standby(&self) -> bool {
        self.standby().is_some_and(|at| {
            let process = &self.processes[at];
            process.stage == Stage::AwaitingRole && process.halt.is_none()
        })
    }

    pub(crate) fn is_external(&self, at: usize) -> bool {
        self.processes[at].is_external(self.external)
    }

    /// Returns the tick that has begun.
    pub(crate) fn tick(&self) -> u64 {
        self.now.saturating_sub(self.start_ns) / self.schedule.tick_ns()
    }

    /// Returns the index of the standby process.
    pub(crate) fn standby(&self) -> Option<usize> {
        let mut living = self.living.iter().rev().copied();
        living.find(|&at| {
            let process = &self.processes[at];
            process.service.is_none() && !process.was_killed
        })
    }

    // --- The steps of the services ---------------------------------------------------------------------------------

    fn counted_steps(&self, service: usize) -> u64 {
        let stored = self.steps_until[service];
        let steps = self.newest[service].is_some_and(|at| self.processes[at].is_stepping());
        match (self.host, steps) {
            (_, false) => stored,
            (Host::LockStep, true) => stored.max(self.ring_at(self.now)),
            (Host::RealTime, true) if self.now < self.start_ns => stored,
            (Host::RealTime, true) => {
                let tick = self.tick().min(self.schedule.last_tick());
                let rate = self.schedule.service_rate(ServiceId::ALL[service]);
                let newest = rate.last_at_or_before(tick);
                // A step that was due before is left out.
                let from = self.newest[service].map_or(0, |at| self.processes[at].flies_from);
                let begins_at = |tick: u64| self.start_ns + tick * self.schedule.tick_ns();
                newest
                    .filter(|&tick| begins_at(tick) >= from)
                    .map_or(stored, |tick| stored.max(tick + 1))
            }
        }
    }

    fn is_ring_complete(&self) -> bool {
        // Nobody waits for a service that has done its last step.
        let goes_on = |service: usize| {
            let newest = self.newest[service].map(|at| &self.processes[at]);
            newest.is_some_and(Simulated::is_stepping) || self.has_flown_all(service)
        };
        (0..SERVICES).all(goes_on)
    }

    /// Returns whether a service has done its last step, as far as its steps are counted.
    pub(crate) fn has_flown_all(&self, service: usize) -> bool {
        let rate = self.schedule.service_rate(ServiceId::ALL[service]);
        let last = rate.last_at_or_before(self.schedule.last_tick());
        last.is_none_or(|last| self.steps_until[service] > last)
    }

    /// Returns 1 + the last tick of a flight in lock step at a time.
    fn ring_at(&self, now: u64) -> u64 {
        let (ticks, since) = self.ring;
        let more = match self.is_ring_complete() {
            true => now.saturating_sub(since) / LOCK_STEP_TICK,
            false => 0,
        };
        (ticks + more).min(self.schedule.last_tick() + 1)
    }

    /// Stores the steps so far; to be called before a service begins or ceases to step.
    fn count_steps(&mut self) {
        let counted: [u64; SERVICES] = std::array::from_fn(|service| self.counted_steps(service));
        for (lie, (before, now)) in self.lies.iter_mut().zip(self.steps_until.iter().zip(&counted)) {
            if before != now {
                *lie = None;
            }
        }
        self.steps_until = counted;
        if self.host == Host::LockStep {
            let (before, since) = self.ring;
            let ticks = self.ring_at(self.now);
            let since = match self.is_ring_complete() {
                true => since + (ticks - before) * LOCK_STEP_TICK,
                false => self.now,
            };
            self.ring = (ticks, since);
        }
    }

    /// Returns which services step.
    pub(crate) fn present(&self) -> Present {
        self.newest
            .map(|newest| newest.is_some_and(|at| self.processes[at].is_stepping()))
    }

    /// Sets the times at which the services that step will have finished; to be called after one begins or ceases.
    fn plan_finishes(&mut self) {
        let last = self.schedule.last_tick();
        let is_complete = self.is_ring_complete();
        for service in 0..SERVICES {
            let Some(at) = self.newest[service] else { continue };
            if !self.processes[at].is_stepping() {
                continue;
            }
            let rate = self.schedule.service_rate(ServiceId::ALL[service]);
            self.processes[at].next_at = match self.host {
                Host::RealTime => {
                    let last = rate.last_at_or_before(last).unwrap_or(0);
                    (self.start_ns + last * self.schedule.tick_ns()).max(self.now)
                }
                Host::LockStep if self.steps_until[service] > last => self.now,
                Host::LockStep if is_complete => self.ring.1 + (last + 1 - self.ring.0) * LOCK_STEP_TICK,
                Host::LockStep => NEVER,
            };
        }
    }

    // --- What the supervisor does ----------------------------------------------------------------------------------

    /// Starts a process. Returns its PID; `None` if the system refuses. The call takes a while.
    pub(crate) fn start(&mut self, number: ProcessNumber, role: Option<Role>) -> Option<u32> {
        let at = self.processes.len();
        let asked_at = self.now;
        let slow = match asked_at < self.slow_forks_until {
            true => 40,
            false => 1,
        };
        self.now += self.drawn(at, 1, latency::FORK) * slow;
        let service = role.map(|role| role.service.index());
        let was_not_started = asked_at < self.no_forks_until;
        let mut process = Simulated {
            number,
            pid: 1000 + at as u32,
            service,
            stage: Stage::Loading,
            next_at: 0,
            halt: None,
            halted_at: 0,
            halted_until: NEVER,
            ends_at: NEVER,
            may_make_ports: false,
            may_go: false,
            is_restarted: false,
            is_to_stop: false,
            is_asked_to_beat: false,
            is_sent_missed: false,
            birth_to_see: 0,
            answers_births: false,
            is_deaf_until: 0,
            has_closed: false,
            cpu_ns: 0,
            delay_ns: 0,
            counted_at: self.now,
            is_faulty: false,
            starved_ns: 0,
            was_killed: false,
            is_end_told: was_not_started,
            was_not_started,
            asked_at,
            flies_from: 0,
        };
        let load = match (service, process.is_external(self.external)) {
            (None, _) => latency::LOAD_STANDBY,
            (Some(_), false) => latency::LOAD,
            (Some(_), true) => latency::LOAD_PROGRAM,
        };
        process.next_at = self.now + self.drawn(at, 2, load);
        if was_not_started {
            process.stage = Stage::Ended;
        } else {
            self.living.push(at);
        }
        let pid = process.pid;
        self.processes.push(process);
        debug_assert_eq!(
            self.by_number.len() + 1,
            number.0 as usize,
            "numbers are consecutive"
        );
        self.by_number.push(at);
        if let Some(service) = service {
            self.count_steps();
            self.newest[service] = Some(at);
            self.plan_finishes();
        }
        (!was_not_started).then_some(pid)
    }

    /// Adds a process of another orchestrator.
    pub(crate) fn adopt(&mut self, at: usize, number: ProcessNumber) {
        debug_assert_eq!(
            self.by_number.len() + 1,
            number.0 as usize,
            "numbers are consecutive"
        );
        self.by_number.push(at);
        self.processes[at].number = number;
        self.processes[at].is_end_told = false;
    }

    /// Removes the numbers that a dead orchestrator gave.
    pub(crate) fn forget_numbers(&mut self) {
        self.by_number.clear();
        self.events.clear();
    }

    /// Gives a process a message. Returns `false` if its channel is full.
    pub(crate) fn send(&mut self, number: ProcessNumber, message: Message) -> bool {
        let at = self.index_of(number);
        let process = &mut self.processes[at];
        if process.has_closed || matches!(process.stage, Stage::Closed | Stage::Ended) {
            return true;
        }
        let is_deaf = self.now < process.is_deaf_until;
        // It counts as a process of the service, even if it never reads that.
        if let Message::Become(role) = message {
            process.service = Some(role.service.index());
            process.asked_at = self.now;
            let service = role.service.index();
            self.count_steps();
            self.newest[service] = Some(at);
            self.plan_finishes();
        }
        if is_deaf {
            return false;
        }
        let process = &mut self.processes[at];
        match message {
            Message::Become(_) => {}
            Message::MakePorts => process.may_make_ports = true,
            Message::Go { is_restarted } => (process.may_go, process.is_restarted) = (true, is_restarted),
            Message::Beat => process.is_asked_to_beat = true,
            Message::Connect { birth } => {
                process.birth_to_see = birth;
                process.answers_births = true;
            }
            Message::Missed => process.is_sent_missed = true,
            Message::Stop => process.is_to_stop = true,
        }
        self.read(at);
        true
    }

    /// Kills a process.
    pub(crate) fn kill(&mut self, at: usize) {
        let takes = self.drawn(at, 3, latency::KILL);
        let now = self.now;
        let process = &mut self.processes[at];
        process.was_killed = true;
        if process.stage == Stage::Ended {
            return;
        }
        let at_least = match self.kills_take_until {
            NEVER => NEVER,
            until => until.max(now).saturating_add(takes),
        };
        process.ends_at = process.ends_at.min(at_least);
        // It takes no further step, as if it were stopped.
        self.halt(at, Halt::Stopped, NEVER);
    }

    /// Lets all flying services see the ports of a restarted one.
    pub(crate) fn announce(&mut self, birth: u32) {
        for service in 0..SERVICES {
            if let Some(at) = self.newest[service]
                && !self.is_external(at)
            {
                self.processes[at].birth_to_see = birth;
                self.read(at);
            }
        }
    }

    // --- Time ------------------------------------------------------------------------------------------------------

    /// Returns the time of the next event of a process.
    pub(crate) fn next_event(&self) -> u64 {
        let next = self.living.iter().map(|&at| self.processes[at].next_event());
        next.min().unwrap_or(NEVER)
    }

    /// Advances to the next event, which is due at `now`.
    pub(crate) fn advance(&mut self, now: u64) {
        self.now = self.now.max(now);
        let due = self.living.iter().copied();
        let Some(at) = due.min_by_key(|&at| self.processes[at].next_event()) else {
            return;
        };
        let process = &self.processes[at];
        if process.next_event() > now {
            return;
        }
        if process.ends_at <= now {
            self.end(at, true);
        } else if process.halt.is_some() {
            self.resume(at);
        } else {
            self.work_is_done(at);
        }
    }

    fn say(&mut self, at: usize, said: Said) {
        if !self.processes[at].has_closed {
            self.events.push_back((at, Event::Said(said)));
        }
    }

    fn enter(&mut self, at: usize, stage: Stage, takes: u64) {
        self.count_steps();
        let now = self.now;
        let process = &mut self.processes[at];
        process.count(now);
        process.stage = stage;
        process.flies_from = now;
        process.next_at = now.saturating_add(takes);
        self.plan_finishes();
    }

    fn work_is_done(&mut self, at: usize) {
        match self.processes[at].stage {
            Stage::Loading => {
                if self.processes[at].service.is_none() {
                    self.say(at, Said::Prepared);
                    self.enter(at, Stage::AwaitingRole, NEVER);
                } else {
                    if self.is_external(at) {
                        self.say(at, Said::Deployed { warnings: Vec::new() });
                    }
                    self.enter(at, Stage::AwaitingPorts, NEVER);
                }
            }
            Stage::MakingPorts => {
                self.say(at, Said::Ready { warnings: Vec::new() });
                self.enter(at, Stage::AwaitingGo, NEVER);
            }
            Stage::Beginning => {
                if self.host == Host::LockStep {
                    self.say(at, Said::CaughtUp);
                }
                self.enter(at, Stage::Flying, NEVER);
            }
            Stage::Flying => {
                self.enter(at, Stage::Finished, NEVER);
                self.say(at, Said::Finished);
            }
            Stage::Ending => {
                let close = self.drawn(at, 4, latency::CLOSE);
                self.close(at);
                self.enter(at, Stage::Closed, close);
            }
            Stage::Closed => self.end(at, false),
            Stage::AwaitingRole
            | Stage::AwaitingPorts
            | Stage::AwaitingGo
            | Stage::Finished
            | Stage::Ended => self.processes[at].next_at = NEVER,
        }
        self.read(at);
    }

    /// Lets a process read its messages, unless it is busy or halted.
    fn read(&mut self, at: usize) {
        let process = &mut self.processes[at];
        if process.halt.is_some() || process.has_closed {
            return;
        }
        if process.birth_to_see > 0 && matches!(process.stage, Stage::Flying | Stage::Beginning) {
            if let Some(service) = process.service {
                self.restarts_seen[service] = self.restarts_seen[service].max(process.birth_to_see);
            }
            process.birth_to_see = 0;
            if process.answers_births {
                self.say(at, Said::Connected);
            }
        }
        let process = &mut self.processes[at];
        match process.stage {
            Stage::Loading | Stage::MakingPorts | Stage::Beginning | Stage::Ending => return,
            Stage::Closed | Stage::Ended => return,
            _ => {}
        }
        if process.is_to_stop {
            let takes = self.drawn(at, 5, latency::END);
            return self.enter(at, Stage::Ending, takes);
        }
        if process.is_asked_to_beat {
            process.is_asked_to_beat = false;
            self.say(at, Said::Prepared);
        }
        let process = &mut self.processes[at];
        if process.is_sent_missed {
            process.is_sent_missed = false;
            self.events.push_back((at, Event::MissedSent));
        }
        let process = &mut self.processes[at];
        match process.stage {
            Stage::AwaitingRole if process.service.is_some() => {
                self.enter(at, Stage::AwaitingPorts, NEVER);
                self.read(at);
            }
            Stage::AwaitingPorts if process.may_make_ports => {
                let takes = self.drawn(at, 6, latency::PORTS);
                self.enter(at, Stage::MakingPorts, takes);
            }
            Stage::AwaitingGo if process.may_go => {
                let is_external = self.is_external(at);
                let is_restarted = self.processes[at].is_restarted;
                let takes = match (self.host, is_external) {
                    (Host::RealTime, true) => self.drawn(at, 7, latency::FIRST_STEP),
                    (Host::LockStep, _) if is_restarted => self.drawn(at, 7, latency::CATCH_UP),
                    _ => 0,
                };
                let stage = match takes {
                    0 => Stage::Flying,
                    _ => Stage::Beginning,
                };
                self.enter(at, stage, takes);
                self.read(at);
            }
            _ => {}
        }
    }

    fn close(&mut self, at: usize) {
        if !self.processes[at].has_closed {
            self.processes[at].has_closed = true;
            self.events.push_back((at, Event::HungUp));
        }
    }

    fn end(&mut self, at: usize, killed: bool) {
        self.enter(at, Stage::Ended, NEVER);
        self.processes[at].halt = None;
        self.living.retain(|&other| other != at);
        let description = String::new();
        self.events
            .push_back((at, Event::Ended(Exit { killed, description })));
    }

    /// Halts a process.
    pub(crate) fn halt(&mut self, at: usize, halt: Halt, until: u64) {
        if self.processes[at].stage == Stage::Ended {
            return;
        }
        self.count_steps();
        let now = self.now;
        let process = &mut self.processes[at];
        process.count(now);
        match process.halt {
            None => (process.halted_at, process.halted_until, process.halt) = (now, until, Some(halt)),
            // What is stopped, or computes without end, does not step when it gets a processor again.
            Some(before) => {
                process.halted_until = process.halted_until.max(until);
                process.halt = Some(before.min(halt));
            }
        }
        if halt == Halt::Starving {
            process.starved_ns += until.saturating_sub(now);
        }
        self.plan_finishes();
    }

    fn resume(&mut self, at: usize) {
        self.count_steps();
        let now = self.now;
        let process = &mut self.processes[at];
        process.count(now);
        let lasted = now - process.halted_at;
        if process.halt == Some(Halt::Starving) {
            process.delay_ns += lasted;
        }
        // It makes up for the newest step that was due meanwhile.
        process.halt = None;
        if process.next_at != NEVER {
            process.next_at = process.next_at.saturating_add(lasted);
        }
        self.plan_finishes();
        self.read(at);
    }

    /// Does a fault to a process. Returns `false` if it has no effect.
    pub(crate) fn strike(&mut self, at: usize, kind: FaultKind, for_ns: u64) -> bool {
        let until = self.now.saturating_add(for_ns);
        let process = &mut self.processes[at];
        if process.stage == Stage::Ended || process.was_killed {
            return false;
        }
        let is_done_to_it = matches!(
            kind,
            FaultKind::Death
                | FaultKind::Stopped
                | FaultKind::Spins
                | FaultKind::Starves
                | FaultKind::ReadsNothing
        );
        // What does not run does nothing wrong.
        if process.halt.is_some() && !is_done_to_it {
            return false;
        }
        process.is_faulty |= kind != FaultKind::Starves;
        let has_role = process.service.is_some();
        let flies = matches!(process.stage, Stage::Flying | Stage::Beginning);
        let service = process.service;
        let steps_until = service.map_or(0, |service| self.steps_until(ServiceId::ALL[service]));
        let is_external = self.is_external(at);
        match kind {
            FaultKind::Death => self.end(at, true),
            FaultKind::Panic => {
                self.say(
                    at,
                    Said::Dying {
                        reason: "a panic".to_owned(),
                    },
                );
                self.end(at, true);
            }
            FaultKind::Stopped => self.halt(at, Halt::Stopped, until),
            FaultKind::Spins => self.halt(at, Halt::Spinning, until),
            FaultKind::Starves => self.halt(at, Halt::Starving, until),
            FaultKind::ClosesChannel => {
                self.close(at);
                // It goes on meanwhile, and ends like one that nobody talks to.
                self.processes[at].ends_at = self.processes[at].ends_at.min(until);
            }
            FaultKind::ReadsNothing => self.processes[at].is_deaf_until = until,
            FaultKind::SpeaksOutOfTurn => {
                let said = match self.drawn(at, 8, 0..=3) {
                    0 => Said::Ready { warnings: Vec::new() },
                    1 => Said::CaughtUp,
                    2 => Said::Prepared,
                    _ => Said::Connected,
                };
                self.say(at, said);
            }
            FaultKind::SaysFinished => self.say(at, Said::Finished),
            FaultKind::SendsGarbage => {
                let event = Event::Unreadable("garbage".to_owned());
                self.events.push_back((at, event));
            }
            FaultKind::NonFinite if flies && !is_external => {
                self.say(
                    at,
                    Said::NonFinite(NonFinite {
                        service: String::new(),
                        tick: 0,
                        topic: String::new(),
                        field: String::new(),
                    }),
                );
                self.leave(at);
            }
            FaultKind::NonFinite => return false,
            FaultKind::Fails => {
                self.say(
                    at,
                    Said::Failed {
                        reason: "a device".to_owned(),
                    },
                );
                self.leave(at);
            }
            FaultKind::Refuses if !flies => {
                self.say(
                    at,
                    Said::Refused {
                        reason: "a file".to_owned(),
                    },
                );
                self.leave(at);
            }
            FaultKind::Refuses => return false,
            FaultKind::CounterGoesBack if has_role && !is_external => {
                if let Some(service) = service {
                    self.count_steps();
                    self.lies[service] = Some(steps_until / 2);
                }
            }
            _ => return false,
        }
        true
    }

    /// Lets a process end by itself, soon.
    fn leave(&mut self, at: usize) {
        let takes = self.drawn(at, 5, latency::END);
        self.enter(at, Stage::Ending, takes);
    }

    /// Ends a process in no time.
    pub(crate) fn remove(&mut self, at: usize) {
        self.end(at, true);
        self.processes[at].is_end_told = true;
    }

    /// Returns the length of the longest period of a step, ns.
    pub(crate) fn longest_period(&self) -> u64 {
        self.periods.iter().max().copied().unwrap_or(1) * self.schedule.tick_ns()
    }
}

/// Message to a process.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Message {
    Become(Role),
    MakePorts,
    Go { is_restarted: bool },
    Beat,
    Connect { birth: u32 },
    Missed,
    Stop,
}

impl Facts for Machine {
    fn steps_until(&self, service: ServiceId) -> u64 {
        let counted = self.counted_steps(service.index());
        match self.lies[service.index()] {
            Some(lie) if counted == self.steps_until[service.index()] => lie,
            _ => counted,
        }
    }

    fn next_tick(&self, service: ServiceId) -> u64 {
        // A process may die between its step and its checkpoint.
        let counted = self.counted_steps(service.index());
        let at = self.newest[service.index()].unwrap_or(0);
        match counted > self.schedule.last_tick() {
            true => counted,
            false => counted.saturating_sub(self.drawn(at, 9, 0..=1)),
        }
    }

    fn restarts_seen(&self, service: ServiceId) -> u32 {
        self.restarts_seen[service.index()]
    }

    fn activity(&self, process: ProcessNumber) -> Option<Activity> {
        let process = &self.processes[*self.by_number.get(process.0 as usize - 1)?];
        (process.stage != Stage::Ended).then(|| process.activity(self.now))
    }
}

/// Delay of the loop after an event, ns.
pub(crate) fn loop_delay(seed: u64, wakes: u64, maximum: u64) -> u64 {
    // Mostly small, and rarely the maximum.
    match drawn(seed, wakes, 10, 0..=15) {
        0 => drawn(seed, wakes, 11, 0..=maximum),
        _ => drawn(seed, wakes, 11, 0..=maximum.min(MS / 20)),
    }
}
