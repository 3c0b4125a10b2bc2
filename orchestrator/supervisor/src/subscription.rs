//! The recorder's ports: one subscriber a topic.

use std::rc::Rc;

use runtime::flight_clock::FlightClock;
use runtime::ports::{PortError, Receiver, TopicPorts};
use runtime::untrusted::{Refusals, UntrustedReceiver};
use shared_types::ExternalServices;
use shared_types::{Schedule, Topic};

/// The recorder's subscriber of a topic.
pub struct Subscription {
    /// The topic.
    pub topic: Topic,
    /// The receiver of its samples.
    pub receiver: Box<dyn Receiver>,
    /// The refusals of it, if an external program publishes it in real time.
    pub refusals: Rc<Refusals>,
    /// Holds the topic: services can open it as long as a process holds it.
    _ports: Box<dyn TopicPorts>,
}

impl Subscription {
    /// Subscribes to every topic that a service of the flight publishes, made or opened by `enter`, with as many places as `places` says.
    ///
    /// # Errors
    /// [`PortError`].
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

    /// Returns whether one of these external programs publishes the topic.
    #[must_use]
    pub fn is_of(&self, external_services: ExternalServices) -> bool {
        self.topic
            .publisher()
            .is_some_and(|service| external_services[service.index()])
    }

    /// Copies every sample before it is looked at.
    #[must_use]
    pub fn distrust(self, schedule: &Schedule) -> Self {
        let receiver = UntrustedReceiver::new(self.receiver, &schedule.publication(self.topic));
        Self {
            receiver: Box::new(receiver),
            ..self
        }
    }

    /// Copies every sample before it is looked at, and refuses it unless it may be there by the flight's clock.
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
