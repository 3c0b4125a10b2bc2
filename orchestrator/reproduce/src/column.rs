//! The laboratories in which every figure is flown: as stated, with doubled latencies and noise, and with a wrong model.
//!
//! A column is a set of settings as for `--set`, derived from the scenario that it is applied to.

use scenario::Scenario;
use serde::{Deserialize, Serialize};

/// A laboratory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Column {
    /// As the scenario states it.
    Baseline,
    /// Latencies and the cameras' noise doubled, in the estimator's parameters as well.
    Doubled,
    /// A rig that differs from the model: slower, stronger actuators, a faster radio that loses frames.
    WrongModel,
}

/// Ratio of the actuators' lag to the modelled one in [`Column::WrongModel`].
const LAG_FACTOR: f64 = 1.5;

/// Ratio of the thrust to the commanded one in [`Column::WrongModel`].
const THRUST_FACTOR: f64 = 1.05;

/// Reduction of the radio's latency below the modelled one in [`Column::WrongModel`], s.
const LATENCY_REDUCTION: f64 = 0.004;

/// Share of lost frames in [`Column::WrongModel`].
const FRAME_LOSS: f64 = 0.05;

const CAPTURE_EDGE: &str = "mocap/pose -> estimator";
const RADIO_EDGE: &str = "rc/frame -> plant";

impl Column {
    /// All laboratories, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Doubled, Self::WrongModel];

    /// Returns the name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Doubled => "doubled",
            Self::WrongModel => "wrong model",
        }
    }

    /// Returns a one-line description.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::Baseline => "the rig as the scenario states it",
            Self::Doubled => "latencies and the cameras' noise doubled, and known to the estimator",
            Self::WrongModel => {
                "lags +50 %, thrust +5 %, radio latency −4 ms, 5 % of the frames lost, all unknown to the model"
            }
        }
    }

    /// Returns the settings that turn the laboratory of `scenario` into this one.
    #[must_use]
    pub fn settings(self, scenario: &Scenario) -> Vec<String> {
        match self {
            Self::Baseline => Vec::new(),
            Self::Doubled => doubled(scenario),
            Self::WrongModel => wrong_model(scenario),
        }
    }
}

fn doubled(scenario: &Scenario) -> Vec<String> {
    let mut settings = Vec::new();
    let mut twice = |key: &str, value: f64| settings.push(setting(key, 2.0 * value));
    for edge in [CAPTURE_EDGE, RADIO_EDGE] {
        if let Some(latency) = scenario.schedule.latency.get(edge) {
            twice(&latency_key(edge), *latency);
        }
    }
    if let Some(model) = &scenario.model {
        twice("model.radio_latency", model.radio_latency);
    }
    if let Some(cameras) = &scenario.cameras {
        twice("cameras.position_deviation", cameras.position_deviation);
        twice("cameras.attitude_deviation", cameras.attitude_deviation);
    }
    if let Some(estimator) = &scenario.estimator {
        let kalman = &estimator.kalman;
        twice("estimator.kalman.position_deviation", kalman.position_deviation);
        twice("estimator.kalman.attitude_deviation", kalman.attitude_deviation);
    }
    settings
}

fn wrong_model(scenario: &Scenario) -> Vec<String> {
    let mut settings = Vec::new();
    if let Some(latency) = scenario.schedule.latency.get(RADIO_EDGE) {
        settings.push(setting(&latency_key(RADIO_EDGE), latency - LATENCY_REDUCTION));
    }
    if let Some(actuators) = &scenario.vehicle.actuators {
        let rate_lag = actuators.rate_lag.map(|lag| rounded(lag * LAG_FACTOR));
        settings.push(setting(
            "vehicle.actuators.thrust_lag",
            actuators.thrust_lag * LAG_FACTOR,
        ));
        settings.push(format!("vehicle.actuators.rate_lag={rate_lag:?}"));
        settings.push(setting("vehicle.actuators.thrust_factor", THRUST_FACTOR));
        settings.push(setting("vehicle.actuators.frame_loss", FRAME_LOSS));
    }
    settings
}

fn latency_key(edge: &str) -> String {
    format!("schedule.latency.\"{edge}\"")
}

fn setting(key: &str, value: f64) -> String {
    format!("{key}={:?}", rounded(value))
}

/// Removes the rounding error of a product or difference: times must be whole ticks.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::ScenarioSource;

    #[test]
    fn doubled_noise_and_latencies_are_believed_and_nothing_else_changes() {
        let baseline = ScenarioSource::FIG3_6.load(&[], 1).unwrap();
        let mut wanted = baseline.clone();
        for latency in wanted.schedule.latency.values_mut() {
            *latency *= 2.0;
        }
        wanted.model.as_mut().unwrap().radio_latency = 0.01;
        let cameras = wanted.cameras.as_mut().unwrap();
        (cameras.position_deviation, cameras.attitude_deviation) = (6e-4, 4e-3);
        let kalman = &mut wanted.estimator.as_mut().unwrap().kalman;
        (kalman.position_deviation, kalman.attitude_deviation) = (6e-4, 4e-3);
        let settings = Column::Doubled.settings(&baseline);
        assert_eq!(ScenarioSource::FIG3_6.load(&settings, 1).unwrap(), wanted);
    }

    #[test]
    fn a_wrong_model_is_one_whose_truth_changes_and_whose_beliefs_do_not() {
        let baseline = ScenarioSource::FIG3_6.load(&[], 1).unwrap();
        let mut wanted = baseline.clone();
        wanted
            .schedule
            .latency
            .insert("rc/frame -> plant".to_owned(), 0.001);
        let actuators = wanted.vehicle.actuators.as_mut().unwrap();
        actuators.thrust_lag = 0.045;
        actuators.rate_lag = [0.03; 3];
        actuators.thrust_factor = 1.05;
        actuators.frame_loss = 0.05;
        let settings = Column::WrongModel.settings(&baseline);
        assert_eq!(ScenarioSource::FIG3_6.load(&settings, 1).unwrap(), wanted);
    }

    #[test]
    fn an_ideal_flight_has_nothing_to_be_worse_in() {
        let ideal = ScenarioSource::FIG1.load(&[], 1).unwrap();
        for column in Column::ALL {
            assert!(column.settings(&ideal).is_empty(), "{column:?}");
        }
    }
}
