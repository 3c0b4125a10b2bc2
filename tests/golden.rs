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
        "156455ddd8190e6672714def7185887c3f745c1dbee7c3da8d85e00adb4d9a8c",
    ),
    (
        "fig2_near",
        SHORT,
        "dd91719344cf6288329a9d7b81c0c07b028213ec61b9f2e4ff770e9280287795",
    ),
    (
        "circle",
        SHORT,
        "27b1451d173ef1c2d7197b420d68bfef2d1def68b2f650da16edbec9deb2b6a1",
    ),
    (
        "waypoints",
        SHORT,
        "316773ebe6a0dcdfe41506656611751bcc30f2d38f4610bf8b636d77cc05a097",
    ),
    (
        "fig3_6",
        &common::ALL_OF_THE_RIG,
        "3f68ad7afbbe0261242e519463cf3ad9805f4b8272dccabf7a0bd5ca36610ac1",
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
