//! The ports of one service through iceoryx2's own API, for the floor of lock-step flight.

use std::error::Error;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample as Received;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use runtime::ports::{RunNode, Wire};
use shared_types::wiring::TopicVisitor;
use shared_types::{Published, Schedule, ServiceId, Topic};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// A service's subscribers and publishers.
pub(super) struct BarePorts {
    inputs: Vec<Input>,
    outputs: Vec<Box<dyn Publish>>,
}

struct Input {
    port: Box<dyn Subscribe>,
    /// `true` if its sample is that of the previous round.
    is_late: bool,
}

impl BarePorts {
    /// Opens the topics that a service publishes or reads in a flight of this schedule.
    pub(super) fn open(node: &RunNode, service: ServiceId, schedule: &Schedule) -> Outcome<Self> {
        let inputs = schedule.inputs_read(service).map(|(input, spec)| {
            let buffer = usize::try_from(schedule.buffer_size(spec.topic))?;
            Ok(Input {
                port: spec.topic.dispatch(Subscriptions {
                    node,
                    topic: spec.topic,
                    buffer,
                })?,
                is_late: schedule.edge(service, input).latency > 0,
            })
        });
        let outputs = schedule.outputs(service).map(|output| {
            let topic = output.topic;
            topic.dispatch(Publications { node, topic })
        });
        Ok(Self {
            inputs: inputs.collect::<Outcome<_>>()?,
            outputs: outputs.collect::<Outcome<_>>()?,
        })
    }

    pub(super) fn connect(&mut self) -> Outcome<()> {
        self.inputs
            .iter_mut()
            .try_for_each(|input| input.port.connect())?;
        self.outputs.iter_mut().try_for_each(|output| output.connect())
    }

    /// Receives one sample of each input and holds it until the next one. `late_too` is `false` in the first round, in which late
    /// inputs have no sample yet.
    #[inline]
    pub(super) fn receive(&mut self, late_too: bool) -> Outcome<()> {
        for input in &mut self.inputs {
            if late_too || !input.is_late {
                input.port.receive()?;
            }
        }
        Ok(())
    }

    /// Publishes one sample of each output.
    #[inline]
    pub(super) fn publish(&mut self) -> Outcome<()> {
        self.outputs.iter_mut().try_for_each(|output| output.publish())
    }
}

trait Subscribe {
    fn connect(&mut self) -> Outcome<()>;
    fn receive(&mut self) -> Outcome<()>;
}

trait Publish {
    fn connect(&mut self) -> Outcome<()>;
    fn publish(&mut self) -> Outcome<()>;
}

struct Held<T: Published> {
    sample: Option<Received<ipc::Service, Wire<T>, ()>>,
    subscriber: Subscriber<ipc::Service, Wire<T>, ()>,
}

impl<T: Published> Subscribe for Held<T> {
    fn connect(&mut self) -> Outcome<()> {
        Ok(self.subscriber.update_connections()?)
    }

    #[inline]
    fn receive(&mut self) -> Outcome<()> {
        self.sample = self.subscriber.receive()?;
        if self.sample.is_none() {
            return Err(format!("no sample of {} was received", T::TOPIC).into());
        }
        Ok(())
    }
}

impl<T: Published> Publish for Publisher<ipc::Service, Wire<T>, ()> {
    fn connect(&mut self) -> Outcome<()> {
        Ok(self.update_connections()?)
    }

    #[inline]
    fn publish(&mut self) -> Outcome<()> {
        let sample = self.loan_uninit()?;
        sample.write_payload(Wire(T::new_zeroed())).send()?;
        Ok(())
    }
}

fn topic<T: Published>(node: &RunNode, topic: Topic) -> Outcome<PortFactory<ipc::Service, Wire<T>, ()>> {
    let name = ServiceName::new(topic.name())?;
    let builder = node.node().service_builder(&name);
    Ok(builder.publish_subscribe::<Wire<T>>().open()?)
}

struct Subscriptions<'a> {
    node: &'a RunNode,
    topic: Topic,
    buffer: usize,
}

impl TopicVisitor for Subscriptions<'_> {
    type Result = Outcome<Box<dyn Subscribe>>;

    fn visit<T: Published>(self) -> Self::Result {
        let service = topic::<T>(self.node, self.topic)?;
        let subscriber = service.subscriber_builder().buffer_size(self.buffer).create()?;
        let sample = None;
        Ok(Box::new(Held { sample, subscriber }))
    }
}

struct Publications<'a> {
    node: &'a RunNode,
    topic: Topic,
}

impl TopicVisitor for Publications<'_> {
    type Result = Outcome<Box<dyn Publish>>;

    fn visit<T: Published>(self) -> Self::Result {
        let service = topic::<T>(self.node, self.topic)?;
        let publisher = service
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::RetryUntilDelivered)
            .create()?;
        Ok(Box::new(publisher))
    }
}
