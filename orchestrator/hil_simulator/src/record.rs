//! Log of the simulation: `run.mcap` with the truth, the captured poses and the frames as they began to act, `host.mcap` with the
//! start time.
//!
//! A separate thread writes, so that a slow disk does not delay the simulation.

use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

use scenario::Scenario;
use shared_types::Topic;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};
use zerocopy::IntoBytes;

use run_log::run_folder::RunFolder;
use run_log::{Compression, HostLogWriter, LogError, Manifest, RunLogWriter, flight_start};

/// The samples of a tick.
#[derive(Clone, Debug)]
pub struct RecordedTick {
    pub truth: VehicleTruth,
    /// Pose, if the cameras captured at the tick.
    pub pose: Option<MocapPose>,
    /// Frame, if one began to act.
    pub frame: Option<RcFrame>,
}

/// Records ticks. `finish` reports write errors.
#[derive(Debug)]
pub struct Record {
    ticks: Sender<RecordedTick>,
    writer: JoinHandle<Result<(), LogError>>,
}

impl Record {
    /// Creates the logs of a scenario's simulation, whose tick 0 begins at `start_ns` of `CLOCK_MONOTONIC`.
    ///
    /// # Errors
    /// [`LogError`] if they cannot be created.
    pub fn begin(folder: &RunFolder, scenario: &Scenario, start_ns: u64) -> Result<Self, LogError> {
        let mut host = HostLogWriter::create(&folder.host_log(), Compression::Zstd)?;
        flight_start::write(&mut host, start_ns)?;
        host.finish()?;
        let manifest = Manifest::new(scenario);
        let mut log = RunLogWriter::create(&folder.run_log(), &manifest, Compression::Zstd)?;
        let (ticks, received) = channel::<RecordedTick>();
        let writer = std::thread::spawn(move || {
            for tick in received {
                write(&mut log, &tick)?;
            }
            log.finish().map(drop)
        });
        Ok(Self { ticks, writer })
    }

    /// Records a tick.
    pub fn push(&self, tick: RecordedTick) {
        // A failed writer accepts no more ticks; `finish` returns its error.
        let _sent = self.ticks.send(tick);
    }

    /// Completes the logs.
    ///
    /// # Errors
    /// The first [`LogError`] of the writer.
    ///
    /// # Panics
    /// If the writer has panicked.
    pub fn finish(self) -> Result<(), LogError> {
        drop(self.ticks);
        self.writer.join().expect("the writer does not panic")
    }
}

fn write(log: &mut RunLogWriter, tick: &RecordedTick) -> Result<(), LogError> {
    let header = tick.truth.header;
    log.write(Topic::VehicleTruth, tick.truth.as_bytes())?;
    if let Some(pose) = &tick.pose {
        log.write(Topic::MocapPose, pose.as_bytes())?;
    }
    if let Some(frame) = &tick.frame {
        let mut frame = *frame;
        (frame.header.tick, frame.header.stamp_ns) = (header.tick, header.stamp_ns);
        log.write(Topic::RcFrame, frame.as_bytes())?;
    }
    log.end_tick(header.tick)
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests damage their own files")]
mod tests {
    use super::*;
    use run_log::is_whole;

    #[test]
    fn the_logs_of_a_simulation_are_complete_also_without_a_tick() {
        let folder = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(Some(&folder.path().join("world")), "world").unwrap();
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../scenarios/laboratory_simulated.toml"
        );
        let scenario = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        Record::begin(&folder, &scenario, 7).unwrap().finish().unwrap();
        let host = folder.host_log();
        assert!(is_whole(&folder.run_log()).unwrap());
        assert!(is_whole(&host).unwrap());
        let bytes = std::fs::read(&host).unwrap();
        std::fs::write(&host, &bytes[..bytes.len() - 20]).unwrap();
        assert!(!is_whole(&host).unwrap_or(false));
    }
}
