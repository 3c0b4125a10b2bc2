//! Files of a log that are worth their headers.

use super::Findings;
use crate::{Key, Scenario, Split};

impl Scenario {
    pub(super) fn check_record(&self, found: &mut Findings) {
        if let Some(split) = self.record.and_then(|record| record.split) {
            split.check(&Key::root().then("record").then("split"), found);
        }
    }
}

impl Split {
    fn check(&self, at: &Key, found: &mut Findings) {
        if self.after_bytes.is_none() && self.after_seconds.is_none() {
            found.add(
                at.clone(),
                "it does not say when the log goes on in another file",
                "state `after_bytes` or `after_seconds` (s), or leave `record.split` out",
            );
        }
        if self.after_bytes.is_some_and(|bytes| bytes < Self::LEAST_BYTES) {
            found.add(
                at.then("after_bytes"),
                "manifest and schemas, which each file repeats, would take most of it",
                format!("give at least {} bytes", Self::LEAST_BYTES),
            );
        }
        let key = at.then("after_seconds");
        if let Some(seconds) = self.after_seconds
            && found.positive(&key, "the time", seconds)
            && seconds < Self::LEAST_SECONDS
        {
            found.add(
                key,
                "manifest and schemas, which each file repeats, would take most of it",
                format!("give at least {:?} s", Self::LEAST_SECONDS),
            );
        }
    }
}
