//! Time of `CLOCK_MONOTONIC` at which a flight in real time began, in `host.mcap`: it aligns logs of programs that ran at the
//! same time on one machine.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use mcap::records::{Record, op};

use super::framing::LogError;
use super::host_writer::HostLogWriter;
use super::records::{self, RawRecord, Records};

/// Name of the metadata record.
pub(crate) const RECORD_NAME: &str = "flight";
const KEY: &str = "start, ns of CLOCK_MONOTONIC";

/// Writes the beginning of tick 0, ns of `CLOCK_MONOTONIC`.
///
/// # Errors
/// [`LogError`].
pub fn write(log: &mut HostLogWriter, start_ns: u64) -> Result<(), LogError> {
    log.write_facts(
        RECORD_NAME,
        BTreeMap::from([(KEY.to_owned(), start_ns.to_string())]),
    )
}

/// Reads the beginning of tick 0, ns of `CLOCK_MONOTONIC`; `None` if it is missing or cannot be read.
#[must_use]
pub fn read(path: &Path) -> Option<u64> {
    let file = File::open(path).ok()?;
    let file_bytes = file.metadata().ok()?.len();
    let mut records = Records::new(BufReader::new(file), file_bytes);
    let mut record = RawRecord::default();
    while records.next(&mut record).ok()? {
        if record.opcode != op::METADATA {
            continue;
        }
        if let Ok(Record::Metadata(metadata)) = records::parse(record.opcode, &record.body)
            && metadata.name == RECORD_NAME
        {
            return metadata.metadata.get(KEY)?.parse().ok();
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Compression, HostEvent};

    #[test]
    fn the_moment_is_found_again_behind_whatever_else_there_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("host.mcap");
        let mut log = HostLogWriter::create(&path, Compression::Zstd).unwrap();
        log.write_facts("host", BTreeMap::new()).unwrap();
        log.write(&HostEvent::new(7, None, HostEvent::KIND_NOTE, 0, "before"))
            .unwrap();
        write(&mut log, u64::MAX - 1).unwrap();
        log.finish().unwrap();
        assert_eq!(read(&path), Some(u64::MAX - 1));
    }

    #[test]
    fn a_record_that_does_not_say_so_is_no_moment() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("host.mcap");
        HostLogWriter::create(&path, Compression::Zstd)
            .unwrap()
            .finish()
            .unwrap();
        assert_eq!(read(&path), None);
        assert_eq!(read(&folder.path().join("none.mcap")), None);
    }
}
