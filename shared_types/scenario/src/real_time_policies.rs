//! Default input policies in real time, where a state may be late.

use shared_types::service::seconds;
use shared_types::{ServiceId, Topic};

use crate::{EdgeName, InputSafety, Scenario};

/// Excess of a state's age up to which the law uses a predicted state, s.
const PREDICTED: f64 = 0.2;

/// Excess of a state's age above which the controller levels the vehicle, s.
const LEVELLED: f64 = 0.3;

/// Excess of a state's age above which the controller descends, s.
const DESCENDED: f64 = 1.0;

/// Excess of a reference's age up to which it is extrapolated along the path, s.
const CONTINUED: f64 = 0.5;

impl Scenario {
    /// Returns the scenario with default policies for a flight in real time: for states and references of the controller,
    /// and for states of the path generator if the flight has phases. They apply unless stated, because the system's clock
    /// does not wait for a service that hangs or restarts.
    ///
    /// For the path generator, a state that is too old means that the vehicle is not tracked: the path comes to rest. If
    /// the vehicle is tracked again elsewhere, the path leads it back from there.
    ///
    /// With a frozen state the law would keep turning the vehicle; a quarter of a second of it loses the vehicle. A level
    /// vehicle without a state drifts with the wind and its attitude errors until it hits a wall, so it descends. The
    /// motors are stopped only if the scenario says so: the height is unknown here.
    ///
    /// While no sample is late, a policy changes no byte of a flight.
    #[must_use]
    pub fn with_real_time_policies(mut self) -> Self {
        let ordinary = |topic, service| {
            EdgeName::between(topic, service).map_or(0.0, |edge| seconds(self.ordinary_age_ns(edge)))
        };
        let state = ordinary(Topic::VehicleState, ServiceId::Controller);
        let mut policies = vec![
            (
                Topic::VehicleState,
                ServiceId::Controller,
                InputSafety {
                    level: Some(state + LEVELLED),
                    descend: Some(state + DESCENDED),
                    ..InputSafety::new(state + PREDICTED)
                },
            ),
            (
                Topic::PathReference,
                ServiceId::Controller,
                InputSafety::new(ordinary(Topic::PathReference, ServiceId::Controller) + CONTINUED),
            ),
        ];
        if self.flight.is_some() {
            let state = ordinary(Topic::VehicleState, ServiceId::PathGenerator);
            policies.push((
                Topic::VehicleState,
                ServiceId::PathGenerator,
                InputSafety::new(state + PREDICTED),
            ));
        }
        for (topic, service, policy) in policies {
            self.safety
                .entry(format!("{topic} -> {service}"))
                .or_insert(policy);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: &str = "vehicle/state -> controller";

    fn scenario(name: &str) -> Scenario {
        let file = format!("{}/../../scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        toml::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
    }

    #[test]
    fn in_real_time_the_path_generator_of_a_flight_with_phases_loses_sight_of_the_vehicle() {
        let mut stated = scenario("takeoff_and_land");
        stated.safety.clear();
        let flown = stated.with_real_time_policies();
        assert_eq!(flown.problems(), []);
        let policy = flown
            .safety_of(Topic::VehicleState, ServiceId::PathGenerator)
            .unwrap();
        assert!(
            (0.2..0.25).contains(&policy.max_age) && policy.jump.is_none(),
            "{policy:?}"
        );
    }

    /// What is stated stays, and what is added is accepted as if it were stated.
    #[test]
    fn in_real_time_the_controller_has_policies_that_nothing_exceeds_without_faults() {
        for stated in [scenario("fig1"), scenario("fig3_6")] {
            let flown = stated.clone().with_real_time_policies();
            assert_eq!(flown.problems(), []);
            assert_eq!(flown.safety.len(), 2);
            for topic in [Topic::VehicleState, Topic::PathReference] {
                let edge = EdgeName::between(topic, ServiceId::Controller).unwrap();
                let policy = flown.safety_of(topic, ServiceId::Controller).unwrap();
                let ordinary = stated.ordinary_age_ns(edge) as f64 / 1e9;
                assert!(policy.max_age > ordinary + 0.1, "{policy:?}");
            }
            let state = flown
                .safety_of(Topic::VehicleState, ServiceId::Controller)
                .unwrap();
            assert!(state.max_age < state.level.unwrap() && state.level < state.descend);
            // The motors of a vehicle in the air are stopped by a statement only.
            assert_eq!((state.failsafe, state.jump), (None, None));
        }
        let stated = InputSafety::new(0.066);
        let mut scenario = scenario("fig3_6");
        scenario.safety.insert(STATE.to_owned(), stated.clone());
        let flown = scenario.with_real_time_policies();
        assert_eq!(flown.safety[STATE], stated);
    }
}
