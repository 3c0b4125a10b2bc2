//! iceoryx2 ports, seen as bytes: a host moves samples of every topic with the same code.
//!
//! Samples travel without a copy: an output is written in loaned shared memory, an input is read there and
//! held until a newer one takes its place. In lock-step delivery is lossless for the run's own receivers; any other
//! subscriber (somebody looking at the flight) loses samples instead of blocking it. In real time nobody is waited
//! for: in a full buffer the newest sample takes the place of the oldest.
#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for promises about memory layout that only `unsafe` can give"
)]

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample as Received;
use iceoryx2::sample_mut::SampleMut as Loaned;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as TopicService;
use shared_types::wiring::TopicVisitor;
use shared_types::{Sample, Schedule, ServiceId, Topic};

use crate::doorbell::Doorbell;
use crate::shared_memory;
use crate::shared_page::{Owner, SharedPage};

/// Places of the recorder's buffer of each topic: some ten milliseconds of the fastest flight.
pub const RECORDER_BUFFER: usize = 1024;

/// Subscribers of a topic beside the run's own: for people who look at a flight with other tools.
const OBSERVERS: usize = 2;

/// Name of the service attribute that carries the layout hash.
pub(crate) const LAYOUT_ATTRIBUTE: &str = "layout";

/// Why a port cannot be made or used.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The run's iceoryx2 configuration cannot be loaded.
    #[error("cannot load the iceoryx2 configuration of the run from {path}: {reason}")]
    Configuration {
        /// The file.
        path: String,
        /// What iceoryx2 says.
        reason: String,
    },
    /// The process cannot take part in the run.
    #[error("cannot join the run's shared memory: {0}; is /dev/shm full or not writable?")]
    Node(String),
    /// The topic cannot be made or opened.
    #[error(
        "cannot open the topic `{topic}`: {reason}; \
         if the types differ, all processes of a run must come from one build"
    )]
    Open {
        /// The topic.
        topic: Topic,
        /// What iceoryx2 says.
        reason: String,
    },
    /// A port of the topic cannot be made.
    #[error("cannot make a port of the topic `{topic}`: {reason}")]
    Create {
        /// The topic.
        topic: Topic,
        /// What iceoryx2 says.
        reason: String,
    },
    /// A sample could not be loaned, sent or received.
    #[error("the topic `{topic}` failed in flight: {reason}")]
    Transport {
        /// The topic.
        topic: Topic,
        /// What iceoryx2 says.
        reason: String,
    },
    /// The run is ending while a receiver's buffer is full.
    #[error("the run is ending")]
    Stopping,
}

/// A sample type as iceoryx2 sees it: with its name in the log instead of its path in Rust.
#[repr(transparent)]
struct Wire<T>(T);

impl<T: Sample> std::fmt::Debug for Wire<T> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(T::MSG_NAME)
    }
}

// SAFETY: a `Sample` is `repr(C)`, without padding, pointers or invalid bit patterns (zerocopy's derives prove
// it), and the name stands for exactly this layout: the layout hash is compared besides.
unsafe impl<T: Sample> ZeroCopySend for Wire<T> {
    unsafe fn type_name() -> &'static str {
        T::MSG_NAME
    }
}

/// The configuration file of the run that this process belongs to: iceoryx2 keeps one for the whole process.
static RUN: OnceLock<PathBuf> = OnceLock::new();

/// A process's membership in the run.
pub struct Member {
    node: Node<ipc::Service>,
    /// What the names of the run's shared memory begin with.
    prefix: String,
}

impl Member {
    /// Joins the run of the given iceoryx2 configuration file. Must be the process's first use of iceoryx2:
    /// cleaning up after the dead falls back to the global configuration, whatever a node was given.
    ///
    /// # Errors
    /// [`PortError::Configuration`] or [`PortError::Node`].
    pub fn join(configuration: &Path, name: &str) -> Result<Self, PortError> {
        set_log_level_from_env_or(LogLevel::Fatal);
        let bad_configuration = |reason: String| PortError::Configuration {
            path: configuration.display().to_string(),
            reason,
        };
        let path = FilePath::new(configuration.as_os_str().as_encoded_bytes())
            .map_err(|error| bad_configuration(format!("{error:?}")))?;
        if RUN.get_or_init(|| configuration.to_owned()) != configuration {
            return Err(bad_configuration(
                "this process already belongs to another run".to_owned(),
            ));
        }
        let mut config = Config::setup_global_config_from_file(&path)
            .map_err(|error| bad_configuration(format!("{error:?}")))?
            .clone();
        // The orchestrator alone cleans up after the dead, and knows when: nobody looks for them besides, which
        // takes longer than all else at every topic.
        config.global.service.cleanup_dead_nodes_on_open = false;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        let name = NodeName::new(name).map_err(|error| PortError::Node(format!("{error:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| PortError::Node(error.to_string()))?;
        Ok(Self {
            node,
            prefix: config.global.prefix.to_string(),
        })
    }

    /// For ports that carry no topic of the wiring table.
    #[must_use]
    pub fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    /// Frees what processes that have died held of the run. They must have been waited for.
    pub fn clean_up_after_the_dead(&self) {
        shared_memory::without_waiting_for_the_unfinished(&self.prefix, || {
            // What cannot be freed now is tried again after the next death, and goes with the run at the latest.
            self.node.try_cleanup_dead_nodes();
        });
        self.remove_unfinished();
    }

    /// Removes shared memory of the run that the dead had only begun to make, and for which others may be waiting.
    pub fn remove_unfinished(&self) {
        shared_memory::remove_unfinished(&self.prefix);
    }

    /// Makes the topic; the orchestrator does so before any service starts.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn create_topic(
        &self,
        topic: Topic,
        schedule: &Schedule,
        delivery: Delivery,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        self.enter(topic, None, schedule, Access::Create(delivery))
    }

    /// Makes a topic of the replay of a service, which nobody has but that one and the orchestrator.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn create_replayed_topic(
        &self,
        topic: Topic,
        replayed: ServiceId,
        schedule: &Schedule,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        // A loss would be noticed, by whoever misses what was ordered.
        let access = Access::Create(Delivery::NewestWins);
        self.enter(topic, Some(replayed), schedule, access)
    }

    /// Opens a topic that the orchestrator has made, if its layout is the one of this build.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open_topic(&self, topic: Topic, schedule: &Schedule) -> Result<Box<dyn TopicPorts>, PortError> {
        self.enter(topic, None, schedule, Access::Open)
    }

    fn enter(
        &self,
        topic: Topic,
        replayed: Option<ServiceId>,
        schedule: &Schedule,
        access: Access,
    ) -> Result<Box<dyn TopicPorts>, PortError> {
        topic.dispatch(Enter {
            member: self,
            topic,
            replayed,
            consumer_buffer: consumer_buffer(schedule, topic),
            access,
        })
    }
}

/// The topics that a service has opened, each once.
pub struct Topics([Option<Box<dyn TopicPorts>>; Topic::ALL.len()]);

impl Topics {
    /// Opens all topics that a service publishes or consumes. The dead that it follows may still have their ports.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open(member: &Member, service: ServiceId, schedule: &Schedule) -> Result<Self, PortError> {
        Self::open_each(service, |topic| member.open_topic(topic, schedule))
    }

    /// Opens the topics of the replay of a service.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open_replayed(
        member: &Member,
        service: ServiceId,
        schedule: &Schedule,
    ) -> Result<Self, PortError> {
        Self::open_each(service, |topic| {
            member.enter(topic, Some(service), schedule, Access::Open)
        })
    }

    fn open_each(
        service: ServiceId,
        open: impl Fn(Topic) -> Result<Box<dyn TopicPorts>, PortError>,
    ) -> Result<Self, PortError> {
        let inputs = service.inputs().iter().map(|input| input.topic);
        let outputs = service.outputs().iter().map(|output| output.topic);
        let mut topics = Self([const { None }; Topic::ALL.len()]);
        for topic in inputs.chain(outputs) {
            topics.0[topic.index()] = Some(open(topic)?);
        }
        Ok(topics)
    }

    /// A topic of the service.
    ///
    /// # Panics
    /// If it is not.
    #[must_use]
    pub fn of(&self, topic: Topic) -> &dyn TopicPorts {
        let ports = self.0[topic.index()].as_deref();
        ports.expect("all topics of the service are open")
    }
}

/// Places of a consumer's buffer of a topic.
pub(crate) fn consumer_buffer(schedule: &Schedule, topic: Topic) -> usize {
    usize::try_from(schedule.buffer_size(topic)).map_or(RECORDER_BUFFER, |size| size.min(RECORDER_BUFFER))
}

/// What becomes of a sample for which a receiver has no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// Its publisher waits until there is.
    Lossless,
    /// It takes the place of the oldest that has not been received.
    NewestWins,
}

/// A topic that has been opened, ready to make ports of it.
pub trait TopicPorts {
    /// Makes the publisher. `page` tells which receivers it waits for when their buffers are full, and when the
    /// run is ending and it shall wait for nobody; by the `doorbells` it wakes whom it waits for.
    ///
    /// # Errors
    /// [`PortError::Create`].
    fn sender(&self, page: Arc<SharedPage>, doorbells: Arc<[Doorbell]>)
    -> Result<Box<dyn Sender>, PortError>;

    /// Makes the publisher of a topic in which the newest sample wins. It waits for nobody.
    ///
    /// # Errors
    /// [`PortError::Create`].
    fn newest_sender(&self) -> Result<Box<dyn Sender>, PortError>;

    /// Makes a consumer's subscriber, its buffer sized by the schedule.
    ///
    /// # Errors
    /// [`PortError::Create`].
    fn receiver(&self) -> Result<Box<dyn Receiver>, PortError>;

    /// Makes the recorder's subscriber, with the largest buffer.
    ///
    /// # Errors
    /// [`PortError::Create`].
    fn recorder(&self) -> Result<Box<dyn Receiver>, PortError>;
}

/// A publisher, in bytes.
pub trait Sender {
    /// Loans the place of the next sample. Its content is that of some earlier sample.
    ///
    /// # Errors
    /// [`PortError::Transport`].
    fn loan(&mut self) -> Result<&mut [u8], PortError>;

    /// Gives the place of the next sample back, if it has been loaned.
    fn take_back(&mut self);

    /// Sends the loaned sample, waiting for the run's own receivers.
    ///
    /// # Errors
    /// [`PortError::Transport`], or [`PortError::Stopping`] if the run ends while a buffer is full.
    fn send(&mut self) -> Result<(), PortError>;

    /// Connects to all receivers that exist by now.
    ///
    /// # Errors
    /// [`PortError::Transport`].
    fn connect(&mut self) -> Result<(), PortError>;
}

/// A subscriber, in bytes.
pub trait Receiver {
    /// Takes the next sample, if there is one; it replaces the held one.
    ///
    /// # Errors
    /// [`PortError::Transport`].
    fn receive(&mut self) -> Result<bool, PortError>;

    /// The sample held.
    fn held(&self) -> Option<&[u8]>;

    /// The port's id, by which publishers know the run's own receivers.
    fn id(&self) -> u128;

    /// Connects to all publishers that exist by now.
    ///
    /// # Errors
    /// [`PortError::Transport`].
    fn connect(&mut self) -> Result<(), PortError>;
}

/// How a process comes to a topic.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Access {
    /// It makes it.
    Create(Delivery),
    /// It expects it to be there, with the layout of this build.
    Open,
}

struct Enter<'a> {
    member: &'a Member,
    topic: Topic,
    /// The service in whose replay the topic is, if it is in one.
    replayed: Option<ServiceId>,
    consumer_buffer: usize,
    access: Access,
}

struct Ports<T: Sample> {
    service: TopicService<ipc::Service, Wire<T>, ()>,
    topic: Topic,
    consumer_buffer: usize,
}

fn open_error(topic: Topic) -> impl Fn(&dyn std::fmt::Debug) -> PortError {
    move |reason| PortError::Open {
        topic,
        reason: format!("{reason:?}"),
    }
}

impl TopicVisitor for Enter<'_> {
    type Result = Result<Box<dyn TopicPorts>, PortError>;

    fn visit<T: Sample>(self) -> Self::Result {
        let Self {
            member,
            topic,
            replayed,
            consumer_buffer,
            access,
        } = self;
        let error = open_error(topic);
        let name = match replayed {
            None => ServiceName::new(topic.name()),
            Some(service) => ServiceName::new(&format!("replay/{service}/{topic}")),
        };
        let name = name.map_err(|reason| error(&reason))?;
        let (key, hash) = layout_attribute::<T>(&error)?;
        let builder = member.node.service_builder(&name).publish_subscribe::<Wire<T>>();
        let service = match access {
            Access::Create(delivery) => {
                let specifier = AttributeSpecifier::new();
                let attributes = specifier.define(&key, &hash).map_err(|reason| error(&reason))?;
                let consumers = topic.consumers().count();
                // The publisher, the consumers, each beside the dead one whose place it takes, and the recorder.
                let members = 2 * (1 + consumers) + 1;
                builder
                    .enable_safe_overflow(delivery == Delivery::NewestWins)
                    .history_size(0)
                    .max_publishers(1)
                    .max_subscribers(consumers + 1 + OBSERVERS)
                    .max_nodes(members + OBSERVERS)
                    .subscriber_max_buffer_size(RECORDER_BUFFER)
                    .subscriber_max_borrowed_samples(2)
                    .create_with_attributes(&attributes)
                    .map_err(|reason| error(&reason))?
            }
            Access::Open => {
                let verifier = AttributeVerifier::new();
                let attributes = verifier.require(&key, &hash).map_err(|reason| error(&reason))?;
                builder
                    .open_with_attributes(&attributes)
                    .map_err(|reason| error(&reason))?
            }
        };
        Ok(Box::new(Ports::<T> {
            service,
            topic,
            consumer_buffer,
        }))
    }
}

type Attribute = (
    iceoryx2::service::attribute::AttributeKey,
    iceoryx2::service::attribute::AttributeValue,
);

fn layout_attribute<T: Sample>(
    error: &dyn Fn(&dyn std::fmt::Debug) -> PortError,
) -> Result<Attribute, PortError> {
    let hash = shared_types::sample::layout_hash::<T>();
    Ok((
        LAYOUT_ATTRIBUTE.try_into().map_err(|reason| error(&reason))?,
        hash.as_str().try_into().map_err(|reason| error(&reason))?,
    ))
}

impl<T: Sample> Ports<T> {
    fn not_created(&self, reason: &dyn std::fmt::Display) -> PortError {
        PortError::Create {
            topic: self.topic,
            reason: reason.to_string(),
        }
    }

    fn typed_sender(&self, publisher: Publisher<ipc::Service, Wire<T>, ()>) -> Box<dyn Sender> {
        Box::new(TypedSender::<T> {
            publisher,
            loaned: None,
            topic: self.topic,
        })
    }

    fn receiver_of_size(&self, buffer_size: usize) -> Result<Box<dyn Receiver>, PortError> {
        let subscriber = self
            .service
            .subscriber_builder()
            .buffer_size(buffer_size)
            .create()
            .map_err(|reason| self.not_created(&reason))?;
        Ok(Box::new(TypedReceiver::<T> {
            subscriber,
            held: None,
            topic: self.topic,
        }))
    }
}

impl<T: Sample> TopicPorts for Ports<T> {
    fn sender(
        &self,
        page: Arc<SharedPage>,
        doorbells: Arc<[Doorbell]>,
    ) -> Result<Box<dyn Sender>, PortError> {
        let publisher = self
            .service
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(move |full: &BackpressureInfo| {
                let words = page.words();
                let Some(owner) = words.owner(full.receiver_port_id) else {
                    return BackpressureAction::DiscardData;
                };
                if words.stopping.load(Ordering::Relaxed) != 0 {
                    return BackpressureAction::DiscardDataAndFail;
                }
                if let Owner::Service(service) = owner {
                    // It sleeps for a later sample, or is out as planned: it makes room when it looks.
                    doorbells[service.index()].ring();
                }
                BackpressureAction::Retry
            })
            .create()
            .map_err(|reason| self.not_created(&reason))?;
        Ok(self.typed_sender(publisher))
    }

    fn newest_sender(&self) -> Result<Box<dyn Sender>, PortError> {
        let publisher = self
            .service
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|reason| self.not_created(&reason))?;
        Ok(self.typed_sender(publisher))
    }

    fn receiver(&self) -> Result<Box<dyn Receiver>, PortError> {
        self.receiver_of_size(self.consumer_buffer)
    }

    fn recorder(&self) -> Result<Box<dyn Receiver>, PortError> {
        self.receiver_of_size(RECORDER_BUFFER)
    }
}

struct TypedSender<T: Sample> {
    // Before the publisher, so that a loaned sample is returned to a publisher that still is.
    loaned: Option<Loaned<ipc::Service, Wire<T>, ()>>,
    publisher: Publisher<ipc::Service, Wire<T>, ()>,
    topic: Topic,
}

impl<T: Sample> Sender for TypedSender<T> {
    #[inline]
    fn loan(&mut self) -> Result<&mut [u8], PortError> {
        let sample = self
            .publisher
            .loan_uninit()
            .map_err(|reason| PortError::Transport {
                topic: self.topic,
                reason: reason.to_string(),
            })?;
        // SAFETY: mapped shared memory always holds some bytes, and a `Sample` is valid for any (`FromBytes`).
        let sample = unsafe { sample.assume_init() };
        Ok(self.loaned.insert(sample).payload_mut().0.as_mut_bytes())
    }

    fn take_back(&mut self) {
        self.loaned = None;
    }

    #[inline]
    fn send(&mut self) -> Result<(), PortError> {
        use iceoryx2::port::SendError;
        let Some(sample) = self.loaned.take() else {
            return Ok(());
        };
        sample.send().map(drop).map_err(|reason| match reason {
            SendError::UnableToDeliver => PortError::Stopping,
            reason => PortError::Transport {
                topic: self.topic,
                reason: reason.to_string(),
            },
        })
    }

    fn connect(&mut self) -> Result<(), PortError> {
        self.publisher
            .update_connections()
            .map_err(|reason| PortError::Transport {
                topic: self.topic,
                reason: reason.to_string(),
            })
    }
}

struct TypedReceiver<T: Sample> {
    held: Option<Received<ipc::Service, Wire<T>, ()>>,
    subscriber: Subscriber<ipc::Service, Wire<T>, ()>,
    topic: Topic,
}

impl<T: Sample> Receiver for TypedReceiver<T> {
    #[inline]
    fn receive(&mut self) -> Result<bool, PortError> {
        match self.subscriber.receive() {
            Ok(None) => Ok(false),
            Ok(sample) => {
                self.held = sample;
                Ok(true)
            }
            Err(reason) => Err(PortError::Transport {
                topic: self.topic,
                reason: reason.to_string(),
            }),
        }
    }

    #[inline]
    fn held(&self) -> Option<&[u8]> {
        self.held.as_ref().map(|sample| sample.payload().0.as_bytes())
    }

    fn id(&self) -> u128 {
        self.subscriber.id().value()
    }

    fn connect(&mut self) -> Result<(), PortError> {
        self.subscriber
            .update_connections()
            .map_err(|reason| PortError::Transport {
                topic: self.topic,
                reason: reason.to_string(),
            })
    }
}
