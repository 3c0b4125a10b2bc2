//! `gerono replay`: repeats the steps of a log and compares the results. `gerono diff`: compares two logs.

use super::{Failure, log_path, print, schedule_of};
use crate::cli::{Diff, Replay};
use command_line::exit::Exit;
use command_line::interrupt;
use command_line::progress::Progress;
use replay::diff::{self, TopicDiff};
use replay::in_words::{differences, report, set_again};
use replay::{self, Options, ProcessFailure, ReplayError};
use run_log::LogReader;

/// `gerono replay`.
///
/// # Errors
/// [`Failure`].
pub fn replay(arguments: &Replay) -> Result<Exit, Failure> {
    let log = log_path(&arguments.log);
    let reader = LogReader::open(&log).map_err(Failure::trouble)?;
    let recorded = &reader.manifest().scenario;
    let changed = if arguments.sets.is_empty() {
        None
    } else {
        let text = scenario_file::to_toml(recorded).map_err(Failure::trouble)?;
        let scenario = scenario_file::load_text(&log, &text, &arguments.sets, None);
        Some(scenario.map_err(Failure::from)?)
    };
    let schedule = schedule_of(recorded)?;
    let interrupt = || interrupt::install().map_err(Failure::trouble);
    let options = Options {
        services: arguments.services.clone(),
        changed,
        from: arguments.from,
        to: arguments.to,
        in_processes: arguments.processes.then(interrupt).transpose()?,
    };
    let mut progress = Progress::new(&schedule, "replay", arguments.quiet);
    let replayed = replay::replay(&log, &options, Some(&mut progress));
    progress.clear();
    let replayed = replayed.map_err(|error| match error {
        // The scenario of the log was flown.
        ReplayError::Scenario(_) if options.changed.is_some() => Failure::bad_input(error),
        error => failure(error),
    })?;
    print(report(&replayed, &options));
    print(set_again(&replayed.set_in_flight, &arguments.sets));
    Ok(if replayed.is_identical() || options.changed.is_some() {
        Exit::of_logs(replayed.log_ends.is_none())
    } else {
        Exit::Diverged
    })
}

/// `gerono diff`.
///
/// # Errors
/// [`Failure`].
pub fn diff(arguments: &Diff) -> Result<Exit, Failure> {
    let [first, second] = [&arguments.first, &arguments.second].map(|path| log_path(path));
    let topics = diff::diff(&first, &second).map_err(Failure::trouble)?;
    let compared: u64 = topics.iter().map(|topic| topic.comparison.compared).sum();
    if topics.iter().all(TopicDiff::is_identical) {
        print(format!("identical: {compared} samples\n"));
        return Ok(Exit::Success);
    }
    print(differences(&topics));
    Ok(Exit::Diverged)
}

fn failure(error: ReplayError) -> Failure {
    match error {
        ReplayError::NothingBetween { .. }
        | ReplayError::BeyondTheEnd { .. }
        | ReplayError::OtherSchedule => Failure::bad_input(error),
        ReplayError::Process(ProcessFailure::Interrupted { signal }) => {
            Failure::new(Exit::Signal(signal), error)
        }
        ReplayError::Process(_)
        | ReplayError::Plugin(_)
        | ReplayError::Read(_)
        | ReplayError::Machine(_)
        | ReplayError::Scenario(_)
        | ReplayError::Tuning(_) => Failure::trouble(error),
    }
}
