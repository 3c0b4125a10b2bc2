//! Channels of a run log: one per topic.

use scenario::Scenario;
use shared_types::Topic;

use super::framing::{LogError, McapFile};
use super::manifest::topics_of;
use super::schema::definition;

/// Adds a channel for every topic of a flight of `scenario`, in order. Returns their numbers.
pub(super) fn declare_topics(
    file: &mut McapFile,
    scenario: &Scenario,
) -> Result<[u16; Topic::ALL.len()], LogError> {
    let mut channels = [0; Topic::ALL.len()];
    for topic in topics_of(scenario) {
        let definition = definition(topic, scenario);
        channels[topic.index()] =
            file.declare_channel(topic.name(), topic.msg_name(), &definition, &topic.layout_hash())?;
    }
    Ok(channels)
}
