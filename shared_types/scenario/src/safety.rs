//! Policy of a service for an input whose samples are too old or invalid.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::input_validator::Policy;

use super::{EdgeName, Scenario};
use crate::range::{between, length, not_negative, positive_up_to};
use crate::timing::LONGEST_DELAY;
use shared_types::path_stop::BRAKE;
use shared_types::service::{nanoseconds, seconds};
use shared_types::wiring::{ServiceId, Topic};

/// Default duration of the transfer to the law's commands, s.
const RECOVER: f64 = 0.1;

/// Default excess of a fresh input's age over its age without faults, s.
const GRACE: f64 = 0.1;

/// Policy of a service for an input whose samples are too old or invalid.
///
/// A sample's age is the time since it was published; only a valid sample resets the age of the input.
/// [`InputSafety::uses`] lists the values that an input has; others are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputSafety {
    /// Age up to which a sample is used, s.
    #[schemars(transform = length, transform = positive_up_to(10.0), extend("x-hint" = "in s: 200 ms are 0.2"))]
    pub max_age: f64,
    /// Age above which the controller levels the vehicle, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = length, transform = positive_up_to(60.0), extend("x-hint" = "in s: 300 ms are 0.3"))]
    pub level: Option<f64>,
    /// Age above which the level vehicle descends, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = length, transform = positive_up_to(60.0), extend("x-hint" = "in s: 1000 ms are 1.0"))]
    pub descend: Option<f64>,
    /// Age above which the motors are stopped, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = length, transform = positive_up_to(600.0), extend("x-hint" = "in s: 10000 ms are 10.0"))]
    pub failsafe: Option<f64>,
    /// Maximum distance of a state from the prediction of the last valid one, m; unlimited unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0.005, 10.0), extend("x-hint" = "in m: 20 cm are 0.2"))]
    pub jump: Option<f64>,
    /// Duration of the bumpless transfer to the law's commands when the state is back, s; 0.1 unless stated, 0 for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = not_negative, extend("x-ticks" = LONGEST_DELAY))]
    pub recover: Option<f64>,
}

impl InputSafety {
    /// Makes a policy that uses samples up to this age (s), without further stages.
    #[must_use]
    pub fn new(max_age: f64) -> Self {
        Self {
            max_age,
            level: None,
            descend: None,
            failsafe: None,
            jump: None,
            recover: None,
        }
    }

    /// Returns the policy of the input validator of states.
    #[must_use]
    pub fn policy(&self) -> Policy {
        Policy {
            max_age_ns: nanoseconds(self.max_age),
            jump: self.jump,
        }
    }

    /// Returns the duration of the transfer to the law's commands, ns.
    #[must_use]
    pub fn recover_ns(&self) -> u64 {
        nanoseconds(self.recover.unwrap_or(RECOVER))
    }

    /// Returns the names and ages (s) of the stages, in the order in which they must increase.
    #[must_use]
    pub fn ages(&self) -> [(&'static str, Option<f64>); 4] {
        [
            ("max_age", Some(self.max_age)),
            ("level", self.level),
            ("descend", self.descend),
            ("failsafe", self.failsafe),
        ]
    }

    /// Returns the values that only some inputs have: name, and whether stated.
    pub(super) fn special_values(&self) -> [(&'static str, bool); 5] {
        [
            ("level", self.level.is_some()),
            ("descend", self.descend.is_some()),
            ("failsafe", self.failsafe.is_some()),
            ("jump", self.jump.is_some()),
            ("recover", self.recover.is_some()),
        ]
    }

    /// Returns the values besides `max_age` that an input has; `None` if its age has no effect on its service.
    #[must_use]
    pub fn uses(edge: EdgeName) -> Option<&'static [&'static str]> {
        match (edge.service, edge.topic) {
            (ServiceId::Controller, Topic::VehicleState) => {
                Some(&["level", "descend", "failsafe", "jump", "recover"])
            }
            (ServiceId::PathGenerator | ServiceId::RcOutput, Topic::VehicleState) => Some(&["jump"]),
            (ServiceId::RcOutput, Topic::ControlCommand) => Some(&["failsafe"]),
            (ServiceId::Controller, Topic::PathReference)
            | (ServiceId::Estimator, Topic::MocapPose)
            | (ServiceId::PathGenerator, Topic::RcFrame) => Some(&[]),
            _ => None,
        }
    }
}

impl Scenario {
    /// Returns the policy of a service for samples of a topic that are too old; `None` if their age is not limited.
    #[must_use]
    pub fn safety_of(&self, topic: Topic, service: ServiceId) -> Option<&InputSafety> {
        self.safety.get(&format!("{topic} -> {service}"))
    }

    /// Returns the age up to which an input counts as fresh, ns: as stated, or 0.1 s above its age without faults.
    #[must_use]
    pub fn fresh_age_ns(&self, topic: Topic, service: ServiceId) -> u64 {
        let stated = self.safety_of(topic, service).map(|safety| safety.max_age);
        let ordinary = EdgeName::between(topic, service).map_or(0, |edge| self.ordinary_age_ns(edge));
        stated.map_or(ordinary + nanoseconds(GRACE), nanoseconds)
    }

    /// Returns the maximum age of an input at a step of its service without faults, ns: since the publication of the newest
    /// sample with new information. 0 without a valid schedule.
    ///
    /// A state without prediction carries the same information until the next capture.
    #[must_use]
    pub fn ordinary_age_ns(&self, edge: EdgeName) -> u64 {
        let Ok(schedule) = self.schedule() else {
            return 0;
        };
        let age = schedule.ordinary_age(edge.service, edge.input);
        let is_predicted = self
            .estimator
            .as_ref()
            .map_or(self.navigation.is_some(), |estimator| estimator.kalman.prediction);
        let between_captures_ns = self.between_captures_ns(&schedule);
        let between_states_ns = schedule.time_ns(schedule.topic_rate(Topic::VehicleState).period);
        let repeats =
            edge.topic == Topic::VehicleState && !is_predicted && between_captures_ns > between_states_ns;
        schedule.time_ns(age) + if repeats { between_captures_ns } else { 0 }
    }

    /// Returns the time for which the path continues without a new reference before it decelerates to rest, s; `None` without
    /// a policy. The total distance is that of `max_age` at the rate of the last reference, unless the stop alone is longer.
    #[must_use]
    pub fn path_continues_for(&self) -> Option<f64> {
        let safety = self.safety_of(Topic::PathReference, ServiceId::Controller)?;
        let ordinary = EdgeName::between(Topic::PathReference, ServiceId::Controller)
            .map_or(0.0, |edge| seconds(self.ordinary_age_ns(edge)));
        Some((safety.max_age - ordinary - 0.5 * BRAKE).max(0.0))
    }
}
