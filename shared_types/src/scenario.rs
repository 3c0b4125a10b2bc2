//! The parameters of a flight, as a scenario file states them and as every service reads them.
//!
//! A scenario determines the experiment together with its seed; nothing of the machine is in it. SI units and
//! radians. Defaults are those of the paper where it gives them (section V), else those that were checked to
//! give its results.

mod check;
mod problem;
pub mod suggest;
#[cfg(test)]
mod tests_support;
mod timing;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use problem::{Key, Problem};

/// A vector of three numbers.
pub type Vector = [f64; 3];

/// Standard gravity as the paper uses it, m/s².
pub const GRAVITY: f64 = 9.81;

/// A flight: vehicle, path, controller, schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What the scenario is for, one line.
    #[serde(default)]
    pub description: String,
    /// Seed of every random draw of the flight.
    #[serde(default = "default::seed")]
    pub seed: u64,
    /// Length of the flight, s.
    pub duration: f64,
    /// Base tick, rates and transport latencies.
    #[serde(default)]
    pub schedule: Timing,
    /// The vehicle and what happens to it.
    pub vehicle: Vehicle,
    /// The path and its timing law.
    pub path: Path,
    /// The control law's gains and bounds.
    #[serde(default)]
    pub controller: Controller,
}

/// Base tick, rates and transport latencies, s. Every time is a whole number of base ticks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Base tick h, s.
    pub tick: f64,
    /// Period of a service or topic, by name, s; one tick unless stated, a topic's is its publisher's.
    pub period: BTreeMap<String, f64>,
    /// First step of a service or first sample of a topic, by name, s; 0 unless stated.
    pub phase: BTreeMap<String, f64>,
    /// Transport latency of an edge, by `"topic -> service"`, s; as in the wiring table unless stated.
    pub latency: BTreeMap<String, f64>,
}

/// The vehicle, its initial state and its changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// m, kg.
    pub mass: f64,
    /// Diagonal of J, kg m².
    pub inertia: Vector,
    /// b, a constant acceleration in {I}, m/s².
    #[serde(default)]
    pub disturbance: Vector,
    /// State at the start of the flight.
    #[serde(default)]
    pub initial: InitialState,
    /// What changes in flight, in the order of time.
    #[serde(default)]
    pub change: Vec<VehicleChange>,
}

/// State of the vehicle at the start of the flight; at the origin, level and at rest unless stated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialState {
    /// p in {I}, m.
    pub position: Vector,
    /// Roll, pitch and yaw, rad; R = Rz(yaw) Ry(pitch) Rx(roll).
    pub roll_pitch_yaw: Vector,
    /// v in {B}, m/s.
    pub velocity_body: Vector,
    /// ω in {B}, rad/s.
    pub angular_velocity_body: Vector,
}

/// A change of the vehicle in flight: what is stated takes its new value at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VehicleChange {
    /// When, s.
    pub at: f64,
    /// New m, kg.
    pub mass: Option<f64>,
    /// New diagonal of J, kg m².
    pub inertia: Option<Vector>,
    /// New b in {I}, m/s².
    pub disturbance: Option<Vector>,
}

/// The path, how fast it is flown, and the gains of the timing law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Path {
    /// Whether the path waits for the vehicle.
    #[serde(default)]
    pub mode: PathMode,
    /// vd, desired rate of the path parameter, 1/s.
    #[serde(default = "default::speed")]
    pub speed: f64,
    /// k4, gain of the timing law (25), 1/s.
    #[serde(default = "default::k4")]
    pub k4: f64,
    /// α1, position error below which the path moves at full speed, m.
    #[serde(default = "default::alpha1")]
    pub alpha1: f64,
    /// α2, position error above which the path stands still, m.
    #[serde(default = "default::alpha2")]
    pub alpha2: f64,
    /// γ at the start of the flight.
    #[serde(default)]
    pub initial_gamma: f64,
    /// γ̇ at the start of the flight, 1/s; trajectory tracking begins at `speed` instead.
    #[serde(default)]
    pub initial_gamma_dot: f64,
    /// ψd, desired yaw, rad.
    #[serde(default)]
    pub yaw: f64,
    /// The curve pd(γ).
    pub curve: Curve,
}

/// How the path parameter moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PathMode {
    /// By the timing law (25): the path waits for the vehicle.
    #[default]
    Following,
    /// At constant rate, the paper's comparison: γ̇ = vd, γ̈ = 0.
    TrajectoryTracking,
}

/// A curve pd(γ) in {I}, at least C⁴ with bounded derivatives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Curve {
    /// The paper's tilted figure of eight (27): Rx(tilt) [ℓ sin wγ cos wγ, ℓ sin wγ, −height]ᵀ.
    TiltedEight(TiltedEight),
    /// A point to hover at.
    Hover(Hover),
    /// A tilted circle.
    Circle(Circle),
    /// A straight line without end.
    Line(Line),
    /// A smooth curve through points, from rest at the first to rest at the last, or around and around.
    Waypoints(Waypoints),
}

/// The paper's tilted figure of eight (27).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TiltedEight {
    /// ℓ, m.
    pub size: f64,
    /// w, rad per unit of γ.
    pub frequency: f64,
    /// Height of the centre above the origin before the tilt, m.
    pub height: f64,
    /// Angle of the tilt about x, rad.
    pub tilt: f64,
}

/// A point to hover at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hover {
    /// The point in {I}, m.
    pub position: Vector,
}

/// Rx(tilt) [r cos wγ, r sin wγ, 0]ᵀ + centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Circle {
    /// Centre in {I}, m.
    pub center: Vector,
    /// r, m.
    pub radius: f64,
    /// w, rad per unit of γ.
    #[serde(default = "default::circle_frequency")]
    pub frequency: f64,
    /// Angle of the tilt about x, rad.
    #[serde(default)]
    pub tilt: f64,
}

/// start + direction γ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// The point at γ = 0 in {I}, m.
    pub start: Vector,
    /// Way per unit of γ in {I}, m.
    pub direction: Vector,
}

/// A smooth curve through points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Waypoints {
    /// The points in {I}, m: at least two, at least three for a closed curve; no two neighbours coincide.
    pub points: Vec<Vector>,
    /// Whether the last point leads back to the first.
    #[serde(default)]
    pub closed: bool,
    /// γ from one point to the next.
    #[serde(default = "default::waypoint_interval")]
    pub interval: f64,
}

/// Gains, bounds and initial estimates of the adaptive law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Controller {
    /// k1, gain on the position error.
    pub k1: f64,
    /// k2, gain on the velocity error.
    pub k2: f64,
    /// k3, gain on the angular velocity error.
    pub k3: f64,
    /// β, weight of the angular velocity error in the Lyapunov function.
    pub beta: f64,
    /// δ, the constant that the velocity error is driven to along the thrust axis, m/s; not 0.
    pub delta: f64,
    /// σmax, level of the saturation; above δ/k1.
    pub sigma_max: f64,
    /// λm, adaptation gain of η̂; with 0 the estimate stays where it begins.
    pub lambda_mass: f64,
    /// Diagonal of Λb, adaptation gains of b̂; with 0 the estimate stays where it begins.
    pub lambda_disturbance: Vector,
    /// Λw is this times the identity: adaptation gain of ŵ; with 0 the estimate stays where it begins.
    pub lambda_inertia: f64,
    /// Where the unknown parameters are known to lie.
    pub bounds: Bounds,
    /// What the estimators begin with.
    pub initial: InitialEstimates,
}

/// Bounds of the unknown parameters (Assumption 1) and how far the smooth projection (5) may pass them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bounds {
    /// mmin, kg.
    pub mass_min: f64,
    /// mmax, kg.
    pub mass_max: f64,
    /// bmax of each component of b, m/s².
    pub disturbance: f64,
    /// ε of the projection of η̂, 1/kg; below 1/mmax.
    pub epsilon_eta: f64,
    /// ε of the projection of b̂, m/s².
    pub epsilon_disturbance: f64,
}

/// What the estimators begin with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialEstimates {
    /// 1/η̂, kg.
    pub mass: f64,
    /// Diagonal of J of which ŵ begins, kg m².
    pub inertia: Vector,
    /// b̂, m/s².
    pub disturbance: Vector,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            tick: 0.001,
            period: BTreeMap::new(),
            phase: BTreeMap::new(),
            latency: BTreeMap::new(),
        }
    }
}

impl Default for TiltedEight {
    fn default() -> Self {
        Self {
            size: 1.2,
            frequency: 0.6,
            height: 1.2,
            tilt: PI / 20.0,
        }
    }
}

impl Default for Controller {
    fn default() -> Self {
        Self {
            k1: 4.0,
            k2: 4.0,
            k3: 13.0,
            beta: 100.0,
            delta: 0.1,
            sigma_max: 1.5,
            lambda_mass: 0.3,
            lambda_disturbance: [1.0; 3],
            lambda_inertia: 1e-8,
            bounds: Bounds::default(),
            initial: InitialEstimates::default(),
        }
    }
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            mass_min: 0.1,
            mass_max: 0.6,
            disturbance: 3.0,
            epsilon_eta: 0.01,
            epsilon_disturbance: 0.1,
        }
    }
}

impl Default for InitialEstimates {
    fn default() -> Self {
        Self {
            mass: 0.2,
            inertia: [6.5e-4, 6.5e-4, 13.0e-4],
            disturbance: [0.0; 3],
        }
    }
}

mod default {
    pub(super) fn seed() -> u64 {
        1
    }
    pub(super) fn speed() -> f64 {
        1.0
    }
    pub(super) fn k4() -> f64 {
        1.0
    }
    pub(super) fn alpha1() -> f64 {
        0.5
    }
    pub(super) fn alpha2() -> f64 {
        1.5
    }
    pub(super) fn circle_frequency() -> f64 {
        1.0
    }
    pub(super) fn waypoint_interval() -> f64 {
        1.0
    }
}

impl Controller {
    /// σ⁻¹(δ/k1): what the theorem bounds ‖z1‖ by ultimately, m.
    #[must_use]
    pub fn ultimate_bound(&self) -> f64 {
        libm::atanh(self.delta.abs() / (self.k1 * self.sigma_max))
    }
}
