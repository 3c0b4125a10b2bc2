//! Recording of a flight: topics and files.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Topic;

use crate::Scenario;
use crate::range::at_least;

/// Recording of the flight. It affects the files of the log, not the flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Split of the log into several files; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// Names of topics, each with a number n: only samples whose sequence number is a multiple of n are recorded.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(transform = at_least(1), extend("x-hint" = "name the topic in `record.leave_out` to record nothing"))]
    pub every: BTreeMap<String, u64>,
    /// Names of topics that are not recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leave_out: Vec<String>,
}

/// Limits of one file of a log: the first one reached starts the next file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Size after which the next file starts, bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = at_least(Self::LEAST_BYTES), extend("x-hint" = "manifest and schemas, which each file repeats, would take most of a smaller file"))]
    pub after_bytes: Option<u64>,
    /// Flight time after which the next file starts, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = at_least(Self::LEAST_SECONDS), extend("x-hint" = "manifest and schemas, which each file repeats, would take most of a shorter file"))]
    pub after_seconds: Option<f64>,
}

impl Scenario {
    /// Returns a description of the topics that are not fully recorded, if any.
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
    /// Minimum limit of a file's size, bytes: manifest and schemas, which each file repeats, take about half of it.
    pub const LEAST_BYTES: u64 = 1 << 16;

    /// Minimum time of a file, s.
    pub const LEAST_SECONDS: f64 = 1.0;
}

/// Recorded part of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// Every sample.
    All,
    /// Samples whose sequence number is a multiple of this number, which is above 1.
    Every(u64),
    /// None.
    Nothing,
}

impl Recorded {
    /// Returns the recorded part of each topic in a log of this scenario.
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

    /// Returns whether the sample with a sequence number is recorded.
    #[inline]
    #[must_use]
    pub fn has(self, seq: u64) -> bool {
        match self {
            Self::All => true,
            Self::Every(every) => seq.is_multiple_of(every),
            Self::Nothing => false,
        }
    }

    /// Returns the number of recorded samples before a sequence number.
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
