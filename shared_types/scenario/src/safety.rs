//! What a service does about an input whose samples are too old or cannot be true.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::input_validator::Policy;

use super::{EdgeName, Scenario};
use shared_types::service::nanoseconds;
use shared_types::wiring::{ServiceId, Topic};

/// For how long commands pass over to those of the law unless stated, s.
const RECOVER: f64 = 0.1;

/// How much older than usual an input is fresh unless stated, s.
const GRACE: f64 = 0.1;

/// What a service does about an input whose samples are too old or cannot be true.
///
/// A sample's age is the time since it was published; only one that can be true makes the input young again. Which
/// of the values an input has a use for says [`InputSafety::uses`]; others are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputSafety {
    /// Age up to which a sample is used as if it were new, s.
    pub max_age: f64,
    /// Age above which the controller levels the vehicle, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<f64>,
    /// Age above which the controller lets the level vehicle descend, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub descend: Option<f64>,
    /// Age above which the motors are stopped, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failsafe: Option<f64>,
    /// Largest distance of a state from where the last good one was going, m; any unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jump: Option<f64>,
    /// For how long commands pass over to the law's when the state is back, s; 0.1 unless stated, 0 is at once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recover: Option<f64>,
}

impl InputSafety {
    /// Uses samples up to this age (s) and does nothing else.
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

    /// What is believed of a state.
    #[must_use]
    pub fn policy(&self) -> Policy {
        Policy {
            max_age_ns: nanoseconds(self.max_age),
            jump: self.jump,
        }
    }

    /// For how long commands pass over to the law's, ns.
    #[must_use]
    pub fn recover_ns(&self) -> u64 {
        nanoseconds(self.recover.unwrap_or(RECOVER))
    }

    /// The ages from which on something else is done, s, by name and in the order in which they must grow.
    #[must_use]
    pub fn ages(&self) -> [(&'static str, Option<f64>); 4] {
        [
            ("max_age", Some(self.max_age)),
            ("level", self.level),
            ("descend", self.descend),
            ("failsafe", self.failsafe),
        ]
    }

    /// The values that not every input has a use for: name, and whether it is stated.
    pub(super) fn special_values(&self) -> [(&'static str, bool); 5] {
        [
            ("level", self.level.is_some()),
            ("descend", self.descend.is_some()),
            ("failsafe", self.failsafe.is_some()),
            ("jump", self.jump.is_some()),
            ("recover", self.recover.is_some()),
        ]
    }

    /// The values besides `max_age` that an input has a use for; `None` if its age makes no difference to its service.
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
    /// What a service does about the samples of a topic that are too old; `None` if it uses them however old.
    #[must_use]
    pub fn safety_of(&self, topic: Topic, service: ServiceId) -> Option<&InputSafety> {
        self.safety.get(&format!("{topic} -> {service}"))
    }

    /// Age up to which an input counts as fresh, ns: what the scenario states for it, or a tenth of a second more than
    /// it is while nothing fails.
    #[must_use]
    pub fn fresh_age_ns(&self, topic: Topic, service: ServiceId) -> u64 {
        let stated = self.safety_of(topic, service).map(|safety| safety.max_age);
        let ordinary = EdgeName::of(topic, service).map_or(0, |edge| self.ordinary_age_ns(edge));
        stated.map_or(ordinary + nanoseconds(GRACE), nanoseconds)
    }

    /// The oldest that an input is at a step of its service while nothing fails, ns: since the newest sample that
    /// tells something new was published. 0 if the times make no schedule.
    ///
    /// A state that is not predicted tells the same until the next capture.
    #[must_use]
    pub fn ordinary_age_ns(&self, edge: EdgeName) -> u64 {
        let Ok(schedule) = self.schedule() else {
            return 0;
        };
        let age = schedule.ordinary_age(edge.service, edge.input);
        let is_predicted = self
            .estimator
            .as_ref()
            .is_some_and(|estimator| estimator.kalman.prediction);
        let between_captures_ns = self.between_captures_ns(&schedule);
        let between_states_ns = schedule.time_ns(schedule.topic_rate(Topic::VehicleState).period);
        let repeats =
            edge.topic == Topic::VehicleState && !is_predicted && between_captures_ns > between_states_ns;
        schedule.time_ns(age) + if repeats { between_captures_ns } else { 0 }
    }
}
