//! The recorder's ports: one subscriber a topic.

use runtime::ports::{PortError, Receiver, TopicPorts};
use shared_types::Topic;

/// The recorder's subscriber of a topic.
pub struct Subscription {
    /// The topic.
    pub topic: Topic,
    /// What comes of it.
    pub receiver: Box<dyn Receiver>,
    /// Holds the topic: services can open it as long as somebody does.
    _ports: Box<dyn TopicPorts>,
}

impl Subscription {
    /// Subscribes to every topic that a service publishes, made or opened by `enter`.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn to_all(
        enter: impl Fn(Topic) -> Result<Box<dyn TopicPorts>, PortError>,
    ) -> Result<Vec<Self>, PortError> {
        let published = Topic::ALL.into_iter().filter(|topic| topic.publisher().is_some());
        let subscribe = |topic| {
            let ports = enter(topic)?;
            Ok(Self {
                topic,
                receiver: ports.recorder()?,
                _ports: ports,
            })
        };
        published.map(subscribe).collect()
    }
}
