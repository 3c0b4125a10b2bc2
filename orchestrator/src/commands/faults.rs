//! `gerono faults`: flies the fault matrix and reports the outcome for the vehicle.

use scenario::{EdgeName, Scenario};
use shared_types::ServiceId;

use super::{Failure, load, print, print_resume_hint, scenario_name, write, write_json};
use crate::cli::Faults;
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress;
use fault_matrix::campaign::Matrix;
use fault_matrix::fault_kind::MatrixFault;
use fault_matrix::flight::{FlightResult, Way};
use fault_matrix::plan::{self, MatrixCase, MatrixCell, Times};
use fault_matrix::undisturbed::NotFlown;
use fault_matrix::{injection_times, report, table};
use flight::interrupt::Interrupt;
use flight::many;
use reproduce::flight::FLIGHTS;
use run_log::run_folder::RunFolder;

/// `gerono faults`.
///
/// # Errors
/// [`Failure`] if there are no results. A lost vehicle is a result; processes that differ from the in-process flight are an
/// [`Exit`].
pub fn faults(arguments: &Faults) -> Result<Exit, Failure> {
    let scenario = load(&arguments.scenario)?;
    if !scenario.fault.is_empty() {
        let reason = "the scenario plans faults itself, which would mix with those of the matrix; \
                      fly it without them: --set fault=[]";
        return Err(Failure::bad_input(reason));
    }
    if let Some(problem) = scenario.missing_arm_request() {
        return Err(Failure::bad_input(problem.to_string()));
    }
    let times = times(arguments, &scenario)?;
    let cells = plan::cells(&scenario, &cases(arguments, &scenario)?, &times)
        .map_err(|problem| Failure::bad_input(problem.to_string()))?;
    let interrupt = interrupt::install().map_err(Failure::trouble)?;
    let name = scenario_name(&arguments.scenario.scenario);
    let out = arguments.out.as_deref();
    let folder =
        RunFolder::resume(out, &format!("faults-{name}"), &[FLIGHTS]).map_err(Failure::not_written)?;
    let matrix = Matrix::new(&scenario, &cells);
    let bar = progress::flights(cells.len());
    let set_bar = |flights: usize| bar.set_position(flights as u64);
    let flown = matrix.fly(
        arguments.processes,
        many::cores(),
        folder.path(),
        &interrupt,
        set_bar,
    );
    bar.finish_and_clear();
    let flown = flown.map_err(|reason| match reason {
        NotFlown::Journal(error) => Failure::from(error),
        reason => Failure::new(Exit::FlightFailed, reason),
    })?;
    let differences = match &flown {
        Some(flown) if arguments.processes => compare(&matrix, &cells, flown, &interrupt),
        _ => Vec::new(),
    };
    if let Some(signal) = interrupt.signal() {
        print_resume_hint(folder.path());
        return Ok(Exit::Signal(signal));
    }
    let flown = flown.expect("a matrix that was not interrupted is whole");
    let mut report = report::report(&name, scenario.seed, times, &cells, &flown);
    report.compared_with_processes = arguments.processes;
    report.differences = differences;

    write_json(&folder.path().join("faults.json"), &report)?;
    write(&folder.path().join("faults.md"), &table::markdown(&report))?;
    print(format!("{report}results: {}\n", folder.path().display()));
    Ok(if report.differences.is_empty() {
        Exit::Success
    } else {
        Exit::FlightFailed
    })
}

/// Returns the times and durations of the faults.
fn times(arguments: &Faults, scenario: &Scenario) -> Result<Times, Failure> {
    let Faults { lasts, after, .. } = *arguments;
    let count = if arguments.quick { 1 } else { fault_matrix::MOMENTS };
    let mut moments = arguments.moments.clone();
    if moments.is_empty() {
        moments = injection_times::spread(scenario, count, lasts + after);
    }
    moments.sort_by(f64::total_cmp);
    moments.dedup();
    let on_ticks = [("--for", lasts), ("--after", after)].into_iter();
    for (name, time) in moments.iter().map(|&time| ("--moments", time)).chain(on_ticks) {
        check_time(scenario, name, time)?;
    }
    if let Some(late) = moments.iter().find(|&&moment| moment >= scenario.duration) {
        let end = scenario.duration;
        return Err(Failure::bad_input(format!(
            "--moments: {late} s is not before the end of the flight at {end} s; give earlier times, or --set duration=…"
        )));
    }
    Ok(Times {
        moments,
        lasts,
        after,
    })
}

fn check_time(scenario: &Scenario, name: &str, time: f64) -> Result<(), Failure> {
    if scenario.tick_of(time) == u64::MAX {
        let near = injection_times::on_tick(scenario, time);
        let tick = scenario.schedule.tick;
        return Err(Failure::bad_input(format!(
            "{name}: {time} s is not a whole number of base ticks of {tick} s; {near} is one"
        )));
    }
    Ok(())
}

/// Returns the requested faults and targets that the flight has. Naming only services excludes edges, and vice versa.
fn cases(arguments: &Faults, scenario: &Scenario) -> Result<Vec<MatrixCase>, Failure> {
    let faults: Vec<MatrixFault> = if arguments.faults.is_empty() {
        MatrixFault::ALL.to_vec()
    } else {
        let is_requested = |fault: &MatrixFault| arguments.faults.iter().any(|group| group.0.contains(fault));
        MatrixFault::ALL.into_iter().filter(is_requested).collect()
    };
    let is_narrowed = !arguments.services.is_empty() || !arguments.edges.is_empty();
    let services: Vec<ServiceId> = plan::services()
        .filter(|service| !is_narrowed || arguments.services.contains(service))
        .collect();
    let edges: Vec<EdgeName> = EdgeName::all()
        .filter(|edge| scenario.has_samples(*edge))
        .filter(|edge| !is_narrowed || arguments.edges.contains(edge))
        .collect();
    let cases = plan::cases(&services, &edges, &faults);
    if cases.is_empty() {
        let reason = "no case is left: services can be off or freeze, edges have all other faults, and the plant has none; \
                      omit --fault, --service or --edge";
        return Err(Failure::bad_input(reason));
    }
    Ok(cases)
}

/// Flies all cells as processes, one after the other, and returns those that differ from the flights in this process, as
/// sentences.
fn compare(
    matrix: &Matrix<'_>,
    cells: &[MatrixCell],
    expected: &[FlightResult],
    interrupt: &Interrupt,
) -> Vec<String> {
    let bar = progress::flights(cells.len());
    let mut differences = Vec::new();
    for (cell, expected) in cells.iter().zip(expected) {
        if interrupt.signal().is_some() {
            break;
        }
        let name = format!(
            "`{}` from {} s on",
            cell.watched.words.replace('`', ""),
            cell.moment
        );
        match matrix.fly_cell(cell, Way::Processes, interrupt) {
            Ok(flown) if flown == *expected => {}
            Ok(_) => differences.push(format!(
                "DIFFERENT: {name}: the processes published other bytes than the in-process flight"
            )),
            Err(reason) => {
                differences.push(format!(
                    "DIFFERENT: {name}: the flight with processes failed: {reason}"
                ));
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    differences
}
