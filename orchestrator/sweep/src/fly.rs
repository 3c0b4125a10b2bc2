//! Recorded rows of a sample, for comparison with a repeated flight.

use std::path::Path;

use crate::definition::Source;
use crate::error::SweepError;
use crate::prepared::Prepared;
use crate::row::{Cell, Row};
use crate::shard::{ShardReader, shards_in};

/// Returns whether cells are equal bit for bit.
#[must_use]
pub fn is_same(one: &[Cell], other: &[Cell]) -> bool {
    let bits = |cell: &Cell| match cell {
        Cell::Number(_) | Cell::Integer(_) => Some(cell.number().to_bits()),
        _ => None,
    };
    one.iter()
        .zip(other)
        .all(|(one, other)| match (bits(one), bits(other)) {
            (Some(one), Some(other)) => one == other,
            _ => one == other,
        })
}

/// Returns a cell as text.
#[must_use]
pub fn text(cell: &Cell) -> String {
    match cell {
        Cell::Flag(flag) => flag.to_string(),
        Cell::Integer(number) => number.to_string(),
        Cell::Number(None) => "–".to_owned(),
        Cell::Number(Some(number)) => format!("{number:?}"),
        Cell::Text(text) => text.clone(),
    }
}

/// Opens a sweep by a folder of results or by its file, and returns it with the recorded rows of a sample. Calls `note` with
/// reasons why a repeated flight may differ.
///
/// # Errors
/// [`SweepError`] if there is no such sweep.
pub fn find(
    folder: &Path,
    sample: u64,
    note: impl Fn(&str),
) -> Result<(Prepared, Option<Vec<Row>>), SweepError> {
    if !folder.is_dir() {
        return Ok((Prepared::new(Source::read(folder)?)?, None));
    }
    let mut prepared = None;
    for (shard, _) in shards_in(folder)?
        .into_iter()
        .filter(|(_, is_complete)| *is_complete)
    {
        let mut reader = ShardReader::open(&shard.path(folder))?;
        let header = reader.header().clone();
        if prepared.is_none() {
            let source = Source::new(
                folder,
                header.sweep_text,
                header.scenario_path,
                header.scenario_text,
            )?;
            let opened = Prepared::new(source)?;
            if opened.program != header.program {
                note(
                    "the results were flown by another build of gerono, whose flights may differ in their bits",
                );
            }
            if *opened.plan.files() != header.files {
                note("the results were flown with other plug-ins or points of a path, whose flights differ");
            }
            prepared = Some(opened);
        }
        let samples = prepared.as_ref().map_or(0, |prepared| prepared.plan.samples);
        if !shard.samples(samples).contains(&sample) {
            continue;
        }
        let mut rows = Vec::new();
        while let Some(row) = reader.next_row()? {
            if row[0] == Cell::Integer(sample) {
                rows.push(row);
            }
        }
        return Ok((prepared.expect("set above"), Some(rows)));
    }
    match prepared {
        Some(prepared) => Ok((prepared, None)),
        None => Err(SweepError::bad_input(format!(
            "there is no complete shard in {}; name the sweep itself, or fly it first",
            folder.display()
        ))),
    }
}
