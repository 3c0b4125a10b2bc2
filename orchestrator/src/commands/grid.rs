//! `gerono grid`: compares control laws in many conditions.

use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use grid::error::GridError;
use grid::flights::{self, Base};
use grid::report::GridReport;
use grid::{margins, page};
use reproduce::flight::FLIGHTS;
use run_log::run_folder::RunFolder;

use super::{Failure, print, print_resume_hint, write, write_json, write_latex, write_or_remove};
use crate::cli::Grid;

/// `gerono grid`.
///
/// # Errors
/// [`Failure`] if a flight cannot begin or results cannot be written.
pub fn grid(arguments: &Grid) -> Result<Exit, Failure> {
    let seeds = arguments.seeds()?;
    let mut laws = arguments.laws()?;
    let base = Base::load(arguments.scenario.as_deref()).map_err(failure)?;
    let conditions = arguments
        .conditions()
        .into_iter()
        .map(|condition| condition.for_scenario(base.stated()));
    let conditions = conditions.collect::<Result<Vec<_>, _>>().map_err(failure)?;
    let quantities = arguments.quantities();
    // Refuses a margin that the scenario does not support before the first flight.
    for quantity in quantities {
        quantity.settings(base.stated(), 0.0).map_err(failure)?;
    }
    if arguments.along_bandwidth {
        let along: Result<Vec<_>, _> = laws.iter().map(|law| law.along_bandwidth(&base)).collect();
        laws = along.map_err(failure)?.concat();
    }
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let jobs = flights::jobs(&base, &laws, &conditions, &seeds).map_err(failure)?;
    let folder =
        RunFolder::resume(arguments.out.as_deref(), "grid", &[FLIGHTS]).map_err(Failure::not_written)?;
    let bar = progress::flights(jobs.len());
    let flown = |flights: usize| bar.set_position(flights as u64);
    let cells = flights::fly(&jobs, &laws, &conditions, folder.path(), &interrupt, flown);
    bar.finish_and_clear();
    let cells = cells.map_err(|error| {
        folder.remove_if_empty();
        failure(error)
    })?;
    let bar = progress::flights(laws.len() * quantities.len());
    let found = |margins: usize| bar.set_position(margins as u64);
    let margins = match &cells {
        Some(_) if !quantities.is_empty() => {
            margins::search(&base, &laws, quantities, &seeds, folder.path(), &interrupt, found)
        }
        _ => Ok(Vec::new()),
    };
    bar.finish_and_clear();
    let margins = margins.map_err(failure)?;
    if let Some(signal) = interrupt.signal() {
        print_resume_hint(folder.path());
        return Ok(Exit::Signal(signal));
    }
    let cells = cells.expect("a grid that was not interrupted is complete");
    let report = GridReport::new(&base, &laws, &conditions, &seeds, cells, margins);
    write_json(&folder.path().join("grid.json"), &report)?;
    write(&folder.path().join("grid.md"), &report.markdown())?;
    write_latex(&folder.path().join("grid.tex"), arguments.latex, &report.tables())?;
    write(&folder.path().join("index.html"), &page::page(&report))?;
    write_or_remove(&folder.path().join("pareto.svg"), page::pareto(&report))?;
    print(format!("{report}results: {}\n", folder.path().display()));
    Ok(Exit::Success)
}

/// Converts the error of a grid to the failure of the command.
fn failure(error: GridError) -> Failure {
    match error {
        GridError::Scenario(error) => error.into(),
        GridError::Flight(error) => error.into(),
        GridError::Journal(error) => error.into(),
        GridError::BadInput(reason) => Failure::bad_input(reason),
        GridError::Unreadable(error) => Failure::trouble(error),
        GridError::Condition {
            law,
            condition,
            source,
        } => {
            let Failure { report, exit } = failure(*source);
            let report = report.wrap_err(format!("`{law}` cannot fly the condition `{condition}`"));
            Failure { report, exit }
        }
    }
}
