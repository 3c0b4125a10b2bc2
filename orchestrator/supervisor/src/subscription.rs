//! Ports of the recorder: one subscriber for each topic.

use std::rc::Rc;

use runtime::flight_clock::FlightClock;
use runtime::ports::{PortError, Receiver, TopicPorts};
use runtime::untrusted::{Refusals, UntrustedReceiver};
use shared_types::ExternalServices;
use shared_types::{Schedule, Topic};

/// Subscriber of a topic.
pub struct Subscription {
    pub topic: Topic,
    pub receiver: Box<dyn Receiver>,
    /// Samples of an external program that were refused in real time.
    pub refusals: Rc<Refusals>,
    /// Keeps the topic alive: services can open it while any process holds it.
    _ports: Box<dyn TopicPorts>,
}

impl Subscription {
    /// Subscribes to every published topic, which `enter` creates or opens, with buffers of `places` samples.
    ///
    /// # Errors
    /// The first [`PortError`].
    pub fn to_all(
        schedule: &Schedule,
        enter: impl Fn(Topic) -> Result<Box<dyn TopicPorts>, PortError>,
        places: impl Fn(Topic) -> usize,
    ) -> Result<Vec<Self>, PortError> {
        let subscribe = |topic| {
            let ports = enter(topic)?;
            Ok(Self {
                topic,
                receiver: ports.recorder(places(topic))?,
                refusals: Rc::default(),
                _ports: ports,
            })
        };
        schedule.published_topics().map(subscribe).collect()
    }

    /// Returns whether an external program publishes the topic.
    #[must_use]
    pub fn is_of(&self, external_services: ExternalServices) -> bool {
        self.topic
            .publisher()
            .is_some_and(|service| external_services[service.index()])
    }

    /// Copies every sample before it is checked.
    #[must_use]
    pub fn distrust(self, schedule: &Schedule) -> Self {
        let receiver = UntrustedReceiver::new(self.receiver, &schedule.publication(self.topic));
        Self {
            receiver: Box::new(receiver),
            ..self
        }
    }

    /// Copies every sample before it is checked, and refuses those that are impossible by the flight's clock.
    #[must_use]
    pub fn distrust_by_the_clock(self, schedule: &Schedule, clock: FlightClock) -> Self {
        let publication = schedule.publication(self.topic);
        let receiver = UntrustedReceiver::new(self.receiver, &publication).within_clock(
            publication,
            schedule.last_tick(),
            move || clock.tick(),
        );
        Self {
            refusals: receiver.refusals(),
            receiver: Box::new(receiver),
            ..self
        }
    }
}
