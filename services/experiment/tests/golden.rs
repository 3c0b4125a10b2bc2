//! The bytes of a short flight, on any machine, in any profile.
//!
//! A change here is a change of every experiment: it must be meant, and its reason be in the commit's message.

#[path = "../../../tests/common/rig.rs"]
mod rig;

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::Path;

use experiment::{ExperimentDigest, build_all};
use runtime::in_process::{InProcess, TickSink};
use shared_types::Topic;
use shared_types::scenario::Scenario;
use toml::{Table, Value};

/// SHA-256 over (topic, time, payload) of what the services publish in the first second of each flight.
const GOLDEN: [(&str, &[&str], &str); 5] = [
    (
        "fig1",
        SHORT,
        "f6028e276680d95e741c34be6f2e9c67e291f74e520445ac3ad47b2fae757fba",
    ),
    (
        "fig2_near",
        SHORT,
        "39f8cf565c88e892a26bcbbd7b10bab9376c71e5d3b900cbfe93ce813bff2fec",
    ),
    (
        "circle",
        SHORT,
        "cabd1540415a54bb73b9d8e0ebb05fda4e780739e96f7741b9769153ec0ef051",
    ),
    (
        "waypoints",
        SHORT,
        "bb158590f56a24dd4d0d621b59b5786c065e5601043946aedeaa2d464a0d7ce4",
    ),
    (
        "fig3_6",
        &rig::ALL_OF_THE_RIG,
        "6188a01b7db77029b251a8ae816c1ded8db5c3ba48f7a83b51f59cda7facb106",
    ),
];

/// What leaves the first second of a scenario as it is.
const SHORT: &[&str] = &["vehicle.change=[]"];

#[derive(Default)]
struct Digesting(ExperimentDigest);

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

/// Puts the values of one table in the place of another's, or beside them.
fn change(table: &mut Table, changes: Table) {
    for (key, value) in changes {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => change(old, new),
            (_, new) => drop(table.insert(key, new)),
        }
    }
}

/// A committed scenario with these values, each written as in a scenario file.
fn scenario(name: &str, changes: &[&str]) -> Scenario {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let text = std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap();
    let mut table: Table = text.parse().unwrap();
    for changes in changes {
        change(&mut table, changes.parse().unwrap());
    }
    let scenario: Scenario = table.try_into().unwrap();
    assert_eq!(scenario.problems(), [], "{name}");
    scenario
}

#[test]
fn short_flights_have_their_golden_hashes() {
    let flown = GOLDEN.map(|(name, changes, _)| {
        let scenario = scenario(name, &[&["duration=1.0"], changes].concat());
        let services = build_all(&scenario).unwrap();
        let mut digest = Digesting::default();
        let mut host = InProcess::new(scenario.schedule().unwrap(), services);
        host.fly(&mut digest).unwrap();
        (name, digest.0.finish())
    });
    assert_eq!(
        flown.each_ref().map(|(name, digest)| (*name, digest.as_str())),
        GOLDEN.map(|(name, _, digest)| (name, digest))
    );
}
