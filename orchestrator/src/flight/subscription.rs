//! The recorder's ports: one subscriber a topic.

use runtime::ports::{Delivery, Member, PortError, Receiver, TopicPorts};
use shared_types::{Schedule, Topic};

/// The recorder's subscriber of a topic, which it has made.
pub struct Subscription {
    /// The topic.
    pub topic: Topic,
    /// What comes of it.
    pub receiver: Box<dyn Receiver>,
    /// Holds the topic: services can open it as long as somebody does.
    _ports: Box<dyn TopicPorts>,
}

impl Subscription {
    /// Makes every topic that a service publishes, and subscribes to it.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn to_all(member: &Member, schedule: &Schedule, delivery: Delivery) -> Result<Vec<Self>, PortError> {
        let published = Topic::ALL.into_iter().filter(|topic| topic.publisher().is_some());
        let subscribe = |topic| {
            let ports = member.create_topic(topic, schedule, delivery)?;
            Ok(Self {
                topic,
                receiver: ports.recorder()?,
                _ports: ports,
            })
        };
        published.map(subscribe).collect()
    }
}
