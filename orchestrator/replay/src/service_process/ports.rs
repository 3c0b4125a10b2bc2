//! The orchestrator's ports in the replay of a service.

use runtime::ports::{PortError, Receiver, Sender, TopicPorts};
use shared_types::schedule::Publication;
use shared_types::service::header_of;

/// Place where the recorded samples of an input are published.
pub(crate) struct InputPort {
    sender: Box<dyn Sender>,
    /// The sequence number of the recorded sample that was published last, if that was one and as it was recorded.
    newest: Option<u64>,
    /// Holds the topic.
    _ports: Box<dyn TopicPorts>,
}

impl InputPort {
    pub(crate) fn new(sender: Box<dyn Sender>, ports: Box<dyn TopicPorts>) -> Self {
        Self {
            sender,
            newest: None,
            _ports: ports,
        }
    }

    /// Connects to the service.
    pub(super) fn connect(&mut self) -> Result<(), PortError> {
        self.sender.connect()
    }

    /// Publishes what the next step sees, unless it is what was published last; whether it did.
    pub(super) fn publish(&mut self, bytes: &[u8], as_recorded: Option<u64>) -> Result<bool, PortError> {
        if as_recorded.is_some() && as_recorded == self.newest {
            return Ok(false);
        }
        self.sender.loan()?.copy_from_slice(bytes);
        self.sender.send()?;
        self.newest = as_recorded;
        Ok(true)
    }
}

/// Place where an output of the service comes.
pub(crate) struct OutputPort {
    publication: Publication,
    receiver: Box<dyn Receiver>,
    /// Holds the topic.
    _ports: Box<dyn TopicPorts>,
}

impl OutputPort {
    pub(crate) fn new(
        publication: Publication,
        receiver: Box<dyn Receiver>,
        ports: Box<dyn TopicPorts>,
    ) -> Self {
        Self {
            publication,
            receiver,
            _ports: ports,
        }
    }

    /// Connects to the service.
    pub(super) fn connect(&mut self) -> Result<(), PortError> {
        self.receiver.connect()
    }

    /// Returns whether a step at `tick` publishes a sample.
    pub(super) fn is_due(&self, tick: u64) -> bool {
        self.publication.is_due(tick)
    }

    /// The sample of `tick`, which has been published; none if something else came.
    pub(super) fn receive(&mut self, tick: u64) -> Result<Option<&[u8]>, PortError> {
        let has_come = self.receiver.receive()?;
        let held = self.receiver.held();
        Ok(held.filter(|bytes| has_come && header_of(bytes).tick == tick))
    }
}
