//! The metadata of a file that its summary names, wherever they stand.
//!
//! The logs of this program begin with them. Programs that sort or merge files write them behind the samples.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{Metadata, Record, op};

use super::records::{self, FRAME_BYTES};

/// Length of the last record with its frame, and of the magic bytes behind it.
const FOOTER_BYTES: u64 = (FRAME_BYTES + 8 + 8 + 4) as u64;

/// Largest summary and largest record of metadata that are read, bytes. Those of a log have some hundred kilobytes.
const BYTES_MAX: u64 = 16 << 20;

/// Most records of metadata that are read.
const RECORDS_MAX: usize = 64;

/// Returns the metadata of a file in the order of its summary; none if it has no proper one.
///
/// # Errors
/// What the system says if the file cannot be read.
pub(super) fn metadata_by_index(path: &Path) -> io::Result<Vec<Metadata>> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    let summary = summary(&file, size)?.unwrap_or_default();
    let mut found = Vec::new();
    for (_, body) in Frames(&summary).filter(|(opcode, _)| *opcode == op::METADATA_INDEX) {
        let Ok(Record::MetadataIndex(index)) = records::parse(op::METADATA_INDEX, body) else {
            continue;
        };
        if found.len() < RECORDS_MAX
            && let Some(record) = bytes_at(&file, size, index.offset, index.length)?
            && let Some((op::METADATA, body)) = Frames(&record).next()
            && let Ok(Record::Metadata(metadata)) = records::parse(op::METADATA, body)
        {
            found.push(metadata);
        }
    }
    // What was said of a recovery or a split belongs to the manifest, which ends the facts.
    found.sort_by_key(|metadata| metadata.name == super::Manifest::RECORD_NAME);
    Ok(found)
}

/// Returns the bytes of the summary, if the file ends as a file with one does.
fn summary(file: &File, size: u64) -> io::Result<Option<Vec<u8>>> {
    let tail = FOOTER_BYTES + mcap::MAGIC.len() as u64;
    let Some(footer_at) = size.checked_sub(tail) else {
        return Ok(None);
    };
    let Some(end) = bytes_at(file, size, footer_at, FOOTER_BYTES)? else {
        return Ok(None);
    };
    let Some((op::FOOTER, body)) = Frames(&end).next() else {
        return Ok(None);
    };
    match records::parse(op::FOOTER, body) {
        Ok(Record::Footer(footer)) if footer.summary_start > 0 => {
            let length = footer_at.checked_sub(footer.summary_start);
            length.map_or(Ok(None), |length| {
                bytes_at(file, size, footer.summary_start, length)
            })
        }
        _ => Ok(None),
    }
}

/// Returns bytes of the file; none if they are not all in it, or too many.
fn bytes_at(file: &File, size: u64, at: u64, length: u64) -> io::Result<Option<Vec<u8>>> {
    let is_in_file = at.checked_add(length).is_some_and(|end| end <= size);
    if !is_in_file || length > BYTES_MAX {
        return Ok(None);
    }
    let mut bytes = vec![0; usize::try_from(length).map_err(io::Error::other)?];
    file.read_exact_at(&mut bytes, at)?;
    Ok(Some(bytes))
}

/// The records that follow each other in these bytes: kind and body.
struct Frames<'a>(&'a [u8]);

impl<'a> Iterator for Frames<'a> {
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let (frame, rest) = self.0.split_first_chunk::<FRAME_BYTES>()?;
        let [opcode, length @ ..] = *frame;
        let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
        let (body, rest) = rest.split_at_checked(length)?;
        self.0 = rest;
        Some((opcode, body))
    }
}
