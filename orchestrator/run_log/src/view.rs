//! Copy of a log for the 3D views of Foxglove, Lichtblick and Rerun.
//!
//! It contains every message of the log, byte for byte, and on channels `view/…` frames and poses at the rate of a display,
//! and once the vehicle's shape and the complete trajectories; of a flight with a satellite receiver also its fixes and the
//! vehicle's place on the earth, for their maps. These are Foxglove's messages as Protocol Buffers, the only
//! format that all three programs support. The copy is for viewers only: other commands do not accept it as a log of a flight.

mod messages;
mod scene;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use mcap::records::Metadata;
use nalgebra::Matrix3;
use prost::{Message, Name};
use result_file::{ResultFile, is_one_of};
use shared_types::geodesy::LocalFrame;
use shared_types::rotation::{from_roll_pitch_yaw, from_row_major};
use shared_types::samples::{GnssFix, PathReference, VehicleState, VehicleTruth};
use shared_types::{Sample, Topic};

use self::scene::Placed;
use super::compression::Compression;
use super::framing::{Content, LogError, McapFile, Written};
use super::manifest::{COPY_RECORD_NAME, Manifest};
use super::parts::files_of_log;
use super::reader::{LogReadError, LogReader, LoggedSample};
use super::topic_channels::declare_topics;

/// Poses per second of the flight's time.
const DISPLAY_RATE: u64 = 30;

/// Maximum number of points of a trajectory, which is one message.
const POINTS_MAX: usize = 20_000;

/// Size at which a chunk is closed, bytes.
const CHUNK_BYTES: u64 = 1 << 20;

/// Error of the copy for viewers.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// The log has no position to show.
    #[error("the log {} does not say where the vehicle is: nothing to show in space", .0.display())]
    Nowhere(PathBuf),
    /// The copy would take the log's place.
    #[error("{} is the log itself or a file of it, which is not overwritten; name another file with `--out`", .0.display())]
    Itself(PathBuf),
    /// The copy cannot be written.
    #[error(transparent)]
    Write(#[from] LogError),
}

/// Returns the default path of the copy for viewers: `run.view.mcap` for `run.mcap`.
#[must_use]
pub fn view_path(log: &Path) -> PathBuf {
    log.with_extension("view.mcap")
}

/// Writes a copy of `log` for viewers to `target`; replaces an existing file when the copy is complete.
///
/// # Errors
/// [`ViewError`].
pub fn export_view(log: &Path, target: &Path) -> Result<Written, ViewError> {
    let inputs = files_of_log(log);
    if is_one_of(target, &inputs) {
        return Err(ViewError::Itself(target.to_owned()));
    }
    let survey = Survey::of(log)?;
    let mut reader = LogReader::open(log)?;
    let result = ResultFile::create(target, &inputs);
    let file = McapFile::create_result(
        result,
        Content::Mixed,
        target,
        survey.compression,
        Some(CHUNK_BYTES),
    )?;
    let mut copy = Copy::begin(file, &reader, &survey)?;
    while let Some(logged) = reader.next_sample()? {
        copy.take(&logged)?;
    }
    Ok(copy.file.finish()?)
}

/// Clock of a display.
#[derive(Default)]
struct Display {
    last_frame: Option<u64>,
}

impl Display {
    /// Returns whether a sample of this time is the first in its period.
    fn is_due(&mut self, time_ns: u64) -> bool {
        let frame = u128::from(time_ns) * u128::from(DISPLAY_RATE) / 1_000_000_000;
        let frame = u64::try_from(frame).unwrap_or(u64::MAX);
        self.last_frame.replace(frame) != Some(frame)
    }
}

/// Trajectory at the rate of a display.
#[derive(Default)]
struct Trajectory {
    display: Display,
    places: Vec<[f64; 3]>,
}

impl Trajectory {
    fn add(&mut self, time_ns: u64, placed: &Placed) {
        if self.display.is_due(time_ns) {
            self.places.push(placed.position_world);
        }
    }

    /// Returns a subset of the positions, with the first one.
    fn thinned(&self) -> Vec<[f64; 3]> {
        let stride = self.places.len().div_ceil(POINTS_MAX).max(1);
        self.places.iter().copied().step_by(stride).collect()
    }
}

/// Facts about a log that are needed before the copy.
struct Survey {
    compression: Compression,
    begin_ns: u64,
    /// Topic of the vehicle's position: the truth, or the estimate if the truth is unknown.
    vehicle: Topic,
    flown: Vec<[f64; 3]>,
    desired: Vec<[f64; 3]>,
}

impl Survey {
    fn of(log: &Path) -> Result<Self, ViewError> {
        let mut reader = LogReader::open(log)?;
        let mut begin_ns = None;
        let [mut truth, mut state, mut reference] = [(); 3].map(|()| Trajectory::default());
        while let Some(logged) = reader.next_sample()? {
            begin_ns.get_or_insert(logged.header.stamp_ns);
            let way = match logged.topic {
                Topic::VehicleTruth => &mut truth,
                Topic::VehicleState => &mut state,
                Topic::PathReference => &mut reference,
                _ => continue,
            };
            if let Some(placed) = placed(logged.topic, logged.bytes) {
                way.add(logged.header.stamp_ns, &placed);
            }
        }
        let (vehicle, flown) = if truth.places.is_empty() {
            (Topic::VehicleState, state)
        } else {
            (Topic::VehicleTruth, truth)
        };
        let Some(begin_ns) = begin_ns.filter(|_| !flown.places.is_empty()) else {
            return Err(ViewError::Nowhere(log.to_owned()));
        };
        Ok(Self {
            compression: Compression::of_name(reader.compression()),
            begin_ns,
            vehicle,
            flown: flown.thinned(),
            desired: reference.thinned(),
        })
    }
}

/// Returns the actual or desired pose in a sample; `None` if it is unknown.
fn placed(topic: Topic, bytes: &[u8]) -> Option<Placed> {
    let (position_world, world_from_body) = match topic {
        Topic::VehicleTruth => {
            let truth: VehicleTruth = read(bytes);
            (truth.position_world, from_row_major(&truth.world_from_body))
        }
        Topic::VehicleState => {
            let state: VehicleState = read(bytes);
            if !state.tracked.is_set() {
                return None;
            }
            (state.position_world, from_row_major(&state.world_from_body))
        }
        Topic::PathReference => {
            let reference: PathReference = read(bytes);
            let attitude: Matrix3<f64> = from_roll_pitch_yaw([0.0, 0.0, reference.yaw]);
            (reference.position_world, attitude)
        }
        _ => return None,
    };
    Some(Placed {
        position_world,
        world_from_body,
    })
}

fn read<T: Sample>(bytes: &[u8]) -> T {
    T::read_from_bytes(bytes).expect("the reader has checked the size")
}

/// A channel for viewers and the number of its next message.
struct Channel {
    id: u16,
    next_sequence: u32,
}

impl Channel {
    fn declare<M: Name>(file: &mut McapFile, name: &str, schema: &[u8]) -> Result<Self, LogError> {
        let id = file.declare_protobuf_channel(name, &M::full_name(), schema)?;
        Ok(Self { id, next_sequence: 0 })
    }

    fn write(&mut self, file: &mut McapFile, time_ns: u64, message: &impl Message) -> Result<(), LogError> {
        let sequence = self.next_sequence;
        self.next_sequence = sequence.wrapping_add(1);
        file.write_payload(self.id, sequence, time_ns, &message.encode_to_vec())
    }
}

/// Copy that is being written.
struct Copy {
    file: McapFile,
    /// Channels of the log's topics.
    topics: [u16; Topic::ALL.len()],
    vehicle_topic: Topic,
    body_frame: Channel,
    vehicle: Channel,
    reference: Channel,
    vehicle_display: Display,
    reference_display: Display,
    map: Option<Map>,
}

/// Channels of a flight with a satellite receiver.
struct Map {
    frame: LocalFrame,
    fix: Channel,
    location: Channel,
}

impl Copy {
    /// Begins the copy with its constant parts.
    fn begin(mut file: McapFile, reader: &LogReader, survey: &Survey) -> Result<Self, LogError> {
        for facts in facts(reader) {
            file.write_metadata(&facts.name, facts.metadata)?;
        }
        let topics = declare_topics(&mut file, &reader.manifest().scenario)?;
        let schema = messages::description();
        let begin_ns = survey.begin_ns;
        let (flown, desired) = (&survey.flown, &survey.desired);

        let mut upright = Channel::declare::<messages::FrameTransform>(&mut file, "view/upright", &schema)?;
        upright.write(&mut file, begin_ns, &scene::upright(begin_ns))?;
        let mut scene = Channel::declare::<messages::SceneUpdate>(&mut file, "view/scene", &schema)?;
        scene.write(&mut file, begin_ns, &scene::scene(begin_ns, flown, desired))?;
        let mut points = Channel::declare::<messages::PointCloud>(&mut file, "view/points", &schema)?;
        points.write(&mut file, begin_ns, &scene::points(begin_ns, flown, desired))?;
        let scenario = &reader.manifest().scenario;
        let map = match scenario.sensors {
            None => None,
            Some(_) => Some(Map {
                frame: scenario.datum_or_default().frame(),
                fix: Channel::declare::<messages::LocationFix>(&mut file, "view/fix", &schema)?,
                location: Channel::declare::<messages::LocationFix>(&mut file, "view/location", &schema)?,
            }),
        };
        Ok(Self {
            map,
            body_frame: Channel::declare::<messages::FrameTransform>(&mut file, "view/body", &schema)?,
            vehicle: Channel::declare::<messages::PoseInFrame>(&mut file, "view/vehicle", &schema)?,
            reference: Channel::declare::<messages::PoseInFrame>(&mut file, "view/reference", &schema)?,
            vehicle_display: Display::default(),
            reference_display: Display::default(),
            vehicle_topic: survey.vehicle,
            topics,
            file,
        })
    }

    /// Copies a sample, and adds its messages for viewers.
    fn take(&mut self, logged: &LoggedSample<'_>) -> Result<(), LogError> {
        let time_ns = logged.header.stamp_ns;
        let channel = self.topics[logged.topic.index()];
        self.file
            .write(channel, logged.header.seq as u32, time_ns, logged.bytes)?;
        if logged.topic == self.vehicle_topic {
            self.show_vehicle(time_ns, placed(logged.topic, logged.bytes))
        } else if logged.topic == Topic::PathReference {
            self.show_reference(time_ns, placed(logged.topic, logged.bytes))
        } else if logged.topic == Topic::GnssFix {
            self.show_fix(time_ns, &read(logged.bytes))
        } else {
            Ok(())
        }
    }

    fn show_vehicle(&mut self, time_ns: u64, vehicle: Option<Placed>) -> Result<(), LogError> {
        let Some(vehicle) = vehicle.filter(|_| self.vehicle_display.is_due(time_ns)) else {
            return Ok(());
        };
        let file = &mut self.file;
        self.body_frame
            .write(file, time_ns, &scene::body_frame(time_ns, &vehicle))?;
        self.vehicle
            .write(file, time_ns, &scene::pose(time_ns, &vehicle))?;
        match &mut self.map {
            None => Ok(()),
            Some(Map { frame, location, .. }) => {
                location.write(file, time_ns, &scene::location(time_ns, frame, &vehicle))
            }
        }
    }

    fn show_fix(&mut self, time_ns: u64, fix: &GnssFix) -> Result<(), LogError> {
        match &mut self.map {
            Some(map) if fix.measured.is_set() => map.fix.write(&mut self.file, time_ns, &scene::fix(fix)),
            _ => Ok(()),
        }
    }

    fn show_reference(&mut self, time_ns: u64, reference: Option<Placed>) -> Result<(), LogError> {
        let Some(reference) = reference.filter(|_| self.reference_display.is_due(time_ns)) else {
            return Ok(());
        };
        self.reference
            .write(&mut self.file, time_ns, &scene::pose(time_ns, &reference))
    }
}

/// Returns the metadata of the copy and of the log.
fn facts(reader: &LogReader) -> Vec<Metadata> {
    let view = Metadata {
        name: COPY_RECORD_NAME.to_owned(),
        metadata: [("poses_per_second".to_owned(), DISPLAY_RATE.to_string())].into(),
    };
    let manifest = Metadata {
        name: Manifest::RECORD_NAME.to_owned(),
        metadata: reader.manifest().to_metadata(),
    };
    let recoveries = reader.recoveries().iter().map(super::Recovery::to_metadata);
    std::iter::once(view)
        .chain(recoveries)
        .chain([manifest])
        .collect()
}
