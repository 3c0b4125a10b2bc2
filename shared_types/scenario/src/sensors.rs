//! Simulated sensors of flight outdoors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::gnss::{FixErrors, FixKind};

use super::{GRAVITY, Vector, Volume};
use crate::range::{length, moment, not_negative, positive};

/// Simulated sensors: what they measure of the vehicle's motion. Their rates and latencies are those of their topics in the
/// schedule.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Inertial measurement unit.
    pub imu: Imu,
    /// Satellite receiver.
    pub gnss: Gnss,
    /// Barometer.
    pub barometer: Barometer,
    /// Magnetometer.
    pub magnetometer: Magnetometer,
}

/// Errors of the inertial measurement unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Imu {
    /// Density of the gyroscope's white noise, rad/s/√Hz.
    #[schemars(transform = not_negative)]
    pub gyroscope_noise: f64,
    /// Standard deviation of each component of the gyroscope's bias when it is switched on, rad/s.
    #[schemars(transform = not_negative)]
    pub gyroscope_bias: f64,
    /// Density of the walk of this bias, rad/s/√s.
    #[schemars(transform = not_negative)]
    pub gyroscope_walk: f64,
    /// Standard deviation of the gyroscope's error of scale about each axis.
    #[schemars(transform = not_negative)]
    pub gyroscope_scale: f64,
    /// Largest measured rate about each axis, rad/s.
    #[schemars(transform = positive)]
    pub gyroscope_range: f64,
    /// Rate per specific force that the gyroscope wrongly measures, rad/s per m/s².
    #[schemars(transform = not_negative)]
    pub gyroscope_sensitivity: f64,
    /// Density of the accelerometer's white noise, m/s²/√Hz.
    #[schemars(transform = not_negative)]
    pub accelerometer_noise: f64,
    /// Standard deviation of each component of the accelerometer's bias when it is switched on, m/s².
    #[schemars(transform = not_negative)]
    pub accelerometer_bias: f64,
    /// Density of the walk of this bias, m/s²/√s.
    #[schemars(transform = not_negative)]
    pub accelerometer_walk: f64,
    /// Standard deviation of the accelerometer's error of scale along each axis.
    #[schemars(transform = not_negative)]
    pub accelerometer_scale: f64,
    /// Largest measured specific force along each axis, m/s².
    #[schemars(transform = positive)]
    pub accelerometer_range: f64,
    /// Place of the unit in {B}, m.
    pub lever_arm: Vector,
    /// Amplitudes of the vibration at the frequency of the rotors and at twice it, m/s².
    #[schemars(transform = not_negative)]
    pub vibration: [f64; 2],
    /// Frequency of the rotors that hold the initial vehicle in the air, Hz.
    #[schemars(transform = positive)]
    pub rotor_frequency: f64,
}

impl Default for Imu {
    fn default() -> Self {
        Self {
            gyroscope_noise: 2.45e-4,
            gyroscope_bias: 0.01,
            gyroscope_walk: 1e-4,
            gyroscope_scale: 1e-3,
            gyroscope_range: 34.906_585,
            gyroscope_sensitivity: 1.02e-4,
            accelerometer_noise: 6.9e-3,
            accelerometer_bias: 0.1,
            accelerometer_walk: 1e-3,
            accelerometer_scale: 1e-3,
            accelerometer_range: 16.0 * GRAVITY,
            lever_arm: [0.0; 3],
            vibration: [2.0, 1.0],
            rotor_frequency: 190.0,
        }
    }
}

/// Satellite receiver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Gnss {
    /// What the receiver solves at the start of the flight.
    pub kind: Fixes,
    /// Building inside of which it sees no satellite, and solves nothing; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub building: Option<Volume>,
    /// Place of the antenna in {B}, m.
    pub antenna: Vector,
    /// Place of a second antenna from this one in {B}, m; there is none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Vector>,
    /// Errors of fixes from codes alone.
    #[serde(with = "FixDeviations")]
    pub single_point: FixErrors,
    /// Errors of fixes with corrections and unknown numbers of carrier waves.
    #[serde(with = "FixDeviations")]
    pub rtk_float: FixErrors,
    /// Errors of fixes with corrections and known numbers of carrier waves.
    #[serde(with = "FixDeviations")]
    pub rtk_fixed: FixErrors,
    /// Changes of what it solves, in chronological order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<FixChange>,
    /// Intervals in which positions drift away and the reported accuracies do not show it, in chronological order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub spoofing: Vec<Spoofing>,
}

impl Default for Gnss {
    fn default() -> Self {
        let [single_point, rtk_float, rtk_fixed] = FixErrors::TYPICAL;
        Self {
            kind: Fixes::RtkFixed,
            building: None,
            antenna: [0.0; 3],
            baseline: None,
            single_point,
            rtk_float,
            rtk_fixed,
            change: Vec::new(),
            spoofing: Vec::new(),
        }
    }
}

impl Gnss {
    /// Returns the errors of each kind of fixes.
    #[must_use]
    pub fn errors(&self) -> [FixErrors; 3] {
        [self.single_point, self.rtk_float, self.rtk_fixed]
    }

    /// Returns the least accurate kind of fixes in the course of the flight; `None` without any.
    #[must_use]
    pub fn least_accurate(&self) -> Option<FixKind> {
        let kinds = self.change.iter().map(|change| change.kind);
        kinds.chain([self.kind]).filter_map(Fixes::kind).min()
    }
}

/// What a receiver solves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fixes {
    /// Nothing: there is no receiver, or it sees no satellite.
    None,
    /// A position from the codes of the satellites alone.
    SinglePoint,
    /// With corrections, and with the numbers of carrier waves as real numbers.
    RtkFloat,
    /// With corrections, and with these numbers known.
    #[default]
    RtkFixed,
}

impl Fixes {
    /// Returns the kind of a fix; `None` if there is none.
    #[must_use]
    pub fn kind(self) -> Option<FixKind> {
        match self {
            Self::None => None,
            Self::SinglePoint => Some(FixKind::SinglePoint),
            Self::RtkFloat => Some(FixKind::RtkFloat),
            Self::RtkFixed => Some(FixKind::RtkFixed),
        }
    }
}

/// Errors of a kind of fixes, each a standard deviation of one component: a white part, and a slow one.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "FixErrors", deny_unknown_fields)]
pub struct FixDeviations {
    /// White error of a horizontal position, m.
    #[schemars(transform = positive)]
    pub position_white: f64,
    /// Slow error of a horizontal position, m.
    #[schemars(transform = not_negative)]
    pub position_slow: f64,
    /// Correlation time of this slow error, s.
    #[schemars(transform = positive)]
    pub position_time: f64,
    /// Vertical error of the position over the horizontal one.
    #[schemars(transform = positive)]
    pub vertical_factor: f64,
    /// White error of the velocity, m/s.
    #[schemars(transform = positive)]
    pub velocity_white: f64,
    /// Slow error of the velocity, m/s.
    #[schemars(transform = not_negative)]
    pub velocity_slow: f64,
    /// Correlation time of this slow error, s.
    #[schemars(transform = positive)]
    pub velocity_time: f64,
}

/// Change of what a receiver solves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FixChange {
    /// Time, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// What it solves from then on.
    pub kind: Fixes,
}

/// Interval in which the positions of fixes drift away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spoofing {
    /// Start, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Duration, s.
    #[schemars(transform = length)]
    pub lasts: f64,
    /// Velocity of the drift in {I}, m/s.
    pub velocity: Vector,
}

/// Errors of the barometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Barometer {
    /// Standard deviation of the white error, m.
    #[schemars(transform = not_negative)]
    pub white: f64,
    /// Standard deviation of the slow error, m.
    #[schemars(transform = not_negative)]
    pub slow: f64,
    /// Correlation time of the slow error, s.
    #[schemars(transform = positive)]
    pub slow_time: f64,
    /// Error per square of the airspeed, m per (m/s)².
    pub airspeed_factor: f64,
    /// Altitude that is missing on the ground while the rotors turn, m.
    pub ground_effect: f64,
    /// Altitude above the ground up to which some is missing, m.
    #[schemars(transform = positive)]
    pub ground_effect_altitude: f64,
    /// Step of the digital output, m; 0 for none.
    #[schemars(transform = not_negative)]
    pub resolution: f64,
}

impl Default for Barometer {
    fn default() -> Self {
        Self {
            white: 0.1,
            slow: 0.3,
            slow_time: 100.0,
            airspeed_factor: 0.02,
            ground_effect: 1.0,
            ground_effect_altitude: 0.5,
            resolution: 0.01,
        }
    }
}

/// Errors of the magnetometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Magnetometer {
    /// Standard deviation of the white error of each component, G.
    #[schemars(transform = not_negative)]
    pub white: f64,
    /// Standard deviation of each component of the vehicle's own field, G.
    #[schemars(transform = not_negative)]
    pub hard_iron: f64,
    /// Standard deviation of each element of the vehicle's effect on the field of the earth.
    #[schemars(transform = not_negative)]
    pub soft_iron: f64,
    /// Field of the motors' current at full thrust in {B}, G.
    pub current: Vector,
    /// Step of the digital output, G; 0 for none.
    #[schemars(transform = not_negative)]
    pub resolution: f64,
}

impl Default for Magnetometer {
    fn default() -> Self {
        Self {
            white: 0.003,
            hard_iron: 0.01,
            soft_iron: 0.02,
            current: [0.0, 0.0, 0.05],
            resolution: 0.001,
        }
    }
}
