//! The steps of a flight in real time, as `host.mcap` tells of them.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::McapError;
use mcap::read::Options;
use shared_types::ServiceId;
use shared_types::service::Operator;
use zerocopy::FromBytes;

use super::ReplayError;
use super::station::Seen;
use crate::log::{HostSample, ServiceStep, host_log_beside};

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

/// All steps, by service and tick. Of one tick there are several where a process died after its step and the one that
/// took its place did it again: what the first published is what was seen and recorded.
pub(super) struct RecordedSteps([BTreeMap<u64, Vec<RecordedStep>>; ServiceId::ALL.len()]);

impl RecordedSteps {
    /// Those of the flight whose log is `log`; none if it was flown in simulated time.
    pub(super) fn beside(log: &Path) -> Result<Option<Self>, ReplayError> {
        let Some(path) = host_log_beside(log) else {
            return Ok(None);
        };
        let failed = |reason: String| ReplayError::Steps {
            path: path.clone(),
            reason,
        };
        let file = std::fs::read(&path).map_err(|error| failed(error.to_string()))?;
        let mut steps = Self(std::array::from_fn(|_| BTreeMap::new()));
        // A log that was not closed is read up to where it breaks off.
        let options = Options::IgnoreEndMagic | Options::ValidateChunkCrcs;
        let messages = mcap::MessageStream::new_with_options(&file, options)
            .map_err(|error| failed(error.to_string()))?;
        for message in messages {
            let message = match message {
                Ok(message) => message,
                Err(McapError::UnexpectedEof) => break,
                Err(McapError::RecordTooLarge { len, .. }) if len > file.len() as u64 => break,
                Err(error) => {
                    let recover = format!("{error}; try `gerono recover {}`", path.display());
                    return Err(failed(recover));
                }
            };
            if message.channel.topic == ServiceStep::CHANNEL {
                steps.keep(&message.data).map_err(failed)?;
            }
        }
        let is_empty = steps.0.iter().all(BTreeMap::is_empty);
        Ok((!is_empty).then_some(steps))
    }

    fn keep(&mut self, data: &[u8]) -> Result<(), String> {
        let other_layout =
            || "its steps are laid out in another way; use the program that wrote it".to_owned();
        let bytes = data.get(4..).ok_or_else(other_layout)?;
        let step = ServiceStep::read_from_bytes(bytes).map_err(|_| other_layout())?;
        let own = self.0.get_mut(step.service as usize).ok_or_else(other_layout)?;
        own.entry(step.tick).or_default().push(RecordedStep::from(&step));
        Ok(())
    }

    /// The steps of a service at a tick, in their order.
    pub(super) fn of(&self, service: ServiceId, tick: u64) -> &[RecordedStep] {
        self.0[service.index()].get(&tick).map_or(&[], Vec::as_slice)
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
