//! The flights of a shard, on all cores.

use std::path::Path;
use std::time::Instant;

use ::flight::interrupt::Interrupt;

use crate::error::{SweepError, make_folder};
use crate::flight;
use crate::prepared::Prepared;
use crate::row::Row;
use crate::shard::{self, Shard};

/// Results of flying a shard.
pub struct ShardFlown {
    /// Rows in the file.
    pub rows: u64,
    /// Rows of the complete shard.
    pub total: u64,
    /// Rows from earlier runs.
    pub before: u64,
    /// Steps of the vehicle.
    pub steps: u64,
    /// Wall time of the flights, s.
    pub seconds: f64,
}

impl ShardFlown {
    /// Returns a count per second of wall time.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "for a person")]
    pub fn per_second(&self, count: u64) -> f64 {
        count as f64 / self.seconds.max(1e-9)
    }
}

/// Flies the missing rows of a shard. Calls `progress` with the number of its rows and the total, before the first flight and
/// after each.
///
/// # Errors
/// [`SweepError`] if a flight cannot begin or a row cannot be written; a lost flight is a row.
pub fn fly_shard(
    prepared: &Prepared,
    shard: Shard,
    folder: &Path,
    threads: usize,
    interrupt: &Interrupt,
    mut progress: impl FnMut(u64, u64),
) -> Result<ShardFlown, SweepError> {
    let plan = &prepared.plan;
    let entries = plan.entries.len() as u64;
    let samples = shard.samples(plan.samples);
    let rows = samples.start * entries..samples.end * entries;
    let journal = shard::open(folder, &prepared.header(shard))?;
    let before = journal.results;
    let total = rows.end - rows.start;
    progress(before, total);
    let fly = |row: u64| fly_row(prepared, rows.start + row, folder, interrupt);
    let mut steps = 0;
    let begun = Instant::now();
    let rows = journal.fill(threads, fly, |rows, _, row_steps| {
        steps += row_steps;
        progress(rows, total);
    })?;
    Ok(ShardFlown {
        rows,
        total,
        before,
        steps,
        seconds: begun.elapsed().as_secs_f64(),
    })
}

/// Flies a row and returns it with the number of steps of its vehicle. `None` if the flight was interrupted.
fn fly_row(
    prepared: &Prepared,
    row: u64,
    folder: &Path,
    interrupt: &Interrupt,
) -> Option<Result<(Row, u64), SweepError>> {
    let Prepared { plan, layout, .. } = prepared;
    let entries = plan.entries.len() as u64;
    let sample = plan.sample(row / entries);
    let entry = &plan.entries[usize::try_from(row % entries).expect("few entries")];
    let flown = match flight::fly(plan, &sample, entry, interrupt) {
        Ok(flown) => flown?,
        Err(failure) => return Some(Err(failure)),
    };
    let row = layout.row(&sample, entry, &flown);
    if layout.keeps_log(plan.source.definition.keep.logs, &row) {
        let log = folder
            .join("logs")
            .join(format!("sample-{}-{}", sample.index, entry.file_name()));
        match keep_log(prepared, &log, &sample, entry, interrupt) {
            Ok(()) => {}
            Err(failure) => return Some(Err(failure)),
        }
    }
    Some(Ok((row, flown.steps)))
}

fn keep_log(
    prepared: &Prepared,
    folder: &Path,
    sample: &crate::plan::Sample,
    entry: &crate::definition::Entry,
    interrupt: &Interrupt,
) -> Result<(), SweepError> {
    make_folder(folder)?;
    flight::fly_recorded(&prepared.plan, sample, entry, &folder.join("run.mcap"), interrupt).map(drop)
}
