//! Records of a flight in `host.mcap`: the steps in real time, and the checkpoints of the services.

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

/// Inputs of a step: the sequence number of each sample, and whether it is fresh, i.e. the step before consumed another
/// one.
pub(super) type InputSequences = [Option<(u64, bool)>; MAX_PORTS];

/// Recorded step with its inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordedStep {
    pub(super) tick: u64,
    /// Tick of the step before it, whose state the service had.
    pub(super) previous: Option<u64>,
    pub(super) operator: Operator,
    /// Number of the gain change in effect.
    pub(super) tuning: u64,
    /// `true` if all its samples were published; otherwise its process died during the step.
    pub(super) is_finished: bool,
    /// Sequence number and freshness of each input.
    pub(super) seen: InputSequences,
}

/// Records next to a flight's log, read on demand. A tick has several steps if a process died during the step and its
/// successor repeated it.
pub(super) struct RecordedSteps {
    /// `None` if the flight has no `host.mcap`.
    source: Option<HostReader>,
    services: [ServiceRecords; ServiceId::ALL.len()],
    has_steps: bool,
    /// Number of ticks that are read ahead of the replayed one: checkpoints are copied concurrently with the steps, and
    /// are recorded at most this far behind them.
    read_ahead: u64,
    /// Tick by which the replay starts: steps before the newest checkpoint up to it are not needed.
    begins_by: u64,
}

struct ServiceRecords {
    /// Identifier and, if known, size of its state's layout.
    layout: u64,
    state_size: Option<usize>,
    waiting: VecDeque<RecordedStep>,
    checkpoints: RecordedCheckpoints,
    /// Tick of the last step that was read.
    read_to: Option<u64>,
    /// `true` if there are checkpoints of another build, which cannot be used.
    has_foreign_checkpoints: bool,
}

impl RecordedSteps {
    /// Opens the records next to the flight's log.
    pub(super) fn beside(log: &Path, scenario: &Scenario, begins_by: u64) -> Result<Self, ReplayError> {
        let path = host_log_beside(log);
        let read_ahead = path.as_deref().map(largest_lateness).transpose()?;
        let source = path.map(|path| HostReader::open(&path));
        let mut recorded_steps = Self {
            source: source.transpose()?,
            read_ahead: read_ahead.unwrap_or_default(),
            services: ServiceId::ALL.map(|service| ServiceRecords {
                layout: registry::state_layout(service, scenario),
                state_size: registry::state_size(service, scenario),
                waiting: VecDeque::new(),
                checkpoints: RecordedCheckpoints::default(),
                read_to: None,
                has_foreign_checkpoints: false,
            }),
            has_steps: false,
            begins_by,
        };
        // A flight in simulated time has no steps, and so few checkpoints that all of them can be kept.
        while !recorded_steps.has_steps && recorded_steps.read_one()? {}
        Ok(recorded_steps)
    }

    pub(super) fn is_of_real_time(&self) -> bool {
        self.has_steps
    }

    /// Returns the services with checkpoints of another build.
    pub(super) fn foreign_checkpoints(&self) -> Vec<ServiceId> {
        let is_strange = |service: &ServiceId| self.services[service.index()].has_foreign_checkpoints;
        ServiceId::ALL.into_iter().filter(is_strange).collect()
    }

    /// Returns the checkpoint from which a service starts: the newest before the start of the replay.
    pub(super) fn start_of(&mut self, service: ServiceId) -> Result<Option<(u64, &[u8])>, ReplayError> {
        self.read_to(service, self.begins_by)?;
        let checkpoints = &self.services[service.index()].checkpoints;
        Ok(checkpoints.newest_before(self.begins_by))
    }

    /// Returns the steps of a service up to a tick that were not taken before, in their order.
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

    /// Returns the checkpoints of a service that steps at `tick` or later may need.
    pub(super) fn checkpoints(&mut self, service: ServiceId, tick: u64) -> &RecordedCheckpoints {
        let checkpoints = &mut self.services[service.index()].checkpoints;
        checkpoints.remove_old(tick);
        checkpoints
    }

    /// Reads until all steps of a service up to a tick, which are recorded in order, and their checkpoints, which
    /// follow with a delay, have been read.
    fn read_to(&mut self, service: ServiceId, tick: u64) -> Result<(), ReplayError> {
        let until = Some(tick.saturating_add(self.read_ahead));
        while self.services[service.index()].read_to <= until && self.read_one()? {}
        Ok(())
    }

    /// Reads the next record of any service; `false` at the end.
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
            own.has_foreign_checkpoints = true;
            return;
        }
        let next_tick = found.checkpoint.next_tick;
        own.checkpoints.keep(next_tick, found.checkpoint.state);
        if next_tick <= self.begins_by {
            own.checkpoints.remove_old(next_tick);
            while own.waiting.pop_front_if(|step| step.tick < next_tick).is_some() {}
        }
    }
}

/// Returns the maximum number of ticks by which a checkpoint is recorded behind the steps of its service.
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
                step.seen(input).checked_sub(1).map(|seq| (seq, is_fresh))
            }),
        }
    }
}
