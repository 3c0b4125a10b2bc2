//! Samples that restarted services have missed, sent to them from the recorder.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;

use decisions::Phase;
use decisions::event::{Event, Facts};
use decisions::failure::ServiceFailure;
use decisions::process::ProcessNumber;
use host::step::Timetable;
use runtime::control::ToService;
use shared_types::schedule::MAX_PORTS;
use shared_types::{ServiceId, Topic};

use super::Supervisor;
use super::process::Process;
use crate::RunFailure;
use crate::archive::Archive;
use crate::recorder::Recorder;

/// Number of samples in a message to a service that restarts in real time.
const MISSED_AT_ONCE: usize = 16;

/// Function that returns the samples of a topic from a tick on.
pub type Remembered<'a> = dyn Fn(Topic, u64) -> Vec<&'a [u8]> + 'a;

/// Samples to be sent to each service.
#[derive(Default)]
pub(super) struct HandOvers {
    /// In lock step.
    catching_up: [Option<CatchUp>; ServiceId::ALL.len()],
    /// In real time: the process, and the messages that were not sent yet.
    missed: [Option<(ProcessNumber, VecDeque<ToService>)>; ServiceId::ALL.len()],
}

/// Samples that a service in lock step is sent.
struct CatchUp {
    /// Place of the next sample to send, of each input.
    places: [u64; MAX_PORTS],
    /// Samples that planned faults repeat from long before those that it may have missed: input and tick.
    remembered: Vec<(usize, u64)>,
}

impl Supervisor<'_> {
    /// Publishes the ports of a restarted service, which it has reported (Release part): a service that reads this
    /// count with Acquire finds them.
    ///
    /// # Errors
    /// [`RunFailure`] if the recorder cannot connect to them.
    pub fn announce(&mut self, birth: u32, recorder: &mut Recorder) -> Result<(), RunFailure> {
        self.page()
            .control_block()
            .restarts
            .store(birth, Ordering::SeqCst);
        recorder.connect().map_err(RunFailure::setup)
    }

    /// Begins to send a restarted service in lock step the samples that it has missed.
    pub fn catch_up(&mut self, service: ServiceId, recorder: &Recorder) {
        let next_tick = self.processes.next_tick(service);
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
        self.hand_overs.catching_up[service.index()] = Some(CatchUp { places, remembered });
    }

    /// Sends restarted services in lock step the samples that they have missed, as far as they are recorded.
    ///
    /// # Errors
    /// [`RunFailure`] if a sample is not stored any more.
    pub fn hand_over(&mut self, recorder: &Recorder) -> Result<(), RunFailure> {
        for service in ServiceId::ALL {
            let Some(catch_up) = &mut self.hand_overs.catching_up[service.index()] else {
                continue;
            };
            let process = self.processes.get(self.supervision.process_of(service));
            let Some(process) = process.filter(|_| self.supervision.phase_of(service) == Phase::CatchingUp)
            else {
                self.hand_overs.catching_up[service.index()] = None;
                continue;
            };
            let mut is_sent = false;
            let inputs = service.inputs();
            while let Some(&(input, tick)) = catch_up.remembered.last() {
                let archive = recorder.archive(inputs[input].topic);
                let place = archive.place_of(tick);
                if !send_sample(process, service, archive, input, place)? {
                    break;
                }
                catch_up.remembered.pop();
                is_sent = true;
            }
            for (input, spec) in self.schedule.inputs_read(service) {
                let archive = recorder.archive(spec.topic);
                let place = &mut catch_up.places[input];
                while send_sample(process, service, archive, input, *place)? {
                    *place += 1;
                    is_sent = true;
                }
            }
            if is_sent {
                self.processes.doorbells[service.index()].ring();
            }
        }
        Ok(())
    }

    /// Sends a service that restarts in real time the `remembered` samples that it needs to make up for late steps, or
    /// to take in every sample, as far as its channel has room.
    pub fn send_missed(&mut self, number: ProcessNumber, service: ServiceId, remembered: &Remembered<'_>) {
        let begun = self.hand_overs.missed[service.index()].take();
        let begun = begun.filter(|(process, _)| *process == number);
        let mut messages = begun.map_or_else(|| self.missed(service, remembered), |(_, messages)| messages);
        let Some(process) = self.processes.get(number) else {
            return;
        };
        while let Some(message) = messages.front() {
            // An error means a dead process, which `watch` detects.
            if matches!(process.channel.try_send(message), Ok(false)) {
                self.hand_overs.missed[service.index()] = Some((number, messages));
                return;
            }
            messages.pop_front();
        }
        self.handle(number, Event::MissedSent);
    }

    /// Returns the remembered samples that a service needs, as messages.
    fn missed(&self, service: ServiceId, remembered: &Remembered<'_>) -> VecDeque<ToService> {
        let timetable = Timetable::new(self.schedule, service);
        let next_tick = self.processes.next_tick(service);
        let last = self.step_log().last_before(service, next_tick);
        let is_external = self.processes.start.scenario.program_of(service).is_some();
        let mut messages = VecDeque::new();
        for (input, spec) in self.schedule.inputs_read(service).filter(|_| !is_external) {
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
    let bytes = archive.at(place).ok_or_else(|| {
        RunFailure::Service(ServiceFailure::GaveUp {
            service: service.to_string(),
            reason: format!("the samples that it has missed of its input {input} are not stored any more"),
        })
    })?;
    let message = ToService::Missed {
        input,
        bytes: bytes.to_vec(),
    };
    Ok(process.channel.try_send(&message).unwrap_or(false))
}
