//! The server's part of the Foxglove WebSocket protocol: all topics in their recorded encoding.
//!
//! A client subscribes to topics; all its other messages are ignored: the server offers none of the protocol's
//! capabilities (publishing, parameters, services). See
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>.
//! capabilities (publishing, parameters, services). See <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>.

use std::sync::Arc;

use run_client::NewestSamples;
use run_log::message_definition;
use scenario::Scenario;
use serde::Deserialize;
use serde_json::{Value, json};
use shared_types::Topic;
use shared_types::sample::CDR_HEADER;
use shared_types::service::header_of;

/// Names of the protocol, which are equivalent, the newer one first.
pub const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// Opcode of a binary message with a sample.
const MESSAGE_DATA: u8 = 1;

const TOPICS: usize = Topic::ALL.len();

/// Newest samples of a flight.
#[derive(Debug)]
pub struct Moment {
    /// Scenario of the flight, shared by all its moments.
    pub scenario: Arc<Scenario>,
    pub samples: NewestSamples,
}

/// Message to a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outgoing {
    Text(String),
    Binary(Vec<u8>),
}

/// Protocol state of a client.
#[derive(Debug, Default)]
pub struct Session {
    scenario: Option<Arc<Scenario>>,
    topics: [TopicState; TOPICS],
}

/// State of a topic for a client.
#[derive(Clone, Copy, Debug, Default)]
struct TopicState {
    is_advertised: bool,
    /// The client's subscription ID, if it has subscribed.
    subscription: Option<u32>,
    /// Sequence number of the last sample that was sent.
    sent: Option<u64>,
}

/// Message from a client. All others are ignored.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Incoming {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

impl Session {
    /// Returns the first message to a client.
    #[must_use]
    pub fn greeting() -> Outgoing {
        let name = format!("gerono {}", env!("CARGO_PKG_VERSION"));
        Outgoing::Text(json!({"op": "serverInfo", "name": name, "capabilities": []}).to_string())
    }

    /// Handles a message from the client.
    pub fn handle(&mut self, text: &str) {
        match serde_json::from_str(text) {
            Ok(Incoming::Subscribe { subscriptions }) => {
                for Subscription { id, channel_id } in subscriptions {
                    let is_free = self.topics.iter().all(|topic| topic.subscription != Some(id));
                    let topic = self.topics.get_mut(channel_id);
                    if let Some(topic) = topic.filter(|topic| is_free && topic.subscription.is_none()) {
                        topic.subscription = Some(id);
                        topic.sent = None;
                    }
                }
            }
            Ok(Incoming::Unsubscribe { subscription_ids }) => {
                for topic in &mut self.topics {
                    if topic
                        .subscription
                        .is_some_and(|id| subscription_ids.contains(&id))
                    {
                        topic.subscription = None;
                    }
                }
            }
            Err(_) => {}
        }
    }

    /// Returns the number of subscriptions.
    #[must_use]
    pub fn subscriptions(&self) -> usize {
        let wanted = self.topics.iter().filter(|topic| topic.subscription.is_some());
        wanted.count()
    }

    /// Returns the messages for a moment: advertisements of new topics, and samples of subscribed ones. `None` if the
    /// moment is of another flight than the ones before: the client has to connect again.
    pub fn messages_for(&mut self, moment: &Moment) -> Option<Vec<Outgoing>> {
        let is_first = self.scenario.is_none();
        let scenario = self.scenario.get_or_insert_with(|| Arc::clone(&moment.scenario));
        if !Arc::ptr_eq(scenario, &moment.scenario) {
            return None;
        }
        let mut channels = Vec::new();
        let mut samples = Vec::new();
        for (state, topic) in self.topics.iter_mut().zip(Topic::ALL) {
            let Some(bytes) = moment.samples.bytes(topic) else {
                continue;
            };
            if !state.is_advertised {
                state.is_advertised = true;
                channels.push(channel(topic, scenario));
            }
            let header = header_of(bytes);
            if let Some(subscription) = state.subscription
                && state.sent != Some(header.seq)
            {
                state.sent = Some(header.seq);
                samples.push(message(subscription, header.stamp_ns, bytes));
            }
        }
        let has_channels = is_first || !channels.is_empty();
        let advertised = has_channels
            .then(|| Outgoing::Text(json!({"op": "advertise", "channels": channels}).to_string()));
        Some(advertised.into_iter().chain(samples).collect())
    }
}

/// Returns the advertisement of a topic, with the schema of the log.
fn channel(topic: Topic, scenario: &Scenario) -> Value {
    json!({
        "id": topic.index(),
        "topic": topic.name(),
        "encoding": "cdr",
        "schemaName": topic.msg_name(),
        "schema": message_definition(topic, scenario),
        "schemaEncoding": "ros2msg",
    })
}

fn message(subscription: u32, time_ns: u64, sample: &[u8]) -> Outgoing {
    let parts: [&[u8]; 5] = [
        &[MESSAGE_DATA],
        &subscription.to_le_bytes(),
        &time_ns.to_le_bytes(),
        &CDR_HEADER,
        sample,
    ];
    Outgoing::Binary(parts.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;
    use shared_types::samples::{PathReference, VehicleTruth};
    use zerocopy::{FromZeros, IntoBytes};

    fn moment(scenario: &Arc<Scenario>, seq: u64, has_path: bool) -> Moment {
        let mut truth = VehicleTruth::new_zeroed();
        truth.header.seq = seq;
        truth.header.stamp_ns = 1_000_000 * seq;
        let path = PathReference::new_zeroed();
        let samples = NewestSamples::of(|topic| match topic {
            Topic::VehicleTruth => Some(truth.as_bytes()),
            Topic::PathReference if has_path => Some(path.as_bytes()),
            _ => None,
        });
        Moment {
            scenario: Arc::clone(scenario),
            samples,
        }
    }

    fn advertised(outgoing: &Outgoing) -> Vec<String> {
        let Outgoing::Text(text) = outgoing else {
            panic!("{outgoing:?}");
        };
        let value: Value = serde_json::from_str(text).unwrap();
        assert_eq!(value["op"], "advertise");
        let channels = value["channels"].as_array().unwrap().iter();
        channels
            .map(|channel| channel["topic"].as_str().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn topics_are_told_once_and_samples_sent_once_to_who_wants_them() {
        let scenario = Arc::new(scenario(0.001, 1.0));
        let mut session = Session::default();
        let news = session.messages_for(&moment(&scenario, 1, false)).unwrap();
        assert_eq!(news.len(), 1);
        assert_eq!(advertised(&news[0]), ["vehicle/truth"]);

        let channel = Topic::VehicleTruth.index();
        session.handle(&format!(
            r#"{{"op":"subscribe","subscriptions":[{{"id":7,"channelId":{channel}}}]}}"#
        ));
        let news = session.messages_for(&moment(&scenario, 1, false)).unwrap();
        let [Outgoing::Binary(sample)] = &news[..] else {
            panic!("{news:?}");
        };
        assert_eq!(sample[..5], [1, 7, 0, 0, 0]);
        assert_eq!(sample[5..13], 1_000_000_u64.to_le_bytes());
        assert_eq!(sample[13..17], CDR_HEADER);
        assert_eq!(sample.len(), 17 + Topic::VehicleTruth.kind().size);
        assert_eq!(session.messages_for(&moment(&scenario, 1, false)), Some(vec![]));

        let news = session.messages_for(&moment(&scenario, 2, true)).unwrap();
        assert_eq!(advertised(&news[0]), ["path/reference"]);
        assert_eq!(news.len(), 2, "a topic that is not wanted is not sent");
        session.handle(r#"{"op":"unsubscribe","subscriptionIds":[7]}"#);
        assert_eq!(session.messages_for(&moment(&scenario, 3, true)), Some(vec![]));
    }

    #[test]
    fn a_client_is_heard_only_when_it_says_what_it_wants() {
        let mut session = Session::default();
        for text in [
            "",
            "[]",
            r#"{"op":"setParameters","parameters":[]}"#,
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":4711}]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":0}]}"#,
        ] {
            session.handle(text);
            assert_eq!(session.subscriptions(), 0, "{text}");
        }
        // One number for one topic.
        session.handle(
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":0},{"id":1,"channelId":1},{"id":2,"channelId":0}]}"#,
        );
        assert_eq!(session.subscriptions(), 1);
    }

    #[test]
    fn another_flight_ends_a_session() {
        let [one, other] = [(); 2].map(|()| Arc::new(scenario(0.001, 1.0)));
        let mut session = Session::default();
        assert!(session.messages_for(&moment(&one, 1, false)).is_some());
        assert_eq!(session.messages_for(&moment(&other, 1, false)), None);
    }
}
