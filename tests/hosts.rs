//! Promises of the step logic that only all services together can show.

#[path = "../tests/common/allocations.rs"]
mod allocations;
mod common;

use std::convert::Infallible;
use std::ops::ControlFlow;

use orchestrator::log::LogDigest;
use orchestrator::{scenario_file, services};
use runtime::in_process::{InProcess, TickSink};
use shared_types::scenario::Scenario;
use shared_types::{ServiceId, Topic};

fn host(scenario: &Scenario) -> InProcess {
    InProcess::new(
        scenario.schedule().unwrap(),
        services::build_all(scenario).unwrap(),
    )
}

fn short_fig1() -> Scenario {
    let sets = [
        "duration=2.0".to_owned(),
        "vehicle.change=[{at = 1.0, mass = 0.245}]".to_owned(),
    ];
    scenario_file::load(&common::scenario("fig1"), &sets, None).unwrap()
}

fn short_rig() -> Scenario {
    let mut sets = vec!["duration=1.0".to_owned()];
    sets.extend(common::ALL_OF_THE_RIG.map(str::to_owned));
    scenario_file::load(&common::scenario("fig3_6"), &sets, None).unwrap()
}

/// Policies that go through all stages and back while services are lost.
fn short_losses() -> Scenario {
    let sets = [
        "duration=2.0",
        "safety.\"vehicle/state -> controller\"={max_age=0.05, level=0.1, descend=0.2, failsafe=0.4, jump=0.2}",
        "safety.\"control/command -> rc_output\"={max_age=0.044, failsafe=0.1}",
        "fault=[{at=0.5, service=\"estimator\", kind=\"off\", for=0.6}, \
         {at=1.3, service=\"path_generator\", kind=\"off\", for=0.6}, \
         {at=1.4, service=\"controller\", kind=\"off\", for=0.2}, \
         {at=1.7, service=\"estimator\", kind=\"off\", state=\"cold\", for=0.1}]",
    ];
    let sets = sets.map(str::to_owned);
    scenario_file::load(&common::scenario("fault_isolation"), &sets, None).unwrap()
}

/// Digests what is published and stops after every tick.
#[derive(Default)]
struct Stopping(LogDigest);

impl TickSink for Stopping {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.0.update(topic, bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Break(()))
    }
}

/// Flies tick by tick, doing something between ticks, to the digest of what was published.
fn digest(scenario: &Scenario, mut between: impl FnMut(&mut InProcess)) -> String {
    let mut host = host(scenario);
    let mut sink = Stopping::default();
    for _ in 0..=host.schedule().last_tick() {
        host.fly(&mut sink).unwrap();
        between(&mut host);
    }
    sink.0.finish()
}

/// A service keeps nothing beside what it saves: born anew after every tick, all fly on with the same bytes.
#[test]
fn services_have_no_hidden_state() {
    for scenario in [short_fig1(), short_rig(), short_losses()] {
        let undisturbed = digest(&scenario, |_| {});
        let reborn = digest(&scenario, |host| {
            for service in ServiceId::ALL {
                let mut state = vec![0; host.service_mut(service).state_size()];
                host.service_mut(service).save(&mut state);
                let mut fresh = services::build(service, &scenario).unwrap();
                fresh.restore(&state);
                host.replace(fresh);
            }
        });
        assert_eq!(undisturbed, reborn);
    }
}

struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        std::hint::black_box(bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

#[test]
fn a_flight_allocates_nothing_in_any_step() {
    for scenario in [short_fig1(), short_rig()] {
        let mut host = host(&scenario);
        let count = allocations::allocations_during(|| host.fly(&mut Nowhere).unwrap());
        assert_eq!(count, 0);
    }
}
