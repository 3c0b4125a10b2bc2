//! What is recorded of a flight, and in which files.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Topic;

use crate::Scenario;
use crate::range::at_least;

/// The recording of the flight. It changes the files of the log, not the flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// When the log goes on in another file; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// Names of topics, each with a number n: only samples whose number is a multiple of n are recorded.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(transform = at_least(1), extend("x-hint" = "name the topic in `record.leave_out` to record nothing"))]
    pub every: BTreeMap<String, u64>,
    /// Names of topics of which nothing is recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leave_out: Vec<String>,
}

/// Limits of one file of a log: the first that is reached counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Size from which on the log goes on in another file, bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = at_least(Self::LEAST_BYTES), extend("x-hint" = "manifest and schemas, which each file repeats, would take most of a smaller file"))]
    pub after_bytes: Option<u64>,
    /// Time of the flight from which on the log goes on in another file, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = at_least(Self::LEAST_SECONDS), extend("x-hint" = "manifest and schemas, which each file repeats, would take most of a shorter file"))]
    pub after_seconds: Option<f64>,
}

impl Scenario {
    /// Returns of which topics not everything is recorded, in words, if there are any.
    #[must_use]
    pub fn omissions(&self) -> Option<String> {
        let topics = Topic::ALL.into_iter().zip(Recorded::of_topics(self));
        let omissions = topics.filter_map(|(topic, recorded)| match recorded {
            Recorded::All => None,
            Recorded::Every(every) => Some(format!("one in {every} samples of {topic}")),
            Recorded::Nothing => Some(format!("nothing of {topic}")),
        });
        let omissions: Vec<_> = omissions.collect();
        (!omissions.is_empty()).then(|| omissions.join(", "))
    }
}

impl Split {
    /// Smallest limit of a file's size, bytes: manifest and schemas, which each file repeats, take about half of it.
    pub const LEAST_BYTES: u64 = 1 << 16;

    /// Shortest time of a file, s.
    pub const LEAST_SECONDS: f64 = 1.0;
}

/// How much of a topic is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// Every sample.
    All,
    /// Those whose number is a multiple of this, which is more than one.
    Every(u64),
    /// None.
    Nothing,
}

impl Recorded {
    /// Of each topic, how much of it a log of a flight of `scenario` has.
    #[must_use]
    pub fn of_topics(scenario: &Scenario) -> [Self; Topic::ALL.len()] {
        let Some(record) = &scenario.record else {
            return [Self::All; Topic::ALL.len()];
        };
        Topic::ALL.map(|topic| {
            let name = topic.name();
            if record.leave_out.iter().any(|left_out| left_out == name) {
                return Self::Nothing;
            }
            match record.every.get(name) {
                Some(&every) if every > 1 => Self::Every(every),
                _ => Self::All,
            }
        })
    }

    /// Returns whether the sample of a sequence number is recorded.
    #[inline]
    #[must_use]
    pub fn has(self, seq: u64) -> bool {
        match self {
            Self::All => true,
            Self::Every(every) => seq.is_multiple_of(every),
            Self::Nothing => false,
        }
    }

    /// Returns how many of the samples before a sequence number are recorded.
    #[inline]
    #[must_use]
    pub fn count_before(self, seq: u64) -> u64 {
        match self {
            Self::All => seq,
            Self::Every(every) => seq.div_ceil(every),
            Self::Nothing => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn as_many_are_counted_as_are_recorded(every in 2u64..50, seq in 0u64..500) {
            for recorded in [Recorded::All, Recorded::Every(every), Recorded::Nothing] {
                let count = (0..seq).filter(|number| recorded.has(*number)).count();
                prop_assert_eq!(recorded.count_before(seq), count as u64);
            }
        }
    }
}
