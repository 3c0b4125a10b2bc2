//! Vehicle, the forces on it, and its changes in flight.

use std::f64::consts::FRAC_PI_2;
use std::ops::Bound::Excluded;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use crate::range::{angle, between, from_0_to_below, moment, not_negative, positive, share, within};

/// The vehicle, its initial state and its changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// m, kg.
    #[schemars(transform = positive, extend("x-symbol" = "m"))]
    pub mass: f64,
    /// Diagonal of J, kg m².
    #[schemars(transform = positive, extend("x-symbol" = "J"))]
    pub inertia: Vector,
    /// b, a constant acceleration in {I}, m/s².
    #[serde(default)]
    pub disturbance: Vector,
    /// State at the start of the flight.
    #[serde(default)]
    pub initial: InitialState,
    /// Centre of mass in {B}, relative to the body's origin, on which the thrust acts and which the cameras track, m.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub center_of_mass: Vector,
    /// Changes in flight, in chronological order.
    #[serde(default)]
    pub change: Vec<VehicleChange>,
    /// Response to the radio's commands; ideal unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuators: Option<Actuators>,
    /// Drag of the rotors along each body axis, linear in the airspeed, N s/m.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(transform = not_negative)]
    pub drag: Vector,
    /// Parasitic drag, quadratic in the airspeed, N s²/m².
    #[serde(default, skip_serializing_if = "is_zero_number")]
    #[schemars(transform = not_negative)]
    pub parasitic_drag: f64,
    /// Wind, which acts through the drag; still air unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wind: Option<Wind>,
    /// Ambient turbulence; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turbulence: Option<Turbulence>,
    /// Fan; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fan: Option<Fan>,
    /// Ground effect of the rotors; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground_effect: Option<GroundEffect>,
}

impl Vehicle {
    /// Makes a vehicle of mass m (kg) and J = Diag(`inertia`) (kg m²) in still air, at the origin, level and at rest.
    #[must_use]
    pub fn new(mass: f64, inertia: Vector) -> Self {
        Self {
            mass,
            inertia,
            disturbance: [0.0; 3],
            initial: InitialState::default(),
            center_of_mass: [0.0; 3],
            change: Vec::new(),
            actuators: None,
            drag: [0.0; 3],
            parasitic_drag: 0.0,
            wind: None,
            turbulence: None,
            fan: None,
            ground_effect: None,
        }
    }
}

/// Response of a vehicle with an on-board rate loop to frames of thrust and body rates: first-order lags.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Actuators {
    /// Time constant of the thrust, s; 0 for no lag.
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "0.03 is usual"))]
    pub thrust_lag: f64,
    /// Time constant of falling thrust, s, because motors decelerate by drag alone; that of `thrust_lag` unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "0.03 is usual"))]
    pub thrust_lag_down: Option<f64>,
    /// Time constants of the body rates about each axis, s; 0 for no lag.
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "0.02 is usual"))]
    pub rate_lag: Vector,
    /// Maximum thrust, N; the minimum is 0.
    #[schemars(transform = positive)]
    pub thrust_max: f64,
    /// Maximum magnitude of the body rate about each axis, rad/s.
    #[schemars(transform = positive)]
    pub rate_max: Vector,
    /// Actual thrust per commanded thrust.
    #[schemars(transform = positive)]
    pub thrust_factor: f64,
    /// Actual body rates per commanded rate.
    #[schemars(transform = positive)]
    pub rate_factor: Vector,
    /// Actual body rates at zero command, rad/s.
    pub rate_bias: Vector,
    /// Share of the radio's frames that the vehicle does not receive; the previous frame stays in effect.
    #[schemars(transform = share)]
    pub frame_loss: f64,
    /// Thrust at the start of the flight and until the first frame, N.
    #[schemars(transform = not_negative)]
    pub initial_thrust: f64,
    /// Battery whose voltage falls in flight; constant voltage unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery: Option<Battery>,
}

/// Battery: thrust falls with the square of its voltage, u² with u = 1 − fade q − droop T/T0.
///
/// q is the spent share of the charge, with dq/dt = T/(T0 endurance), and T0 is `initial_thrust`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// Time for which the battery sustains `initial_thrust`, s.
    #[schemars(transform = positive)]
    pub endurance: f64,
    /// Share of the voltage lost from full to empty.
    #[schemars(transform = share)]
    pub fade: f64,
    /// Share of the voltage lost at the battery's resistance at `initial_thrust`.
    #[serde(default)]
    #[schemars(transform = share)]
    pub droop: f64,
    /// Voltage at u = 1, for the telemetry of a simulated vehicle, V; none is sent unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1.0, 100.0))]
    pub voltage: Option<f64>,
}

impl Battery {
    /// Returns u ≥ 0, the voltage over that of the full battery at rest, at a spent share of the charge and a load T/T0.
    #[must_use]
    #[inline]
    pub fn voltage_share(&self, spent: f64, load: f64) -> f64 {
        (1.0 - self.fade * spent - self.droop * load).max(0.0)
    }
}

impl Default for Actuators {
    fn default() -> Self {
        Self {
            thrust_lag: 0.03,
            thrust_lag_down: None,
            rate_lag: [0.02; 3],
            thrust_max: 5.5,
            rate_max: [19.0, 19.0, 8.0],
            thrust_factor: 1.0,
            rate_factor: [1.0; 3],
            rate_bias: [0.0; 3],
            frame_loss: 0.0,
            initial_thrust: 0.0,
            battery: None,
        }
    }
}

/// Uniform random process: each component is an Ornstein–Uhlenbeck process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Turbulence {
    /// Standard deviation of each component: m/s² for turbulence, m/s for gusts.
    #[schemars(transform = not_negative)]
    pub deviation: f64,
    /// Correlation time, s.
    #[schemars(transform = positive)]
    pub correlation_time: f64,
}

/// Uniform wind: w = mean + gusts + sine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Wind {
    /// Mean velocity in {I}, m/s.
    pub mean: Vector,
    /// Gusts, each component an Ornstein–Uhlenbeck process, m/s; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gusts: Option<Turbulence>,
    /// Gusts of the Dryden model along and across the mean; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dryden: Option<Dryden>,
    /// Amplitude of a sine in {I}, m/s.
    #[serde(skip_serializing_if = "is_zero")]
    pub sine: Vector,
    /// Frequency of the sine, rad/s.
    #[serde(skip_serializing_if = "is_zero_number")]
    #[schemars(transform = not_negative)]
    pub sine_frequency: f64,
}

/// Gusts of the Dryden model (MIL-F-8785C), carried by the mean wind.
///
/// At a low height h its lengths are h/(0.177 + 0.000823 h)^1.2 along and across the wind, and h/2 vertically, in feet. Below
/// 10 ft, in rooms, they are a choice: 1 to 5 m, with deviations of 0.2 to 0.4 times the mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dryden {
    /// Standard deviations along the mean wind, across it and vertically, m/s.
    #[schemars(transform = not_negative)]
    pub deviation: Vector,
    /// Lengths along the mean wind, across it and vertically, m.
    #[schemars(transform = positive)]
    pub length: Vector,
}

/// Ground effect: T/T∞ = 1/(1 − ρ (R/4z)²), at most 1.5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroundEffect {
    /// R, radius of a rotor, m.
    #[schemars(transform = positive)]
    pub rotor_radius: f64,
    /// ρ, 1 for a single rotor, up to 8.6 for four.
    #[serde(default = "default::ground_factor")]
    #[schemars(transform = not_negative, extend("x-symbol" = "ρ"))]
    pub factor: f64,
    /// z of the ground in {I}, m; the rotors are at the height of the centre of mass.
    #[serde(default)]
    pub ground: f64,
}

pub(super) fn is_zero_number(number: &f64) -> bool {
    *number == 0.0
}

/// Fan: a round, turbulent jet with a force on the vehicle.
///
/// The force on the axis falls with the square of the distance from the fan, as in a free jet far from its nozzle. The
/// radial profile is a Gaussian.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// Time at which the fan is switched on, s.
    #[serde(default)]
    #[schemars(transform = moment)]
    pub on_at: f64,
    /// Time at which the fan is switched off, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = moment)]
    pub off_at: Option<f64>,
    /// Time constant of start and stop, s; 0 for no lag.
    #[serde(default)]
    #[schemars(transform = not_negative)]
    pub run_up: f64,
    /// Position in {I}, m.
    pub position: Vector,
    /// Direction of the jet in {I}; of any length but 0.
    pub direction: Vector,
    /// Force on the vehicle on the axis at `reference_distance`, N.
    #[schemars(transform = not_negative)]
    pub force: f64,
    /// Distance from the fan for which `force` is stated, m.
    #[schemars(transform = positive)]
    pub reference_distance: f64,
    /// Half the opening angle of the jet, at which the force has fallen to 1/e, rad.
    #[serde(default = "default::jet_half_angle")]
    #[schemars(transform = within((Excluded(0.0), Excluded(FRAC_PI_2))), extend("x-hint" = "a free jet has about 0.2"))]
    pub half_angle: f64,
    /// Standard deviation of the force's fluctuation in each component, as a share of the local force.
    #[serde(default)]
    #[schemars(transform = not_negative)]
    pub turbulence: f64,
    /// Correlation time of the fluctuation, s.
    #[serde(default = "default::jet_correlation_time")]
    #[schemars(transform = positive)]
    pub correlation_time: f64,
    /// Later poses of the fan, in chronological order, with linear interpolation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moves: Vec<FanMove>,
}

/// Pose of the fan at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FanMove {
    /// Time of the pose, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Position in {I}, m.
    pub position: Vector,
    /// Direction of the jet in {I}.
    pub direction: Vector,
}

/// State of the vehicle at the start of the flight; at the origin, level and at rest unless stated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialState {
    /// p in {I}, m.
    pub position: Vector,
    /// Roll, pitch and yaw, rad; R = Rz(yaw) Ry(pitch) Rx(roll).
    #[schemars(transform = angle)]
    pub roll_pitch_yaw: Vector,
    /// v in {B}, m/s.
    pub velocity_body: Vector,
    /// ω in {B}, rad/s.
    pub angular_velocity_body: Vector,
}

/// Change of the vehicle in flight: stated values take effect immediately.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VehicleChange {
    /// Time of the change, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// New m, kg.
    #[schemars(transform = positive, extend("x-symbol" = "m"))]
    pub mass: Option<f64>,
    /// New diagonal of J, kg m².
    #[schemars(transform = positive, extend("x-symbol" = "J"))]
    pub inertia: Option<Vector>,
    /// New b in {I}, m/s².
    pub disturbance: Option<Vector>,
    /// New centre of mass in {B}, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_of_mass: Option<Vector>,
}

mod default {
    pub(super) fn jet_half_angle() -> f64 {
        0.2
    }

    pub(super) fn ground_factor() -> f64 {
        1.0
    }

    pub(super) fn jet_correlation_time() -> f64 {
        0.3
    }
}

/// Returns whether a vector is zero, which means "none".
pub(super) fn is_zero(vector: &Vector) -> bool {
    *vector == [0.0; 3]
}
