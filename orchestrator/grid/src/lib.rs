//! `gerono grid`: compares control laws with each other, in performance and in margin.
//!
//! Every law flies the same conditions with the same seeds, so that differences are to be read seed by seed. Beside the
//! error the grid has the second axis: how much of each disturbance a law survives, found by bisection with the same
//! seeds. Flights are in one process and functions of their scenario alone.
//!
//! * [`laws`]: the control laws;
//! * [`conditions`]: the conditions, and the quantities whose margin is searched;
//! * [`flights`]: the flights, and the results of a law in a condition;
//! * [`margins`]: the search for the largest value that a law survives;
//! * [`front`]: the laws that none beats in performance and margin;
//! * [`report`]: the results as tables, as JSON and as a page with a heat map.

pub mod arguments;
pub mod conditions;
pub mod flights;
pub mod front;
pub mod laws;
pub mod margins;
pub mod page;
pub mod report;

use command_line::exit::Exit;
use command_line::failure::Failure;
use command_line::interrupt;
use command_line::output::{print, write, write_json};
use command_line::progress;
use evaluation::text_table::latex_file;
use run_log::run_folder::RunFolder;

use arguments::Grid;
use flights::Base;
use report::GridReport;

/// First of the seeds unless another is asked for; none of them was used for tuning.
pub const FIRST_SEED: u64 = 201;

/// `gerono grid`.
///
/// # Errors
/// [`Failure`] if nothing can be flown or written.
pub fn grid(arguments: &Grid) -> Result<Exit, Failure> {
    let seeds = arguments.seeds()?;
    let mut laws = arguments.laws()?;
    let base = Base::load(arguments.scenario.as_deref())?;
    let of_base = arguments
        .conditions()
        .into_iter()
        .map(|condition| condition.of(base.stated()));
    let conditions = of_base.collect::<Result<Vec<_>, _>>()?;
    let quantities = arguments.quantities();
    // A margin that the scenario does not have is refused before anything is flown.
    for quantity in quantities {
        quantity.settings(base.stated(), 0.0)?;
    }
    if arguments.along_bandwidth {
        let along: Result<Vec<_>, _> = laws.iter().map(|law| law.along_bandwidth(&base)).collect();
        laws = along?.concat();
    }
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let jobs = flights::jobs(&base, &laws, &conditions, &seeds)?;
    let folder = RunFolder::create(arguments.out.as_deref(), "grid").map_err(Failure::not_written)?;
    let bar = progress::flights(jobs.len());
    let cells = flights::fly(&jobs, &laws, &conditions, &interrupt, || bar.inc(1));
    bar.finish_and_clear();
    let cells = cells.inspect_err(|_| folder.remove_if_empty())?;
    let bar = progress::flights(laws.len() * quantities.len());
    let margins = margins::search(&base, &laws, quantities, &seeds, &interrupt, || bar.inc(1))?;
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
