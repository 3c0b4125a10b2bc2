//! The library flies the path, and goes on from a saved state as if nothing had happened.

#[path = "support/mod.rs"]
mod support;

use std::convert::Infallible;

use host::in_process::{InProcess, TickSink};
use shared_types::samples::VehicleTruth;
use shared_types::service::ErasedService;
use shared_types::{ServiceId, Topic};
use zerocopy::FromBytes;

use support::{library, scenario};

/// Positions of the vehicle, m.
#[derive(Default)]
struct Positions(Vec<[f64; 3]>);

impl TickSink for Positions {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if topic == Topic::VehicleTruth {
            self.0
                .push(VehicleTruth::ref_from_bytes(bytes).unwrap().position_world);
        }
        Ok(())
    }
}

fn fly(services: Vec<Box<dyn ErasedService>>) -> Vec<[f64; 3]> {
    let mut positions = Positions::default();
    let schedule = scenario().schedule().unwrap();
    InProcess::new(schedule, services).fly(&mut positions).unwrap();
    positions.0
}

fn services() -> Vec<Box<dyn ErasedService>> {
    registry::build_all(&scenario()).unwrap()
}

#[test]
fn it_flies_as_the_same_law_linked_in() {
    let flown = fly(services());
    assert_eq!(flown.len(), 5001);
    let mut linked = services();
    linked[ServiceId::Controller.index()] = support::linked_in();
    assert_eq!(flown, fly(linked));
}

#[test]
fn a_saved_state_is_all_that_it_knows() {
    let mut original = library();
    let mut state = vec![0; original.state_size()];
    original.save(&mut state);
    assert_eq!(state, [0; 24]);
    let known: Vec<u8> = [0.1f64, -0.2, 0.3]
        .into_iter()
        .flat_map(f64::to_ne_bytes)
        .collect();
    original.restore(&known);
    original.save(&mut state);
    assert_eq!(state, known);
}
