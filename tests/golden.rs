//! The bytes of a short flight, on any machine, in any profile.
//!
//! A change here is a change of every experiment: it must be meant, and its reason be in the commit's message.

mod common;

use std::convert::Infallible;
use std::ops::ControlFlow;

use orchestrator::flight::in_process;
use orchestrator::interrupt::Interrupt;
use orchestrator::log::LogDigest;
use orchestrator::scenario_file;
use runtime::in_process::TickSink;
use shared_types::Topic;

/// SHA-256 over (topic, time, payload) of what the services publish in the first second of each flight.
const GOLDEN: [(&str, &[&str], &str); 5] = [
    (
        "fig1",
        SHORT,
        "606068db6cc4ae965b80a83b2404d7c403c6be3bd877e29d116e864f7d683fef",
    ),
    (
        "fig2_near",
        SHORT,
        "17a519180d2b986ad3b66740f2ea5ac058adc948d4632d44efd6b092647cca6a",
    ),
    (
        "circle",
        SHORT,
        "8d2ea468913a0894df634c8dc5e46fe8f395adc4112882265d69d22a209d08e5",
    ),
    (
        "waypoints",
        SHORT,
        "203e7a90f06c691bdb9be8e2a23b8939a640dca9651d4d6e49ad0a30bb1a0032",
    ),
    (
        "fig3_6",
        &common::ALL_OF_THE_RIG,
        "d8e42c1ab1b47af05e4b61353b4cc18fda94cfdcc3070f6282b3acd1fbb12e72",
    ),
];

/// What leaves the first second of a scenario as it is.
const SHORT: &[&str] = &["vehicle.change=[]"];

#[derive(Default)]
struct Digesting(LogDigest);

impl TickSink for Digesting {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.0.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

#[test]
fn short_flights_have_their_golden_hashes() {
    let flown = GOLDEN.map(|(name, changes, _)| {
        let sets: Vec<_> = ["duration=1.0"]
            .iter()
            .chain(changes)
            .map(|&setting| setting.to_owned())
            .collect();
        let scenario = scenario_file::load(&common::scenario(name), &sets, None).unwrap();
        let mut digest = Digesting::default();
        in_process::fly(&scenario, &mut digest, &Interrupt::never()).unwrap();
        (name, digest.0.finish())
    });
    assert_eq!(
        flown.each_ref().map(|(name, digest)| (*name, digest.as_str())),
        GOLDEN.map(|(name, _, digest)| (name, digest))
    );
}
