//! The paper's simulations, section V: what Figs. 1 and 2 show, and the claim of "a wide range of vehicles".
//!
//! Flown in one process, which the other hosts equal to the byte (see `identity.rs`).

use crate::common;

use std::convert::Infallible;

use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use host::in_process::TickSink;
use metrics::tracker::{Moment, Tracker};
use scenario::Scenario;
use shared_types::Topic;
use shared_types::samples::PathReference;
use zerocopy::FromBytes;

/// The vehicle's distance from its path and the state of the timing law, tick by tick.
struct Flight {
    tracker: Tracker,
    /// Distance from the path, m.
    distance: Vec<f64>,
    /// γ̇, 1/s.
    gamma_dot: Vec<f64>,
}

impl TickSink for Flight {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        let moment = self.tracker.observe(topic, bytes);
        self.keep(moment);
        if topic == Topic::PathReference {
            let reference = PathReference::ref_from_bytes(bytes).unwrap();
            self.gamma_dot.push(reference.gamma_dot);
        }
        Ok(())
    }
}

impl Flight {
    fn of(scenario: &Scenario) -> Self {
        let mut flight = Self {
            tracker: Tracker::new(&scenario.schedule().unwrap(), false),
            distance: Vec::new(),
            gamma_dot: Vec::new(),
        };
        let ending = in_process::fly(scenario, &mut flight, &Interrupt::never()).unwrap();
        assert!(
            matches!(ending.outcome, Outcome::Completed),
            "{:?}",
            ending.outcome
        );
        let last = flight.tracker.last();
        flight.keep(last);
        flight
    }

    fn keep(&mut self, moment: Option<Moment>) {
        let distance = moment.map(|moment| moment.distance.expect("there is a path at every tick"));
        self.distance.extend(distance);
    }

    /// Largest distance from the path from one time to another, s.
    fn peak(&self, from: usize, to: usize) -> f64 {
        self.distance[from * 1000..=to * 1000]
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }
}

fn load(name: &str, sets: &[String]) -> Scenario {
    scenario_file::load(&common::scenario(name), sets, None).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn fig1_stays_within_the_bound_before_and_after_the_mass_step() {
    let flight = Flight::of(&load("fig1", &[]));
    assert!(
        flight.peak(25, 30) <= 0.0175,
        "before the step: {}",
        flight.peak(25, 30)
    );
    assert!(
        flight.peak(55, 60) <= 0.0175,
        "after the step: {}",
        flight.peak(55, 60)
    );
    let transient = flight.peak(30, 60);
    assert!(
        (0.03..=0.075).contains(&transient),
        "the step must be felt, and be small: {transient}"
    );
}

#[test]
fn fig2_converges_from_anywhere_while_the_path_waits() {
    for (name, start) in [("fig2_near", 8.15), ("fig2_middle", 26.58), ("fig2_far", 51.40)] {
        let scenario = load(name, &[]);
        let flight = Flight::of(&scenario);
        assert!(
            (flight.distance[0] - start).abs() < 0.005,
            "{name} starts at {}",
            flight.distance[0]
        );
        let last = flight.distance.len() / 1000;
        assert!(
            flight.peak(last - 5, last) <= 0.0185,
            "{name} ends at {}",
            flight.peak(last - 5, last)
        );

        let arrival = flight
            .distance
            .iter()
            .position(|&distance| distance < scenario.path.alpha2)
            .unwrap();
        assert!(arrival > 1000, "{name} has a way to go");
        assert!(
            flight.gamma_dot[..=arrival].iter().all(|&rate| rate == 0.0),
            "{name}: the path waits"
        );
        assert!(flight.gamma_dot[arrival + 3000] > 0.5, "{name}: then it moves");
    }
}

#[test]
fn one_set_of_gains_and_initial_estimates_flies_vehicles_from_100_grams_to_2_kilograms() {
    for mass in [0.1, 0.2, 0.4, 0.8, 1.4, 2.0] {
        let scale = mass / 0.2;
        let sets = [
            "vehicle.change=[]".to_owned(),
            format!("vehicle.mass={mass:?}"),
            format!(
                "vehicle.inertia=[{:?}, {:?}, {:?}]",
                6.5e-4 * scale,
                6.5e-4 * scale,
                13.0e-4 * scale
            ),
            "controller.bounds.mass_min=0.04".to_owned(),
            "controller.bounds.mass_max=2.5".to_owned(),
        ];
        let flight = Flight::of(&load("fig1", &sets));
        assert!(
            flight.peak(55, 60) <= 0.02,
            "{mass} kg ends at {}",
            flight.peak(55, 60)
        );
    }
}
