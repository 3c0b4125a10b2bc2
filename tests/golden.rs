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
const GOLDEN: [(&str, &str); 4] = [
    ("fig1", "unset"),
    ("fig2_near", "unset"),
    ("circle", "unset"),
    ("waypoints", "unset"),
];

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
    let flown = GOLDEN.map(|(name, _)| {
        let sets = ["duration=1.0".to_owned(), "vehicle.change=[]".to_owned()];
        let scenario = scenario_file::load(&common::scenario(name), &sets, None).unwrap();
        let mut digest = Digesting::default();
        in_process::fly(&scenario, &mut digest, &Interrupt::never()).unwrap();
        (name, digest.0.finish())
    });
    assert_eq!(
        flown.each_ref().map(|(name, digest)| (*name, digest.as_str())),
        GOLDEN
    );
}
