//! `gerono sweep`: thousands of flights of varied scenarios.

mod fly;
mod plan;
mod run;

use std::path::Path;

use command_line::exit::Exit;
use flight::interrupt::Interrupt;
use sweep::definition::Source;
use sweep::error::SweepError;
use sweep::merge::merge_folder;
use sweep::prepared::Prepared;
use sweep::shard::Shard;

use super::{Failure, note, print, write_latex};
use crate::cli::{Sweep, SweepCommand, SweepMerge};

/// `gerono sweep`.
///
/// # Errors
/// [`Failure`].
pub fn sweep(arguments: &Sweep) -> Result<Exit, Failure> {
    match &arguments.command {
        SweepCommand::Plan(arguments) => plan::plan(arguments),
        SweepCommand::Run(arguments) => run::run(arguments),
        SweepCommand::Merge(arguments) => merge(arguments),
        SweepCommand::Fly(arguments) => fly::fly(arguments),
    }
}

/// Reads and checks a sweep.
fn prepared(sweep: &Path) -> Result<Prepared, Failure> {
    Source::read(sweep).and_then(Prepared::new).map_err(failure)
}

/// Checks the scenarios of a shard, and notes the refused ones.
fn check_flyable(prepared: &Prepared, shard: Shard, interrupt: &Interrupt) -> Result<(), Failure> {
    let plan = &prepared.plan;
    let samples = shard.samples(plan.samples);
    if let (refused, Some(first)) = plan.check_flyable(samples, interrupt).map_err(failure)? {
        note(format_args!("{refused} flights are refused: {first}"));
    }
    if let Some(name) = plan.idle_inertia() {
        note(format_args!(
            "`vary.\"{name}\"` has no effect: these vehicles follow body rates by `vehicle.actuators.rate_lag`, whatever their inertia"
        ));
    }
    for entry in &plan.entries {
        if let Some(warning) = plan.warning(entry) {
            note(format_args!("`{}`, sample 0: {warning}", entry.name));
        }
    }
    Ok(())
}

/// Converts the error of a sweep to the failure of the command.
fn failure(error: SweepError) -> Failure {
    match error {
        SweepError::Scenario(error) => error.into(),
        SweepError::Flight(error) => error.into(),
        SweepError::BadInput(error) => Failure::bad_input(error),
        SweepError::NotWritten(error) => Failure::not_written(error),
        SweepError::Trouble(error) => Failure::trouble(error),
    }
}

/// `gerono sweep merge`.
///
/// # Errors
/// [`Failure`] if shards are missing, differ or are damaged, or results cannot be written.
fn merge(arguments: &SweepMerge) -> Result<Exit, Failure> {
    merge_and_print(&arguments.results, arguments.mixed_builds, arguments.latex)
}

/// Merges the shards of a folder and prints the report.
fn merge_and_print(folder: &Path, mixed_builds: bool, latex: bool) -> Result<Exit, Failure> {
    let (report, refused) = merge_folder(folder, mixed_builds).map_err(failure)?;
    write_latex(&folder.join("sweep.tex"), latex, &report.tables())?;
    print(format!("{report}results: {}\n", folder.display()));
    if refused > 0 {
        note(format_args!(
            "{refused} flights were refused: their samples cannot be flown; see `reason` in the table"
        ));
    }
    match report.laws.iter().find(|law| law.flown() == 0) {
        Some(law) => Err(Failure::bad_input(format!(
            "no sample was flown with `{}`: all {} were refused, see `reason` in the table",
            law.name, law.refused
        ))),
        None => Ok(Exit::Success),
    }
}
