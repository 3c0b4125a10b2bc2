//! A made-up flight for tests: every topic at every tick, every byte of every sample a function of topic and tick.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::path::Path;

use scenario::Scenario;
use shared_types::samples::{ControlErrors, PathReference, VehicleTruth};
use shared_types::{FlightPhase, Header, Sample, Schedule, Topic};
use zerocopy::{FromZeros, IntoBytes};

use super::{Compression, Manifest, RunLogWriter, Written, partial_path};

/// The same flight with Gerono's own controller, which has no numbers of its own.
pub fn scenario_of_own_controller(tick: f64, duration: f64) -> Scenario {
    let mut scenario = scenario(tick, duration);
    scenario.controller.telemetry.clear();
    scenario.navigation = None;
    scenario
}

/// A flight of `duration` seconds at `tick` seconds with a change of mass in its middle, and with all topics.
pub fn scenario(tick: f64, duration: f64) -> Scenario {
    toml::from_str(&format!(
        "description = \"a test\"\nduration = {duration}\nschedule.tick = {tick}\n\
         [vehicle]\nmass = 0.2\ninertia = [1e-3, 1e-3, 2e-3]\nchange = [{{ at = {}, mass = 0.3 }}]\n\
         [path.curve.hover]\nposition = [0.0, 0.0, -1.0]\n\
         [controller]\ntelemetry = [\"sliding\", \"gain\"]\n[sensors]\n[navigation]\nbaseline = [1.0, 0.0, 0.0]\n[navigation.poses]\n",
        duration / 2.0
    ))
    .unwrap()
}

/// The bytes of a sample of `topic` with this header.
pub fn sample(topic: Topic, header: Header) -> Vec<u8> {
    let seed = header.tick.wrapping_mul(31) + topic.index() as u64;
    let mut bytes: Vec<u8> = (0..topic.kind().size as u64)
        .map(|index| (seed + 7 * index) as u8)
        .collect();
    bytes[..size_of::<Header>()].copy_from_slice(header.as_bytes());
    bytes
}

/// All samples of a flight in the order of the log.
pub fn samples(schedule: &Schedule) -> impl Iterator<Item = (Topic, Vec<u8>)> {
    (0..=schedule.last_tick())
        .flat_map(|tick| Topic::ALL.map(|topic| (topic, sample(topic, schedule.header(topic, tick)))))
}

/// A log, never closed, of so many chunks that unpack to so many bytes each and are next to nothing in the file.
pub fn bomb(path: &Path, chunks: u64, bytes: usize) {
    let scenario = scenario(0.05, 1.0);
    let topic = Topic::VehicleTruth;
    let same = sample(topic, scenario.schedule().unwrap().header(topic, 0));
    let mut writer = RunLogWriter::create(path, &Manifest::new(&scenario), Compression::Zstd).unwrap();
    for _ in 0..chunks {
        for _ in 0..bytes / same.len() {
            writer.write(topic, &same).unwrap();
        }
        // The last tick of a chunk, which is closed.
        writer.end_tick(4).unwrap();
    }
    drop(writer);
    // Without the indexes of the chunks, which are larger than they.
    let written = std::fs::read(partial_path(path)).unwrap();
    let (magic, mut records) = written.split_at(mcap::MAGIC.len());
    let mut kept = magic.to_vec();
    while let Some((frame, _)) = records.split_first_chunk::<9>() {
        let length = u64::from_le_bytes(std::array::from_fn(|index| frame[1 + index]));
        let (record, rest) = records.split_at(frame.len() + usize::try_from(length).unwrap());
        if frame[0] != mcap::records::op::MESSAGE_INDEX {
            kept.extend(record);
        }
        records = rest;
    }
    std::fs::write(path, kept).unwrap();
}

/// Records the flight of `scenario`.
pub fn record(path: &Path, scenario: &Scenario, compression: Compression) -> Written {
    let schedule = scenario.schedule().unwrap();
    record_samples(path, scenario, compression, samples(&schedule))
}

/// Records these samples.
pub fn record_samples(
    path: &Path,
    scenario: &Scenario,
    compression: Compression,
    samples: impl Iterator<Item = (Topic, Vec<u8>)>,
) -> Written {
    let mut writer = RunLogWriter::create(path, &Manifest::new(scenario), compression).unwrap();
    let mut samples = samples.peekable();
    while let Some((topic, bytes)) = samples.next() {
        writer.write(topic, &bytes).unwrap();
        let tick = tick_of(&bytes);
        if samples.peek().is_none_or(|(_, next)| tick_of(next) != tick) {
            writer.end_tick(tick).unwrap();
        }
    }
    writer.finish().unwrap()
}

fn tick_of(bytes: &[u8]) -> u64 {
    shared_types::service::header_of(bytes).tick
}

/// A sample of the errors with this z1.
pub fn errors(header: Header, z1: [f64; 3]) -> Vec<u8> {
    let mut errors = ControlErrors::new_zeroed();
    *errors.header_mut() = header;
    errors.z1 = z1;
    errors.as_bytes().to_vec()
}

/// The truth of a tick at which the vehicle is level and so far (m) from a path that stands in the origin, and the reference of
/// that path.
pub fn away(schedule: &Schedule, tick: u64, distance: f64) -> [(Topic, Vec<u8>); 2] {
    let truth = VehicleTruth {
        header: schedule.header(Topic::VehicleTruth, tick),
        position_world: [0.6 * distance, 0.0, -0.8 * distance],
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        ..VehicleTruth::new_zeroed()
    };
    let header = schedule.header(Topic::PathReference, tick);
    let reference = PathReference {
        header,
        reference_time_ns: header.stamp_ns,
        phase: FlightPhase::Fly.code(),
        ..PathReference::new_zeroed()
    };
    [
        (Topic::VehicleTruth, truth.as_bytes().to_vec()),
        (Topic::PathReference, reference.as_bytes().to_vec()),
    ]
}
