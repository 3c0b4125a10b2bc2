//! `gerono reproduce`: flies, judges and draws the paper's figures over many seeds.

use std::path::Path;

use super::{Failure, ended, print, print_resume_hint, write, write_json};
use crate::cli::Reproduce;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use flight::interrupt::Interrupt;
use flight::many;
use flight::{Outcome, in_process};
use reproduce::drawings::{DRAWINGS, Drawing, TraceBook};
use reproduce::figures::Figure;
use reproduce::flight::{CampaignError, FLIGHTS, FlightResults, Job};
use reproduce::judgement::{self, ReproductionReport};
use reproduce::known_gaps::KnownGaps;
use reproduce::pages::{FlightPage, PageError};
use reproduce::plan::Plan;
use reproduce::traces::{Tracer, Traces};
use reproduce::{QUICK_SEEDS, SEEDS, ablation, gallery, observability, seeds, table};
use run_log::run_folder::RunFolder;

/// `gerono reproduce`.
///
/// # Errors
/// [`Failure`] if there are no results; a regression is an [`Exit`].
pub fn reproduce(arguments: &Reproduce) -> Result<Exit, Failure> {
    let count = arguments
        .seeds
        .unwrap_or(if arguments.quick { QUICK_SEEDS } else { SEEDS });
    let seeds = seeds(count);
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let out = arguments.out.as_deref();
    let folder = RunFolder::resume(out, "reproduce", &[FLIGHTS]).map_err(Failure::not_written)?;
    let end = if arguments.ablation {
        show_ablation(&seeds, &folder, &interrupt)?
    } else {
        show_figures(arguments, &seeds, &folder, &interrupt)?
    };
    if let Exit::Signal(_) = end {
        print_resume_hint(folder.path());
    } else {
        print(format!("results: {}\n", folder.path().display()));
    }
    Ok(end)
}

fn show_ablation(seeds: &[u64], folder: &RunFolder, interrupt: &Interrupt) -> Result<Exit, Failure> {
    let mut plan = Plan::default();
    plan.add_ablation(seeds);
    let Some(results) = fly(&plan.jobs()?, folder, interrupt)? else {
        return Ok(ended(interrupt));
    };
    let lines = ablation::table(&results, seeds);
    let table = table::ablation(&lines);
    write_json(&folder.path().join("ablation.json"), &lines)?;
    write(&folder.path().join("ablation.md"), &table.markdown())?;
    print(format!(
        "The eight of Figs. 3 to 6 without parts of the design, {} seeds from {} on, medians\n{table}\n",
        seeds.len(),
        seeds[0],
    ));
    for line in lines.iter().filter(|line| !line.note.is_empty()) {
        print(format!("{}\n", line.note));
    }
    Ok(Exit::Success)
}

fn show_figures(
    arguments: &Reproduce,
    seeds: &[u64],
    folder: &RunFolder,
    interrupt: &Interrupt,
) -> Result<Exit, Failure> {
    let figures = figures(arguments);
    let with_observability = !arguments.quick && figures.contains(&Figure::Fig10);
    let mut plan = Plan::default();
    for &figure in &figures {
        plan.add_figure(figure, seeds);
    }
    if with_observability {
        plan.add_observability(seeds);
    }
    let jobs = plan.jobs()?;
    let Some(results) = fly(&jobs, folder, interrupt)? else {
        return Ok(ended(interrupt));
    };
    let (drawn, pages) = draw(&figures, &jobs, folder.path(), interrupt)?;
    if let Some(signal) = interrupt.signal() {
        return Ok(Exit::Signal(signal));
    }

    let gaps = KnownGaps::committed();
    let judged = figures
        .iter()
        .map(|&figure| judgement::judge(figure, &results, seeds, &gaps));
    let report = ReproductionReport {
        seeds: seeds.to_vec(),
        laboratories: judgement::laboratories(),
        figures: judged.collect(),
        observability: with_observability.then(|| observability::table(&results, seeds)),
    };
    write_json(&folder.path().join("reproduce.json"), &report)?;
    let table = table::figures(&report.figures);
    write(&folder.path().join("figures.md"), &table.markdown())?;
    if let Some(observability) = &report.observability {
        let table = table::observability(observability);
        write(&folder.path().join("observability.md"), &table.markdown())?;
    }
    write(
        &folder.path().join("index.html"),
        &gallery::page(&report, &drawn, &pages),
    )?;
    print(&report);
    Ok(if report.has_regressed() {
        Exit::Regressed
    } else {
        Exit::Success
    })
}

/// Returns the requested figures, in the paper's order and each once.
fn figures(arguments: &Reproduce) -> Vec<Figure> {
    let requested = if !arguments.figures.is_empty() {
        &arguments.figures[..]
    } else if arguments.quick {
        &Figure::QUICK[..]
    } else {
        &Figure::ALL[..]
    };
    let mut figures = requested.to_vec();
    figures.sort_unstable();
    figures.dedup();
    figures
}

/// Flies all jobs on all cores, with a progress bar on a terminal. Returns `None` if the campaign was interrupted.
fn fly(jobs: &[Job], folder: &RunFolder, interrupt: &Interrupt) -> Result<Option<FlightResults>, Failure> {
    let bar = progress::flights(jobs.len());
    let flown = |flights: usize| bar.set_position(flights as u64);
    let results = FlightResults::fly(jobs, many::cores(), folder.path(), interrupt, flown);
    bar.finish_and_clear();
    results.map_err(|error| match error {
        CampaignError::Journal(error) => error.into(),
        CampaignError::Flight(error) => error.into(),
    })
}

/// Draws the figures from the first seed in the first laboratory, and writes a page about the first flight of each. Returns the
/// drawings and pages that were written.
fn draw(
    figures: &[Figure],
    jobs: &[Job],
    folder: &Path,
    interrupt: &Interrupt,
) -> Result<(Vec<Drawing>, Vec<FlightPage>), Failure> {
    let requested: Vec<Drawing> = DRAWINGS
        .into_iter()
        .filter(|drawing| figures.contains(&drawing.figure))
        .collect();
    // Jobs are in the order of laboratory and seed: the first job of a name is drawn.
    let mut names: Vec<_> = requested
        .iter()
        .flat_map(|drawing| drawing.flights)
        .copied()
        .collect();
    names.sort_unstable();
    names.dedup();
    let drawn_jobs: Vec<&Job> = names
        .iter()
        .filter_map(|name| jobs.iter().find(|job| job.name == *name))
        .collect();
    let mut pages: Vec<FlightPage> = figures
        .iter()
        .copied()
        .filter_map(FlightPage::for_figure)
        .collect();
    let traced = many::map(&drawn_jobs, many::cores(), |job| {
        match pages.iter().find(|page| page.flight == job.name) {
            Some(page) => page.fly(&job.scenario, folder, interrupt),
            None => Ok(trace(job, interrupt)),
        }
    });
    let mut flights = TraceBook::new();
    for (job, traces) in drawn_jobs.iter().zip(traced) {
        let traces = traces.map_err(|error: PageError| Failure::not_written(error))?;
        flights.extend(traces.map(|traces| (job.name.clone(), traces)));
    }
    pages.retain(|page| flights.contains_key(page.flight));
    let can_be_drawn = |drawing: &Drawing| drawing.flights.iter().all(|&flight| flights.contains_key(flight));
    let drawable: Vec<Drawing> = requested.into_iter().filter(can_be_drawn).collect();
    for drawing in &drawable {
        write(&folder.join(drawing.file), &drawing.svg(&flights))?;
    }
    Ok((drawable, pages))
}

/// Repeats a flight for its traces. Returns `None` if it was not completed, which the results report already.
fn trace(job: &Job, interrupt: &Interrupt) -> Option<Traces> {
    let schedule = flight::schedule_of(&job.scenario).ok()?;
    let mut tracer = Tracer::new(&job.scenario, &schedule);
    let ending = in_process::fly(&job.scenario, &mut tracer, interrupt).ok()?;
    matches!(ending.outcome, Outcome::Completed).then(|| tracer.finish())
}
