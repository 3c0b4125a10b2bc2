//! Sweeps for other programs: flown and merged without output to the terminal.

use std::path::{Path, PathBuf};

use ::flight::interrupt::Interrupt;
use ::flight::many;

use crate::definition::{Entry, Source};
use crate::error::{SweepError, make_folder};
use crate::flight::{self, OwnController};
use crate::merge::merge_folder;
use crate::prepared::Prepared;
use crate::run::fly_shard;
use crate::shard::{self, Shard, is_complete};

fn prepared(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
    interrupt: &Interrupt,
) -> Result<Prepared, SweepError> {
    let source = Source::new(Path::new("sweep"), text, scenario_path, scenario_text)?;
    let prepared = Prepared::new(source)?;
    prepared.plan.check_flyable(0..prepared.plan.samples, interrupt)?;
    make_folder(folder)?;
    Ok(prepared)
}

/// Flies a sweep into a folder, on `jobs` threads or on all cores, and merges it. Resumes an interrupted sweep, and flies
/// nothing if the folder holds the same sweep completely.
///
/// # Errors
/// [`SweepError`] if nothing can be flown or written, or if the folder holds another sweep.
pub fn run(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
    jobs: Option<usize>,
    interrupt: &Interrupt,
) -> Result<(), SweepError> {
    let prepared = prepared(text, scenario_path, scenario_text, folder, interrupt)?;
    if !is_complete(folder, &prepared.header(Shard::WHOLE))? {
        let threads = jobs.unwrap_or_else(many::cores);
        fly_shard(&prepared, Shard::WHOLE, folder, threads, interrupt, |_, _| ())?;
    }
    if interrupt.signal().is_some() {
        return Ok(());
    }
    merge_folder(folder, false).map(drop)
}

/// As [`run`], with controllers of the caller: `make` is called before each flight and returns its controller, if the entry has
/// one. Flights run one after the other; an aborted flight leaves no row and ends the sweep.
///
/// # Errors
/// [`SweepError`] as [`run`], and that of `make`.
pub fn run_with(
    text: String,
    scenario_path: PathBuf,
    scenario_text: String,
    folder: &Path,
    make: &mut dyn FnMut(&Entry) -> Result<Option<OwnController>, SweepError>,
) -> Result<(), SweepError> {
    let prepared = prepared(text, scenario_path, scenario_text, folder, &Interrupt::never())?;
    let (plan, layout) = (&prepared.plan, &prepared.layout);
    if is_complete(folder, &prepared.header(Shard::WHOLE))? {
        return merge_folder(folder, false).map(drop);
    }
    let mut writer = shard::open(folder, &prepared.header(Shard::WHOLE))?;
    let entries = plan.entries.len() as u64;
    for row in writer.results..plan.samples * entries {
        let sample = plan.sample(row / entries);
        let entry = &plan.entries[usize::try_from(row % entries).expect("few entries")];
        let flown =
            make(entry).and_then(|own| flight::fly_own(plan, &sample, entry, own, &Interrupt::never()));
        match flown {
            Ok(Some(flown)) => writer.write(&layout.row(&sample, entry, &flown))?,
            Ok(None) => return Ok(writer.pause()?),
            Err(failure) => {
                // Keeps the rows so far. An error of this is dropped: the failure of the flight is the one to report.
                let _ = writer.pause();
                return Err(failure);
            }
        }
    }
    writer.complete()?;
    merge_folder(folder, false).map(drop)
}
