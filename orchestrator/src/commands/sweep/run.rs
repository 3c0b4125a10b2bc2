//! `gerono sweep run`: flies a shard on all cores.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use flight::interrupt::Interrupt;
use flight::many;
use sweep::error::make_folder;
use sweep::prepared::Prepared;
use sweep::run::{ShardFlown, fly_shard};
use sweep::shard::{Shard, is_complete};

use super::{failure, merge_and_print};
use crate::cli::SweepRun;
use crate::commands::{Failure, note, print};

/// Period of progress lines if standard error is no terminal.
const LINE_PERIOD: Duration = Duration::from_secs(30);

/// Returns the default folder for the results of a sweep.
fn default_folder(sweep: &Path) -> PathBuf {
    let name = sweep
        .file_stem()
        .map_or_else(|| "sweep".into(), |stem| stem.to_string_lossy());
    Path::new("runs").join(format!("sweep-{name}"))
}

/// `gerono sweep run`.
///
/// # Errors
/// [`Failure`] if a flight cannot begin or a row cannot be written; a lost flight is a row.
pub(super) fn run(arguments: &SweepRun) -> Result<Exit, Failure> {
    let prepared = super::prepared(&arguments.sweep)?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let shard = arguments.shard.unwrap_or(Shard::WHOLE);
    super::check_flyable(&prepared, shard, &interrupt)?;
    let folder = arguments
        .out
        .clone()
        .unwrap_or_else(|| default_folder(&arguments.sweep));
    make_folder(&folder).map_err(failure)?;
    let threads = arguments.jobs.map_or_else(many::cores, usize::from);
    if is_complete(&folder, &prepared.header(shard)).map_err(failure)? {
        note(format_args!(
            "{} is complete already, nothing was flown",
            folder.display()
        ));
    } else {
        let flown = fly(&prepared, shard, &folder, threads, &interrupt)?;
        if let Some(signal) = interrupt.signal() {
            note(format_args!(
                "{} of {} rows are stored in {}; the same command resumes from there",
                flown.rows,
                flown.total,
                folder.display()
            ));
            return Ok(Exit::Signal(signal));
        }
        print(format!(
            "{} flights in {:.1} s, {:.1} per second, {:.2} million vehicle steps per second\n",
            flown.rows - flown.before,
            flown.seconds,
            flown.per_second(flown.rows - flown.before),
            flown.per_second(flown.steps) / 1e6,
        ));
    }
    if arguments.shard.is_none() {
        return merge_and_print(&folder, false, arguments.latex);
    }
    Ok(Exit::Success)
}

/// Flies a shard and shows the progress.
fn fly(
    prepared: &Prepared,
    shard: Shard,
    folder: &Path,
    threads: usize,
    interrupt: &Interrupt,
) -> Result<ShardFlown, Failure> {
    let mut counter = None;
    let flown = fly_shard(prepared, shard, folder, threads, interrupt, |done, total| {
        counter
            .get_or_insert_with(|| Counter::new(total, done))
            .count(done);
    });
    if let Some(counter) = counter {
        counter.bar.finish_and_clear();
    }
    flown.map_err(failure)
}

/// Progress of the flights: a bar on a terminal, otherwise a line every [`LINE_PERIOD`].
struct Counter {
    bar: progress::ProgressBar,
    done: u64,
    total: u64,
    begun: Instant,
    before: u64,
    last_line: Instant,
}

impl Counter {
    fn new(total: u64, before: u64) -> Self {
        let bar = progress::rated_flights(total);
        bar.set_position(before);
        bar.reset_eta();
        let now = Instant::now();
        Self {
            bar,
            done: before,
            total,
            begun: now,
            before,
            last_line: now,
        }
    }

    fn count(&mut self, done: u64) {
        self.done = done;
        self.bar.set_position(self.done);
        if self.bar.is_hidden() && self.last_line.elapsed() >= LINE_PERIOD {
            self.last_line = Instant::now();
            #[expect(clippy::cast_precision_loss, reason = "for a person")]
            let rate = (self.done - self.before) as f64 / self.begun.elapsed().as_secs_f64();
            #[expect(clippy::cast_precision_loss, reason = "for a person")]
            let left = (self.total - self.done) as f64 / rate;
            note(format_args!(
                "{} of {} flights, {rate:.1} per second, {left:.0} s left",
                self.done, self.total
            ));
        }
    }
}
