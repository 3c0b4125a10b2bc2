//! What the filter assumes of its sensors.

use nalgebra::Vector3;
use shared_types::gnss::FixErrors;

/// Assumed errors of three orthogonal inertial sensors; their unit is u = rad/s or m/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialNoise {
    /// N, density of the white noise, u/√Hz.
    pub noise_density: f64,
    /// Standard deviation of each component of the bias when it is switched on, u.
    pub bias_deviation: f64,
    /// K, density of the bias walk, u/√s.
    pub bias_walk: f64,
}

/// Parameters of the filter. The defaults fit the defaults of the simulated sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// N_g, b_g and K_g.
    pub gyroscope: InertialNoise,
    /// N_a, b_a and K_a.
    pub accelerometer: InertialNoise,
    /// Errors of a fix of each kind ([`FixKind`](shared_types::gnss::FixKind)).
    pub fixes: [FixErrors; 3],
    /// l, place of the antenna in {B}, m.
    pub antenna_body: Vector3<f64>,
    /// b, place of the second antenna from the first in {B}, m; `None` of a receiver with one antenna.
    pub baseline_body: Option<Vector3<f64>>,
    /// B, field of the earth in {I}, G.
    pub field_world: Vector3<f64>,
    /// Standard deviation of a component of the measured field, G: its noise, and soft iron.
    pub field_white: f64,
    /// Standard deviation of each component of b_m, the field of the vehicle, G.
    pub field_bias_deviation: f64,
    /// Density of the walk of b_m, G/√s.
    pub field_bias_walk: f64,
    /// Standard deviation by which b_m may change when the motors start, G.
    pub field_arming_deviation: f64,
    /// Standard deviation of b_h at the alignment, m: large unless the pressure at the origin of {I} was set.
    pub altitude_deviation: f64,
    /// Standard deviation of the white error of an altitude, m.
    pub altitude_white: f64,
    /// Largest altitude that may be missing near the ground while the rotors turn, m.
    pub altitude_ground_effect: f64,
    /// Density of the walk of b_h, the slow error of the altitude, m/√s.
    pub altitude_walk: f64,
    /// Standard deviations of each component of a pose's position (m), and of its attitude about each axis (rad).
    pub pose_deviations: [f64; 2],
    /// Delay of the horizon, s: at least the latency of the latest measurement.
    pub horizon: f64,
    /// Time after which a source that is refused without a break is accepted again, s.
    pub reset_after: f64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            gyroscope: InertialNoise {
                noise_density: 2.45e-4,
                bias_deviation: 0.01,
                bias_walk: 1e-4,
            },
            accelerometer: InertialNoise {
                noise_density: 6.9e-3,
                bias_deviation: 0.1,
                bias_walk: 1e-3,
            },
            fixes: FixErrors::TYPICAL,
            antenna_body: Vector3::new(0.0, 0.0, 0.0),
            baseline_body: None,
            field_world: Vector3::new(0.21, 0.0, 0.43),
            field_white: 0.01,
            field_bias_deviation: 0.015,
            field_bias_walk: 1e-4,
            field_arming_deviation: 0.05,
            altitude_deviation: 10.0,
            altitude_white: 0.1,
            altitude_ground_effect: 1.0,
            // 0.3 m with a correlation time of 100 s: σ √(2/τ).
            altitude_walk: 0.042,
            pose_deviations: [3e-4, 2e-3],
            horizon: 0.12,
            reset_after: 7.0,
        }
    }
}
