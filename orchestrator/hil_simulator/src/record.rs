//! The truth, kept in the logs of a run: `run.mcap` with the truth, what the cameras saw and the frames as they
//! began to act, `host.mcap` with the moment at which it began.
//!
//! A thread of its own writes, so that a slow disk does not hold the world.

use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

use scenario::Scenario;
use shared_types::Topic;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};
use zerocopy::IntoBytes;

use run_log::run_folder::RunFolder;
use run_log::{Compression, HostLogWriter, LogError, Manifest, RunLogWriter, flight_start};

/// The samples of a tick: the truth, a pose if cameras looked, a frame if one began to act.
#[derive(Clone, Debug)]
pub struct RecordedTick {
    /// The truth.
    pub truth: VehicleTruth,
    /// The pose that cameras saw.
    pub pose: Option<MocapPose>,
    /// The frame.
    pub frame: Option<RcFrame>,
}

/// Keeps moments. What cannot be written is told when it is finished.
#[derive(Debug)]
pub struct Record {
    moments: Sender<RecordedTick>,
    writer: JoinHandle<Result<(), LogError>>,
}

impl Record {
    /// Begins the logs of a world of a scenario, whose tick 0 begins at a time of `CLOCK_MONOTONIC`, ns.
    ///
    /// # Errors
    /// [`LogError`] if they cannot be made.
    pub fn begin(folder: &RunFolder, scenario: &Scenario, start_ns: u64) -> Result<Self, LogError> {
        let mut host = HostLogWriter::create(&folder.host_log(), Compression::Zstd)?;
        flight_start::write(&mut host, start_ns)?;
        host.finish()?;
        let manifest = Manifest::new(scenario);
        let mut log = RunLogWriter::create(&folder.run_log(), &manifest, Compression::Zstd)?;
        let (moments, received) = channel::<RecordedTick>();
        let writer = std::thread::spawn(move || {
            for moment in received {
                write(&mut log, &moment)?;
            }
            log.finish().map(drop)
        });
        Ok(Self { moments, writer })
    }

    /// Keeps a moment.
    pub fn keep(&self, moment: RecordedTick) {
        // A writer that has failed takes nothing any more, and says why at the end.
        let _kept = self.moments.send(moment);
    }

    /// Completes the logs.
    ///
    /// # Errors
    /// The first [`LogError`] that came up.
    ///
    /// # Panics
    /// If the writer has panicked.
    pub fn finish(self) -> Result<(), LogError> {
        drop(self.moments);
        self.writer.join().expect("the writer does not panic")
    }
}

fn write(log: &mut RunLogWriter, moment: &RecordedTick) -> Result<(), LogError> {
    let header = moment.truth.header;
    log.write(Topic::VehicleTruth, moment.truth.as_bytes())?;
    if let Some(pose) = &moment.pose {
        log.write(Topic::MocapPose, pose.as_bytes())?;
    }
    if let Some(frame) = &moment.frame {
        let mut frame = *frame;
        (frame.header.tick, frame.header.stamp_ns) = (header.tick, header.stamp_ns);
        log.write(Topic::RcFrame, frame.as_bytes())?;
    }
    log.end_tick(header.tick)
}
