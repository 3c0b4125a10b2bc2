//! Inertial navigation, and the place on the earth where the vehicle flies.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Topic;
use shared_types::geodesy::{Geodetic, LocalFrame};
use shared_types::gnss::{FixErrors, FixKind};

use super::sensors::FixDeviations;
use super::{Scenario, Vector};
use crate::range::{angle, between, not_negative, positive};

/// Place of the origin of {I} on the earth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Datum {
    /// Geodetic latitude (WGS-84), degrees.
    #[schemars(transform = between(-90.0, 90.0))]
    pub latitude: f64,
    /// Longitude (WGS-84), degrees.
    #[schemars(transform = between(-180.0, 180.0))]
    pub longitude: f64,
    /// Height above the ellipsoid, m.
    #[schemars(transform = between(-500.0, 9000.0))]
    pub height: f64,
    /// Azimuth of the x axis of {I}, clockwise from north, rad.
    #[schemars(transform = angle)]
    pub azimuth: f64,
    /// Magnetic field of the earth to the north, to the east and downwards, G.
    pub field: Vector,
}

impl Default for Datum {
    fn default() -> Self {
        // A meadow near Munich.
        Self {
            latitude: 48.137_154,
            longitude: 11.576_124,
            height: 565.0,
            azimuth: 0.0,
            field: [0.21, 0.015, 0.43],
        }
    }
}

impl Datum {
    /// Returns {I} as a frame on the earth.
    #[must_use]
    pub fn frame(&self) -> LocalFrame {
        let place = Geodetic {
            latitude: self.latitude,
            longitude: self.longitude,
            height: self.height,
        };
        LocalFrame::new(place, self.azimuth)
    }

    /// Returns the magnetic field of the earth in {I}, G.
    #[must_use]
    pub fn field_world(&self) -> Vector {
        self.frame().turned(self.field)
    }
}

/// Inertial navigation: an estimator of flight outdoors, over inertial, satellite, pressure and magnetic sensors. Its numbers
/// are what it assumes of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Navigation {
    /// Density of the gyroscope's white noise, rad/s/√Hz.
    #[schemars(transform = positive)]
    pub gyroscope_noise: f64,
    /// Standard deviation of each component of the gyroscope's bias when it is switched on, rad/s.
    #[schemars(transform = positive)]
    pub gyroscope_bias: f64,
    /// Density of the walk of this bias, rad/s/√s.
    #[schemars(transform = not_negative)]
    pub gyroscope_walk: f64,
    /// Density of the accelerometer's white noise, m/s²/√Hz.
    #[schemars(transform = positive)]
    pub accelerometer_noise: f64,
    /// Standard deviation of each component of the accelerometer's bias when it is switched on, m/s².
    #[schemars(transform = positive)]
    pub accelerometer_bias: f64,
    /// Density of the walk of this bias, m/s²/√s.
    #[schemars(transform = not_negative)]
    pub accelerometer_walk: f64,
    /// Place of the antenna in {B}, m.
    pub antenna: Vector,
    /// Vector from the antenna of the moving base to that of its rover, which sends it, in {B}, m; it is not used unless stated.
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
    /// Standard deviation of each component of a measured field, G: noise, and the vehicle's effect on the field of the earth.
    #[schemars(transform = positive)]
    pub field_white: f64,
    /// Standard deviation of each component of the vehicle's own field, G.
    #[schemars(transform = positive)]
    pub field_bias: f64,
    /// Density of the walk of this field, G/√s.
    #[schemars(transform = not_negative)]
    pub field_walk: f64,
    /// Standard deviation by which this field may change when the motors start, G.
    #[schemars(transform = not_negative)]
    pub field_arming: f64,
    /// Standard deviation of the barometer's slow error at the alignment, m.
    #[schemars(transform = positive)]
    pub altitude_bias: f64,
    /// Standard deviation of the white error of an altitude, m.
    #[schemars(transform = positive)]
    pub altitude_white: f64,
    /// Largest altitude that may be missing near the ground while the rotors turn, m.
    #[schemars(transform = not_negative)]
    pub altitude_ground_effect: f64,
    /// Density of the walk of the barometer's slow error, m/√s.
    #[schemars(transform = not_negative)]
    pub altitude_walk: f64,
    /// Errors of poses of motion capture, which is fused where it sees the vehicle; it is not used unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<Poses>,
    /// Delay at which measurements are fused, s: at least the latency of the latest one.
    #[schemars(transform = between(0.0, LONGEST_HORIZON))]
    pub horizon: f64,
    /// Time after which a source that is refused without a break is accepted again, s.
    #[schemars(transform = positive)]
    pub reset_after: f64,
    /// Time over which the published position follows a jump of the estimate, s.
    #[schemars(transform = positive)]
    pub ramp: f64,
    /// Time with fixes, without a break of a second, after which the vehicle counts as tracked, s.
    #[schemars(transform = not_negative)]
    pub healthy_for: f64,
    /// Time for which the state counts as tracked without a fix, s.
    #[schemars(transform = not_negative)]
    pub coast: f64,
    /// Bandwidth of the estimated acceleration that thrust and gravity do not explain, rad/s.
    #[schemars(transform = positive)]
    pub push_bandwidth: f64,
}

/// Errors of poses. Their frame is {I}, also of the datum, and they are of the body's origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Poses {
    /// Standard deviation of each component of a position, m.
    #[schemars(transform = positive)]
    pub position_deviation: f64,
    /// Standard deviation of an attitude about each axis, rad.
    #[schemars(transform = positive)]
    pub attitude_deviation: f64,
}

impl Default for Poses {
    fn default() -> Self {
        Self {
            position_deviation: 3e-4,
            attitude_deviation: 2e-3,
        }
    }
}

/// Largest delay of the horizon, s: the filter stores 256 samples up to it.
pub(crate) const LONGEST_HORIZON: f64 = 0.25;

impl Default for Navigation {
    fn default() -> Self {
        let [single_point, rtk_float, rtk_fixed] = FixErrors::TYPICAL;
        Self {
            gyroscope_noise: 2.45e-4,
            gyroscope_bias: 0.01,
            gyroscope_walk: 1e-4,
            accelerometer_noise: 6.9e-3,
            accelerometer_bias: 0.1,
            accelerometer_walk: 1e-3,
            antenna: [0.0; 3],
            baseline: None,
            single_point,
            rtk_float,
            rtk_fixed,
            field_white: 0.01,
            field_bias: 0.015,
            field_walk: 1e-4,
            field_arming: 0.05,
            altitude_bias: 10.0,
            altitude_white: 0.1,
            altitude_ground_effect: 1.0,
            altitude_walk: 0.042,
            poses: None,
            horizon: 0.12,
            reset_after: 7.0,
            ramp: 1.0,
            healthy_for: 10.0,
            coast: 120.0,
            push_bandwidth: 30.0,
        }
    }
}

impl Navigation {
    /// Returns the errors of each kind of fixes.
    #[must_use]
    pub fn errors(&self) -> [FixErrors; 3] {
        [self.single_point, self.rtk_float, self.rtk_fixed]
    }

    /// Returns the standard deviation (m) that a position may keep with the best fixes of a kind: that of their slow height.
    /// Without fixes it is that of a pose, or infinite.
    #[must_use]
    pub fn attainable_sigma(&self, kind: Option<FixKind>) -> f64 {
        let errors = kind.map(|kind| self.errors()[kind as usize]);
        let of_fixes = errors.map(|errors| errors.position_slow * errors.vertical_factor);
        let of_poses = self.poses.map(|poses| poses.position_deviation);
        of_fixes.or(of_poses).unwrap_or(f64::INFINITY)
    }
}

impl Scenario {
    /// Returns whether the flight has a topic, by its sections: that of a sensor only with sensors, telemetry only if it
    /// names values, and innovations of poses and baselines only if they are fused.
    #[must_use]
    pub fn has_topic(&self, topic: Topic) -> bool {
        match topic {
            Topic::ControlTelemetry => !self.controller.telemetry.is_empty(),
            // A missing output is the last of its service.
            Topic::PoseInnovations => self.fuses_poses() == Some(true) || self.baseline().is_some(),
            Topic::GnssBaseline | Topic::BaselineInnovations => self.baseline().is_some(),
            topic if topic.is_of_flight_outdoors() => self.sensors.is_some(),
            _ => true,
        }
    }

    /// Returns whether inertial navigation fuses poses; `None` without it.
    #[must_use]
    pub fn fuses_poses(&self) -> Option<bool> {
        self.navigation
            .as_ref()
            .map(|navigation| navigation.poses.is_some())
    }

    /// Returns the baseline that inertial navigation assumes of two antennas in {B}, m.
    #[must_use]
    pub fn baseline(&self) -> Option<Vector> {
        self.navigation.as_ref()?.baseline
    }

    /// Returns the place where the vehicle flies.
    #[must_use]
    pub fn datum_or_default(&self) -> Datum {
        self.datum.clone().unwrap_or_default()
    }
}
