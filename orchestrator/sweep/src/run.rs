//! `gerono sweep run`: flies a shard on all cores.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ::flight::interrupt::Interrupt;
use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{note, print};
use command_line::progress;
use evaluation::reproduce::parallel;

use crate::arguments::Run;
use crate::definition::Source;
use crate::prepared::Prepared;
use crate::row::Row;
use crate::shard::{Shard, ShardError, ShardWriter, is_complete};
use crate::{flight, merge, ordered};

/// Time between two lines of progress where standard error is no terminal.
const LINE_PERIOD: Duration = Duration::from_secs(30);

impl From<ShardError> for Failure {
    fn from(error: ShardError) -> Self {
        match error {
            ShardError::File { .. } => Self::not_written(error),
            _ => Self::bad_input(error),
        }
    }
}

/// Returns the folder for the results of a sweep unless another is asked for.
fn default_folder(sweep: &Path) -> PathBuf {
    let name = sweep
        .file_stem()
        .map_or_else(|| "sweep".into(), |stem| stem.to_string_lossy());
    Path::new("runs").join(format!("sweep-{name}"))
}

/// `gerono sweep run`.
///
/// # Errors
/// [`Failure`] if nothing can be flown or written; a flight that is lost is a row.
pub(crate) fn run(arguments: &Run) -> Result<Exit, Failure> {
    let prepared = Prepared::new(Source::read(&arguments.sweep)?)?;
    prepared.plan.check_flyable()?;
    let folder = arguments
        .out
        .clone()
        .unwrap_or_else(|| default_folder(&arguments.sweep));
    std::fs::create_dir_all(&folder)
        .map_err(|error| Failure::not_written(format!("cannot make {}: {error}", folder.display())))?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let threads = arguments.jobs.map_or_else(parallel::cores, usize::from);
    let shard = arguments.shard.unwrap_or(Shard::WHOLE);
    if is_complete(&folder, &prepared.header(shard))? {
        note(format_args!(
            "{} is complete already, nothing was flown",
            folder.display()
        ));
    } else {
        let flown = fly_shard(&prepared, shard, &folder, threads, &interrupt)?;
        if let Some(signal) = interrupt.signal() {
            note(format_args!(
                "{} of {} rows are kept in {}; the same command goes on from there",
                flown.rows,
                flown.of,
                folder.display()
            ));
            return Ok(Exit::Signal(signal));
        }
        print(format!(
            "{} flights in {:.1} s, {:.1} a second, {:.2} million vehicle steps a second\n",
            flown.rows - flown.before,
            flown.seconds,
            flown.per_second(flown.rows - flown.before),
            flown.per_second(flown.steps) / 1e6,
        ));
    }
    if arguments.shard.is_none() {
        return merge::merge_and_tell(&folder, false, arguments.latex);
    }
    Ok(Exit::Success)
}

/// What a shard's flights came to.
pub(crate) struct ShardFlown {
    /// Rows in the file, and those that it is to have.
    rows: u64,
    of: u64,
    /// Rows that were there before.
    before: u64,
    /// Steps of the vehicle.
    steps: u64,
    seconds: f64,
}

impl ShardFlown {
    #[expect(clippy::cast_precision_loss, reason = "for a person")]
    fn per_second(&self, count: u64) -> f64 {
        count as f64 / self.seconds.max(1e-9)
    }
}

pub(crate) fn fly_shard(
    prepared: &Prepared,
    shard: Shard,
    folder: &Path,
    threads: usize,
    interrupt: &Interrupt,
) -> Result<ShardFlown, Failure> {
    let plan = &prepared.plan;
    let entries = plan.entries.len() as u64;
    let samples = shard.samples(plan.samples);
    let rows = samples.start * entries..samples.end * entries;
    let mut writer = ShardWriter::open(folder, &prepared.header(shard))?;
    let before = writer.rows;
    let mut counter = Counter::new(rows.end - rows.start, before);
    let fly = |row: u64| fly_row(prepared, row, folder, interrupt);
    let mut steps = 0;
    let begun = Instant::now();
    let flown = ordered::for_each(rows.start + before..rows.end, threads, fly, |flown| {
        let (row, of_row) = flown?;
        steps += of_row;
        writer.write(&row)?;
        counter.count();
        Ok(())
    });
    counter.end();
    let seconds = begun.elapsed().as_secs_f64();
    let of = rows.end - rows.start;
    let written = writer.rows;
    if let Err(failure) = flown {
        // What was flown is kept also where this row could not be.
        let _ = writer.pause();
        return Err(failure);
    }
    if written == of {
        writer.complete()?;
    } else {
        writer.pause()?;
    }
    Ok(ShardFlown {
        rows: written,
        of,
        before,
        steps,
        seconds,
    })
}

/// Flies the row of a number, and returns it with the steps of its vehicle; none if the flight was interrupted.
fn fly_row(
    prepared: &Prepared,
    row: u64,
    folder: &Path,
    interrupt: &Interrupt,
) -> Option<Result<(Row, u64), Failure>> {
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
) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::not_written(format!("cannot make {}: {error}", folder.display())))?;
    flight::fly_recorded(&prepared.plan, sample, entry, &folder.join("run.mcap"), interrupt).map(drop)
}

/// Progress of the flights: a bar on a terminal, a line now and then elsewhere.
struct Counter {
    bar: progress::ProgressBar,
    done: u64,
    of: u64,
    begun: Instant,
    before: u64,
    told: Instant,
}

impl Counter {
    fn new(of: u64, before: u64) -> Self {
        let bar = progress::rated_flights(of);
        bar.set_position(before);
        bar.reset_eta();
        let now = Instant::now();
        Self {
            bar,
            done: before,
            of,
            begun: now,
            before,
            told: now,
        }
    }

    fn count(&mut self) {
        self.done += 1;
        self.bar.set_position(self.done);
        if self.bar.is_hidden() && self.told.elapsed() >= LINE_PERIOD {
            self.told = Instant::now();
            #[expect(clippy::cast_precision_loss, reason = "for a person")]
            let rate = (self.done - self.before) as f64 / self.begun.elapsed().as_secs_f64();
            #[expect(clippy::cast_precision_loss, reason = "for a person")]
            let left = (self.of - self.done) as f64 / rate;
            note(format_args!(
                "{} of {} flights, {rate:.1} a second, {left:.0} s left",
                self.done, self.of
            ));
        }
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}
