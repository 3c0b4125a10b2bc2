//! Parameters of a flight, as stated by a scenario file and read by every service.
//!
//! A scenario and its seed determine the experiment. Separate sections state the use of the machine;
//! [`Scenario::experiment`] removes them. SI units and radians. Defaults are those of the paper (section V) if it gives
//! them, otherwise those with which its results were reproduced.

#![warn(missing_docs)]

mod cameras;
mod check;
mod controller;
mod curve;
mod envelope;
mod estimator;
mod fault;
mod flight;
mod gains;
mod judge;
mod kind;
mod law;
mod link_battery;
mod machine;
mod model;
mod motion_capture;
mod navigation;
mod operator;
mod path;
mod plugins;
mod problem;
mod programs;
mod radio_link;
mod range;
mod rc_link;
mod real_time_policies;
mod receivers;
mod record;
mod safety;
pub mod schema;
mod sensors;
mod serialized;
pub mod suggest;
#[cfg(test)]
mod tests_support;
mod thrust_channel;
mod timing;
mod vehicle;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::positive;
pub use cameras::{Cameras, MarkerSwap, Occlusion, Volume};
pub use controller::{Bounds, Controller, ControllerChange, Harmonics, InitialEstimates, RateCommand};
pub use curve::{Circle, Curve, Hover, Line, Lissajous, TiltedEight, Waypoints};
pub use envelope::{Action, Envelope, EstimateLimit, Fence, Limit, VectorLimit};
pub use estimator::{Estimator, Kalman};
pub use fault::{Fault, FaultKind, FaultState, Target};
pub use flight::{Flight, LEG_ACCELERATION, MOST_CURVED, STEEPEST, leg_duration};
pub use judge::Judge;
pub use kind::{Kind, role_of_process};
pub use law::{Baseline, LawKind};
pub use link_battery::{BatteryModel, LinkBattery, LowVoltageAction, VoltageSource};
pub use machine::{Deployment, OrchestratorLoss, RealTime, ServiceDeployment};
pub use model::Model;
pub use motion_capture::{
    BodyNumbers, CaptureProperties, CaptureSystem, FrameTransform, MotionCapture, PoseSource,
};
pub use navigation::{Datum, Navigation, Poses};
pub use operator::{KillSwitchLoss, OperatorDevices};
pub use path::{Path, PathMode, YawStep};
pub use plugins::Plugins;
pub use problem::{Key, Problem, Unflyable};
pub use programs::Programs;
pub use radio_link::{
    ByteFormat, ChannelSwitch, DsmProtocol, Mavlink, MavlinkMessage, MultiModule, RadioProperties,
    RadioProtocol, Transmitter,
};
pub use range::Range;
pub use rc_link::RcLink;
pub use receivers::Receivers;
pub use record::{Record, Recorded, Split};
pub use safety::InputSafety;
pub use sensors::{Barometer, FixChange, FixDeviations, Fixes, Gnss, Imu, Magnetometer, Sensors, Spoofing};
pub use shared_types::GRAVITY;
pub use shared_types::crazyflie_uri::{CrazyflieUri, CrazyflieUriError, RadioAddress, RadioRate};
pub use thrust_channel::ThrustChannel;
pub use timing::Timing;
pub use timing::names::EdgeName;
pub use vehicle::{
    Actuators, Battery, Dryden, Fan, FanMove, GroundEffect, InitialState, Turbulence, Vehicle, VehicleChange,
    Wind,
};

/// Moved keys: previous table, name, and present table.
pub const MOVED_KEYS: [(&str, &str, &str); 2] = [
    ("estimator", "source", "motion_capture"),
    ("estimator", "recording", "motion_capture"),
];

/// A vector of three numbers.
pub type Vector = [f64; 3];

/// A flight: vehicle, path, controller, schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, remote = "Self")]
#[schemars(!remote)]
pub struct Scenario {
    /// Purpose of the scenario, one line.
    #[serde(default)]
    pub description: String,
    /// Seed of all random draws of the flight.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Length of the flight, s.
    #[schemars(transform = positive)]
    pub duration: f64,
    /// Base tick, rates and transport latencies.
    #[serde(default)]
    pub schedule: Timing,
    /// The vehicle and its changes in flight.
    pub vehicle: Vehicle,
    /// The path and its timing law.
    pub path: Path,
    /// The control law's gains and bounds.
    #[serde(default)]
    pub controller: Controller,
    /// The simulated cameras; ideal unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<Cameras>,
    /// The state estimator; passes on the captures of ideal cameras unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimator: Option<Estimator>,
    /// The simulated sensors of flight outdoors; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensors: Option<Sensors>,
    /// Inertial navigation, the estimator of flight outdoors; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub navigation: Option<Navigation>,
    /// Place of the origin of {I} on the earth; a meadow near Munich unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub datum: Option<Datum>,
    /// Source of poses; the plant's cameras unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_capture: Option<MotionCapture>,
    /// Receivers and autopilots that measure a real vehicle, in place of the simulated sensors; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub receivers: Option<Receivers>,
    /// The radio link; ideal unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rc_output: Option<RcLink>,
    /// Model of vehicle and links in estimator and controller; the true values may differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// The phases of the flight, from take-off to landing; without it the vehicle is in the air from start to end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<Flight>,
    /// Limits that the transmitter enforces on the vehicle and the controller; none unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub envelope: Option<Envelope>,
    /// Limits beyond which the vehicle counts as lost; defaults unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judge: Option<Judge>,
    /// Planned faults of services and of their inputs, exact in simulated time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
    /// Policies of services for samples that are too old or impossible, by input: `"topic -> service"`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub safety: BTreeMap<String, InputSafety>,
    /// Plug-ins: shared libraries that fly in place of a service's step logic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plugins: Option<Plugins>,
    /// External services: programs that fly in place of services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub programs: Option<Programs>,
    /// The recording of the flight: everything in one file unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<Record>,
    /// Use of the machine by the services; never changes the log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deployment: Option<Deployment>,
    /// Reaction of a flight in real time to services that are late or hang, and to the loss of the orchestrator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_time: Option<RealTime>,
    /// Devices of the operator in a flight in real time: a kill switch. None unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<OperatorDevices>,
}

fn first_seed() -> u64 {
    1
}

impl Scenario {
    /// Makes a flight of `duration` seconds with defaults for all optional values.
    #[must_use]
    pub fn new(duration: f64, vehicle: Vehicle, path: Path) -> Self {
        Self {
            description: String::new(),
            seed: first_seed(),
            duration,
            schedule: Timing::default(),
            vehicle,
            path,
            controller: Controller::default(),
            cameras: None,
            estimator: None,
            sensors: None,
            navigation: None,
            datum: None,
            motion_capture: None,
            receivers: None,
            rc_output: None,
            model: None,
            flight: None,
            envelope: None,
            judge: None,
            fault: Vec::new(),
            safety: BTreeMap::new(),
            plugins: None,
            programs: None,
            record: None,
            deployment: None,
            real_time: None,
            operator: None,
        }
    }
}
