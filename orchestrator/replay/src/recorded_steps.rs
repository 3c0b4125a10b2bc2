//! The record of a flight in `host.mcap`: its steps, if it was one of real time, and the states of the services before
//! some.

use std::collections::VecDeque;
use std::path::Path;

use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::Operator;

use runtime::step_log::TUNING_SHIFT;

use super::ReplayError;
use super::checkpoints::RecordedCheckpoints;
use run_log::{HostEntry, HostReader, LoggedCheckpoint, ServiceStep, host_log_beside};

/// A step's view of an input: the sequence number of the sample, and whether the step before saw another one.
pub(super) type InputSequences = [Option<(u64, bool)>; MAX_PORTS];

/// One step, and what it saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordedStep {
    pub(super) tick: u64,
    /// Tick of the step before it that the service remembered.
    pub(super) previous: Option<u64>,
    pub(super) operator: Operator,
    /// Number of the last change of gains that held.
    pub(super) tuning: u64,
    /// `true` if all that it had to publish was published; else its process died meanwhile.
    pub(super) is_finished: bool,
    /// Of each input, the sequence number of the sample that it saw, and whether the step before saw another one.
    pub(super) seen: InputSequences,
}

/// The record beside a flight's log, read as far as it is needed. Of one tick there are several steps where a process
/// died in its step and the one that took its place did it again.
pub(super) struct RecordedSteps {
    /// None if there is no record of the recorded_steps.
    source: Option<HostReader>,
    services: [OfService; ServiceId::ALL.len()],
    has_steps: bool,
    /// Ticks beyond a tick up to which the steps of a service are read before it is replayed: its checkpoints are copied
    /// beside it, and stand at most that far behind its steps.
    read_ahead: u64,
    /// The tick by which the replay is to have begun: what led to the newest checkpoint before it is not needed.
    begins_by: u64,
}

struct OfService {
    /// Identifier of the layout of its state, and size of the state, if that is known.
    layout: u64,
    state_size: Option<usize>,
    waiting: VecDeque<RecordedStep>,
    checkpoints: RecordedCheckpoints,
    /// Tick of the last step that was read.
    read_to: Option<u64>,
    /// `true` if there are checkpoints of another build, which mean nothing here.
    has_strange_checkpoints: bool,
}

impl RecordedSteps {
    /// Reads the record beside the flight's log `log`.
    pub(super) fn beside(log: &Path, scenario: &Scenario, begins_by: u64) -> Result<Self, ReplayError> {
        let path = host_log_beside(log);
        let read_ahead = path.as_deref().map(largest_lateness).transpose()?;
        let source = path.map(|path| HostReader::open(&path));
        let mut recorded_steps = Self {
            source: source.transpose()?,
            read_ahead: read_ahead.unwrap_or_default(),
            services: ServiceId::ALL.map(|service| OfService {
                layout: registry::state_layout(service, scenario),
                state_size: registry::state_size(service, scenario),
                waiting: VecDeque::new(),
                checkpoints: RecordedCheckpoints::default(),
                read_to: None,
                has_strange_checkpoints: false,
            }),
            has_steps: false,
            begins_by,
        };
        // A flight in simulated time has none, and so little else that all of it may be kept.
        while !recorded_steps.has_steps && recorded_steps.read_one()? {}
        Ok(recorded_steps)
    }

    /// Returns whether the flight was flown in real time.
    pub(super) fn is_of_real_time(&self) -> bool {
        self.has_steps
    }

    /// Services whose checkpoints another build has written.
    pub(super) fn strange_checkpoints(&self) -> Vec<ServiceId> {
        let is_strange = |service: &ServiceId| self.services[service.index()].has_strange_checkpoints;
        ServiceId::ALL.into_iter().filter(is_strange).collect()
    }

    /// Returns where a service can begin: the newest checkpoint before the tick by which it is to have begun.
    pub(super) fn start_of(&mut self, service: ServiceId) -> Result<Option<(u64, &[u8])>, ReplayError> {
        self.read_to(service, self.begins_by)?;
        let checkpoints = &self.services[service.index()].checkpoints;
        Ok(checkpoints.newest_before(self.begins_by))
    }

    /// The steps of a service up to a tick that were not taken before, in their order.
    pub(super) fn take_to(
        &mut self,
        service: ServiceId,
        tick: u64,
    ) -> Result<Vec<RecordedStep>, ReplayError> {
        self.read_to(service, tick)?;
        let waiting = &mut self.services[service.index()].waiting;
        let count = waiting.iter().take_while(|step| step.tick <= tick).count();
        Ok(waiting.drain(..count).collect())
    }

    /// Returns a service's states before steps, as far as the steps at `tick` or later may ask for them.
    pub(super) fn checkpoints(&mut self, service: ServiceId, tick: u64) -> &RecordedCheckpoints {
        let checkpoints = &mut self.services[service.index()].checkpoints;
        checkpoints.forget_old(tick);
        checkpoints
    }

    /// Reads on until the steps of a service up to a tick have been read, which each tells of in their order, and its
    /// checkpoints, which may come later: they are copied beside the service.
    fn read_to(&mut self, service: ServiceId, tick: u64) -> Result<(), ReplayError> {
        let until = Some(tick.saturating_add(self.read_ahead));
        while self.services[service.index()].read_to <= until && self.read_one()? {}
        Ok(())
    }

    /// Reads the next thing, of whichever service; `false` if there is none.
    fn read_one(&mut self) -> Result<bool, ReplayError> {
        let Some(source) = &mut self.source else {
            return Ok(false);
        };
        match source.next().transpose()? {
            Some(HostEntry::Step(service, step)) => self.keep_step(service, &step),
            Some(HostEntry::Checkpoint(checkpoint)) => self.keep_checkpoint(checkpoint),
            None => return Ok(false),
        }
        Ok(true)
    }

    fn keep_step(&mut self, service: ServiceId, step: &ServiceStep) {
        self.has_steps = true;
        let own = &mut self.services[service.index()];
        own.read_to = own.read_to.max(Some(step.tick));
        own.waiting.push_back(RecordedStep::from(step));
    }

    fn keep_checkpoint(&mut self, found: LoggedCheckpoint) {
        let service = found.service;
        let own = &mut self.services[service.index()];
        let size = found.checkpoint.state.len();
        let is_known = found.layout == own.layout && own.state_size.is_none_or(|expected| size == expected);
        if !is_known {
            own.has_strange_checkpoints = true;
            return;
        }
        let next_tick = found.checkpoint.next_tick;
        own.checkpoints.keep(next_tick, found.checkpoint.state);
        if next_tick <= self.begins_by {
            own.checkpoints.forget_old(next_tick);
            while own.waiting.pop_front_if(|step| step.tick < next_tick).is_some() {}
        }
    }
}

/// Returns the most ticks by which a checkpoint in a record of the machine stands behind the steps of its service.
fn largest_lateness(path: &Path) -> Result<u64, ReplayError> {
    let mut newest = [0_u64; ServiceId::ALL.len()];
    let mut largest = 0;
    for entry in HostReader::open(path)? {
        match entry? {
            HostEntry::Step(service, step) => {
                let newest = &mut newest[service.index()];
                *newest = step.tick.max(*newest);
            }
            HostEntry::Checkpoint(found) => {
                let steps_until = newest[found.service.index()] + 1;
                largest = largest.max(steps_until.saturating_sub(found.checkpoint.next_tick));
            }
        }
    }
    Ok(largest)
}

impl From<&ServiceStep> for RecordedStep {
    fn from(step: &ServiceStep) -> Self {
        Self {
            tick: step.tick,
            is_finished: step.published_ns != 0,
            previous: step.previous.checked_sub(1),
            operator: Operator::from_bits(step.operator as u8),
            tuning: u64::from(step.operator >> TUNING_SHIFT),
            seen: std::array::from_fn(|input| {
                let is_fresh = step.fresh_inputs & 1 << input != 0;
                step.consumed[input].checked_sub(1).map(|seq| (seq, is_fresh))
            }),
        }
    }
}
