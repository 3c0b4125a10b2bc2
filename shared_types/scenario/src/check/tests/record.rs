//! Files of a log that are worth their headers.

use super::{accepted, refused};
use crate::{Record, Scenario, Split};

fn split(after_bytes: Option<u64>, after_seconds: Option<f64>) -> impl FnOnce(&mut Scenario) {
    move |scenario| {
        let split = Some(Split {
            after_bytes,
            after_seconds,
        });
        scenario.record = Some(Record { split });
    }
}

#[test]
fn a_log_is_split_by_size_by_time_or_by_both() {
    accepted(|scenario| scenario.record = Some(Record::default()));
    accepted(split(Some(65_536), None));
    accepted(split(None, Some(1.0)));
    accepted(split(Some(u64::MAX), Some(3600.5)));
}

#[test]
fn a_split_that_says_nothing_or_makes_crumbs_is_refused() {
    refused(
        split(None, None),
        "record.split",
        "does not say when",
        "after_seconds",
    );
    refused(
        split(Some(65_535), None),
        "record.split.after_bytes",
        "repeats",
        "65536",
    );
    refused(
        split(None, Some(0.5)),
        "record.split.after_seconds",
        "repeats",
        "1.0 s",
    );
    refused(
        split(None, Some(f64::NAN)),
        "record.split.after_seconds",
        "finite",
        "",
    );
}
