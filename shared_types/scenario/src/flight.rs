//! Phases of a flight: the operator's planned requests, and take-off and landing.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Action, Scenario};
use crate::range::{between, moment};
use shared_types::flight_phase::ReadyLimits;
use shared_types::schedule::OperatorPlan;
use shared_types::{ServiceId, Topic};

/// Flight with phases: disarmed, armed, take-off, fly, land, disarmed. The ground is at the vehicle's initial height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Flight {
    /// Time of the operator's request to arm, s, which expires after 0.5 s if the vehicle is not ready; by command only unless
    /// stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = moment)]
    pub arm_at: Option<f64>,
    /// Time of the operator's request to land, s; by command only unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = moment)]
    pub land_at: Option<f64>,
    /// Time of the operator's kill, s; by command only unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = moment)]
    pub kill_at: Option<f64>,
    /// Time for which the motors idle between arming and take-off, s.
    #[schemars(transform = between(0.0, 60.0), extend("x-hint" = "in s: 1000 ms are 1.0"))]
    pub spool_up: f64,
    /// Height of the climb before the vehicle flies to the path, m.
    #[schemars(transform = between(0.05, 50.0), extend("x-hint" = "in m: 80 cm are 0.8"))]
    pub takeoff_height: f64,
    /// Maximum speed from the ground to the path, m/s.
    #[schemars(transform = between(0.01, 5.0), extend("x-hint" = "in m/s: 40 cm/s are 0.4"))]
    pub takeoff_speed: f64,
    /// Time in which the path accelerates from rest to full speed, and later decelerates to rest before the descent, s.
    #[schemars(transform = between(0.05, 60.0), extend("x-hint" = "in s: 2000 ms are 2.0"))]
    pub transition_time: f64,
    /// Speed of the descent, m/s.
    #[schemars(transform = between(0.01, 3.0), extend("x-hint" = "in m/s: 30 cm/s are 0.3"))]
    pub landing_speed: f64,
    /// Maximum standard deviation of the estimated position for arming, m.
    #[schemars(transform = between(0.001, 20.0), extend("x-hint" = "in m: 1 cm is 0.01"))]
    pub position_sigma_max: f64,
    /// Maximum angle between thrust axis and vertical for arming, rad.
    #[schemars(transform = between(0.02, FRAC_PI_2), extend("x-hint" = "in rad: 0.35, which is 20°, is much for a vehicle that stands on its legs"))]
    pub tilt_max: f64,
    /// Turn at lift-off, and back, which shows a wrong sign of yaw (`wrong_response`), rad; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0.1, FRAC_PI_6), extend("x-hint" = "in rad: 0.2, which is 11°, shows the sign; less is found too late"))]
    pub yaw_test: Option<f64>,
    /// z in {I} of the vehicle on the ground, m: farther from it than `ground_tolerance`, it is not armed by command. Not
    /// checked unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<f64>,
    /// Maximum distance from `ground` for arming, m; 0.1 unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0.005, 10.0), extend("x-hint" = "in m: 5 cm are 0.05"))]
    pub ground_tolerance: Option<f64>,
    /// File of the vehicle's hand test, relative to the scenario's, which `gerono lab check` writes: without a test that this body
    /// has passed with these cameras, it is not armed by command. No test is needed unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hand_test: Option<String>,
    /// Action in real time if the vehicle answers the first commands of a take-off about a wrong axis or with a wrong sign;
    /// `"kill"` unless stated, which lands a vehicle that is 0.3 m above the ground or higher.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wrong_response: Option<Action>,
}

/// Maximum distance from the stated ground for arming unless stated, m.
const GROUND_TOLERANCE: f64 = 0.1;

impl Default for Flight {
    fn default() -> Self {
        Self {
            arm_at: None,
            land_at: None,
            kill_at: None,
            spool_up: 1.0,
            takeoff_height: 1.0,
            takeoff_speed: 0.5,
            transition_time: 2.0,
            landing_speed: 0.3,
            position_sigma_max: 0.02,
            tilt_max: 0.35,
            yaw_test: None,
            ground: None,
            ground_tolerance: None,
            hand_test: None,
            wrong_response: None,
        }
    }
}

impl Flight {
    /// Returns the maximum duration of a landing from a height (m), s: the path stops, up to 1 m higher; the vehicle
    /// descends; within 5 s the touch-down is detected and the motors are off.
    #[must_use]
    pub fn landing_time(&self, height: f64) -> f64 {
        self.transition_time + (height.max(0.0) + 1.0) / self.landing_speed + 5.0
    }

    /// Returns the duration of a flight that lands immediately after take-off, s.
    #[must_use]
    pub fn shortest_time(&self) -> f64 {
        let rise = self.takeoff_height;
        self.spool_up + leg_duration(rise, self.takeoff_speed) + self.landing_time(rise)
    }

    /// Returns z of the ground, of the floor unless stated, and the distance from it that is permitted for arming, m.
    #[must_use]
    pub fn ground_or_floor(&self) -> [f64; 2] {
        [
            self.ground.unwrap_or(0.0),
            self.ground_tolerance.unwrap_or(GROUND_TOLERANCE),
        ]
    }

    /// Returns the distance from the ground (m) of a vehicle at a height z, and the limit, if it is too far away for arming.
    #[must_use]
    pub fn off_the_ground(&self, z: f64) -> Option<[f64; 2]> {
        let [_, limit] = self.ground_or_floor();
        let distance = (z - self.ground?).abs();
        // Not a number is no height.
        (distance.is_nan() || distance > limit).then_some([distance, limit])
    }

    /// Returns the planned requests of the operator: key, and the time (s) if stated.
    #[must_use]
    pub fn requests(&self) -> [(&'static str, Option<f64>); 3] {
        [
            ("arm_at", self.arm_at),
            ("land_at", self.land_at),
            ("kill_at", self.kill_at),
        ]
    }
}

/// Maximum slope of the normalised position along a leg, from rest to rest.
pub const STEEPEST: f64 = 35.0 / 16.0;
/// Upper bound of its second derivative: 84√5/25 = 7.513….
pub const MOST_CURVED: f64 = 7.5132;
/// Maximum acceleration on a leg, m/s².
pub const LEG_ACCELERATION: f64 = 1.0;

/// Returns the duration of a straight leg of a length (m) with a maximum speed (m/s), s.
#[must_use]
pub fn leg_duration(length: f64, speed: f64) -> f64 {
    (STEEPEST * length / speed).max((MOST_CURVED * length / LEG_ACCELERATION).sqrt())
}

impl Scenario {
    /// Returns the limits for arming; `None` in a flight without phases.
    #[must_use]
    pub fn ready_limits(&self) -> Option<ReadyLimits> {
        let flight = self.flight.as_ref()?;
        let age_ns = |topic| self.fresh_age_ns(topic, ServiceId::PathGenerator);
        Some(ReadyLimits {
            state_age_ns: age_ns(Topic::VehicleState),
            frame_age_ns: age_ns(Topic::RcFrame),
            position_sigma: flight.position_sigma_max,
            tilt: flight.tilt_max,
        })
    }

    /// Returns the planned requests of the operator.
    pub(super) fn operator_plan(&self) -> OperatorPlan {
        let Some(flight) = &self.flight else {
            return OperatorPlan::FLYING;
        };
        let tick = |time: Option<f64>| time.map_or(u64::MAX, |time| self.tick_of(time));
        OperatorPlan {
            armed_from: tick(flight.arm_at),
            land_from: tick(flight.land_at),
            killed_from: tick(flight.kill_at),
        }
    }
}
