//! The two logs of a run.
//!
//! * `run.mcap` ([`RunLogWriter`], [`LogReader`]) is the log of the experiment: every sample of every topic, as a function of
//!   scenario and seed alone.
//! * `host.mcap` ([`HostLogWriter`]) is the record of the machine.
//!
//! Both are MCAP files of the profile `ros2`, which any tool with MCAP and CDR reads. A sample's
//! bytes in shared memory are its bytes in the log (see [`mod@shared_types::sample`]).
//!
//! Failure policy: the log of a flight has the name `<name>.partial` until it is complete, and no existing file is
//! removed for it. A log that is derived from another one is written as every result ([`result_file`]): completely or not at
//! all. A failed write is reported once, with the fix; later writes report that the log is closed. A reader returns nothing
//! of a damaged chunk.

#![warn(missing_docs)]

mod compression;
mod csv;
mod digest;
mod durability;
mod export;
pub mod flight_start;
mod framing;
mod host_reader;
mod host_samples;
mod host_writer;
mod manifest;
mod metadata_index;
mod parts;
mod reader;
mod records;
mod recovery;
pub mod run_folder;
mod schema;
mod size;
mod splitter;
mod topic_channels;
mod view;
mod writer;

use std::path::{Path, PathBuf};

pub use compression::Compression;
pub use csv::export_csv;
pub use digest::digest;
pub use export::{ExportError, decode_sample, export_json};
pub use framing::{LogError, Written, partial_path};
pub use host_reader::{HostEntry, HostReadError, HostReader};
pub use host_samples::{
    CaptureFigures, HostEvent, HostSample, LinkFigures, LoggedCheckpoint, ServiceCheckpoint, ServiceHealth,
    ServiceStep,
};
pub use host_writer::HostLogWriter;
pub use manifest::{FORMAT_VERSION, Manifest, ManifestProblem, topics_of};
pub use parts::{Ending, ending, files_of_log, number_of, written_files};
pub use reader::{LogReadError, LogReader, LoggedSample};
pub use recovery::{Gap, RecoverError, Recovery, SampleTime, inspect, is_whole, recover, recovered_path};
pub use schema::definition as message_definition;
pub use size::predicted_bytes;
pub use view::{ViewError, export_view, view_path};
pub use writer::RunLogWriter;

/// Returns the record of the machine beside a run's log, complete or not, if it exists; for a recovered log the recovered one.
#[must_use]
pub fn host_log_beside(log: &Path) -> Option<PathBuf> {
    let complete = log.with_file_name("host.mcap");
    let recovered = recovered_path(&complete);
    let is_recovered = parts::has_recovered(log);
    let others = [partial_path(&complete), complete];
    let candidates = is_recovered.then_some(recovered).into_iter().chain(others);
    candidates.into_iter().find(|path| path.exists())
}

#[cfg(any(test, feature = "test_flight"))]
pub mod test_flight;
