//! Sweeps for other programs: flown and merged without a word on the terminal.

use std::path::{Path, PathBuf};

use command_line::failure::Failure;
use command_line::interrupt::Interrupt;
use evaluation::reproduce::parallel;

use crate::definition::Source;
use crate::flight::{self, OwnController};
use crate::merge::merge_folder;
use crate::prepared::Prepared;
use crate::run::fly_shard;
use crate::shard::{Shard, ShardWriter};

fn prepared(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
) -> Result<Prepared, Failure> {
    let source = Source::new(Path::new("sweep"), text, scenario_path, scenario_text)?;
    let prepared = Prepared::new(source)?;
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::not_written(format!("cannot make {}: {error}", folder.display())))?;
    Ok(prepared)
}

/// Flies a sweep into a folder, on so many threads or on all cores, and merges it; goes on where an earlier call was
/// interrupted.
///
/// # Errors
/// [`Failure`] if nothing can be flown or written.
pub fn run(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
    jobs: Option<usize>,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let prepared = prepared(text, scenario_path, scenario_text, folder)?;
    if !Shard::WHOLE.path(folder).exists() {
        let threads = jobs.unwrap_or_else(parallel::cores);
        fly_shard(&prepared, Shard::WHOLE, folder, threads, interrupt)?;
    }
    merge_folder(folder, false).map(drop)
}

/// Flies a sweep with a controller of the caller's, a new one for every flight, one flight after the other.
///
/// # Errors
/// [`Failure`] if nothing can be flown or written, or if no controller can be made.
pub fn run_with(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
    make: &mut dyn FnMut() -> Result<OwnController, Failure>,
) -> Result<(), Failure> {
    let prepared = prepared(text, scenario_path, scenario_text, folder)?;
    let (plan, layout) = (&prepared.plan, &prepared.layout);
    let mut writer = ShardWriter::open(folder, &prepared.header(Shard::WHOLE))?;
    let entries = plan.entries.len() as u64;
    for row in writer.rows..plan.samples * entries {
        let sample = plan.sample(row / entries);
        let entry = &plan.entries[usize::try_from(row % entries).expect("few entries")];
        let flown = flight::fly_own(plan, &sample, entry, make()?, &Interrupt::never())?;
        if let Some(flown) = flown {
            writer.write(&layout.row(&sample, entry, &flown))?;
        }
    }
    writer.complete()?;
    merge_folder(folder, false).map(drop)
}
