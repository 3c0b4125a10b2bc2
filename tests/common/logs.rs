//! The content of logs, and the results of their replays.

use std::path::Path;

use replay::{Options, Replayed, replay};
use run_log::LogReader;
use shared_types::ServiceId;
use zerocopy::FromBytes;

use super::Place;

/// The last sample of a type in the `host.mcap` of a run's folder.
pub(crate) fn last_of_host<T: FromBytes>(place: &Place, run: &str, channel: &str) -> T {
    let file = std::fs::read(place.path(run).join("host.mcap")).unwrap();
    let messages = mcap::MessageStream::new(&file).unwrap();
    let of_channel = messages
        .map(|message| message.unwrap())
        .filter(|message| message.channel.topic == channel);
    T::read_from_bytes(&of_channel.last().unwrap().data[4..]).unwrap()
}

/// A whole log, replayed.
pub(crate) fn replayed(log: &Path) -> Replayed {
    replay(log, &Options::default(), None).unwrap()
}

/// A log, replayed with a controller that is one tenth stiffer.
pub(crate) fn replayed_with_another_controller(log: &Path) -> Replayed {
    let mut changed = LogReader::open(log).unwrap().manifest().scenario.clone();
    changed.controller.k1 *= 1.1;
    let options = Options {
        changed: Some(changed),
        ..Options::default()
    };
    replay(log, &options, None).unwrap()
}

/// Asserts that what the controller publishes differs, and nothing else.
#[track_caller]
pub(crate) fn assert_only_the_controller_differs(replayed: &Replayed) {
    for comparison in &replayed.comparisons {
        let of_the_controller = comparison.topic.publisher() == Some(ServiceId::Controller);
        assert_eq!(
            comparison.different > 0,
            of_the_controller,
            "{}",
            comparison.topic
        );
    }
}

/// Samples that services have published into a log at ticks of which `is_counted` says so.
pub(crate) fn published(log: &Path, is_counted: impl Fn(u64) -> bool) -> u64 {
    let mut reader = LogReader::open(log).unwrap();
    let mut count = 0;
    while let Some(sample) = reader.next_sample().unwrap() {
        count += u64::from(sample.topic.publisher().is_some() && is_counted(sample.header.tick));
    }
    count
}

/// The last tick of which there is a sample in a log.
pub(crate) fn last_tick(log: &Path) -> u64 {
    let mut reader = LogReader::open(log).unwrap();
    let mut last = 0;
    while let Some(sample) = reader.next_sample().unwrap() {
        last = sample.header.tick;
    }
    last
}

/// Samples of a type in `host.mcap`.
pub(crate) fn host_samples<T: FromBytes>(place: &Place, out: &str, channel: &str) -> Vec<T> {
    let file = std::fs::read(place.path(out).join("host.mcap")).unwrap();
    let messages = mcap::MessageStream::new(&file).unwrap();
    messages
        .map(|message| message.unwrap())
        .filter(|message| message.channel.topic == channel)
        .map(|message| T::read_from_bytes(&message.data[4..]).unwrap())
        .collect()
}
