//! Bytes of a short flight, on any machine, in any profile.
//!
//! A change here is a change of every experiment: it must be intended, with its reason in the commit's message.

#[path = "../../../tests/common/rig.rs"]
mod rig;

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use registry::build_all;
use scenario::Scenario;
use shared_types::digest::ExperimentDigest;
use shared_types::{Schedule, Topic};
use toml::{Table, Value};

/// SHA-256 over (topic, time, payload) of what the services publish in the first second of each flight, outdoors in six.
const GOLDEN: [(&str, &[&str], &str); 6] = [
    (
        "fig1",
        SHORT,
        "e55b3d4beebddb18d67c0695acb5df8377b5965bc8898d866bfa26836681f2a6",
    ),
    (
        "fig2_near",
        SHORT,
        "6695ab761c0b7f28a34f6e6bf8e22324ba7f5e95b64f74ea8094e04a2092def6",
    ),
    (
        "circle",
        SHORT,
        "82fe30a411e7a79fb7be4b019c23d678cddcf457d8be42c463e9e0f8f7c2851a",
    ),
    (
        "waypoints",
        SHORT,
        "35c9f1da87fb678f45b1a4d7f594ee2b5d9659567dc02d6899ecd308db4082a0",
    ),
    (
        "fig3_6",
        &rig::ALL_OF_THE_RIG,
        "b4c7f7e492e3b0bcdae1185357369c7e8c43db600a1d41065dd4f8114301c86a",
    ),
    (
        "outdoor_rtk",
        TAKES_OFF,
        "1cdaa5a58781cd355cefd81443cfc7a02040c19a1e3c4ceeac02e030bfadcb12",
    ),
];

/// Change that leaves the first second of a scenario unchanged.
const SHORT: &[&str] = &["vehicle.change=[]"];

/// Change by which a flight outdoors is on its way to the path at its end, and has lost its corrections.
const TAKES_OFF: &[&str] = &[
    "duration=6.0",
    "flight.arm_at=3.0",
    "flight.land_at=5.5",
    "navigation.healthy_for=1.0",
    "sensors.gnss.change=[{at=5.0,kind='rtk_float'}]",
];

/// Seconds of a flight in which all inputs of the services are in use: it is in the air by then.
const WHILE: u64 = 5;

/// Digest of the first ticks.
struct Digesting {
    digest: ExperimentDigest,
    last_tick: u64,
}

impl TickSink for Digesting {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.digest.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(if tick < self.last_tick {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        })
    }
}

/// Overwrites values of one table by another's, and adds new ones.
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

/// Digest of the first ticks of a flight, on a schedule that may differ from the scenario's own.
fn fly(scenario: &Scenario, schedule: Schedule, last_tick: u64) -> String {
    let mut sink = Digesting {
        digest: ExperimentDigest::default(),
        last_tick,
    };
    let mut host = InProcess::new(schedule, build_all(scenario).unwrap());
    host.fly(&mut sink).unwrap();
    sink.digest.finish()
}

#[test]
fn short_flights_have_their_golden_hashes() {
    let flown = GOLDEN.map(|(name, changes, _)| {
        let scenario = scenario(name, &[&["duration=1.0"], changes].concat());
        let schedule = scenario.schedule().unwrap();
        let last_tick = schedule.last_tick();
        (name, fly(&scenario, schedule, last_tick))
    });
    assert_eq!(
        flown.each_ref().map(|(name, digest)| (*name, digest.as_str())),
        GOLDEN.map(|(name, _, digest)| (name, digest))
    );
}

/// Returns all committed scenarios with a simulated vehicle, by name.
fn simulated() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let files = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path());
    let scenarios = files.filter(|file| file.extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<_> = scenarios
        .map(|file| file.file_stem().unwrap().to_str().unwrap().to_owned())
        .filter(|name| scenario(name, &[]).schedule().unwrap().simulates_the_world())
        .collect();
    names.sort_unstable();
    names
}

#[test]
fn an_input_that_no_step_uses_changes_nothing() {
    let mut disconnected = 0;
    for name in simulated() {
        let scenario = scenario(&name, &[]);
        let schedule = scenario.schedule().unwrap();
        let connected = schedule.clone().with_unread_inputs(Default::default());
        if connected == schedule {
            continue;
        }
        disconnected += 1;
        let last_tick = WHILE * 1_000_000_000 / schedule.tick_ns();
        let flown = fly(&scenario, schedule, last_tick);
        assert_eq!(flown, fly(&scenario, connected, last_tick), "{name}");
    }
    assert!(
        disconnected > 5,
        "only {disconnected} scenarios leave an input out"
    );
}
