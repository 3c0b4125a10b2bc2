//! Known values come back: markers, delay and noise of simulated laboratories that are not as believed.

use std::convert::Infallible;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use shared_types::Topic;

use super::*;

impl TickSink for Recording {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.observe(topic, bytes);
        Ok(())
    }
}

/// Tick of the simulation, s.
const TICK: f64 = 1e-3;

/// Flies the eight for 25 s in a laboratory with these changes, which nobody knows of.
fn flown(changes: &[&str]) -> Recording {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/fig3_6.toml");
    let common = ["duration=25.0", "vehicle.change=[]"];
    let sets: Vec<String> = common.iter().chain(changes).map(ToString::to_string).collect();
    let scenario = scenario_file::load(&path, &sets, None).unwrap();
    let mut recording = Recording::new(&scenario).unwrap();
    let services = registry::build_all(&scenario).unwrap();
    InProcess::new(scenario.schedule().unwrap(), services)
        .fly(&mut recording)
        .unwrap();
    recording.complete().unwrap()
}

#[track_caller]
fn assert_near(found: Quantity, is: f64, within: f64) {
    assert!(
        (found.found - is).abs() <= within,
        "{found:?} is not {is} within {within}"
    );
    assert!(found.error < within, "{found:?}");
}

#[test]
fn a_laboratory_as_stated_is_found_to_be_so() {
    let found = identify(&flown(&[])).unwrap();
    for offset in found.marker_offset {
        assert_near(offset, 0.0, 0.003);
    }
    // The simulated plant applies a frame from the tick before the one at which it arrives.
    assert_near(found.radio_latency, 0.005 - TICK, 0.0005);
    assert_near(found.position_deviation, 3e-4, 3e-5);
    assert_near(found.attitude_deviation, 2e-3, 3e-4);
    let told = found.to_string();
    assert!(!told.contains("differs") && !told.contains("unknown"), "{told}");
}

#[test]
fn markers_delay_and_noise_of_another_laboratory_are_found() {
    let changes = [
        "vehicle.center_of_mass=[-0.008, 0.006, 0.012]",
        "schedule.latency.\"rc/frame -> plant\"=0.012",
        "cameras.position_deviation=6e-4",
        "cameras.attitude_deviation=5e-3",
    ];
    let found = identify(&flown(&changes)).unwrap();
    for (offset, is) in found.marker_offset.into_iter().zip([0.008, -0.006, -0.012]) {
        assert_near(offset, is, 0.003);
    }
    assert_near(found.radio_latency, 0.012 - TICK, 0.0005);
    assert_near(found.position_deviation, 6e-4, 6e-5);
    assert_near(found.attitude_deviation, 5e-3, 5e-4);
    let told = found.to_string();
    assert_eq!(told.matches("differs").count(), 6, "{told}");
    assert!(told.contains("[model]\nmarker_offset = [0.00"), "{told}");
}

#[test]
fn an_offset_that_no_turn_has_shown_stays_as_stated() {
    let known = Quantity {
        stated: 0.0,
        found: 0.01,
        error: 0.001,
    };
    let unknown = Quantity {
        error: 0.008,
        ..known
    };
    let told = Identification {
        marker_offset: [known, unknown, known],
        radio_latency: known,
        position_deviation: known,
        attitude_deviation: known,
    }
    .to_string();
    assert!(
        told.contains("unknown") && told.contains("did not turn enough"),
        "{told}"
    );
    assert!(told.contains("marker_offset = [0.010, 0.000, 0.010]"), "{told}");
}

#[test]
fn flights_without_a_filter_and_short_ones_say_so() {
    let fig1 = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/fig1.toml");
    let scenario = scenario_file::load(&fig1, &[], None).unwrap();
    assert!(matches!(Recording::new(&scenario), Err(IdentifyError::NoFilter)));
    let fig3_6 = fig1.with_file_name("fig3_6.toml");
    let scenario = scenario_file::load(&fig3_6, &[], None).unwrap();
    let empty = Recording::new(&scenario).unwrap().complete();
    assert!(matches!(
        empty,
        Err(IdentifyError::TooShort {
            captures: 0,
            frames: 0
        })
    ));
}
