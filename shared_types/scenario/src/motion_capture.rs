//! Where poses come from in a laboratory: a motion-capture system on the network, and what is known of it.

use std::net::Ipv4Addr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Scenario, Vector};
use shared_types::schedule::Schedule;
use shared_types::service::nanoseconds;
use shared_types::wiring::Topic;

/// Where poses come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// The plant's cameras.
    #[default]
    Simulated,
    /// Vicon Tracker's UDP object stream.
    ViconUdp,
    /// A VRPN server.
    Vrpn,
    /// OptiTrack Motive's NatNet stream.
    Natnet,
    /// The captures of a recorded flight, at the times at which they came then.
    Replay,
}

/// A motion-capture system that sends poses over a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureSystem {
    /// Vicon Tracker's UDP object stream.
    ViconUdp,
    /// A VRPN server.
    Vrpn,
    /// OptiTrack Motive's NatNet stream.
    Natnet,
}

/// Where poses come from, and what is known of a laboratory's motion-capture system: where it is, which body is the vehicle,
/// and what a pose can be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionCapture {
    /// Where poses come from.
    #[serde(default, skip_serializing_if = "PoseSource::is_simulated")]
    pub source: PoseSource,
    /// The log of the flight whose captures are replayed, or its run's folder; with the source `replay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// IPv4 address of the machine that sends; packets from any other are counted and dropped. With a system as the source.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub server: String,
    /// Its port, or with Vicon's UDP stream the port here; 3883 (VRPN), 1510 (NatNet) or 51001 (Vicon) unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<u32>,
    /// IPv4 address of the interface here on which packets are received; nothing else is listened to.
    #[serde(default = "default_interface")]
    pub interface: String,
    /// The vehicle: a body's name; its number as `#7` (NatNet); or both as `name#1` (a sensor of VRPN, 0 unless stated). With a
    /// system as the source.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub object: String,
    /// From the capture system's frame to {I}; from its usual axes unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_capture: Option<FrameTransform>,
    /// From the frame of the vehicle's markers to {B}; of a body that was made level, nose along the system's x, unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body_from_markers: Option<FrameTransform>,
    /// Shortest time from the exposure to the arrival that no stamp tells, s; 0.005 (Vicon), 0.004 (VRPN) or 0.0002 (NatNet) unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<f64>,
    /// Least and largest rate of frames without a warning, Hz; captures are missing after two periods of the least.
    #[serde(default = "default_rate")]
    pub rate: [f64; 2],
    /// Largest speed that a pose is believed at, m/s.
    #[serde(default = "default_max_speed")]
    pub max_speed: f64,
    /// Largest rate of turn that a pose is believed at, rad/s.
    #[serde(default = "default_max_turn_rate")]
    pub max_turn_rate: f64,
    /// For how long poses must follow each other before they are believed, at the start and after a jump, s.
    #[serde(default = "default_settle")]
    pub settle: f64,
}

/// x ↦ R x + position, with R = Rz(yaw) Ry(pitch) Rx(roll).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FrameTransform {
    /// The origin of the frame that is transformed from, m.
    pub position: Vector,
    /// Roll, pitch and yaw, rad.
    pub roll_pitch_yaw: Vector,
}

fn default_interface() -> String {
    Ipv4Addr::LOCALHOST.to_string()
}

fn default_rate() -> [f64; 2] {
    [50.0, 500.0]
}

fn default_max_speed() -> f64 {
    10.0
}

fn default_max_turn_rate() -> f64 {
    35.0
}

fn default_settle() -> f64 {
    0.3
}

impl PoseSource {
    /// The system on the network; `None` for the plant's cameras and for recorded ones.
    #[must_use]
    pub fn system(self) -> Option<CaptureSystem> {
        match self {
            Self::Simulated | Self::Replay => None,
            Self::ViconUdp => Some(CaptureSystem::ViconUdp),
            Self::Vrpn => Some(CaptureSystem::Vrpn),
            Self::Natnet => Some(CaptureSystem::Natnet),
        }
    }

    /// Whether poses come from the plant's cameras.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        *self == Self::Simulated
    }
}

impl From<CaptureSystem> for PoseSource {
    fn from(system: CaptureSystem) -> Self {
        match system {
            CaptureSystem::ViconUdp => Self::ViconUdp,
            CaptureSystem::Vrpn => Self::Vrpn,
            CaptureSystem::Natnet => Self::Natnet,
        }
    }
}

impl CaptureSystem {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::ViconUdp, Self::Vrpn, Self::Natnet];

    /// The word of `motion_capture.source`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ViconUdp => "vicon_udp",
            Self::Vrpn => "vrpn",
            Self::Natnet => "natnet",
        }
    }

    /// Port unless stated.
    #[must_use]
    pub fn port(self) -> u16 {
        match self {
            Self::ViconUdp => 51001,
            Self::Vrpn => 3883,
            Self::Natnet => 1510,
        }
    }

    /// Time from the exposure to the arrival that no stamp tells unless stated, s.
    #[must_use]
    pub fn latency(self) -> f64 {
        match self {
            Self::ViconUdp => 0.005,
            Self::Vrpn => 0.004,
            // Motive stamps exposure and sending: only the network is left.
            Self::Natnet => 0.0002,
        }
    }
}

impl Scenario {
    /// Where the poses come from.
    #[must_use]
    pub fn pose_source(&self) -> PoseSource {
        self.motion_capture
            .as_ref()
            .map_or(PoseSource::Simulated, |stated| stated.source)
    }

    /// The motion-capture system that sees the vehicle in a laboratory, and what is known of it; `None` if the poses come
    /// from elsewhere.
    #[must_use]
    pub fn capture_system(&self) -> Option<(CaptureSystem, &MotionCapture)> {
        let stated = self.motion_capture.as_ref()?;
        Some((stated.source.system()?, stated))
    }

    /// The recorded flight whose captures are replayed; `None` if the poses come from elsewhere.
    #[must_use]
    pub fn recorded_captures(&self) -> Option<&str> {
        let stated = self.motion_capture.as_ref()?;
        let recording = stated.recording.as_deref();
        recording.filter(|_| stated.source == PoseSource::Replay)
    }

    /// What is known of the cameras, where they are no simulated ones.
    fn real_cameras(&self) -> Option<&MotionCapture> {
        let stated = self.motion_capture.as_ref();
        stated.filter(|stated| !stated.source.is_simulated())
    }

    /// Longest time between two captures of which none is missing, ns.
    #[must_use]
    pub fn between_captures_ns(&self, schedule: &Schedule) -> u64 {
        let published = schedule.time_ns(schedule.topic_rate(Topic::MocapPose).period);
        self.real_cameras().map_or(published, |cameras| {
            published.max(nanoseconds(1.0 / cameras.rate[0]))
        })
    }

    /// Shortest time from the exposure of a capture to its arrival, which a laboratory's cameras need, ns.
    #[must_use]
    pub fn capture_latency_ns(&self) -> u64 {
        self.real_cameras().map_or(0, |cameras| {
            let usual = cameras.source.system().map_or(0.0, CaptureSystem::latency);
            nanoseconds(cameras.latency.unwrap_or(usual))
        })
    }
}

impl MotionCapture {
    /// A system that is known by its address and the vehicle's name only.
    #[must_use]
    pub fn new(system: CaptureSystem, server: Ipv4Addr, object: &str) -> Self {
        Self {
            source: system.into(),
            recording: None,
            server: server.to_string(),
            port: None,
            interface: default_interface(),
            object: object.to_owned(),
            world_from_capture: None,
            body_from_markers: None,
            latency: None,
            rate: default_rate(),
            max_speed: default_max_speed(),
            max_turn_rate: default_max_turn_rate(),
            settle: default_settle(),
        }
    }

    /// Name and number of the vehicle's body, each if stated; `None` if what stands behind `#` is no number.
    #[must_use]
    pub fn name_and_number(&self) -> Option<(&str, Option<i32>)> {
        match self.object.rsplit_once('#') {
            None => Some((&self.object, None)),
            Some((name, number)) => Some((name, Some(number.parse().ok()?))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests_support::rig;
    use super::*;

    #[test]
    fn captures_are_as_far_apart_as_the_slowest_cameras_make_them_or_the_schedule() {
        let between = |rate: f64, source: PoseSource| {
            let mut scenario = rig();
            scenario.motion_capture = Some(MotionCapture {
                source,
                rate: [rate, 500.0],
                ..MotionCapture::new(CaptureSystem::Vrpn, Ipv4Addr::LOCALHOST, "quad")
            });
            let schedule = scenario.schedule().unwrap();
            (
                scenario.between_captures_ns(&schedule),
                scenario.capture_latency_ns(),
            )
        };
        assert_eq!(between(40.0, PoseSource::Vrpn), (25_000_000, 4_000_000));
        assert_eq!(between(400.0, PoseSource::Vrpn), (10_000_000, 4_000_000));
        assert_eq!(between(40.0, PoseSource::Replay), (25_000_000, 0));
        assert_eq!(between(40.0, PoseSource::Simulated), (10_000_000, 0));
    }
}
