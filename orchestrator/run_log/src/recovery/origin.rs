//! Origin of a file, complete or not: one definition for all commands.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use mcap::records::op;

use super::channels::{Channels, Kind, kinds};
use super::scan::{Chunk, Piece, Scan};
use crate::flight_start;
use crate::framing::{LIBRARY, ROS2_PROFILE};
use crate::manifest::{COPY_RECORD_NAME, Manifest};
use crate::metadata_index::summary_of;
use crate::parts::Part;

/// Origin of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// Parts of a flight, or the beginning of a file of this program without a record.
    Flight,
    /// The record of a machine.
    Machine,
    /// Neither, or a copy for viewers.
    Foreign,
}

/// Returns the origin of a file: by the channels in its summary, or by its first valid known part.
///
/// # Errors
/// If the file cannot be read, or would take an excessive amount of work.
pub(crate) fn origin(path: &Path) -> io::Result<Origin> {
    let kinds = kinds();
    if let Some(summary) = summary_of(&mut File::open(path)?)?.filter(|summary| !summary.channels.is_empty())
    {
        let is_copy = |index: &mcap::records::MetadataIndex| index.name == COPY_RECORD_NAME;
        if summary.metadata_indexes.iter().any(is_copy) {
            return Ok(Origin::Foreign);
        }
        let mut channels = summary.channels.values();
        let known = channels.find_map(|channel| {
            let schema = channel.schema.as_ref()?;
            kinds.iter().find(|kind| kind.is_of(&channel.topic, &schema.name))
        });
        return Ok(known.map_or(Origin::Foreign, Kind::origin));
    }
    let mut channels = Channels::new(&kinds);
    let mut scan = Scan::open(path)?;
    while let Some(piece) = scan.next()? {
        let found = match piece {
            Piece::Metadata(metadata) => of_metadata(&metadata.name),
            Piece::Chunk(chunk) | Piece::Cut { chunk, .. } => of_chunk(&mut channels, &chunk),
            Piece::Damage { .. } | Piece::End => None,
        };
        if let Some(found) = found {
            return Ok(found);
        }
    }
    begins_as_ours(path)
}

fn of_metadata(name: &str) -> Option<Origin> {
    match name {
        Manifest::RECORD_NAME | Part::RECORD_NAME => Some(Origin::Flight),
        COPY_RECORD_NAME => Some(Origin::Foreign),
        // The record of a simulated laboratory has nothing else.
        flight_start::RECORD_NAME => Some(Origin::Machine),
        _ => None,
    }
}

fn of_chunk(channels: &mut Channels<'_>, chunk: &Chunk) -> Option<Origin> {
    let mut found = None;
    let read = channels.read(chunk, |message| {
        found.get_or_insert(message.kind);
        Ok::<(), std::convert::Infallible>(())
    });
    let Ok(_) = read;
    let known = found.or_else(|| channels.known());
    known.map(|position| channels.kinds[position].origin())
}

/// Returns the origin of a file without a valid known part, by its beginning: nothing else was written yet, or is left.
fn begins_as_ours(path: &Path) -> io::Result<Origin> {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let header = [text(ROS2_PROFILE), text(LIBRARY)].concat();
    let frame = [&[op::HEADER][..], &(header.len() as u64).to_le_bytes()[..]].concat();
    let expected = [mcap::MAGIC, frame.as_slice(), header.as_slice()].concat();
    let mut begin = Vec::new();
    File::open(path)?
        .take(expected.len() as u64)
        .read_to_end(&mut begin)?;
    Ok(if expected.starts_with(&begin) {
        Origin::Flight
    } else {
        Origin::Foreign
    })
}
