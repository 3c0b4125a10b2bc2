//! Topics as iceoryx2 services: make or open a topic, and make its ports.

use std::error::Error;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use iceoryx2::port::{BackpressureAction, BackpressureInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as TopicService;
use iceoryx2::service::port_factory::publisher::PortFactoryPublisher;
use shared_types::wiring::TopicVisitor;
use shared_types::{Published, ServiceId, Topic};

use super::connections::Connections;
use super::typed::{TypedReceiver, TypedSender, Wire};
use super::{
    Delivery, LAYOUT_ATTRIBUTE, MAX_BORROWED, MAX_LOANED, OBSERVERS, PortError, RECORDER_BUFFER, Receiver,
    Sender, TopicPorts, max_subscribers,
};
use crate::doorbell::Doorbell;
use crate::shared_memory;
use crate::shared_page::{Owner, SharedPage};
use host::watchdog::{self, Work};

/// Access of a process to a topic.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// The process creates the topic.
    Create(Delivery),
    /// The topic must exist with the layout of this build.
    Open,
}

/// Creation or opening of a topic of any sample type.
pub(super) struct Enter<'a> {
    pub(super) node: &'a Node<ipc::Service>,
    pub(super) topic: Topic,
    /// The replayed service, in a replay.
    pub(super) replayed: Option<ServiceId>,
    pub(super) consumer_buffer: usize,
    pub(super) access: Access,
}

/// Name of the ports of a run's processes: those of observers have others.
const OF_THE_RUN: &str = "gerono";

struct Ports<T: Published> {
    service: Rc<TopicService<ipc::Service, Wire<T>, ()>>,
    name: PortName,
    topic: Topic,
    consumer_buffer: usize,
}

fn not_opened(topic: Topic, error: impl Error + Send + Sync + 'static) -> PortError {
    PortError::Open {
        topic,
        source: shared_memory::explained(error),
    }
}

impl TopicVisitor for Enter<'_> {
    type Result = Result<Box<dyn TopicPorts>, PortError>;

    fn visit<T: Published>(self) -> Self::Result {
        let Self {
            node,
            topic,
            replayed,
            consumer_buffer,
            access,
        } = self;
        let name = match replayed {
            None => ServiceName::new(topic.name()),
            Some(service) => ServiceName::new(&format!("replay/{service}/{topic}")),
        };
        let name = name.map_err(|error| not_opened(topic, error))?;
        let (key, hash) = layout_attribute::<T>(topic)?;
        let builder = node.service_builder(&name).publish_subscribe::<Wire<T>>();
        let service = match access {
            Access::Create(delivery) => {
                let specifier = AttributeSpecifier::new();
                let attributes = specifier
                    .define(&key, &hash)
                    .map_err(|error| not_opened(topic, error))?;
                let consumers = topic.consumers().count();
                // The publisher and the consumers, each with a dead predecessor, and the recorder.
                let nodes = 2 * (1 + consumers) + 1;
                builder
                    .enable_safe_overflow(delivery == Delivery::NewestWins)
                    .history_size(0)
                    .max_publishers(1)
                    .max_subscribers(max_subscribers(topic))
                    .max_nodes(nodes + OBSERVERS)
                    .subscriber_max_buffer_size(RECORDER_BUFFER)
                    .subscriber_max_borrowed_samples(MAX_BORROWED)
                    .create_with_attributes(&attributes)
                    .map_err(|error| not_opened(topic, error))?
            }
            Access::Open => {
                let verifier = AttributeVerifier::new();
                let attributes = verifier
                    .require(&key, &hash)
                    .map_err(|error| not_opened(topic, error))?;
                builder.open_with_attributes(&attributes).map_err(|source| {
                    use PublishSubscribeOpenError::{IncompatibleAttributes, IncompatibleTypes};
                    match source {
                        IncompatibleTypes | IncompatibleAttributes => {
                            PortError::OtherLayout { topic, source }
                        }
                        error => not_opened(topic, error),
                    }
                })?
            }
        };
        Ok(Box::new(Ports::<T> {
            service: Rc::new(service),
            name: PortName::new(OF_THE_RUN).map_err(|error| not_opened(topic, error))?,
            topic,
            consumer_buffer,
        }))
    }
}

type Attribute = (
    iceoryx2::service::attribute::AttributeKey,
    iceoryx2::service::attribute::AttributeValue,
);

fn layout_attribute<T: Published>(topic: Topic) -> Result<Attribute, PortError> {
    let hash = shared_types::sample::layout_hash::<T>();
    Ok((
        LAYOUT_ATTRIBUTE
            .try_into()
            .map_err(|error| not_opened(topic, error))?,
        hash.as_str()
            .try_into()
            .map_err(|error| not_opened(topic, error))?,
    ))
}

/// Makes or connects one port as a separate piece of work: the watchdog limits the time without progress, and not the
/// total time for all ports of a service on a busy machine.
pub(super) fn one_port<R>(act: impl FnOnce() -> R) -> R {
    watchdog::during(Work::Ports, act)
}

impl<T: Published> Ports<T> {
    fn not_created(&self, error: impl Error + Send + Sync + 'static) -> PortError {
        PortError::Create {
            topic: self.topic,
            source: shared_memory::explained(error),
        }
    }

    fn receiver_of_size(&self, buffer_size: usize) -> Result<Box<dyn Receiver>, PortError> {
        let service = Rc::clone(&self.service);
        let publishers = move || {
            let mut found = Vec::new();
            service.dynamic_config().list_publishers(|publisher| {
                found.push((publisher.publisher_id.value(), publisher.node_id, true));
                CallbackProgression::Continue
            });
            found
        };
        let connections = Connections::new(self.topic, publishers);
        let builder = self.service.subscriber_builder().buffer_size(buffer_size);
        let builder = builder
            .name(&self.name)
            .set_degradation_handler(connections.handler(|info| info.sender_port_id));
        let subscriber = one_port(|| builder.create()).map_err(|error| self.not_created(error))?;
        connections.check_now()?;
        Ok(Box::new(TypedReceiver::new(subscriber, self.topic, connections)))
    }

    /// Makes a publisher. An unnamed receiver belongs to the run if `is_of_the_run` says so of its id.
    fn sender_to(
        &self,
        builder: PortFactoryPublisher<'_, ipc::Service, Wire<T>, ()>,
        is_of_the_run: impl Fn(u128) -> bool + 'static,
    ) -> Result<Box<dyn Sender>, PortError> {
        let service = Rc::clone(&self.service);
        let subscribers = move || {
            let mut found = Vec::new();
            service.dynamic_config().list_subscribers(|subscriber| {
                let id = subscriber.subscriber_id.value();
                let is_known = subscriber.subscriber_name.as_str() == OF_THE_RUN || is_of_the_run(id);
                found.push((id, subscriber.node_id, is_known));
                CallbackProgression::Continue
            });
            found
        };
        let connections = Connections::new(self.topic, subscribers);
        let builder = builder
            .name(&self.name)
            .max_loaned_samples(MAX_LOANED)
            .set_degradation_handler(connections.handler(|info| info.receiver_port_id));
        let publisher = one_port(|| builder.create()).map_err(|error| self.not_created(error))?;
        connections.check_now()?;
        Ok(Box::new(TypedSender::new(publisher, self.topic, connections)))
    }
}

impl<T: Published> TopicPorts for Ports<T> {
    fn sender(
        &self,
        page: Arc<SharedPage>,
        doorbells: Arc<[Doorbell]>,
    ) -> Result<Box<dyn Sender>, PortError> {
        let run = Arc::clone(&page);
        let builder = self
            .service
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .set_backpressure_handler(move |full: &BackpressureInfo| {
                // iceoryx2 does not limit the wait for a stopped receiver. A new piece of work at each retry keeps the
                // watchdog from ending this process.
                watchdog::work(Work::Step);
                let block = page.control_block();
                let Some(owner) = block.owner(full.receiver_port_id) else {
                    return BackpressureAction::DiscardData;
                };
                if block.stopping.load(Ordering::Relaxed) != 0 {
                    return BackpressureAction::DiscardDataAndFail;
                }
                if let Owner::Service(service) = owner {
                    // The receiver sleeps for a later sample or has a planned outage: it makes room when it is woken.
                    doorbells[service.index()].ring();
                }
                BackpressureAction::Retry
            });
        self.sender_to(builder, move |receiver| {
            run.control_block().owner(receiver).is_some()
        })
    }

    fn newest_sender(&self) -> Result<Box<dyn Sender>, PortError> {
        let builder = self.service.publisher_builder();
        self.sender_to(
            builder.backpressure_strategy(BackpressureStrategy::DiscardData),
            |_| false,
        )
    }

    fn receiver(&self) -> Result<Box<dyn Receiver>, PortError> {
        self.receiver_of_size(self.consumer_buffer)
    }

    fn recorder(&self, capacity: usize) -> Result<Box<dyn Receiver>, PortError> {
        self.receiver_of_size(capacity)
    }
}
