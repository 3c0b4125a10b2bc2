//! Conclusion of a recorded flight: closes the log, writes the summary and prints it.

use std::path::PathBuf;

use super::{Failure, note, print, write_json};
use crate::cli::Host;
use command_line::exit::Exit;
use command_line::output::print_error;
use command_line::progress::Progress;
use decisions::failure::ServiceFailure;
use flight::failure::FlightFailure;
use flight::recording_sink::RecordingSink;
use metrics::summary::{self, RunFacts, Summary};
use run_log::run_folder::{RunFolder, log_meant_by};
use run_log::{files_of_log, inspect};
use scenario_file::printable::report_of;
use supervisor::{Ending, Outcome, RunFailure};

/// A finished flight.
pub(super) struct FlightResult<'a> {
    pub(super) name: &'a str,
    pub(super) host: Host,
    /// Folder of the results.
    pub(super) folder: &'a RunFolder,
    /// Files that were copied into the folder before the flight.
    pub(super) kept: Vec<PathBuf>,
    /// `true` to print errors only.
    pub(super) quiet: bool,
}

impl FlightResult<'_> {
    /// Closes the log, writes the summary and prints it. Returns the exit code of the command.
    pub(super) fn conclude(
        &self,
        sink: RecordingSink<'_>,
        progress: &mut Progress,
        ending: Ending,
    ) -> Result<Exit, Failure> {
        let log_lost = matches!(
            &ending.outcome,
            Outcome::Failed(RunFailure::Flight(FlightFailure::Log(_)))
        );
        let (flown, written) = if log_lost {
            (sink.abandon(), Ok(None))
        } else {
            sink.finish()
        };
        progress.clear();
        let ending = match written {
            Ok(_) => ending,
            Err(error) => Ending {
                outcome: Outcome::Failed(error.into()),
                ..ending
            },
        };
        let summary = flown.finish(self.facts(&ending));
        if has_flown_nothing(&ending.outcome, &summary) {
            self.folder.remove_logs();
            let gave_up = matches!(&ending.outcome, Outcome::Failed(failure) if failure.is_given_up());
            if was_refused(&ending.outcome) || gave_up {
                // No results: the folder is left unchanged for the next attempt.
                self.folder.remove_files(&self.kept);
                self.folder.remove_if_empty();
                self.show(&summary, &ending);
                return Ok(exit(&ending.outcome, &summary));
            }
        }
        let saved = write_json(&self.folder.summary(), &summary);
        self.show(&summary, &ending);
        saved?;
        Ok(exit(&ending.outcome, &summary))
    }

    fn facts(&self, ending: &Ending) -> RunFacts {
        RunFacts {
            scenario: self.name.to_owned(),
            host: self.host.name().to_owned(),
            in_log: match &ending.outcome {
                Outcome::Failed(RunFailure::Flight(FlightFailure::Log(_))) => Some(self.samples_in_log()),
                _ => None,
            },
            wall_seconds: ending.wall_time.as_secs_f64(),
            restarts: ending.restarts.clone(),
            timing: ending.timing.clone(),
            laboratory: ending.laboratory.clone(),
            ..ending.outcome.facts(RunFailure::not_finite_at)
        }
    }

    /// Returns the number of samples in a log whose writing failed; it lacks some of the received ones.
    fn samples_in_log(&self) -> u64 {
        let files = files_of_log(&log_meant_by(self.folder.path()));
        let found = files.iter().filter_map(|file| inspect(file).ok());
        found.map(|found| found.kept()).sum()
    }

    fn show(&self, summary: &Summary, ending: &Ending) {
        if !self.quiet {
            for warning in &ending.warnings {
                note(warning);
            }
            if !has_flown_nothing(&ending.outcome, summary) {
                print(format!("{summary}\nresults: {}\n", self.folder.path().display()));
            }
        }
        if let Outcome::Failed(failure) = &ending.outcome {
            print_error(format_args!("{:?}", report_of(failure)));
            if let Some(lateness) = summary.lateness() {
                note(&lateness);
            }
        }
    }
}

/// Returns whether the run failed before its first sample, so that there are no results.
fn has_flown_nothing(outcome: &Outcome, summary: &Summary) -> bool {
    let has_failed = matches!(outcome, Outcome::Failed(_));
    has_failed && summary.topics.iter().all(|topic| topic.recorded == 0)
}

/// Returns whether the machine refused the run.
fn was_refused(outcome: &Outcome) -> bool {
    matches!(
        outcome,
        Outcome::Failed(
            RunFailure::Flight(FlightFailure::Setup(_))
                | RunFailure::Service(ServiceFailure::NotReady { .. })
                | RunFailure::NotPermitted { .. }
        )
    )
}

/// Returns the exit code: failures of the machine or the log take precedence over failures of the flight, and those over the loss
/// of the vehicle or a kill.
fn exit(outcome: &Outcome, summary: &Summary) -> Exit {
    match outcome {
        Outcome::Completed => match summary.run.outcome {
            summary::Outcome::Lost | summary::Outcome::Killed => Exit::Lost,
            _ => Exit::Success,
        },
        Outcome::Interrupted { signal } => Exit::Signal(*signal),
        Outcome::Failed(RunFailure::Flight(FlightFailure::Log(_)) | RunFailure::Record(_)) => {
            Exit::NotWritten
        }
        Outcome::Failed(RunFailure::Flight(FlightFailure::Refused(_))) => Exit::BadInput,
        outcome if was_refused(outcome) => Exit::Trouble,
        Outcome::Failed(_) => Exit::FlightFailed,
    }
}
