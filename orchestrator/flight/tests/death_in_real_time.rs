//! A flight in real time whose controller was killed, computed again in one thread ([`host::newest_wins`]).

use std::collections::BTreeMap;
use std::path::Path;

use host::newest_wins::{NewestWins, Presence, Start};
use registry::build_all;
use run_log::LogReader;
use shared_types::service::{header_of, nanoseconds};
use shared_types::{ServiceId, Topic};

/// First tick at which the controller was dead.
const DIED: u64 = 200;
/// Tick in which its successor was started, after the other services had done their steps.
const STARTED: u64 = 206;

/// Samples of the log by tick and topic; a hover at 1 kHz.
type Samples = BTreeMap<(u64, usize), Vec<u8>>;

#[test]
fn the_samples_of_a_flight_in_real_time_with_a_death_are_computed_byte_for_byte() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/old_logs/3077b11a/real_time");
    let mut log = LogReader::open(&folder.join("run.mcap")).unwrap();
    let scenario = log.manifest().scenario.clone();
    let mut samples = Samples::new();
    while let Some(sample) = log.next_sample().unwrap() {
        if sample.topic != Topic::RunEvent {
            let key = (sample.header.tick, sample.topic.index());
            samples.insert(key, sample.bytes.to_vec());
        }
    }
    let schedule = scenario.schedule().unwrap();
    let grace_ns = nanoseconds(scenario.real_time.unwrap_or_default().grace);
    let mut flight = NewestWins::new(schedule.clone(), grace_ns, build_all(&scenario).unwrap());
    for tick in 0..=schedule.last_tick() {
        match tick {
            DIED => flight.set_presence(ServiceId::Controller, Presence::Gone),
            STARTED => flight.open_ports(ServiceId::Controller, Start::FromCheckpoint),
            _ if tick == STARTED + 1 => flight.set_presence(ServiceId::Controller, Presence::Present),
            _ => {}
        }
        flight.step(flight.planned_operator()).unwrap();
        for topic in schedule
            .published_topics()
            .filter(|&topic| topic != Topic::RunEvent)
        {
            let computed = flight.newest(topic).filter(|bytes| header_of(bytes).tick == tick);
            let logged = samples.remove(&(tick, topic.index()));
            // The late sample is overtaken by the next one before it can be seen here.
            if !(tick == STARTED && topic.publisher() == Some(ServiceId::Controller)) {
                assert!(computed == logged.as_deref(), "{topic} of tick {tick}");
            }
        }
    }
    assert!(samples.is_empty());
}
