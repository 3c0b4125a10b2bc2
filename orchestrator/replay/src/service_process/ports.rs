//! Ports of the replay's topics.

use runtime::ports::{PortError, Receiver, Sender, TopicPorts};
use shared_types::schedule::Publication;
use shared_types::service::header_of;

/// Publisher of the recorded samples of an input.
pub(crate) struct InputPort {
    sender: Box<dyn Sender>,
    /// Sequence number of the last published sample; `None` if that was altered by a fault.
    newest: Option<u64>,
    /// Keeps the topic alive.
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

    pub(super) fn connect(&mut self) -> Result<(), PortError> {
        self.sender.connect()
    }

    /// Publishes the sample for the next step, unless it is the last published one. Returns whether it was published.
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

/// Receiver of an output of the service.
pub(crate) struct OutputPort {
    publication: Publication,
    receiver: Box<dyn Receiver>,
    /// Keeps the topic alive.
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

    pub(super) fn connect(&mut self) -> Result<(), PortError> {
        self.receiver.connect()
    }

    /// Returns whether a step at `tick` publishes a sample.
    pub(super) fn is_due(&self, tick: u64) -> bool {
        self.publication.is_due(tick)
    }

    /// Receives the sample of `tick`, which was published before; `None` if another one arrived.
    pub(super) fn receive(&mut self, tick: u64) -> Result<Option<&[u8]>, PortError> {
        let has_come = self.receiver.receive()?;
        let held = self.receiver.held();
        Ok(held.filter(|bytes| has_come && header_of(bytes).tick == tick))
    }
}
