//! Outputs of a service: loaned samples and their consumers.

use shared_types::schedule::Publication;
use shared_types::wiring::OutputSpec;
use shared_types::{Schedule, ServiceId};

use crate::crash::{CrashPlace, CrashPoint};
use crate::ports::{PortError, Sender, TopicPorts, Topics};
use host::step::{self, Slots};

/// Outputs of a service in a flight, in the order of the wiring table.
pub struct OutputPorts {
    outputs: Vec<OutputPort>,
    consumers: Vec<ServiceId>,
}

struct OutputPort {
    publication: Publication,
    sender: Box<dyn Sender>,
}

impl OutputPorts {
    /// Makes a publisher of each topic with `sender_of`.
    ///
    /// # Errors
    /// The error of `sender_of`.
    pub fn open(
        topics: &Topics,
        id: ServiceId,
        schedule: &Schedule,
        mut sender_of: impl FnMut(&dyn TopicPorts) -> Result<Box<dyn Sender>, PortError>,
    ) -> Result<Self, PortError> {
        let open = |spec: &OutputSpec| {
            Ok(OutputPort {
                publication: schedule.publication(spec.topic),
                sender: sender_of(topics.ports(spec.topic))?,
            })
        };
        Ok(Self {
            outputs: schedule.outputs(id).map(open).collect::<Result<_, PortError>>()?,
            consumers: readers_of(id, schedule),
        })
    }

    /// Returns the consumers of all outputs, without duplicates.
    #[must_use]
    #[inline]
    pub fn consumers(&self) -> &[ServiceId] {
        &self.consumers
    }

    /// Connects to all existing receivers.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.outputs
            .iter_mut()
            .try_for_each(|output| output.sender.connect())
    }

    /// Loans memory for the samples that are due at `tick`. The step writes in place: a copy of a sample would stall until
    /// the cache lines of the loaned memory arrive from the recorder's core.
    ///
    /// # Errors
    /// [`PortError`].
    #[inline]
    pub fn loan<'a>(&'a mut self, tick: u64, slots: &mut Slots<'a>) -> Result<(), PortError> {
        for (slot, output) in slots.iter_mut().zip(&mut self.outputs) {
            debug_assert!(slot.bytes.is_none(), "a step has each output once");
            if output.publication.is_due(tick) {
                let header = output.publication.header(tick);
                *slot = step::prepared(output.publication.topic, header, output.sender.loan()?);
            }
        }
        Ok(())
    }

    /// Returns the loaned samples without publishing them.
    #[cold]
    pub fn discard_loan(&mut self) {
        for output in &mut self.outputs {
            output.sender.discard_loan();
        }
    }

    /// Publishes the samples that were loaned at `tick`.
    ///
    /// # Errors
    /// [`PortError`].
    #[inline]
    pub fn send(&mut self, tick: u64, crash: CrashPoint) -> Result<(), PortError> {
        for output in &mut self.outputs {
            output.sender.send()?;
            crash.pass(CrashPlace::BetweenPublishes, tick);
        }
        Ok(())
    }
}

fn readers_of(id: ServiceId, schedule: &Schedule) -> Vec<ServiceId> {
    let outputs = id.outputs().iter();
    let readers = outputs.flat_map(|output| schedule.readers(output.topic));
    let mut readers: Vec<_> = readers.map(|(service, _)| service).collect();
    readers.sort_unstable();
    readers.dedup();
    readers
}
