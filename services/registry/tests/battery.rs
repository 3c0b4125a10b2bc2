//! Hover on a battery that empties: the thrust that acts for a commanded one, and where the vehicle is, with and without the
//! correction of the link.

use std::convert::Infallible;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use registry::build_all;
use scenario::{Battery, BatteryModel, LinkBattery, Scenario, VoltageSource};
use shared_types::Topic;
use shared_types::samples::{ControlAdaptation, RcFrame, VehicleTruth};
use zerocopy::FromBytes;

const WEIGHT: f64 = 1.962;
/// Duration of the flight and endurance of the battery, s.
const DURATION: f64 = 60.0;

/// Means over the last ten seconds.
#[derive(Debug, Default)]
struct Means {
    /// Thrust that acted, and thrust of the frames, N.
    acted: f64,
    commanded: f64,
    /// Height of the vehicle over the path, m, and m̂, kg.
    height: f64,
    mass_estimate: f64,
    counts: [f64; 3],
}

impl Means {
    fn finished(&self) -> [f64; 3] {
        let [truths, frames, estimates] = self.counts;
        [
            (self.acted / truths) / (self.commanded / frames),
            self.height / truths,
            self.mass_estimate / estimates,
        ]
    }
}

impl TickSink for Means {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        match topic {
            Topic::VehicleTruth => {
                let truth = VehicleTruth::read_from_bytes(bytes).unwrap();
                if truth.header.stamp_ns > 50_000_000_000 {
                    self.acted += truth.thrust;
                    self.height += -1.2 - truth.position_world[2];
                    self.counts[0] += 1.0;
                }
            }
            Topic::RcFrame => {
                let frame = RcFrame::read_from_bytes(bytes).unwrap();
                if frame.header.stamp_ns > 50_000_000_000 {
                    self.commanded += frame.thrust;
                    self.counts[1] += 1.0;
                }
            }
            Topic::ControlAdaptation => {
                let adaptation = ControlAdaptation::read_from_bytes(bytes).unwrap();
                if adaptation.header.stamp_ns > 50_000_000_000 {
                    self.mass_estimate += adaptation.mass_estimate;
                    self.counts[2] += 1.0;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// Flies Fig. 7 without its fan on a battery that ends with the flight. Returns the thrust that acts per commanded thrust, the
/// height over the path (m) and m̂ (kg) over the last ten seconds.
fn fly(is_corrected: bool) -> [f64; 3] {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let text = std::fs::read_to_string(folder.join("fig7.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let mut scenario: Scenario = table.try_into().unwrap();
    scenario.duration = DURATION;
    scenario.vehicle.fan = None;
    scenario.vehicle.actuators.as_mut().unwrap().battery = Some(Battery {
        endurance: DURATION,
        fade: 0.15,
        droop: 0.03,
        voltage: None,
    });
    scenario.rc_output.get_or_insert_default().battery = is_corrected.then(|| LinkBattery {
        source: VoltageSource::Modelled,
        calibrated: Some(8.4),
        model: Some(BatteryModel {
            full: 8.4,
            thrust: WEIGHT,
            spent: 0.0,
            endurance: DURATION,
            fade: 0.15,
            droop: 0.03,
        }),
        ..LinkBattery::default()
    });
    assert_eq!(scenario.problems(), []);
    let mut means = Means::default();
    let mut host = InProcess::new(scenario.schedule().unwrap(), build_all(&scenario).unwrap());
    host.fly(&mut means).unwrap();
    means.finished()
}

#[test]
fn a_corrected_link_keeps_the_thrust_of_a_flight_on_a_battery_that_empties() {
    let [without, with] = [fly(false), fly(true)];
    let (ratio, mass) = (without[0], without[2]);
    assert!((0.65..0.75).contains(&ratio), "without: {without:?}");
    // The law learns the lost thrust as mass.
    assert!(mass > 0.21, "without: {without:?}");
    let [ratio, height, mass] = with;
    assert!((ratio - 1.0).abs() < 0.003, "with: {with:?}");
    assert!((mass - 0.2).abs() < 0.01, "with: {with:?}");
    assert!(height.abs() < 0.005, "with: {with:?}");
}
