//! The parameters of a flight, as a scenario file states them and as every service reads them.
//!
//! A scenario determines the experiment together with its seed. How the machine is used stands in sections of its
//! own, which [`Scenario::experiment`] leaves out. SI units and radians. Defaults are those of the paper where it gives them (section V), else those that were checked to
//! give its results.

mod check;
mod envelope;
mod fault;
mod flight;
mod machine;
mod motion_capture;
mod problem;
mod programs;
mod radio_link;
mod safety;
pub mod suggest;
#[cfg(test)]
mod tests_support;
mod timing;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use envelope::{Action, Envelope, EstimateLimit, Fence, Limit, VectorLimit};
pub use fault::{Fault, FaultKind, FaultState, Target};
pub use flight::Flight;
pub use machine::{Deployment, OrchestratorLoss, RealTime, ServiceDeployment};
pub use motion_capture::{CaptureSystem, FrameTransform, MotionCapture, PoseSource};
pub use problem::{Key, Problem};
pub use programs::{Guests, Programs};
pub use radio_link::{
    ChannelSwitch, DsmProtocol, Mavlink, MavlinkMessage, MultiModule, RadioProtocol, Transmitter,
};
pub use safety::InputSafety;
pub use timing::names::EdgeName;

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
    /// The motion-capture system; ideal unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<Cameras>,
    /// The state estimator; passes what ideal cameras see on unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimator: Option<Estimator>,
    /// The motion-capture system of a laboratory; needed where `estimator.source` names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_capture: Option<MotionCapture>,
    /// The radio link; ideal unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rc_output: Option<RcLink>,
    /// What estimator and controller believe of vehicle and links; the truth may be otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// The phases of the flight, from the ground to the ground; without it the vehicle is in the air from the start to
    /// the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<Flight>,
    /// What the transmitter does not let the vehicle and the controller do; nothing is refused unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub envelope: Option<Envelope>,
    /// Planned faults of services and of their inputs, exact in simulated time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
    /// What services do about samples that are too old or cannot be true, by input: `"topic -> service"`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub safety: BTreeMap<String, InputSafety>,
    /// Programs of one's own that fly in place of services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub programs: Option<Programs>,
    /// How the services use the machine; never changes the log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deployment: Option<Deployment>,
    /// What a flight in real time does when services are late, hang, or are alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_time: Option<RealTime>,
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
    /// Centre of mass in {B}, seen from the body's origin, on which the thrust acts and which the cameras track, m.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub center_of_mass: Vector,
    /// What changes in flight, in the order of time.
    #[serde(default)]
    pub change: Vec<VehicleChange>,
    /// How it follows what the radio says; at once and exactly unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuators: Option<Actuators>,
    /// Drag in still air: force against the velocity, along each body axis, N s/m.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub drag: Vector,
    /// Turbulence of the air everywhere; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turbulence: Option<Turbulence>,
    /// A fan that blows at it; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fan: Option<Fan>,
}

/// How a vehicle with an on-board rate loop follows frames of thrust and body rates: as first-order lags.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Actuators {
    /// Time constant of the thrust, s; 0 follows at once.
    pub thrust_lag: f64,
    /// Time constants of the body rates about each axis, s; 0 follows at once.
    pub rate_lag: Vector,
    /// Largest thrust, N; the smallest is 0.
    pub thrust_max: f64,
    /// Largest magnitude of the body rate about each axis, rad/s.
    pub rate_max: Vector,
    /// Thrust that results, per thrust that a frame asks for.
    pub thrust_factor: f64,
    /// Body rates that result, per rate that a frame asks for.
    pub rate_factor: Vector,
    /// Body rates that result when none are asked for, rad/s.
    pub rate_bias: Vector,
    /// Share of the radio's frames that the vehicle does not receive, 0 to 1; the one before goes on acting.
    pub frame_loss: f64,
    /// Thrust at the start of the flight and until the first frame, N.
    pub initial_thrust: f64,
}

/// A random acceleration, the same everywhere: of each component an Ornstein–Uhlenbeck process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Turbulence {
    /// Standard deviation of each component, m/s².
    pub deviation: f64,
    /// Correlation time, s.
    pub correlation_time: f64,
}

/// A fan: a round, turbulent jet that pushes at the vehicle.
///
/// The force on the axis falls with the square of the distance from the fan, as that of a free jet far from
/// its nozzle, and across the jet like a bell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// When it is switched on, s.
    #[serde(default)]
    pub on_at: f64,
    /// When it is switched off, s; never unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub off_at: Option<f64>,
    /// Time constant of its running up and down, s; 0 is at once.
    #[serde(default)]
    pub run_up: f64,
    /// Where it stands in {I}, m.
    pub position: Vector,
    /// Where it blows to in {I}; of any length but 0.
    pub direction: Vector,
    /// Force on the vehicle on the axis at `reference_distance`, N.
    pub force: f64,
    /// Distance from the fan at which `force` is meant, m.
    pub reference_distance: f64,
    /// Half the opening angle of the jet, at which the force has fallen to 1/e, rad.
    #[serde(default = "default::jet_half_angle")]
    pub half_angle: f64,
    /// Standard deviation of the force's fluctuation in each component, as a share of the local force.
    #[serde(default)]
    pub turbulence: f64,
    /// Correlation time of the fluctuation, s.
    #[serde(default = "default::jet_correlation_time")]
    pub correlation_time: f64,
    /// Where it is moved to, in the order of time: straight and steadily from one place to the next.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moves: Vec<FanMove>,
}

/// A place that the fan has reached at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FanMove {
    /// When it is there, s.
    pub at: f64,
    /// Where it is then in {I}, m.
    pub position: Vector,
    /// Where it blows to then in {I}.
    pub direction: Vector,
}

/// The motion-capture system's imperfections. Its rate and latency are those of `mocap/pose` in the schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cameras {
    /// Standard deviation of each component of the position, m.
    pub position_deviation: f64,
    /// Standard deviation of the attitude about each axis, rad.
    pub attitude_deviation: f64,
    /// How much earlier than at its tick a frame may be exposed, s: evenly spread between 0 and this.
    pub jitter: f64,
    /// Whether frames carry the time of their exposure; if not, that of their tick.
    pub jitter_stamped: bool,
    /// Share of the frames in which the body is not found, 0 to 1.
    pub frame_loss: f64,
    /// When the body is hidden, in the order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occlusion: Vec<Occlusion>,
    /// When markers are taken for others, in the order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub marker_swap: Vec<MarkerSwap>,
}

/// A while in which the cameras do not see the body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Occlusion {
    /// From when, s.
    pub at: f64,
    /// How long, s.
    pub lasts: f64,
}

/// A while in which the cameras take markers for others: the pose jumps, and says nothing of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkerSwap {
    /// From when, s.
    pub at: f64,
    /// How long, s.
    pub lasts: f64,
    /// By how much the position is wrong in {I}, m.
    #[serde(default)]
    pub position: Vector,
    /// By what rotation the attitude is wrong, axis times angle in {B}, rad.
    #[serde(default)]
    pub rotation: Vector,
}

/// The state estimator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimator {
    /// Where poses come from.
    #[serde(default, skip_serializing_if = "PoseSource::is_simulated")]
    pub source: PoseSource,
    /// The log of the flight whose captures are replayed, or its run's folder; with the source `replay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// The error-state Kalman filter.
    pub kalman: Kalman,
}

/// An error-state Kalman filter on poses and the frames already sent, with prediction to the time at which the
/// next frame acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kalman {
    /// Standard deviation of a captured position, each component, m.
    pub position_deviation: f64,
    /// Standard deviation of a captured attitude about each axis, rad.
    pub attitude_deviation: f64,
    /// Spectral density of the disturbance's drift, each component, (m/s³)²/Hz.
    pub disturbance_drift: f64,
    /// Spectral density of the acceleration's noise, each component, (m/s²)²/Hz.
    pub acceleration_noise: f64,
    /// Spectral density of the body rates' noise about each axis, (rad/s)²/Hz.
    pub rate_noise: f64,
    /// Spectral density of the body rates' bias drift about each axis, (rad/s²)²/Hz.
    pub rate_bias_drift: f64,
    /// Squared Mahalanobis distance above which a capture is refused as an outlier.
    pub gate: f64,
    /// For how long captures may be refused in a row before the filter starts anew from one, s.
    pub restart_after: f64,
    /// For how long the state counts as tracked without a capture, s.
    pub coast: f64,
    /// Whether the state is predicted to the time at which the next frame acts; if not it speaks of the last capture.
    pub prediction: bool,
}

/// The radio link: what a stick's travel means, and how finely and often it is sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RcLink {
    /// Thrust at a thrust channel of 0, N.
    pub thrust_offset: f64,
    /// Thrust per unit of the thrust channel, N.
    pub thrust_slope: f64,
    /// Body rate about each axis per unit of its channel, rad/s; the paper's are negative.
    pub rate_slope: Vector,
    /// Range of the thrust channel; the paper says [0, 1], with which its vehicle could not hover.
    pub thrust_range: [f64; 2],
    /// Range of each rate channel.
    pub rate_range: [f64; 2],
    /// Steps from −1 to 1 that the link tells apart, as a power of two, bits.
    pub resolution: u32,
    /// What frames leave on in real time; simulated unless stated, and always in simulated time.
    #[serde(skip_serializing_if = "RadioProtocol::is_simulated")]
    pub link: RadioProtocol,
    /// The transmitter of a laboratory; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmitter: Option<Transmitter>,
}

/// What estimator and controller believe of the vehicle and of the links.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Model {
    /// Mass, kg.
    pub mass: f64,
    /// Edges of the cuboid that the vehicle is taken for, along each body axis, m: its J is Ji = M(lj² + lk²)/12.
    pub size: Vector,
    /// Time constant of the thrust, s.
    pub thrust_lag: f64,
    /// Time constant of the body rates, s.
    pub rate_lag: f64,
    /// Time from the sending of a frame to its acting, s.
    pub radio_latency: f64,
    /// Time from a capture's exposure to its arrival, s; if not stated, captures tell by their stamps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture_latency: Option<f64>,
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
    /// New centre of mass in {B}, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_of_mass: Option<Vector>,
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
    /// When the desired yaw steps to another, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub yaw_step: Vec<YawStep>,
    /// The curve pd(γ).
    pub curve: Curve,
}

/// A step of the desired yaw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct YawStep {
    /// When, s.
    pub at: f64,
    /// New ψd, rad.
    pub yaw: f64,
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
    /// A Lissajous figure: an oscillation along each axis, such as a bob up and down.
    Lissajous(Lissajous),
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

/// center + amplitude ∘ sin(frequency γ + phase), along each axis of {I}.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lissajous {
    /// Centre in {I}, m.
    pub center: Vector,
    /// Amplitudes, m.
    pub amplitude: Vector,
    /// Frequencies, rad per unit of γ.
    pub frequency: Vector,
    /// Phases at γ = 0, rad.
    #[serde(default)]
    pub phase: Vector,
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
    /// Whether the law aims above the path by what δ makes the vehicle hang below it, so that z1 → 0; not in the paper.
    pub remove_offset: bool,
    /// Thrust and body rates in place of thrust and torque, for a vehicle with its own rate loop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rates: Option<RateCommand>,
    /// Gain γ of the immersion-and-invariance mass observer that flies along unheard; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observer_gain: Option<f64>,
}

/// How commands of body rates are made: the torque drives an artificial angular velocity, which is sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RateCommand {
    /// kp of the yaw law (28), 1/s.
    pub yaw_kp: f64,
    /// ki of the yaw law (28), 1/s².
    pub yaw_ki: f64,
    /// Largest magnitude of the yaw law's integral term, rad/s: the largest drift that it is expected to make up
    /// for. It rests while the proportional term is larger.
    pub yaw_integral_max: f64,
    /// Step at which the law drives the artificial angular velocity over the hold of a frame, s.
    pub roll_out_step: f64,
    /// Whether vehicle and path move along over the hold; if not the law sees them as they are at its beginning.
    pub roll_out: bool,
    /// Whether the vehicle of the roll-out is also pushed by what the estimator sees and the estimates of mass and
    /// disturbance do not explain.
    pub unexplained: bool,
    /// Whether commands make up for the believed lags of thrust and rates.
    pub lag_inversion: bool,
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
            remove_offset: false,
            rates: None,
            observer_gain: None,
        }
    }
}

impl Default for RateCommand {
    fn default() -> Self {
        Self {
            yaw_kp: 4.0,
            yaw_ki: 0.5,
            yaw_integral_max: 0.5,
            roll_out_step: 0.001,
            roll_out: true,
            unexplained: true,
            lag_inversion: true,
        }
    }
}

impl Default for Actuators {
    fn default() -> Self {
        Self {
            thrust_lag: 0.03,
            rate_lag: [0.02; 3],
            thrust_max: 5.5,
            rate_max: [19.0, 19.0, 8.0],
            thrust_factor: 1.0,
            rate_factor: [1.0; 3],
            rate_bias: [0.0; 3],
            frame_loss: 0.0,
            initial_thrust: 0.0,
        }
    }
}

impl Default for Cameras {
    fn default() -> Self {
        Self {
            position_deviation: 3e-4,
            attitude_deviation: 2e-3,
            jitter: 0.0,
            jitter_stamped: true,
            frame_loss: 0.0,
            occlusion: Vec::new(),
            marker_swap: Vec::new(),
        }
    }
}

impl Default for Kalman {
    fn default() -> Self {
        Self {
            position_deviation: 3e-4,
            attitude_deviation: 2e-3,
            disturbance_drift: 0.3,
            acceleration_noise: 1e-5,
            rate_noise: 2e-4,
            rate_bias_drift: 1e-3,
            gate: 60.0,
            restart_after: 0.3,
            coast: 0.25,
            prediction: true,
        }
    }
}

impl Default for RcLink {
    fn default() -> Self {
        Self {
            thrust_offset: 2.3071,
            thrust_slope: 3.138,
            rate_slope: [-19.0, -19.0, -8.0],
            thrust_range: [-1.0, 1.0],
            rate_range: [-1.0, 1.0],
            resolution: 11,
            link: RadioProtocol::Simulated,
            transmitter: None,
        }
    }
}

impl Default for Model {
    fn default() -> Self {
        Self {
            mass: 0.2,
            size: [0.14, 0.14, 0.14],
            thrust_lag: 0.03,
            rate_lag: 0.02,
            radio_latency: 0.005,
            capture_latency: None,
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
    pub(super) fn jet_half_angle() -> f64 {
        0.2
    }
    pub(super) fn jet_correlation_time() -> f64 {
        0.3
    }
}

/// Whether a vector is the one that stands for "none".
fn is_zero(vector: &Vector) -> bool {
    *vector == [0.0; 3]
}

impl Scenario {
    /// A flight of `duration` seconds in which everything that need not be stated is as by default.
    #[must_use]
    pub fn new(duration: f64, vehicle: Vehicle, path: Path) -> Self {
        Self {
            description: String::new(),
            seed: default::seed(),
            duration,
            schedule: Timing::default(),
            vehicle,
            path,
            controller: Controller::default(),
            cameras: None,
            estimator: None,
            motion_capture: None,
            rc_output: None,
            model: None,
            flight: None,
            envelope: None,
            fault: Vec::new(),
            safety: BTreeMap::new(),
            programs: None,
            deployment: None,
            real_time: None,
        }
    }
}

impl Vehicle {
    /// A vehicle of mass m (kg) and J = Diag(`inertia`) (kg m²) in still air, at the origin, level and at rest.
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
            turbulence: None,
            fan: None,
        }
    }
}

impl Path {
    /// A curve flown by the timing law with the paper's gains.
    #[must_use]
    pub fn new(curve: Curve) -> Self {
        Self {
            mode: PathMode::default(),
            speed: default::speed(),
            k4: default::k4(),
            alpha1: default::alpha1(),
            alpha2: default::alpha2(),
            initial_gamma: 0.0,
            initial_gamma_dot: 0.0,
            yaw: 0.0,
            yaw_step: Vec::new(),
            curve,
        }
    }
}

impl Model {
    /// Diagonal of J of the cuboid, kg m² (Remark 2).
    #[must_use]
    pub fn inertia(&self) -> Vector {
        let [x, y, z] = self.size.map(|edge| edge * edge * self.mass / 12.0);
        [y + z, x + z, x + y]
    }
}

impl RcLink {
    /// The least and the largest thrust that a frame can ask for, N; never below 0.
    #[must_use]
    pub fn thrust_limits(&self) -> [f64; 2] {
        let [a, b] = self
            .thrust_range
            .map(|channel| (self.thrust_offset + self.thrust_slope * channel).max(0.0));
        [a.min(b), a.max(b)]
    }

    /// The largest body rate about each axis that a frame can ask for in both senses, rad/s.
    #[must_use]
    pub fn rate_limits(&self) -> Vector {
        let reach = self.rate_range[0].abs().min(self.rate_range[1].abs());
        self.rate_slope.map(|slope| slope.abs() * reach)
    }
}

impl Controller {
    /// σ⁻¹(δ/k1): what the theorem bounds ‖z1‖ by ultimately, m.
    #[must_use]
    pub fn ultimate_bound(&self) -> f64 {
        libm::atanh(self.delta.abs() / (self.k1 * self.sigma_max))
    }
}
