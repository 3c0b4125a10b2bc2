//! Restart of a service: from its death until another process flies in its place without having missed a sample.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use host::step::Timetable;
use runtime::control::{Role, ToService};
use runtime::deployment;
use shared_types::schedule::MAX_PORTS;
use shared_types::{ServiceId, Topic};

use super::managed_service::{ManagedService, Phase};
use super::process::Process;
use super::{Exit, Restart, ServiceEvent, Supervisor};
use crate::RunFailure;
use crate::archive::Archive;
use crate::recorder::Recorder;

/// Number of samples in a message to a service that restarts in real time.
const MISSED_AT_ONCE: usize = 16;

/// Timeout for the service to receive these messages.
const MISSED_LIMIT: Duration = Duration::from_millis(500);

/// Function that returns the samples of a topic from a tick on.
pub type Remembered<'a> = dyn Fn(Topic, u64) -> Vec<&'a [u8]> + 'a;

impl Supervisor<'_> {
    /// Handles the end of a process: waits for it, releases its resources, and decides on a restart.
    pub(super) fn reap(&mut self, at: usize) -> Option<ServiceEvent> {
        let mut exit = self.end_process(at);
        // Only now: until its end the process may have written another checkpoint.
        let next_tick = self.next_tick(self.members[at].service);
        let flown_until = self.steps_until(self.members[at].service);
        let member = &mut self.members[at];
        let (service, pid) = (member.service, member.process.id());
        let not_finite = member.not_finite.take();
        if let Some(found) = &not_finite {
            exit.description = found.to_string();
        }
        if let Some(words) = member.fatal_report.take(flown_until) {
            exit.description = words;
        }
        match member.blamed.take() {
            Some(what) => exit.description = format!("killed, because it {what}"),
            None => member.deaths += 1,
        }
        self.exits.push((Some(service), pid, exit.clone()));

        let block = self.page.control_block();
        let cell = &block.cells[service.index()];
        let is_over = matches!(member.phase, Phase::Finished | Phase::GivenUp);
        if is_over || block.stopping.load(Ordering::Relaxed) != 0 {
            return None;
        }
        // Must be stored before the death is handled: from here on, no service in real time waits for the dead one.
        cell.gone.store(1, Ordering::SeqCst);
        if let Some(failure) = self.external_end_failure(at, &exit) {
            self.members[at].phase = Phase::GivenUp;
            return Some(ServiceEvent::Lost(failure));
        }
        let member = &mut self.members[at];
        member.fruitless = if flown_until > member.flown_until {
            0
        } else {
            member.fruitless + 1
        };
        // A process that repeats steps is behind its predecessor.
        member.flown_until = flown_until.max(member.flown_until);
        let timetable = Timetable::new(self.schedule, service);
        let after = timetable.steps.first_at_or_after(flown_until);
        let is_planned = flown_until > 0 && timetable.dies_after(flown_until - 1, after);
        let next = timetable.steps.first_at_or_after(next_tick);
        let pause = if is_planned {
            Some(Duration::ZERO)
        } else {
            self.restart_policies[service.index()].pause(member.fruitless)
        };
        let Some(pause) = pause else {
            member.phase = Phase::GivenUp;
            let (name, times) = (member.name, member.fruitless);
            let died = |exit: Exit| RunFailure::Died {
                service: name.to_owned(),
                pid,
                tick: flown_until.saturating_sub(1),
                how: exit.description,
                times,
            };
            return Some(ServiceEvent::Lost(
                not_finite.map_or_else(|| died(exit), RunFailure::from),
            ));
        };
        let now = Instant::now();
        // A death before the first step extends the gap that the death before it began.
        let silent_since = member.silent_since.take();
        let gap_began = member
            .died_at
            .filter(|_| member.is_replacement())
            .or(silent_since);
        member.died_at = (!is_planned).then_some(gap_began.unwrap_or(now));
        member.phase = if next.is_some_and(|next| next <= self.schedule.last_tick()) {
            Phase::Dead(now + pause)
        } else {
            Phase::Finished
        };
        // Must precede the clean-up of its ports: a publisher must not wait for room in the queue of a receiver that
        // never reads.
        block.forget_receivers(service);
        cell.waiting_for.store(0, Ordering::Relaxed);
        // If the service restarts at once, `respawn` cleans up.
        if member.phase != Phase::Dead(now) {
            self.node.clean_up_after_the_dead();
        }
        // Services that waited for the dead one check again.
        self.wake_all();
        Some(ServiceEvent::Died)
    }

    /// Lets services that restarted in real time fly on with the newest samples. One that makes up for late steps, or
    /// takes in every sample, first gets the `remembered` samples that it needs, as far as its channel has room.
    ///
    /// # Errors
    /// [`RunFailure`] if a message cannot be sent.
    pub fn resume_in_real_time(&mut self, remembered: &Remembered<'_>) -> Result<(), RunFailure> {
        for at in 0..self.members.len() {
            if self.members[at].phase == Phase::Ready && self.send_missed(at, remembered) {
                let service = self.members[at].service;
                self.members[at].phase = Phase::Flying;
                self.note_restart(service);
                self.send_go(service, true)?;
            }
        }
        Ok(())
    }

    /// Sends a service the samples that it has missed, as far as there is room. Returns whether all were sent.
    fn send_missed(&mut self, at: usize, remembered: &Remembered<'_>) -> bool {
        let begun = self.members[at].missed.take();
        let (since, mut messages) = begun.unwrap_or_else(|| (Instant::now(), self.missed(at, remembered)));
        let channel = &self.members[at].process.channel;
        while let Some(message) = messages.front() {
            // An error means a dead process, which `watch` detects.
            if matches!(channel.try_send(message), Ok(false)) && since.elapsed() < MISSED_LIMIT {
                self.members[at].missed = Some((since, messages));
                return false;
            }
            messages.pop_front();
        }
        true
    }

    /// Returns the remembered samples that a service needs, as messages.
    fn missed(&self, at: usize, remembered: &Remembered<'_>) -> VecDeque<ToService> {
        let service = self.members[at].service;
        let (timetable, next_tick) = (Timetable::new(self.schedule, service), self.next_tick(service));
        let last = self.step_log.last_before(service, next_tick);
        let mut messages = VecDeque::new();
        let inputs = self.schedule.inputs_read(service);
        for (input, spec) in inputs.filter(|_| !self.is_external_service(at)) {
            let seen = last.and_then(|step| step.consumed_tick(input));
            let first = timetable.first_needed(&self.schedule.edge(service, input), next_tick, seen);
            let missed = first.map_or_else(Vec::new, |first| remembered(spec.topic, first));
            for samples in missed.chunks(MISSED_AT_ONCE) {
                let bytes = samples.concat();
                messages.push_back(ToService::Missed { input, bytes });
            }
        }
        messages
    }

    /// Restarts dead services that are due. A failure of one does not prevent the restart of others, and is retried.
    ///
    /// # Errors
    /// The first [`RunFailure`], if a service cannot be started or does not become ready.
    pub fn restart_dead(&mut self) -> Result<(), RunFailure> {
        let now = Instant::now();
        let mut outcome = Ok(());
        for at in 0..self.members.len() {
            outcome = outcome.and(self.restart_one(at, now));
        }
        outcome
    }

    fn restart_one(&mut self, at: usize, now: Instant) -> Result<(), RunFailure> {
        let phase = self.members[at].phase;
        match phase {
            // A killed process that has not ended yet still owns its ports; a successor could not create them.
            Phase::Dead(again_at) if again_at > now || !self.members[at].process.is_over() => Ok(()),
            Phase::Dead(_) => self.respawn(at).inspect_err(|_| {
                let pause = self.longest_pause(at);
                let member = &mut self.members[at];
                if matches!(member.phase, Phase::Dead(_)) {
                    member.phase = Phase::Dead(now + pause);
                }
            }),
            Phase::Starting if self.is_external_service(at) => self.limit_external_start(at, now),
            Phase::Starting => self.limit_start(at, now),
            _ => Ok(()),
        }
    }

    /// Restarts services that were given up, after their longest back-off: a vehicle in the air needs all of them to
    /// land.
    pub fn retry_given_up(&mut self) {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::GivenUp {
                continue;
            }
            if !self.members[at].process.is_gone {
                self.members[at].process.end();
            }
            let block = self.page.control_block();
            let service = self.members[at].service;
            block.cells[service.index()].gone.store(1, Ordering::SeqCst);
            block.forget_receivers(service);
            let pause = self.longest_pause(at);
            self.members[at].phase = Phase::Dead(Instant::now() + pause);
        }
    }

    fn longest_pause(&self, at: usize) -> Duration {
        self.restart_policies[self.members[at].service.index()].longest_pause
    }

    /// Gives a service another process: the standby process, or a new one.
    fn respawn(&mut self, at: usize) -> Result<(), RunFailure> {
        let service = self.members[at].service;
        let role = Role {
            service,
            crash: self.crash_of(service, self.members[at].deaths),
        };
        // The standby process has built the internal services, not the external one.
        let standby = if self.is_external_service(at) {
            None
        } else {
            self.take_standby(role)
        };
        let is_new = standby.is_none();
        let (process, was_prepared) = match standby {
            Some(prepared) => prepared,
            None => (self.spawn_on_its_core(service)?, false),
        };
        let member = &mut self.members[at];
        member.process = process;
        (member.was_prepared, member.slow_start, member.missed) = (was_prepared, None, None);
        member.lives += 1;
        member.phase = Phase::Starting;
        if is_new {
            self.send_start(&self.members[at].process, Some(role))?;
        }
        // Done while the process loads or opens its topics.
        self.node.clean_up_after_the_dead();
        if let Some(reserve) = &mut self.reserve {
            reserve.lend();
        }
        self.send(service, &ToService::MakePorts)?;
        self.wake_all();
        Ok(())
    }

    /// Lets services that restarted in lock step fly on, once all others are connected to their ports: a sample
    /// published before would be lost for an unconnected consumer.
    ///
    /// # Errors
    /// [`RunFailure`] if a message cannot be sent.
    pub fn resume(&mut self, recorder: &mut Recorder) -> Result<(), RunFailure> {
        for at in 0..self.members.len() {
            if self.members[at].phase != Phase::Ready {
                continue;
            }
            let block = self.page.control_block();
            let Some((birth, announced_at)) = self.members[at].birth else {
                // Publishes the new ports, which `Ready` has reported (Release part): a service that reads this count
                // with Acquire finds them.
                let birth = 1 + block.restarts.fetch_add(1, Ordering::SeqCst);
                self.members[at].birth = Some((birth, Instant::now()));
                self.connect_external_services(birth)?;
                recorder.connect().map_err(RunFailure::setup)?;
                self.wake_all();
                continue;
            };
            let is_connected = |member: &ManagedService| {
                let seen = &block.cells[member.service.index()].restarts_seen;
                let flies = matches!(member.phase, Phase::Flying | Phase::CatchingUp(_));
                // Acquire: pairs with the Release by which a service confirms that it is connected.
                !flies || seen.load(Ordering::Acquire) >= birth
            };
            if self.members.iter().all(is_connected) {
                self.resume_one(self.members[at].service, recorder)?;
            } else {
                self.limit_connect_time(birth, announced_at)?;
            }
        }
        Ok(())
    }

    fn resume_one(&mut self, service: ServiceId, recorder: &Recorder) -> Result<(), RunFailure> {
        let next_tick = self.next_tick(service);
        let first_tick = self.schedule.steps(service).first_at_or_after(next_tick);
        let tick = first_tick.unwrap_or_default();
        let mut places = [0; MAX_PORTS];
        let mut remembered = Vec::new();
        for (input, _) in self.schedule.inputs_read(service) {
            let edge = self.schedule.edge(service, input);
            let archive = recorder.archive(edge.topic);
            let due = edge.due_sample(tick);
            // With planned faults, these samples may be much older than all others that are needed.
            let old = due.filter(|_| edge.has_faults());
            remembered.extend(old.map(|due| (input, due)));
            if let Some(due) = old {
                remembered.extend(edge.needed_again(due).map(|tick| (input, tick)));
            }
            places[input] = archive.place_of(match old {
                Some(due) => due.max(edge.first_to_come(tick)),
                None => due.unwrap_or_else(|| edge.first_to_come(tick)),
            });
        }
        self.members[service.index()].remembered = remembered;
        self.members[service.index()].phase = Phase::CatchingUp(places);
        self.note_restart(service);
        self.send_go(service, true)
    }

    /// Returns the tick of the first step that the service's last checkpoint does not include.
    fn next_tick(&self, service: ServiceId) -> u64 {
        self.checkpoints
            .newest(service)
            .map_or(0, |checkpoint| checkpoint.next_tick)
    }

    pub(super) fn note_restart(&mut self, service: ServiceId) {
        let tick = self.steps_until(service).checked_sub(1);
        let member = &self.members[service.index()];
        if let Some(died_at) = member.died_at {
            self.restarts.push(Restart {
                service,
                name: member.name,
                pid: member.process.id(),
                tick,
                lost_seconds: died_at.elapsed().as_secs_f64(),
            });
        }
    }

    /// Sends restarted services the samples that they have missed, as far as they are recorded.
    ///
    /// # Errors
    /// [`RunFailure`] if a sample is not stored any more.
    pub fn hand_over(&mut self, recorder: &Recorder) -> Result<(), RunFailure> {
        for member in &mut self.members {
            let Phase::CatchingUp(places) = &mut member.phase else {
                continue;
            };
            let mut is_sent = false;
            let inputs = member.service.inputs();
            while let Some(&(input, tick)) = member.remembered.last() {
                let archive = recorder.archive(inputs[input].topic);
                let place = archive.place_of(tick);
                if !send_sample(&member.process, member.service, archive, input, place)? {
                    break;
                }
                member.remembered.pop();
                is_sent = true;
            }
            for (input, spec) in self.schedule.inputs_read(member.service) {
                let archive = recorder.archive(spec.topic);
                let place = &mut places[input];
                while send_sample(&member.process, member.service, archive, input, *place)? {
                    *place += 1;
                    is_sent = true;
                }
            }
            if is_sent {
                self.doorbells[member.service.index()].ring();
            }
        }
        Ok(())
    }

    /// Starts a process on the core on which it will fly: the other services wait for it there, while this process is
    /// busy on another core.
    fn spawn_on_its_core(&self, service: ServiceId) -> Result<Process, RunFailure> {
        let own = deployment::allowed_cores();
        let moved = self.start.core.map(|core| deployment::pin_to(&[core]));
        let process = self.spawn(self.name_of(service));
        if moved.is_some_and(|moved| moved.is_ok()) {
            // A refusal is ignored: it only costs time.
            let _ = deployment::pin_to(&own);
        }
        process
    }
}

/// Sends a restarted service one recorded input. `false` if it is not recorded yet or the socket is full; the caller
/// retries. A dead process gets it after its restart.
fn send_sample(
    process: &Process,
    service: ServiceId,
    archive: &Archive,
    input: usize,
    place: u64,
) -> Result<bool, RunFailure> {
    if place >= archive.count() {
        return Ok(false);
    }
    let bytes = archive.at(place).ok_or_else(|| RunFailure::GaveUp {
        service: service.to_string(),
        reason: format!("the samples that it has missed of its input {input} are not stored any more"),
    })?;
    let message = ToService::Missed {
        input,
        bytes: bytes.to_vec(),
    };
    Ok(process.channel.try_send(&message).unwrap_or(false))
}
