//! Checks of the recording.

use shared_types::Topic;

use super::Findings;
use crate::suggest::known_names;
use crate::{Key, Record, Scenario, Split};

impl Scenario {
    pub(super) fn check_record(&self, found: &mut Findings) {
        let Some(record) = &self.record else { return };
        let at = Key::root().then("record");
        if let Some(split) = record.split {
            split.check(&at.then("split"), found);
        }
        record.check_topics(&at, found);
    }
}

impl Record {
    fn check_topics(&self, at: &Key, found: &mut Findings) {
        for topic in self.every.keys() {
            let key = at.then("every").then(topic);
            check_topic(topic, &key, found);
            if self.leave_out.contains(topic) {
                found.add(
                    key,
                    "`record.leave_out` names the topic as well",
                    "name it in one of the two",
                );
            }
        }
        for (index, topic) in self.leave_out.iter().enumerate() {
            check_topic(topic, &at.then("leave_out").then(index), found);
        }
    }
}

/// Requires the name of a topic that may be recorded in part.
fn check_topic(topic: &str, key: &Key, found: &mut Findings) {
    match Topic::from_name(topic) {
        None => found.add(
            key.clone(),
            format!("there is no topic `{topic}`"),
            known_names(topic, &Topic::ALL.map(Topic::name)),
        ),
        Some(Topic::RunEvent) => found.add(
            key.clone(),
            "the events document the flight, and a replay needs them",
            "leave them in the log; they are few",
        ),
        Some(_) => {}
    }
}

impl Split {
    fn check(&self, at: &Key, found: &mut Findings) {
        if self.after_bytes.is_none() && self.after_seconds.is_none() {
            found.add(
                at.clone(),
                "it does not state when the next file starts",
                "state `after_bytes` or `after_seconds` (s), or leave `record.split` out",
            );
        }
    }
}
