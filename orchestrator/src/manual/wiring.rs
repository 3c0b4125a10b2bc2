//! The wiring table as a diagram.

use shared_types::schedule::acts_before_delivery;
use shared_types::{ServiceId, Topic};

/// Returns the wiring table as a Mermaid diagram.
#[must_use]
pub fn mermaid() -> String {
    let mut text = String::from("flowchart LR\n");
    for service in ServiceId::ALL {
        text.push_str(&format!("    {service}[{service}]\n"));
    }
    text.push_str("    recorder[(orchestrator: run.mcap)]\n");
    for topic in Topic::ALL {
        let Some(publisher) = topic.publisher() else {
            continue;
        };
        for (consumer, input) in topic.consumers() {
            let latency = consumer.inputs()[input].default_latency_ticks - acts_before_delivery(consumer);
            let note = if latency == 0 {
                String::new()
            } else {
                format!(", {latency} tick later")
            };
            text.push_str(&format!("    {publisher} -- \"{topic}{note}\" --> {consumer}\n"));
        }
        if topic.consumers().next().is_none() {
            text.push_str(&format!("    {publisher} -. {topic} .-> recorder\n"));
        }
    }
    text
}
