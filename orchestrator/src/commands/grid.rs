//! `gerono grid`: control laws compared in many conditions.

use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use grid::error::GridError;
use grid::flights::{self, Base};
use grid::report::GridReport;
use grid::{margins, page};
use report::text_table::latex_file;
use run_log::run_folder::RunFolder;

use super::{Failure, print, write, write_json};
use crate::cli::Grid;

/// `gerono grid`.
///
/// # Errors
/// [`Failure`] if nothing can be flown or written.
pub fn grid(arguments: &Grid) -> Result<Exit, Failure> {
    let seeds = arguments.seeds()?;
    let mut laws = arguments.laws()?;
    let base = Base::load(arguments.scenario.as_deref()).map_err(failure)?;
    let of_base = arguments
        .conditions()
        .into_iter()
        .map(|condition| condition.of(base.stated()));
    let conditions = of_base.collect::<Result<Vec<_>, _>>().map_err(failure)?;
    let quantities = arguments.quantities();
    // A margin that the scenario does not have is refused before anything is flown.
    for quantity in quantities {
        quantity.settings(base.stated(), 0.0).map_err(failure)?;
    }
    if arguments.along_bandwidth {
        let along: Result<Vec<_>, _> = laws.iter().map(|law| law.along_bandwidth(&base)).collect();
        laws = along.map_err(failure)?.concat();
    }
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let jobs = flights::jobs(&base, &laws, &conditions, &seeds).map_err(failure)?;
    let folder = RunFolder::create(arguments.out.as_deref(), "grid").map_err(Failure::not_written)?;
    let bar = progress::flights(jobs.len());
    let cells = flights::fly(&jobs, &laws, &conditions, &interrupt, || bar.inc(1));
    bar.finish_and_clear();
    let cells = cells.map_err(|error| {
        folder.remove_if_empty();
        failure(error)
    })?;
    let bar = progress::flights(laws.len() * quantities.len());
    let margins =
        margins::search(&base, &laws, quantities, &seeds, &interrupt, || bar.inc(1)).map_err(failure)?;
    bar.finish_and_clear();
    if let Some(signal) = interrupt.signal() {
        folder.remove_if_empty();
        return Ok(Exit::Signal(signal));
    }
    let report = GridReport::new(&base, &laws, &conditions, &seeds, cells, margins);
    write_json(&folder.path().join("grid.json"), &report)?;
    write(&folder.path().join("grid.md"), &report.markdown())?;
    if arguments.latex {
        write(&folder.path().join("grid.tex"), &latex_file(&report.tables()))?;
    }
    write(&folder.path().join("index.html"), &page::page(&report))?;
    if let Some(drawing) = page::pareto(&report) {
        write(&folder.path().join("pareto.svg"), &drawing)?;
    }
    print(format!("{report}results: {}\n", folder.path().display()));
    Ok(Exit::Success)
}

/// Returns the failure of a command from that of a grid.
fn failure(error: GridError) -> Failure {
    match error {
        GridError::Scenario(error) => error.into(),
        GridError::Flight(error) => error.into(),
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
