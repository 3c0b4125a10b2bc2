//! iceoryx2 ports in bytes: a host moves samples of every topic with the same code.
//!
//! Samples travel without a copy: an output is written in loaned shared memory, an input is read there and held until a
//! newer one replaces it. In lock step, delivery is lossless for the receivers of the run; any other subscriber (an
//! observer of the flight) loses samples instead of blocking it. In real time, publishers wait for no receiver: in a
//! full buffer the newest sample replaces the oldest.

mod bare;
mod connections;
mod run_node;
mod topic;
mod typed;

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use shared_types::{Schedule, ServiceId, Topic};

use crate::doorbell::Doorbell;
use crate::shared_page::SharedPage;

pub use bare::{BareEvent, BareListener, BareNotifier, BarePorts};
pub use run_node::RunNode;

/// Capacity of the recorder's buffer of each topic: some ten milliseconds of the fastest flight.
pub const RECORDER_BUFFER: usize = 1024;

/// Subscribers of a topic besides those of the run, for third-party tools.
const OBSERVERS: usize = 2;

/// Maximum number of samples that a subscriber holds.
pub const MAX_BORROWED: usize = 2;

/// Maximum number of samples that a publisher has loaned.
pub const MAX_LOANED: usize = 2;

/// Returns the maximum number of subscribers of a topic: its consumers, the recorder, and observers.
#[must_use]
pub fn max_subscribers(topic: Topic) -> usize {
    topic.consumers().count() + 1 + OBSERVERS
}

/// Name of the service attribute that carries the layout hash.
pub(crate) const LAYOUT_ATTRIBUTE: &str = "layout";

/// An error of iceoryx2, which has one type for each operation.
type Cause = Box<dyn Error + Send + Sync>;

/// Failure to make or use a port.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The run's iceoryx2 configuration cannot be loaded.
    #[error("cannot load the iceoryx2 configuration of the run from {}: {source}", .path.display())]
    Configuration {
        /// The file.
        path: PathBuf,
        /// The error of iceoryx2.
        source: Cause,
    },
    /// The process cannot join the run.
    #[error("cannot join the run's shared memory: {0}")]
    Node(#[source] Cause),
    /// The topic cannot be made or opened.
    #[error("cannot open the topic `{topic}`: {source}")]
    Open {
        /// The topic.
        topic: Topic,
        /// The error of iceoryx2.
        source: Cause,
    },
    /// The topic exists with samples of another layout.
    #[error(
        "cannot open the topic `{topic}`: {source}: it carries another type; all processes of a run must come from one build"
    )]
    OtherLayout {
        /// The topic.
        topic: Topic,
        /// The error of iceoryx2.
        source: PublishSubscribeOpenError,
    },
    /// A port of the topic cannot be made.
    #[error("cannot make a port of the topic `{topic}`: {source}")]
    Create {
        /// The topic.
        topic: Topic,
        /// The error of iceoryx2.
        source: Cause,
    },
    /// A port cannot be connected to that of another process of the run.
    #[error("cannot connect a port of the topic `{topic}` to that of another process: {source}")]
    Unconnected {
        /// The topic.
        topic: Topic,
        /// The last error of the system.
        source: Cause,
    },
    /// A sample could not be loaned, sent or received.
    #[error("the topic `{topic}` failed in flight: {source}")]
    Transport {
        /// The topic.
        topic: Topic,
        /// The error of iceoryx2.
        source: Cause,
    },
    /// The run is ending while a receiver's buffer is full.
    #[error("the run is ending")]
    Stopping,
}

/// Open topics of a service.
pub struct Topics([Option<Box<dyn TopicPorts>>; Topic::ALL.len()]);

impl Topics {
    /// Opens all topics that a service publishes or consumes. Its dead predecessor may still have ports of them.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open(node: &RunNode, service: ServiceId, schedule: &Schedule) -> Result<Self, PortError> {
        let inputs = schedule.inputs_read(service).map(|(_, input)| input.topic);
        Self::open_each(service, schedule, inputs, |topic| {
            node.open_topic(topic, schedule)
        })
    }

    /// Opens the topics of the replay of a service.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open_replayed(node: &RunNode, service: ServiceId, schedule: &Schedule) -> Result<Self, PortError> {
        let inputs = service.inputs().iter().map(|input| input.topic);
        Self::open_each(service, schedule, inputs, |topic| {
            node.open_replayed_topic(topic, service, schedule)
        })
    }

    fn open_each(
        service: ServiceId,
        schedule: &Schedule,
        inputs: impl Iterator<Item = Topic>,
        open: impl Fn(Topic) -> Result<Box<dyn TopicPorts>, PortError>,
    ) -> Result<Self, PortError> {
        let outputs = schedule.outputs(service).map(|output| output.topic);
        let mut topics = Self([const { None }; Topic::ALL.len()]);
        for topic in inputs.chain(outputs) {
            topics.0[topic.index()] = Some(open(topic)?);
        }
        Ok(topics)
    }

    /// Returns a topic that the service publishes or consumes.
    ///
    /// # Panics
    /// If the service has not opened it.
    #[must_use]
    pub fn ports(&self, topic: Topic) -> &dyn TopicPorts {
        let ports = self.0[topic.index()].as_deref();
        ports.expect("all topics of the service are open")
    }
}

/// Returns the capacity of a consumer's buffer of a topic.
pub(crate) fn consumer_buffer(schedule: &Schedule, topic: Topic) -> usize {
    usize::try_from(schedule.buffer_size(topic)).map_or(RECORDER_BUFFER, |size| size.min(RECORDER_BUFFER))
}

/// Delivery of a sample to a receiver whose buffer is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The publisher waits.
    Lossless,
    /// The sample replaces the oldest one in the buffer.
    NewestWins,
}

/// Opened topic, ready to make its ports.
pub trait TopicPorts {
    /// Makes the publisher. It waits for a full buffer only of the receivers that `page` lists, and for none when the run
    /// ends. It wakes the receivers by the `doorbells`.
    ///
    /// # Errors
    /// [`PortError::Create`] or [`PortError::Unconnected`].
    fn sender(&self, page: Arc<SharedPage>, doorbells: Arc<[Doorbell]>)
    -> Result<Box<dyn Sender>, PortError>;

    /// Makes the publisher of a topic in which the newest sample wins; it never waits.
    ///
    /// # Errors
    /// [`PortError::Create`] or [`PortError::Unconnected`].
    fn newest_sender(&self) -> Result<Box<dyn Sender>, PortError>;

    /// Makes a consumer's subscriber, its buffer sized by the schedule.
    ///
    /// # Errors
    /// [`PortError::Create`] or [`PortError::Unconnected`].
    fn receiver(&self) -> Result<Box<dyn Receiver>, PortError>;

    /// Makes a subscriber with a buffer of this capacity, at most [`RECORDER_BUFFER`], for the recorder or a service that
    /// catches up with late steps.
    ///
    /// # Errors
    /// [`PortError::Create`] or [`PortError::Unconnected`].
    fn recorder(&self, capacity: usize) -> Result<Box<dyn Receiver>, PortError>;
}

/// Publisher, in bytes.
pub trait Sender {
    /// Loans memory for the next sample. It holds an earlier sample.
    ///
    /// # Errors
    /// [`PortError::Transport`].
    fn loan(&mut self) -> Result<&mut [u8], PortError>;

    /// Returns the loaned memory, if any, unpublished.
    fn discard_loan(&mut self);

    /// Sends the loaned sample, and waits for the receivers of the run.
    ///
    /// # Errors
    /// [`PortError::Transport`], [`PortError::Unconnected`], or [`PortError::Stopping`] if the run ends while a buffer is full.
    fn send(&mut self) -> Result<(), PortError>;

    /// Connects to all existing receivers.
    ///
    /// # Errors
    /// [`PortError::Transport`] or [`PortError::Unconnected`].
    fn connect(&mut self) -> Result<(), PortError>;
}

/// Subscriber, in bytes.
pub trait Receiver {
    /// Receives the next sample, if there is one; it replaces the held one.
    ///
    /// # Errors
    /// [`PortError::Transport`] or [`PortError::Unconnected`].
    fn receive(&mut self) -> Result<bool, PortError>;

    /// Returns the held sample.
    fn held(&self) -> Option<&[u8]>;

    /// Returns the port's id, by which publishers identify the receivers of the run.
    fn id(&self) -> u128;

    /// Connects to all existing publishers.
    ///
    /// # Errors
    /// [`PortError::Transport`] or [`PortError::Unconnected`].
    fn connect(&mut self) -> Result<(), PortError>;
}
