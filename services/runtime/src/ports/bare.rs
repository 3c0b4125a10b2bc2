//! Ports through iceoryx2's own API: no page, no doorbells, no errors of Gerono's. The floors of flight, for benchmarks.
//!
//! Beside the ports of flights, because iceoryx2's code for each sample type is half of what this crate costs to compile:
//! another crate would compile all of it again.

use std::error::Error;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample as Received;
use iceoryx2::service::builder::event::Builder as EventBuilder;
use iceoryx2::service::port_factory::event::PortFactory as EventService;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::wiring::TopicVisitor;
use shared_types::{Published, Schedule, ServiceId, Topic};

use super::RunNode;
use super::typed::Wire;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// A service's subscribers and publishers.
pub struct BarePorts {
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
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn open(node: &RunNode, service: ServiceId, schedule: &Schedule) -> Outcome<Self> {
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

    /// Connects the ports, once all of the run exist.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn connect(&mut self) -> Outcome<()> {
        self.inputs
            .iter_mut()
            .try_for_each(|input| input.port.connect())?;
        self.outputs.iter_mut().try_for_each(|output| output.connect())
    }

    /// Receives one sample of each input and holds it until the next one. `late_too` is `false` in the first round, in which late
    /// inputs have no sample yet.
    ///
    /// # Errors
    /// Those of iceoryx2, and an input without a sample.
    #[inline]
    pub fn receive(&mut self, late_too: bool) -> Outcome<()> {
        for input in &mut self.inputs {
            if late_too || !input.is_late {
                input.port.receive()?;
            }
        }
        Ok(())
    }

    /// Publishes one sample of each output.
    ///
    /// # Errors
    /// Those of iceoryx2.
    #[inline]
    pub fn publish(&mut self) -> Outcome<()> {
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

/// An event that one process sends to another one.
pub struct BareEvent(EventService<ipc::Service>);

impl BareEvent {
    /// Creates the event of a name.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn create(node: &RunNode, name: &str) -> Outcome<Self> {
        Ok(Self(Self::builder(node, name)?.create()?))
    }

    /// Opens the event of a name.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn open(node: &RunNode, name: &str) -> Outcome<Self> {
        Ok(Self(Self::builder(node, name)?.open()?))
    }

    fn builder(node: &RunNode, name: &str) -> Outcome<EventBuilder<ipc::Service>> {
        Ok(node.node().service_builder(&ServiceName::new(name)?).event())
    }

    /// Makes the port that sends it.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn notifier(&self) -> Outcome<BareNotifier> {
        Ok(BareNotifier(self.0.notifier_builder().create()?))
    }

    /// Makes the port that waits for it.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn listener(&self) -> Outcome<BareListener> {
        Ok(BareListener(self.0.listener_builder().create()?))
    }
}

/// Port that sends an event.
pub struct BareNotifier(Notifier<ipc::Service>);

impl BareNotifier {
    /// Sends the event.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn notify(&self) -> Outcome<()> {
        self.0.notify()?;
        Ok(())
    }
}

/// Port that waits for an event.
pub struct BareListener(Listener<ipc::Service>);

impl BareListener {
    /// Waits for the event, up to a time.
    ///
    /// # Errors
    /// Those of iceoryx2.
    pub fn wait(&self, limit: Duration) -> Outcome<()> {
        self.0.timed_wait(|_| (), limit)?;
        Ok(())
    }
}
