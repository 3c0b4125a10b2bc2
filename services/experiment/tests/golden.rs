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
use shared_types::scenario::Scenario;
use shared_types::{Schedule, Topic};
use toml::{Table, Value};

/// SHA-256 over (topic, time, payload) of what the services publish in the first second of each flight.
const GOLDEN: [(&str, &[&str], &str); 5] = [
    (
        "fig1",
        SHORT,
        "9668aa11952f6b071088fc26f09d6cd1e3d7f24a3603bfdfee414635329aba59",
    ),
    (
        "fig2_near",
        SHORT,
        "6a1cbbbd30a7569004cb824ab071b1b7e7d2f27a1d6b7b8728d6f3fb9a55504d",
    ),
    (
        "circle",
        SHORT,
        "5dd4c960dd18c243fa3a0042d450328e108e45c14c7590bb22e04e4ad60cd4ff",
    ),
    (
        "waypoints",
        SHORT,
        "27f56b711b14b1f101642dcf4d598995eee5ffaed978cfbb524175f537358469",
    ),
    (
        "fig3_6",
        &rig::ALL_OF_THE_RIG,
        "d7a096a68408e846a96ad1b8c9863152eb6723badceeea793f36343de74fd377",
    ),
];

/// What leaves the first second of a scenario as it is.
const SHORT: &[&str] = &["vehicle.change=[]"];

/// Seconds of a flight that show what its services look at: it is in the air by then.
const WHILE: u64 = 5;

/// Takes the first ticks in.
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

/// All committed scenarios whose world is simulated, by name.
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
fn what_no_step_looks_at_changes_nothing() {
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
        "only {disconnected} scenarios leave anything out"
    );
}
