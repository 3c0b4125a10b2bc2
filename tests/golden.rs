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
    (
        "fig1",
        "7e1e828450787cc8f97430ad1a581402816f26f860b8b050e3abb01ae8b6af64",
    ),
    (
        "fig2_near",
        "6176a4277171f2cddf8a2eb5af156f1b182199a4e5ac563cdffcd1a8063d881e",
    ),
    (
        "circle",
        "501c165a4c3e43e8cb252bdafa54568edb2f05e0075fab752fb855f5f226002d",
    ),
    (
        "waypoints",
        "e81d828d4598f9121eed6c81588eec212da3030d6450de1ec159ad6011705ee4",
    ),
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
