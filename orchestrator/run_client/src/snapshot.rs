//! The state of a live run at one moment.

use serde::{Deserialize, Serialize};

use metrics::summary::timing::Quantiles;

/// The state of a run in real time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Name of the scenario.
    pub scenario: String,
    /// Time since the start of the flight, s.
    pub time: f64,
    /// Length of the flight, s.
    pub duration: f64,
    /// The phase of the flight; none if it is flown without phases.
    pub phase: Option<String>,
    /// `true` if the motors may turn.
    pub armed: bool,
    /// `true` if the vehicle has been asked to land.
    pub landing: bool,
    /// `true` if the motors rest for ever.
    pub killed: bool,
    /// The services, in the order of the wiring table.
    pub services: Vec<ServiceSnapshot>,
    /// From a capture to the frame that rests on it, in the last second.
    pub capture_to_frame: Option<Quantiles>,
    /// The state of the cameras, if there are real ones.
    pub cameras: Option<CamerasSnapshot>,
    /// The state of the radio link, if there is a real one.
    pub radio_link: Option<LinkSnapshot>,
    /// Distance from the path, m: the true one, or in a laboratory the estimated one; none while nothing is to be followed.
    pub position_error: Option<f64>,
    /// m̂, kg.
    pub mass_estimate: Option<f64>,
    /// ‖b̂‖, m/s².
    pub disturbance_estimate: Option<f64>,
    /// Samples recorded.
    pub recorded: u64,
    /// The last events, the newest last.
    pub events: Vec<LiveEvent>,
}

impl Snapshot {
    /// Changes all text that a scenario, a network or another program may have written.
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
        let cameras = self.cameras.as_mut().and_then(|cameras| cameras.trouble.as_mut());
        let radio_link = self.radio_link.as_mut().and_then(|link| link.trouble.as_mut());
        cameras.into_iter().chain(radio_link).for_each(&mut change);
        self.events.iter_mut().for_each(|event| change(&mut event.text));
    }
}

/// The state of a service.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ServiceSnapshot {
    /// Its name.
    pub name: String,
    /// Its process.
    pub pid: u32,
    /// `true` if it flies; else it is dead or being started.
    pub flies: bool,
    /// Steps in the last second.
    pub rate: u64,
    /// The lateness of its steps of the last second.
    pub wake: Option<Quantiles>,
    /// Time for which its steps of the last second took.
    pub step: Option<Quantiles>,
    /// Steps left out, since the start.
    pub missed_steps: u64,
    /// Inputs that came too late, since the start.
    pub late_inputs: u64,
    /// Number of restarts.
    #[serde(rename = "rebirths")]
    pub restarts: u64,
    /// Its inputs.
    pub inputs: Vec<InputSnapshot>,
}

/// The state of a laboratory's cameras; counts are since the start of the process that listens to them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CamerasSnapshot {
    /// Reason why they are not to be trusted; none if they are.
    pub trouble: Option<String>,
    /// Frames in the last whole second, Hz.
    pub rate: f64,
    /// Mean time from capture to arrival in that second, s.
    pub latency: f64,
    /// Standard deviation of the time between frames in that second, s.
    pub jitter: f64,
    /// Frames that told of the vehicle or could have.
    pub frames: u64,
    /// Those whose pose was believed.
    pub believed: u64,
    /// Reasons of refused packets and poses in words, each with its count; none if nothing was refused.
    #[serde(default)]
    pub refused: Option<String>,
}

/// The state of a laboratory's radio link; counts are since the start of the process that drives it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LinkSnapshot {
    /// Reason why no frame can leave; none if they do.
    pub trouble: Option<String>,
    /// Frames on their way.
    pub sent: u64,
    /// Frames that were dropped or left out.
    pub lost: u64,
}

/// The age of an input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InputSnapshot {
    /// Name of the topic.
    pub topic: String,
    /// Age of the sample at the last step, s; none if there was none.
    pub age: Option<f64>,
}

/// Something that happened.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveEvent {
    /// When, s since the start of the flight.
    pub time: f64,
    /// What, in words.
    pub text: String,
}
