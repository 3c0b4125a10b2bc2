//! Source of poses: the motion-capture system of a laboratory.

use std::net::Ipv4Addr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Scenario, Vector};
use crate::range::{angle, between, from_0_to_below};
use shared_types::schedule::Schedule;
use shared_types::service::nanoseconds;
use shared_types::wiring::Topic;

/// Source of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// The plant's cameras.
    #[default]
    Simulated,
    /// Vicon Tracker's UDP object stream.
    #[serde(alias = "vicon")]
    ViconUdp,
    /// A VRPN server.
    Vrpn,
    /// OptiTrack Motive's NatNet stream.
    #[serde(alias = "optitrack")]
    Natnet,
    /// The captures of a recorded flight, at their recorded times.
    Replay,
}

/// Motion-capture system that sends poses over a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureSystem {
    /// Vicon Tracker's UDP object stream.
    ViconUdp,
    /// A VRPN server.
    Vrpn,
    /// OptiTrack Motive's NatNet stream.
    Natnet,
}

/// Properties of a motion-capture system that a scenario depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureProperties {
    /// Source of poses.
    pub source: PoseSource,
    /// Name in `motion_capture.source`.
    pub name: &'static str,
    /// Other names.
    pub aliases: &'static [&'static str],
    /// Full name, in listings of the choices.
    pub title: &'static str,
    /// Default port.
    pub port: u16,
    /// Default time from exposure to arrival that the stamps do not cover, s.
    pub latency: f64,
    /// Maximum length of a body's name, bytes.
    pub longest_name: usize,
    /// Meaning of a number after a body's name.
    pub numbers: BodyNumbers,
}

/// Meaning of the number in `name#number`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyNumbers {
    /// None: a `#` is part of the name.
    None,
    /// A sensor of the body, the first unless stated.
    Sensor,
    /// The body itself, whose name may then be omitted.
    Body,
}

impl BodyNumbers {
    /// Returns the default number of a body.
    #[must_use]
    pub fn unstated(self) -> Option<i32> {
        (self == Self::Sensor).then_some(0)
    }
}

/// Source of poses, with the address of a laboratory's motion-capture system, the vehicle's body, and the limits of a
/// pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionCapture {
    /// Source of poses.
    #[serde(default, skip_serializing_if = "PoseSource::is_simulated")]
    pub source: PoseSource,
    /// Log of the flight whose captures are replayed, or its run's folder; with the source `replay`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// IPv4 address of the server; packets from other machines are counted and dropped. With a system as the source.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub server: String,
    /// Port of the server, or with Vicon's UDP stream the local port; 3883 (VRPN), 1510 (NatNet) or 51001 (Vicon) unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1, u16::MAX))]
    pub port: Option<u32>,
    /// IPv4 address of the local interface on which packets are received; packets on others are ignored.
    #[serde(default = "default_interface")]
    pub interface: String,
    /// The vehicle's body: its name, its number as `#7` (NatNet), or both as `name#1` (a sensor of VRPN, 0 unless stated). With
    /// a system as the source.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub object: String,
    /// Transform from the capture system's frame to {I}; that of its usual axes unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_capture: Option<FrameTransform>,
    /// Transform from the frame of the vehicle's markers to {B}; that of a body defined level, nose along the system's x,
    /// unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body_from_markers: Option<FrameTransform>,
    /// Minimum time from exposure to arrival that the stamps do not cover, s; 0.005 (Vicon), 0.004 (VRPN) or 0.0002 (NatNet)
    /// unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = from_0_to_below(0.25), extend("x-hint" = "poses that are older cannot be flown with; 0.005 is usual"))]
    pub latency: Option<f64>,
    /// Minimum and maximum frame rate without a warning, Hz; captures count as missing after two periods of the minimum.
    #[serde(default = "default_rate")]
    #[schemars(transform = between(5.0, 2000.0), extend("x-hint" = "in Hz"))]
    pub rate: [f64; 2],
    /// Maximum speed at which a pose is accepted, m/s.
    #[serde(default = "default_max_speed")]
    #[schemars(transform = between(0.2, 100.0), extend("x-hint" = "in m/s: 600 cm/s are 6.0"))]
    pub max_speed: f64,
    /// Maximum turn rate at which a pose is accepted, rad/s.
    #[serde(default = "default_max_turn_rate")]
    #[schemars(transform = between(1.0, 100.0), extend("x-hint" = "in rad/s: 2000 °/s are 34.9"))]
    pub max_turn_rate: f64,
    /// Time for which poses must be consistent before they are accepted, at the start and after a jump, s.
    #[serde(default = "default_settle")]
    #[schemars(transform = between(0.0, 10.0), extend("x-hint" = "in s: 300 ms are 0.3"))]
    pub settle: f64,
}

/// x ↦ R x + position, with R = Rz(yaw) Ry(pitch) Rx(roll).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameTransform {
    /// Origin of the source frame, m.
    #[serde(default)]
    #[schemars(transform = between(-1000.0, 1000.0), extend("x-hint" = "in m: 1500 mm are 1.5"))]
    pub position: Vector,
    /// Roll, pitch and yaw, rad; without a default, because it replaces the turn of the system's axes into ours.
    #[schemars(transform = angle)]
    pub roll_pitch_yaw: Vector,
}

/// Maximum length of a body's name in any system, bytes.
pub(crate) const LONGEST_NAME: usize = 255;

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
    /// Returns the system on the network; `None` for the plant's cameras and for recorded ones.
    #[must_use]
    pub fn system(self) -> Option<CaptureSystem> {
        let mut systems = CaptureSystem::ALL.into_iter();
        systems.find(|system| system.properties().source == self)
    }

    /// Returns whether poses come from the plant's cameras.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        *self == Self::Simulated
    }
}

impl CaptureSystem {
    /// All systems.
    pub const ALL: [Self; 3] = [Self::ViconUdp, Self::Vrpn, Self::Natnet];

    /// Returns the properties of the system.
    #[must_use]
    pub fn properties(self) -> &'static CaptureProperties {
        match self {
            Self::ViconUdp => &CaptureProperties {
                source: PoseSource::ViconUdp,
                name: "vicon_udp",
                aliases: &["vicon"],
                title: "Vicon Tracker's UDP object stream",
                port: 51001,
                latency: 0.005,
                longest_name: 24,
                numbers: BodyNumbers::None,
            },
            Self::Vrpn => &CaptureProperties {
                source: PoseSource::Vrpn,
                name: "vrpn",
                aliases: &[],
                title: "VRPN over TCP",
                port: 3883,
                latency: 0.004,
                longest_name: LONGEST_NAME,
                numbers: BodyNumbers::Sensor,
            },
            Self::Natnet => &CaptureProperties {
                source: PoseSource::Natnet,
                name: "natnet",
                aliases: &["optitrack"],
                title: "Motive's NatNet",
                port: 1510,
                // Motive stamps exposure and transmission: only the network delay remains.
                latency: 0.0002,
                longest_name: LONGEST_NAME,
                numbers: BodyNumbers::Body,
            },
        }
    }

    /// Returns the name in `motion_capture.source`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.properties().name
    }
}

impl Scenario {
    /// Returns the source of the poses.
    #[must_use]
    pub fn pose_source(&self) -> PoseSource {
        self.motion_capture
            .as_ref()
            .map_or(PoseSource::Simulated, |section| section.source)
    }

    /// Returns the motion-capture system of the laboratory with its settings; `None` if the poses have another source.
    #[must_use]
    pub fn capture_system(&self) -> Option<(CaptureSystem, &MotionCapture)> {
        let section = self.motion_capture.as_ref()?;
        Some((section.source.system()?, section))
    }

    /// Returns the recorded flight whose captures are replayed; `None` if the poses have another source.
    #[must_use]
    pub fn recorded_captures(&self) -> Option<&str> {
        let section = self.motion_capture.as_ref()?;
        let recording = section.recording.as_deref();
        recording.filter(|_| section.source == PoseSource::Replay)
    }

    /// Returns the settings of real cameras.
    fn real_cameras(&self) -> Option<&MotionCapture> {
        let section = self.motion_capture.as_ref();
        section.filter(|section| !section.source.is_simulated())
    }

    /// Returns the maximum time between two consecutive captures, ns.
    #[must_use]
    pub fn between_captures_ns(&self, schedule: &Schedule) -> u64 {
        let published = schedule.time_ns(schedule.topic_rate(Topic::MocapPose).period);
        self.real_cameras().map_or(published, |cameras| {
            published.max(nanoseconds(1.0 / cameras.rate[0]))
        })
    }

    /// Returns the minimum time from exposure to arrival of a capture in a laboratory, ns.
    #[must_use]
    pub fn capture_latency_ns(&self) -> u64 {
        self.real_cameras().map_or(0, |cameras| {
            let usual = cameras
                .source
                .system()
                .map_or(0.0, |system| system.properties().latency);
            nanoseconds(cameras.latency.unwrap_or(usual))
        })
    }
}

impl MotionCapture {
    /// Makes a system with an address and the vehicle's name only.
    #[must_use]
    pub fn new(system: CaptureSystem, server: Ipv4Addr, object: &str) -> Self {
        Self {
            source: system.properties().source,
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

    /// Returns name and number of the vehicle's body, each if stated; `None` if the text after `#` is not a number. In
    /// systems without body numbers, names may contain a `#`.
    #[must_use]
    pub fn name_and_number(&self) -> Option<(&str, Option<i32>)> {
        let system = self.source.system();
        if system.is_some_and(|system| system.properties().numbers == BodyNumbers::None) {
            return Some((&self.object, None));
        }
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
    use serde::de::value::{Error, StrDeserializer};

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

    /// A source that no system states would be taken for the plant's cameras.
    #[test]
    fn every_source_but_the_plant_and_recordings_is_a_system() {
        let schema = schemars::schema_for!(PoseSource).to_value();
        let variants = schema["oneOf"].as_array().unwrap().iter();
        let words: Vec<&str> = variants
            .map(|variant| variant["const"].as_str().unwrap())
            .collect();
        let others = words
            .into_iter()
            .filter(|word| !["simulated", "replay"].contains(word));
        assert_eq!(
            others.collect::<Vec<_>>(),
            CaptureSystem::ALL.map(CaptureSystem::name)
        );
        for system in CaptureSystem::ALL {
            let properties = system.properties();
            for word in [&[properties.name], properties.aliases].concat() {
                let read = PoseSource::deserialize(StrDeserializer::<Error>::new(word));
                assert_eq!(read, Ok(properties.source), "{word}");
            }
        }
    }

    #[test]
    fn vicon_s_stream_has_a_short_name_too() {
        let read = |name| PoseSource::deserialize(StrDeserializer::<Error>::new(name));
        assert_eq!(read("vicon"), read("vicon_udp"));
        assert!(read("vicon_tcp").is_err());
    }

    #[test]
    fn a_number_is_behind_the_name_but_with_vicon_it_is_part_of_it() {
        let stated = |system| MotionCapture::new(system, Ipv4Addr::LOCALHOST, "quad#2");
        let [vicon, natnet] = [CaptureSystem::ViconUdp, CaptureSystem::Natnet].map(stated);
        assert_eq!(vicon.name_and_number(), Some(("quad#2", None)));
        assert_eq!(natnet.name_and_number(), Some(("quad", Some(2))));
        assert!(vicon.problems().is_empty() && natnet.problems().is_empty());
    }

    #[test]
    fn a_section_alone_is_checked_as_in_a_scenario() {
        let long = "quadcopter_experiment_number_01";
        let vicon = MotionCapture::new(CaptureSystem::ViconUdp, Ipv4Addr::LOCALHOST, long);
        let everywhere = MotionCapture {
            interface: "0.0.0.0".to_owned(),
            ..MotionCapture::new(CaptureSystem::Vrpn, Ipv4Addr::LOCALHOST, "")
        };
        for (stated, key) in [(vicon, "object"), (everywhere, "interface")] {
            let problems = stated.problems();
            assert!(
                problems.len() == 1 && problems[0].to_string().contains(key),
                "{problems:?}"
            );
        }
    }
}
