//! The steps of a flight in real time, as `host.mcap` tells of them.

use std::collections::VecDeque;
use std::path::Path;

use shared_types::ServiceId;
use shared_types::service::Operator;

use super::ReplayError;
use super::station::Seen;
use crate::log::{HostSteps, ServiceStep, host_log_beside};

/// One step, and what it saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordedStep {
    pub(super) tick: u64,
    /// Tick of the step before it that the service remembered.
    pub(super) previous: Option<u64>,
    pub(super) operator: Operator,
    /// Whether all that it had to publish was published; else its process died meanwhile.
    pub(super) is_finished: bool,
    /// Of each input, the sequence number of the sample that it saw, and whether the step before saw another one.
    pub(super) seen: Seen,
}

/// The steps of a flight, read as far as they are needed. Of one tick there are several where a process died in its step and
/// the one that took its place did it again.
pub(super) struct RecordedSteps {
    source: HostSteps,
    services: [StepsOfService; ServiceId::ALL.len()],
}

#[derive(Default)]
struct StepsOfService {
    waiting: VecDeque<RecordedStep>,
    /// Tick of the last step that was read.
    read_to: Option<u64>,
}

impl RecordedSteps {
    /// Those of the flight whose log is `log`; none if it was flown in simulated time.
    pub(super) fn beside(log: &Path) -> Result<Option<Self>, ReplayError> {
        let Some(path) = host_log_beside(log) else {
            return Ok(None);
        };
        let mut steps = Self {
            source: HostSteps::open(&path)?,
            services: Default::default(),
        };
        Ok(steps.read_one()?.then_some(steps))
    }

    /// Reads on until the steps of a service up to a tick have been read: each tells of its own in their order.
    fn read_to(&mut self, service: ServiceId, tick: u64) -> Result<(), ReplayError> {
        while self.services[service.index()].read_to <= Some(tick) && self.read_one()? {}
        Ok(())
    }

    /// Reads the next step, of whichever service; `false` if there is none.
    fn read_one(&mut self) -> Result<bool, ReplayError> {
        let Some((service, step)) = self.source.next().transpose()? else {
            return Ok(false);
        };
        let own = &mut self.services[service.index()];
        own.read_to = own.read_to.max(Some(step.tick));
        own.waiting.push_back(RecordedStep::from(&step));
        Ok(true)
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
}

impl From<&ServiceStep> for RecordedStep {
    fn from(step: &ServiceStep) -> Self {
        let has = |bit: u32| step.operator & bit != 0;
        Self {
            tick: step.tick,
            is_finished: step.published_ns != 0,
            previous: step.previous.checked_sub(1),
            operator: Operator {
                armed: has(1),
                land: has(2),
                killed: has(4),
            },
            seen: std::array::from_fn(|input| {
                let is_fresh = step.fresh_inputs & 1 << input != 0;
                step.consumed[input].checked_sub(1).map(|seq| (seq, is_fresh))
            }),
        }
    }
}
