//! Snapshot of a live run.

use serde::{Deserialize, Serialize};

use metrics::summary::timing::Quantiles;
use shared_types::FlightPhase;
use shared_types::receiver_figures::ReceiverFigures;

/// State of a run in real time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    pub scenario: String,
    /// Time since the start of the flight, s.
    pub time: f64,
    /// Duration of the flight, s.
    pub duration: f64,
    /// Phase of the flight; `None` if the scenario has no phases.
    pub phase: Option<String>,
    /// `true` if the motors may turn.
    pub armed: bool,
    /// `true` if landing was requested.
    pub landing: bool,
    /// `true` if the motors were killed.
    pub killed: bool,
    /// What killed the motors, in words.
    pub killed_by: Option<String>,
    /// Reason why a request to arm would be refused; `None` unless the vehicle is disarmed in a flight that an operator can arm.
    pub refusal_to_arm: Option<String>,
    /// A wrong axis or sign in the response to the first commands off the ground.
    pub response: Option<String>,
    /// Services in the order of the wiring table.
    pub services: Vec<ServiceSnapshot>,
    /// Time from a capture to the frame based on it, in the last second.
    pub capture_to_frame: Option<Quantiles>,
    /// State of the cameras; `None` if they are simulated.
    pub cameras: Option<CamerasSnapshot>,
    /// State of the receivers of a flight outdoors; `None` if they are simulated. Runs of earlier versions send none.
    #[serde(default)]
    pub receivers: Option<ReceiversSnapshot>,
    /// State of the radio link; `None` if it is simulated.
    pub radio_link: Option<LinkSnapshot>,
    /// Battery of the vehicle, measured or modelled; `None` without a voltage. Runs of earlier versions send none.
    #[serde(default)]
    pub battery: Option<BatterySnapshot>,
    /// Distance from the path, m: the true one, or in a laboratory the estimated one; `None` while there is no path to
    /// follow.
    pub position_error: Option<f64>,
    /// m̂, kg.
    pub mass_estimate: Option<f64>,
    /// ‖b̂‖, m/s².
    pub disturbance_estimate: Option<f64>,
    /// Number of samples recorded.
    pub recorded: u64,
    /// Last events, the newest last.
    pub events: Vec<LiveEvent>,
}

/// Beginning of the event that a request to arm lapsed, or that an armed vehicle was disarmed, because it was not ready.
pub const NOT_READY: &str = "disarmed: the vehicle was not ready";

impl Snapshot {
    /// Returns whether the vehicle is armed, on the ground or in the air.
    pub(super) fn is_armed_or_flies(&self) -> bool {
        self.phase
            .as_deref()
            .is_some_and(|phase| phase != FlightPhase::Disarmed.name())
    }

    /// Returns why the vehicle was not ready at its last arming since a time, s, if it was not.
    pub(super) fn not_ready_since(&self, time: f64) -> Option<&str> {
        let since = self.events.iter().rev().take_while(|event| event.time >= time);
        let mut texts = since.map(|event| event.text.as_str());
        texts.find(|text| text.starts_with(NOT_READY))
    }

    /// Applies `change` to all texts from a scenario, a network or another program.
    pub(super) fn change_texts(&mut self, mut change: impl FnMut(&mut String)) {
        change(&mut self.scenario);
        self.phase.iter_mut().for_each(&mut change);
        for service in &mut self.services {
            change(&mut service.name);
            service
                .inputs
                .iter_mut()
                .for_each(|input| change(&mut input.topic));
        }
        let told = [&mut self.killed_by, &mut self.refusal_to_arm, &mut self.response];
        told.into_iter().flatten().for_each(&mut change);
        let cameras = self.cameras.iter_mut();
        let cameras = cameras.flat_map(|cameras| [&mut cameras.trouble, &mut cameras.refused]);
        let receivers = self.receivers.iter_mut();
        let receivers = receivers.flat_map(|receivers| [&mut receivers.trouble, &mut receivers.refused]);
        let radio_link = self.radio_link.as_mut().and_then(|link| link.trouble.as_mut());
        let battery = self.battery.as_mut().and_then(|battery| battery.trouble.as_mut());
        cameras
            .chain(receivers)
            .flatten()
            .chain(radio_link)
            .chain(battery)
            .for_each(&mut change);
        self.events.iter_mut().for_each(|event| change(&mut event.text));
    }
}

/// State of a service.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ServiceSnapshot {
    pub name: String,
    pub pid: u32,
    /// `true` if the process flies; otherwise it is dead or starting.
    pub flies: bool,
    /// Steps in the last second.
    pub rate: u64,
    /// Lateness of the steps in the last second.
    pub wake: Option<Quantiles>,
    /// Duration of the steps in the last second.
    pub step: Option<Quantiles>,
    /// Steps skipped since the start.
    pub missed_steps: u64,
    /// Inputs that arrived late since the start.
    pub late_inputs: u64,
    /// Number of restarts;
    /// runs of earlier versions send it as `rebirths`.
    #[serde(alias = "rebirths")]
    pub restarts: u64,
    pub inputs: Vec<InputSnapshot>,
}

/// State of a laboratory's cameras; counts are since the start of the receiving process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CamerasSnapshot {
    /// Reason why their poses are not trusted; `None` if they are.
    pub trouble: Option<String>,
    /// Frames in the last whole second, Hz.
    pub rate: f64,
    /// Mean time from capture to arrival in that second, s.
    pub latency: f64,
    /// Standard deviation of the time between frames in that second, s.
    pub jitter: f64,
    /// Frames that contain the vehicle or could have.
    pub frames: u64,
    /// Frames whose pose was accepted.
    pub believed: u64,
    /// Reasons of refused packets and poses as text, each with its count; `None` without refusals.
    #[serde(default)]
    pub refused: Option<String>,
}

/// State of the receivers of a flight outdoors; counts are since the start of the receiving process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReceiversSnapshot {
    /// Reason why inertial navigation cannot rely on them; `None` if it can.
    pub trouble: Option<String>,
    /// Samples of each of [`SENSORS`](Self::SENSORS) in the last whole second, Hz.
    pub rates: [f64; 4],
    /// Packets that were read.
    pub packets: u64,
    /// Reasons of refused packets as text, each with its count; `None` without refusals.
    pub refused: Option<String>,
}

impl ReceiversSnapshot {
    /// Names of the sensors' samples.
    pub const SENSORS: [&str; 4] = ReceiverFigures::SENSORS;
}

/// State of a laboratory's radio link; counts are since the start of the sending process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LinkSnapshot {
    /// Reason why no frame can be sent; `None` if they are sent.
    pub trouble: Option<String>,
    /// Frames sent.
    pub sent: u64,
    /// Frames dropped or skipped.
    pub lost: u64,
}

/// State of the vehicle's battery.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatterySnapshot {
    /// Voltage, V.
    pub voltage: f64,
    /// Age of a measured voltage, s; `None` for a modelled one.
    pub age: Option<f64>,
    /// Factor of the thrust; `None` without a correction.
    pub factor: Option<f64>,
    /// Reason for a warning: a low battery, or an old voltage.
    pub trouble: Option<String>,
}

/// Age of an input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InputSnapshot {
    pub topic: String,
    /// Age of the sample at the last step, s; `None` without a sample.
    pub age: Option<f64>,
}

/// Event of a flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveEvent {
    /// Time since the start of the flight, s.
    pub time: f64,
    pub text: String,
}
