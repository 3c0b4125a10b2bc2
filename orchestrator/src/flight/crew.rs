//! The service processes of a run: started, watched, started again when they die, stopped, and never left behind.
//!
//! A death in flight is mended by a process that goes on from the dead one's last checkpoint and gets from the
//! recorder what it has missed ([`runtime::inlet`]). A service that dies again and again at the same place is given
//! up: its crash is a function of its inputs, and so will the next be.

mod process;
pub mod restart;

use std::os::fd::AsFd;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::checkpoints::Checkpoints;
use runtime::control::{ControlError, Start, ToOrchestrator, ToService};
use runtime::crash::Crash;
use runtime::deployment;
use runtime::doorbell::Doorbell;
use runtime::ports::Member;
use runtime::shared_page::{Cell, SharedPage};
use runtime::step::Timetable;
use runtime::step_log::StepLog;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;
use shared_types::schedule::MAX_PORTS;
use shared_types::{Schedule, ServiceId};

pub use process::Exit;
use process::Process;
use restart::RestartPolicy;

use super::FlightFailure;
use super::archive::Archive;
use super::recorder::Recorder;

/// How long a service may take to make its ports.
const READY_LIMIT: Duration = Duration::from_secs(30);
/// How long a service that was told to stop may take before it is killed.
const STOP_LIMIT: Duration = Duration::from_secs(2);

/// How often and how soon each service is started again.
pub type Restarts = [RestartPolicy; ServiceId::ALL.len()];

/// All service processes of a run. Dropping it ends them.
pub struct Crew<'a> {
    member: &'a Member,
    schedule: &'a Schedule,
    start: Start,
    /// Deaths that processes shall bring upon themselves, the first of a service upon its first process and so on.
    crashes: Vec<(ServiceId, Crash)>,
    restarts: Restarts,
    members: Vec<CrewMember>,
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
    doorbells: Vec<Doorbell>,
    is_flying: bool,
    exits: Vec<(ServiceId, u32, Exit)>,
    rebirths: Vec<Rebirth>,
}

struct CrewMember {
    service: ServiceId,
    process: Process,
    phase: Phase,
    /// How many processes have been started.
    lives: u32,
    /// How often in a row one has died without flying a tick more.
    fruitless: u32,
    /// 1 + the last tick that was flown before the last death.
    flown_until: u64,
    /// When the last death was noticed.
    died_at: Option<Instant>,
    /// Number of this birth, once it was announced to the others.
    birth: Option<u32>,
    /// Samples that it needs from long before those that it may have missed, as planned: input and tick.
    remembered: Vec<(usize, u64)>,
}

/// Where a service is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It makes its ports.
    Starting,
    /// It has made them and waits for the others.
    Ready,
    /// It flies.
    Flying,
    /// It flies again and may have missed samples: the next of each input to be handed over, by place.
    CatchingUp([u64; MAX_PORTS]),
    /// It has flown its last tick.
    Finished,
    /// It is dead and is to be started again at this time.
    Dead(Instant),
    /// It is dead and stays so.
    GivenUp,
}

/// A death in flight that was mended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rebirth {
    /// Which service.
    #[serde(serialize_with = "by_name")]
    pub service: ServiceId,
    /// Id of the new process.
    pub pid: u32,
    /// The last tick that had been flown; `None` if it was the first.
    pub tick: Option<u64>,
    /// From the moment when the death was noticed until the new process flew, s.
    pub lost_seconds: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde wants it")]
fn by_name<S: serde::Serializer>(service: &ServiceId, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(service.name())
}

impl std::fmt::Display for Rebirth {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let service = self.service;
        match self.tick {
            Some(tick) => write!(formatter, "`{service}` died after tick {tick}")?,
            None => write!(formatter, "`{service}` died before its first step")?,
        }
        let lost = 1e3 * self.lost_seconds;
        write!(formatter, " and flew again {lost:.1} ms later")
    }
}

/// What a service process told or did.
#[derive(Debug)]
pub enum CrewEvent {
    /// It made its ports; what it could not have of its deployment.
    Ready(ServiceId, Vec<String>),
    /// It has flown its last tick.
    Finished(ServiceId),
    /// It died, and will be started again.
    Died,
    /// It cannot go on.
    Lost(FlightFailure),
}

impl<'a> Crew<'a> {
    /// Starts one process a service and tells each what to fly.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`].
    pub fn start(
        member: &'a Member,
        schedule: &'a Schedule,
        start: Start,
        crashes: Vec<(ServiceId, Crash)>,
        restarts: Restarts,
    ) -> Result<Self, FlightFailure> {
        let doorbells = ServiceId::ALL
            .iter()
            .map(|_| Doorbell::create())
            .collect::<Result<_, _>>()
            .map_err(setup)?;
        let mut crew = Self {
            member,
            schedule,
            start,
            crashes,
            restarts,
            members: Vec::new(),
            page: SharedPage::create().map_err(setup)?,
            checkpoints: Checkpoints::create().map_err(setup)?,
            step_log: StepLog::create().map_err(setup)?,
            doorbells,
            is_flying: false,
            exits: Vec::new(),
            rebirths: Vec::new(),
        };
        for service in ServiceId::ALL {
            let process = crew.spawn(service)?;
            // Kept before it is spoken to, so that it is ended whatever happens next.
            crew.members.push(CrewMember {
                service,
                process,
                phase: Phase::Starting,
                lives: 1,
                fruitless: 0,
                flown_until: 0,
                died_at: None,
                birth: None,
                remembered: Vec::new(),
            });
            crew.instruct(service)?;
        }
        Ok(crew)
    }

    fn spawn(&self, service: ServiceId) -> Result<Process, FlightFailure> {
        let doorbells = self.doorbells.iter().map(AsFd::as_fd);
        let files: Vec<_> = [self.page.file(), self.checkpoints.file(), self.step_log.file()]
            .into_iter()
            .chain(doorbells)
            .collect();
        Process::start(service, &files).map_err(setup)
    }

    /// Starts a process on the core on which it will fly: the others of the run wait for it there, while this process
    /// is busy on another one.
    fn spawn_on_its_core(&self, service: ServiceId) -> Result<Process, FlightFailure> {
        let own = deployment::allowed_cores();
        let moved = self.start.core.map(|core| deployment::pin_to(&[core]));
        let process = self.spawn(service);
        if moved.is_some_and(|moved| moved.is_ok()) {
            // Only slower if it is refused.
            let _ = deployment::pin_to(&own);
        }
        process
    }

    /// Tells a process that has just been started what to fly.
    fn instruct(&mut self, service: ServiceId) -> Result<(), FlightFailure> {
        let life = self.members[service.index()].lives - 1;
        let mut own = self.crashes.iter().filter(|(whose, _)| *whose == service);
        let start = Start {
            crash: own.nth(life as usize).map(|(_, crash)| *crash),
            ..self.start.clone()
        };
        self.say(service, &ToService::Start(Box::new(start)))
    }

    /// The words that the crew shares.
    #[must_use]
    pub fn page(&self) -> &SharedPage {
        &self.page
    }

    /// What the services tell of their steps in real time.
    #[must_use]
    pub fn step_log(&self) -> &StepLog {
        &self.step_log
    }

    /// The processes, by service.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, u32)> {
        self.members
            .iter()
            .map(|member| (member.service, member.process.child.id()))
    }

    /// How the processes that have ended did, in the order of their ends.
    #[must_use]
    pub fn exits(&self) -> &[(ServiceId, u32, Exit)] {
        &self.exits
    }

    /// Deaths that were mended, in their order.
    #[must_use]
    pub fn rebirths(&self) -> &[Rebirth] {
        &self.rebirths
    }

    /// Waits until every service has made its ports; their warnings.
    ///
    /// # Errors
    /// [`FlightFailure`] if one of them fails or takes too long.
    pub fn await_ready(&mut self) -> Result<Vec<String>, FlightFailure> {
        let mut notes = Vec::new();
        while self.members.iter().any(|member| member.phase != Phase::Ready) {
            self.mend()?;
            for event in self.watch(Duration::from_millis(10)) {
                match event {
                    CrewEvent::Ready(service, warnings) => {
                        notes.extend(warnings);
                        self.note_rebirth(service, None);
                    }
                    CrewEvent::Lost(failure) => return Err(failure),
                    CrewEvent::Finished(_) | CrewEvent::Died => {}
                }
            }
        }
        notes.sort();
        notes.dedup();
        Ok(notes)
    }

    /// Lets everybody fly, in the order of the ring.
    ///
    /// # Errors
    /// [`FlightFailure`] if the system refuses.
    pub fn go(&mut self) -> Result<(), FlightFailure> {
        self.is_flying = true;
        for service in ServiceId::ALL {
            self.members[service.index()].phase = Phase::Flying;
            self.say(service, &ToService::Go { reborn: false })?;
        }
        Ok(())
    }

    /// Whether somebody is dead, on the way back, or has samples to catch up with.
    #[must_use]
    #[inline]
    pub fn needs_care(&self) -> bool {
        let is_well = |member: &CrewMember| matches!(member.phase, Phase::Flying | Phase::Finished);
        !self.members.iter().all(is_well)
    }

    /// Starts again what is dead and due.
    ///
    /// # Errors
    /// [`FlightFailure`] if a service cannot be started or does not become ready.
    pub fn mend(&mut self) -> Result<(), FlightFailure> {
        let now = Instant::now();
        for at in 0..self.members.len() {
            match self.members[at].phase {
                Phase::Dead(again_at) if again_at <= now => self.give_birth(at)?,
                Phase::Starting if now - self.members[at].process.started_at > READY_LIMIT => {
                    return Err(FlightFailure::NotReady {
                        services: vec![self.members[at].service.to_string()],
                        limit: READY_LIMIT,
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn give_birth(&mut self, at: usize) -> Result<(), FlightFailure> {
        let service = self.members[at].service;
        let process = self.spawn_on_its_core(service)?;
        let member = &mut self.members[at];
        member.process = process;
        member.lives += 1;
        member.phase = Phase::Starting;
        // While the process loads; it makes its ports when it is told what to fly.
        self.member.clean_up_after_the_dead();
        self.instruct(service)?;
        self.rouse();
        Ok(())
    }

    /// Lets services that were born again in flight go on, once all others are connected to their ports: what is
    /// published before might be lost to a consumer that is not.
    ///
    /// # Errors
    /// [`FlightFailure`] if the system refuses.
    pub fn resume(&mut self, recorder: &mut Recorder) -> Result<(), FlightFailure> {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::Ready {
                continue;
            }
            let words = self.page.words();
            let Some(birth) = self.members[at].birth else {
                self.members[at].birth = Some(1 + words.births.fetch_add(1, Ordering::SeqCst));
                recorder
                    .connect()
                    .map_err(|error| FlightFailure::Setup(error.to_string()))?;
                self.rouse();
                continue;
            };
            let is_connected = |member: &CrewMember| {
                let seen = &words.cells[member.service.index()].births_seen;
                let flies = matches!(member.phase, Phase::Flying | Phase::CatchingUp(_));
                !flies || seen.load(Ordering::Acquire) >= birth
            };
            if self.members.iter().all(is_connected) {
                self.resume_one(self.members[at].service, recorder)?;
            }
        }
        Ok(())
    }

    /// Lets services that were born again in real time go on at once, with the newest that comes.
    ///
    /// # Errors
    /// [`FlightFailure`] if the system refuses.
    pub fn resume_in_real_time(&mut self) -> Result<(), FlightFailure> {
        for at in 0..self.members.len() {
            if self.members[at].phase == Phase::Ready {
                let service = self.members[at].service;
                self.members[at].phase = Phase::Flying;
                self.note_rebirth(service, self.next_tick(service).checked_sub(1));
                self.say(service, &ToService::Go { reborn: true })?;
            }
        }
        Ok(())
    }

    /// Whether a service is in flight: neither being born nor dead nor at its end.
    #[must_use]
    pub fn flies(&self, service: ServiceId) -> bool {
        self.members[service.index()].phase == Phase::Flying
    }

    /// Kills the process of a service, which is then born again.
    pub fn kill(&mut self, service: ServiceId) {
        // It fails only for a process that is gone.
        let _ = self.members[service.index()].process.child.kill();
    }

    /// Whether every service has flown its last tick.
    #[must_use]
    pub fn has_finished(&self) -> bool {
        self.members.iter().all(|member| member.phase == Phase::Finished)
    }

    fn resume_one(&mut self, service: ServiceId, recorder: &Recorder) -> Result<(), FlightFailure> {
        let next_tick = self.next_tick(service);
        let first_tick = self.schedule.steps(service).first_at_or_after(next_tick);
        let tick = first_tick.unwrap_or_default();
        let mut places = [0; MAX_PORTS];
        let mut remembered = Vec::new();
        for (input, place) in places.iter_mut().enumerate().take(service.inputs().len()) {
            let edge = self.schedule.edge(service, input);
            let archive = recorder.archive(edge.topic);
            let due = edge.due_sample(tick);
            // With planned faults these may lie far before all others that are needed.
            let old = due.filter(|_| edge.has_faults());
            remembered.extend(old.map(|due| (input, due)));
            remembered.extend(
                old.and_then(|due| edge.repeated_by(due))
                    .map(|tick| (input, tick)),
            );
            *place = archive.place_of(match old {
                Some(due) => due.max(edge.first_to_come(tick)),
                None => due.unwrap_or_else(|| edge.first_to_come(tick)),
            });
        }
        self.members[service.index()].remembered = remembered;
        self.members[service.index()].phase = Phase::CatchingUp(places);
        self.note_rebirth(service, next_tick.checked_sub(1));
        self.say(service, &ToService::Go { reborn: true })
    }

    /// Tick of the first step that is not known to the service's last checkpoint.
    fn next_tick(&self, service: ServiceId) -> u64 {
        self.checkpoints
            .newest(service)
            .map_or(0, |checkpoint| checkpoint.next_tick)
    }

    fn note_rebirth(&mut self, service: ServiceId, tick: Option<u64>) {
        let member = &self.members[service.index()];
        if let Some(died_at) = member.died_at {
            self.rebirths.push(Rebirth {
                service,
                pid: member.process.child.id(),
                tick,
                lost_seconds: died_at.elapsed().as_secs_f64(),
            });
        }
    }

    /// Hands over what reborn services have missed, as far as it is recorded by now.
    ///
    /// # Errors
    /// [`FlightFailure`] if it is not recorded any more.
    pub fn hand_over(&mut self, recorder: &Recorder) -> Result<(), FlightFailure> {
        for member in &mut self.members {
            let Phase::CatchingUp(places) = &mut member.phase else {
                continue;
            };
            let mut is_told = false;
            let inputs = member.service.inputs();
            while let Some(&(input, tick)) = member.remembered.last() {
                let archive = recorder.archive(inputs[input].topic);
                let place = archive.place_of(tick);
                if !give(&member.process, member.service, archive, input, place)? {
                    break;
                }
                member.remembered.pop();
                is_told = true;
            }
            for ((input, spec), place) in inputs.iter().enumerate().zip(places) {
                let archive = recorder.archive(spec.topic);
                while give(&member.process, member.service, archive, input, *place)? {
                    *place += 1;
                    is_told = true;
                }
            }
            if is_told {
                self.doorbells[member.service.index()].ring();
            }
        }
        Ok(())
    }

    /// Waits up to `limit` for something to happen and tells what did.
    pub fn watch(&mut self, limit: Duration) -> Vec<CrewEvent> {
        let timeout = Timespec {
            tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        let living: Vec<usize> = (0..self.members.len())
            .filter(|&at| !self.members[at].process.is_gone)
            .collect();
        let mut files: Vec<PollFd<'_>> = Vec::with_capacity(2 * living.len());
        for &at in &living {
            let process = &self.members[at].process;
            files.push(PollFd::from_borrowed_fd(process.channel.as_fd(), PollFlags::IN));
            files.push(PollFd::from_borrowed_fd(process.death.as_fd(), PollFlags::IN));
        }
        // An interrupted poll is one in which nothing happened.
        let happened = poll(&mut files, Some(&timeout)).unwrap_or(0) > 0;
        if !happened {
            return Vec::new();
        }
        let called: Vec<usize> = living
            .iter()
            .zip(files.chunks_exact(2))
            .filter(|(_, pair)| pair.iter().any(|file| !file.revents().is_empty()))
            .map(|(&at, _)| at)
            .collect();
        drop(files);
        called.into_iter().flat_map(|at| self.listen(at)).collect()
    }

    /// Everything that a process has said, and its end if it has ended.
    fn listen(&mut self, at: usize) -> Vec<CrewEvent> {
        let mut events = Vec::new();
        loop {
            match self.members[at].process.channel.try_receive::<ToOrchestrator>() {
                Ok(Some(message)) => events.extend(self.members[at].understand(message)),
                Ok(None) => break,
                Err(ControlError::Closed) => {
                    events.extend(self.bury(at));
                    break;
                }
                Err(error) => {
                    events.push(CrewEvent::Lost(FlightFailure::GaveUp {
                        service: self.members[at].service.to_string(),
                        reason: error.to_string(),
                    }));
                    break;
                }
            }
        }
        events
    }

    /// Waits for a process that has closed its line, frees what it held, and decides what comes next.
    fn bury(&mut self, at: usize) -> Option<CrewEvent> {
        let next_tick = self.next_tick(self.members[at].service);
        let member = &mut self.members[at];
        let (service, pid) = (member.service, member.process.child.id());
        let exit = member.process.wait();
        self.exits.push((service, pid, exit.clone()));

        let words = self.page.words();
        let cell = &words.cells[service.index()];
        let is_over = matches!(member.phase, Phase::Finished | Phase::GivenUp);
        if is_over || words.stopping.load(Ordering::Relaxed) != 0 {
            return None;
        }
        let flown_until = cell.steps_until.load(Ordering::Relaxed);
        member.fruitless = if flown_until > member.flown_until {
            0
        } else {
            member.fruitless + 1
        };
        member.flown_until = flown_until;
        let timetable = Timetable::new(self.schedule, service);
        let next = timetable.steps.first_at_or_after(next_tick);
        let is_planned = next_tick > 0 && timetable.dies_after(next_tick - 1, next);
        let pause = if is_planned {
            Some(Duration::ZERO)
        } else {
            self.restarts[service.index()].pause(member.fruitless)
        };
        let Some(pause) = pause else {
            member.phase = Phase::GivenUp;
            return Some(CrewEvent::Lost(FlightFailure::Died {
                service: service.to_string(),
                pid,
                tick: flown_until.saturating_sub(1),
                how: exit.description,
                times: member.fruitless,
            }));
        };
        let now = Instant::now();
        member.died_at = (!is_planned).then_some(now);
        member.phase = if next.is_some_and(|next| next <= self.schedule.last_tick()) {
            Phase::Dead(now + pause)
        } else {
            Phase::Finished
        };
        words.forget_receivers(service);
        cell.waiting_for.store(0, Ordering::Relaxed);
        // One that is born again at once finds everything cleaned up when it makes its ports.
        if member.phase != Phase::Dead(now) {
            self.member.clean_up_after_the_dead();
        }
        // Whoever waited for it in vain looks again.
        self.rouse();
        Some(CrewEvent::Died)
    }

    /// Wakes everybody to look again, whatever has become of their wake-ups.
    pub fn rouse(&self) {
        self.doorbells.iter().for_each(Doorbell::ring);
        self.page.words().cells.iter().for_each(Cell::ring);
    }

    /// Tells everybody to stop, waits until all are gone, and kills who does not go.
    pub fn stop(&mut self) {
        let words = self.page.words();
        words.stopping.store(1, Ordering::SeqCst);
        for member in &self.members {
            // Who is gone already need not be told.
            let _ = member.process.channel.send(&ToService::Stop);
        }
        self.rouse();
        let deadline = Instant::now() + STOP_LIMIT;
        while self.members.iter().any(|member| !member.process.is_gone) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            self.watch(left);
        }
        for member in &mut self.members {
            if !member.process.is_gone {
                // It fails only for a process that is gone.
                let _ = member.process.child.kill();
                let exit = member.process.wait();
                self.exits.push((member.service, member.process.child.id(), exit));
            }
        }
    }

    /// Tells a service something. One that is gone is found so when the crew is watched.
    fn say(&mut self, service: ServiceId, message: &ToService) -> Result<(), FlightFailure> {
        match self.members[service.index()].process.channel.send(message) {
            Ok(()) | Err(ControlError::Closed) => Ok(()),
            Err(error) => Err(FlightFailure::Setup(error.to_string())),
        }
    }
}

impl Drop for Crew<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Gives a service the sample of a place in the sequence of an input. `false` if it has not been recorded yet, or
/// if the service takes no more now: who is full gets the rest later, and who is gone gets it in the next life.
fn give(
    process: &Process,
    service: ServiceId,
    archive: &Archive,
    input: usize,
    place: u64,
) -> Result<bool, FlightFailure> {
    if place >= archive.count() {
        return Ok(false);
    }
    let bytes = archive.at(place).ok_or_else(|| FlightFailure::GaveUp {
        service: service.to_string(),
        reason: format!("what it has missed of its input {input} is not kept any more"),
    })?;
    let message = ToService::Missed {
        input,
        bytes: bytes.to_vec(),
    };
    Ok(process.channel.try_send(&message).unwrap_or(false))
}

impl CrewMember {
    fn understand(&mut self, message: ToOrchestrator) -> Option<CrewEvent> {
        Some(match message {
            ToOrchestrator::Ready { warnings } => {
                self.phase = Phase::Ready;
                self.birth = None;
                CrewEvent::Ready(self.service, warnings)
            }
            ToOrchestrator::CaughtUp => {
                if matches!(self.phase, Phase::CatchingUp(_)) {
                    self.phase = Phase::Flying;
                }
                return None;
            }
            ToOrchestrator::Finished => {
                self.phase = Phase::Finished;
                CrewEvent::Finished(self.service)
            }
            ToOrchestrator::NonFinite(found) => {
                self.phase = Phase::GivenUp;
                CrewEvent::Lost(FlightFailure::NonFinite(found))
            }
            ToOrchestrator::Failed { reason } => {
                self.phase = Phase::GivenUp;
                CrewEvent::Lost(FlightFailure::GaveUp {
                    service: self.service.to_string(),
                    reason,
                })
            }
        })
    }
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "used to map errors, which come by value"
)]
fn setup(error: std::io::Error) -> FlightFailure {
    FlightFailure::Setup(error.to_string())
}
