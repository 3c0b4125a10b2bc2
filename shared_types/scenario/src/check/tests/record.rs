//! Files of a log that are worth their headers, and topics of which less may be recorded.

use super::{accepted, refused};
use crate::{Record, Scenario, Split};

fn split(after_bytes: Option<u64>, after_seconds: Option<f64>) -> impl FnOnce(&mut Scenario) {
    move |scenario| {
        let split = Some(Split {
            after_bytes,
            after_seconds,
        });
        scenario.record = Some(Record {
            split,
            ..Record::default()
        });
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
fn a_split_that_says_nothing_is_refused() {
    refused(
        split(None, None),
        "record.split",
        "does not state when",
        "after_seconds",
    );
}

fn topics(every: &[(&str, u64)], leave_out: &[&str]) -> impl FnOnce(&mut Scenario) {
    let every = every.iter().map(|(topic, every)| ((*topic).to_owned(), *every));
    let record = Record {
        every: every.collect(),
        leave_out: leave_out.iter().map(ToString::to_string).collect(),
        ..Record::default()
    };
    |scenario| scenario.record = Some(record)
}

#[test]
fn any_topic_but_the_events_may_be_recorded_in_part_or_not_at_all() {
    accepted(topics(&[("control/errors", 10)], &["vehicle/truth"]));
    accepted(topics(&[("control/errors", 1)], &[]));
    refused(
        topics(&[("run/events", 2)], &[]),
        "record.every.\"run/events\"",
        "replay",
        "few",
    );
    refused(
        topics(&[], &["run/events"]),
        "record.leave_out.0",
        "replay",
        "few",
    );
}

#[test]
fn what_is_no_topic_and_what_contradicts_itself_is_refused() {
    refused(
        topics(&[("control/error", 10)], &[]),
        "record.every.\"control/error\"",
        "no topic",
        "did you mean `control/errors`",
    );
    refused(
        topics(&[], &["mocap/pose", "mocap/pos"]),
        "record.leave_out.1",
        "no topic",
        "did you mean `mocap/pose`",
    );
    refused(
        topics(&[("mocap/pose", 2)], &["mocap/pose"]),
        "record.every.\"mocap/pose\"",
        "as well",
        "one of the two",
    );
}
