//! External service: an external program that flies in place of a service, in any language.
//!
//! The process that `gerono run` starts for the service reads its start message and applies its deployment as every service
//! does. It writes a launch manifest with all data that the program needs, and executes the program. From then on the
//! orchestrator and the program exchange the messages of docs/process_contract.md, without the control block, the
//! checkpoints and the step records, which only processes of one build share.

use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use rustix::fs::{MemfdFlags, SealFlags};
use scenario::Scenario;
use serde::Serialize;
use shared_types::schedule::Rate;
use shared_types::service::nanoseconds;
use shared_types::{Schedule, ServiceId, Topic};

use crate::control::{CONTROL_FD, Channel, Host, Start};
use crate::descriptors::hand_on;
use crate::doorbell::Doorbell;
use crate::ports::{LAYOUT_ATTRIBUTE, consumer_buffer};

/// Version of the contract with external services; raised by every incompatible change.
pub const CONTRACT: u32 = 1;

/// Environment variable with the name of the replaced service, by which users and the orchestrator identify the process.
pub const SERVICE_VARIABLE: &str = "GERONO_SERVICE";

/// File descriptor of the launch manifest in an external service.
const MANIFEST_FD: i32 = CONTROL_FD + 1;
/// File descriptor of the first service's doorbell in an external service, behind the lock of the run's place.
const FIRST_BELL_FD: i32 = MANIFEST_FD + 2;

/// Launch manifest: the data that a program needs to fly in place of a service.
#[derive(Debug, Serialize)]
pub struct LaunchManifest {
    contract: u32,
    service: &'static str,
    host: &'static str,
    iceoryx2_configuration: String,
    control: i32,
    bell: i32,
    tick_ns: u64,
    last_tick: u64,
    period: u64,
    phase: u64,
    grace_ns: u64,
    inputs: Vec<InputStream>,
    outputs: Vec<OutputStream>,
    scenario: Scenario,
}

/// A topic that an external service consumes or publishes.
#[derive(Debug, Serialize)]
struct Stream {
    name: &'static str,
    topic: &'static str,
    #[serde(rename = "type")]
    type_name: &'static str,
    size: usize,
    /// Attributes of the iceoryx2 service.
    attributes: BTreeMap<&'static str, String>,
    msg: String,
    period: u64,
    phase: u64,
}

#[derive(Debug, Serialize)]
struct InputStream {
    #[serde(flatten)]
    stream: Stream,
    latency: u64,
    buffer: usize,
}

#[derive(Debug, Serialize)]
struct OutputStream {
    #[serde(flatten)]
    stream: Stream,
    bells: Vec<i32>,
}

/// Descriptors that an external service inherits.
pub struct LaunchDescriptors<'a> {
    /// The control channel.
    pub channel: &'a Channel,
    /// The file of the lock of the run's place, without the lock.
    pub lock: BorrowedFd<'a>,
    /// The doorbells of all services, in the order of the wiring table.
    pub doorbells: &'a [Doorbell],
}

impl LaunchManifest {
    /// Makes the launch manifest of a program in place of `service`.
    ///
    /// # Errors
    /// If the path of the run's place is not valid text.
    pub fn new(service: ServiceId, start: &Start, schedule: &Schedule) -> Result<Self, String> {
        let configuration = &start.iceoryx2_configuration;
        let configuration = configuration.to_str().ok_or_else(|| {
            format!(
                "{} is not valid text and cannot be passed to a program; set XDG_RUNTIME_DIR or TMPDIR to a text path",
                configuration.display()
            )
        })?;
        let Rate { period, phase } = schedule.service_rate(service);
        Ok(Self {
            contract: CONTRACT,
            service: service.name(),
            host: match start.host {
                Host::RealTime => "real_time",
                Host::LockStep | Host::Replay => "lock_step",
            },
            iceoryx2_configuration: configuration.to_owned(),
            control: CONTROL_FD,
            bell: bell_of(service),
            tick_ns: schedule.tick_ns(),
            last_tick: schedule.last_tick(),
            period,
            phase,
            grace_ns: nanoseconds(start.scenario.real_time.unwrap_or_default().grace),
            inputs: schedule
                .inputs(service)
                .map(|(index, input)| InputStream {
                    stream: Stream::new(input.name, input.topic, schedule),
                    latency: schedule.latency(service, index),
                    buffer: consumer_buffer(schedule, input.topic),
                })
                .collect(),
            outputs: schedule
                .outputs(service)
                .map(|output| OutputStream {
                    stream: Stream::new(output.name, output.topic, schedule),
                    bells: output
                        .topic
                        .consumers()
                        .map(|(consumer, _)| bell_of(consumer))
                        .collect(),
                })
                .collect(),
            scenario: start.scenario.experiment(),
        })
    }

    /// Writes the manifest to a sealed anonymous file, positioned at its beginning.
    fn file(&self) -> std::io::Result<OwnedFd> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let mut file = std::fs::File::from(rustix::fs::memfd_create("gerono-manifest", flags)?);
        file.write_all(&serde_json::to_vec(self)?)?;
        let seals = SealFlags::WRITE | SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL;
        rustix::fs::fcntl_add_seals(&file, seals)?;
        file.rewind()?;
        Ok(file.into())
    }
}

impl Stream {
    fn new(name: &'static str, topic: Topic, schedule: &Schedule) -> Self {
        let Rate { period, phase } = schedule.publications(topic).rate;
        Self {
            name,
            topic: topic.name(),
            type_name: topic.msg_name(),
            size: topic.kind().size,
            attributes: BTreeMap::from([(LAYOUT_ATTRIBUTE, topic.layout_hash())]),
            msg: topic.msg_definition(),
            period,
            phase,
        }
    }
}

fn bell_of(service: ServiceId) -> i32 {
    FIRST_BELL_FD + i32::try_from(service.index()).expect("few services")
}

/// Replaces this process by the program of `words`, in `folder`. Returns only on failure, with the reason.
#[must_use]
pub fn become_program(
    words: &[String],
    folder: Option<&Path>,
    manifest: &LaunchManifest,
    descriptors: &LaunchDescriptors<'_>,
) -> String {
    let Some((program, arguments)) = words.split_first() else {
        return "no program is named".to_owned();
    };
    let mut command = Command::new(program);
    command.args(arguments).env(SERVICE_VARIABLE, manifest.service);
    if let Some(folder) = folder {
        command.current_dir(folder);
    }
    let started = manifest.file().and_then(|manifest| {
        let files = [descriptors.channel.as_fd(), manifest.as_fd(), descriptors.lock];
        let doorbells = descriptors.doorbells.iter().map(AsFd::as_fd);
        hand_on(&mut command, CONTROL_FD, files.into_iter().chain(doorbells))
    });
    let error = started.map_or_else(|error| error, |()| command.exec());
    let folder = folder.map_or_else(String::new, |folder| format!(" in {}", folder.display()));
    format!(
        "its program `{program}` cannot be started{folder}: {error}; a name without `/` is looked for in $PATH, any other \
         in that folder (`programs.folder`)"
    )
}

#[cfg(test)]
mod tests {
    use scenario::{Curve, Hover, Path, Vehicle};
    use serde_json::Value;

    use super::*;
    use crate::deployment::Scheduler;

    fn manifest() -> Value {
        let vehicle = Vehicle::new(0.2, [0.1e-3; 3]);
        let hover = Curve::Hover(Hover {
            position: [0.0, 0.0, -1.0],
        });
        let start = Start {
            scenario: Scenario::new(10.0, vehicle, Path::new(hover)),
            iceoryx2_configuration: "/run/iceoryx2.toml".into(),
            core: None,
            scheduler: Scheduler::Fair,
            role: None,
            host: Host::RealTime,
        };
        let schedule = start.scenario.schedule().unwrap();
        let manifest = LaunchManifest::new(ServiceId::Controller, &start, &schedule).unwrap();
        serde_json::to_value(manifest).unwrap()
    }

    #[test]
    fn a_manifest_names_every_input_and_output() {
        let manifest = manifest();
        let names = |kind: &str| -> Vec<String> {
            let streams = manifest[kind].as_array().unwrap().iter();
            streams
                .map(|stream| stream["topic"].as_str().unwrap().to_owned())
                .collect()
        };
        assert_eq!(names("inputs"), ["vehicle/state", "path/reference"]);
        assert_eq!(
            names("outputs"),
            ["control/command", "control/adaptation", "control/errors"]
        );
        let state = &manifest["inputs"][0];
        assert_eq!(state["size"], Topic::VehicleState.kind().size);
        assert_eq!(state["attributes"]["layout"], Topic::VehicleState.layout_hash());
        assert_eq!(state["type"], "gerono_msgs/msg/VehicleState");
        assert_eq!((&state["period"], &state["latency"]), (&1.into(), &0.into()));
    }

    #[test]
    fn commands_ring_the_radio_link_and_telemetry_rings_no_service() {
        let manifest = manifest();
        let bells = |output: usize| manifest["outputs"][output]["bells"].clone();
        assert_eq!(bells(0), serde_json::json!([bell_of(ServiceId::RcOutput)]));
        assert_eq!(bells(1), serde_json::json!([]));
        assert_eq!(manifest["bell"], bell_of(ServiceId::Controller));
    }
}
