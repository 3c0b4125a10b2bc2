//! Metadata of a file at any position, by the index in its summary.
//!
//! The logs of this program begin with their metadata. Programs that sort or merge files write them after the samples.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::Summary;
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

use super::records::{self, FRAME_BYTES};

/// Maximum size of a record, bytes. A log's metadata have some hundred kilobytes.
const BYTES_MAX: usize = 16 << 20;

/// Maximum number of metadata records.
const RECORDS_MAX: usize = 64;

/// Returns the metadata of a file in the order of its summary; none without a valid summary.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn metadata_by_index(path: &Path) -> io::Result<Vec<Metadata>> {
    let mut file = File::open(path)?;
    let size = file.metadata()?.len();
    let summary = summary_of(&mut file)?.unwrap_or_default();
    let mut found = Vec::new();
    for index in summary.metadata_indexes.iter().take(RECORDS_MAX) {
        if let Some(record) = bytes_at(&file, size, index.offset, index.length)?
            && let Some((frame, body)) = record.split_first_chunk::<FRAME_BYTES>()
            && frame[0] == op::METADATA
            && let Ok(Record::Metadata(metadata)) = records::parse(op::METADATA, body)
        {
            found.push(metadata);
        }
    }
    // Metadata on a recovery or a split precede the manifest, which comes last.
    found.sort_by_key(|metadata| metadata.name == super::Manifest::RECORD_NAME);
    Ok(found)
}

/// Returns the summary of a file, if it has one.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn summary_of(file: &mut File) -> io::Result<Option<Summary>> {
    let size = file.metadata()?.len();
    let options = SummaryReaderOptions::default().with_file_size(size);
    let mut reader = SummaryReader::new_with_options(options.with_record_length_limit(BYTES_MAX));
    while let Some(event) = reader.next_event() {
        match event {
            Ok(SummaryReadEvent::ReadRequest(bytes)) => {
                let read = file.read(reader.insert(bytes))?;
                reader.notify_read(read);
            }
            Ok(SummaryReadEvent::SeekRequest(place)) => match file.seek(place) {
                Ok(at) => reader.notify_seeked(at),
                // The file is too short for a summary.
                Err(_) => return Ok(None),
            },
            Err(_) => return Ok(None),
        }
    }
    Ok(reader.finish())
}

/// Returns bytes of the file; `None` if they exceed the file or the limit.
fn bytes_at(file: &File, size: u64, at: u64, length: u64) -> io::Result<Option<Vec<u8>>> {
    let is_in_file = at.checked_add(length).is_some_and(|end| end <= size);
    let length = usize::try_from(length).map_err(io::Error::other)?;
    if !is_in_file || length > BYTES_MAX {
        return Ok(None);
    }
    let mut bytes = vec![0; length];
    file.read_exact_at(&mut bytes, at)?;
    Ok(Some(bytes))
}
