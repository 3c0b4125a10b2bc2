//! What comes after a recorded flight: its log is closed, its summary made, kept and shown.

use miette::Report;

use super::{Failure, print, write_json};
use crate::cli::Host;
use crate::exit::Exit;
use crate::flight::tape::Tape;
use crate::flight::{Ending, FlightFailure, Outcome};
use crate::run_folder::RunFolder;
use crate::summary::{self, RunFacts, Summary};

/// A flight that is over.
pub(super) struct Flown<'a> {
    pub(super) name: &'a str,
    pub(super) host: Host,
    /// Where its results go.
    pub(super) folder: &'a RunFolder,
    /// Whether nothing is shown that went well.
    pub(super) quiet: bool,
}

impl Flown<'_> {
    /// Closes the log, keeps the summary and shows it; the exit code of the command that flew.
    pub(super) fn conclude(&self, tape: Tape<'_>, ending: Ending) -> Result<Exit, Failure> {
        let log_lost = matches!(&ending.outcome, Outcome::Failed(FlightFailure::Log(_)));
        let (flown, written) = if log_lost {
            (tape.abandon(), Ok(None))
        } else {
            tape.finish()
        };
        let ending = match written {
            Ok(_) => ending,
            Err(error) => Ending {
                outcome: Outcome::Failed(error.into()),
                ..ending
            },
        };
        let summary = flown.finish(self.facts(&ending));
        let saved = write_json(&self.folder.summary(), &summary);
        self.show(&summary, &ending);
        saved?;
        Ok(exit(&ending.outcome))
    }

    fn facts(&self, ending: &Ending) -> RunFacts {
        let (outcome, reason) = match &ending.outcome {
            Outcome::Completed => (summary::Outcome::Completed, String::new()),
            Outcome::Interrupted { signal } => (summary::Outcome::Interrupted, format!("signal {signal}")),
            Outcome::Failed(failure) => (summary::Outcome::Failed, failure.to_string()),
        };
        RunFacts {
            scenario: self.name.to_owned(),
            host: self.host.name().to_owned(),
            outcome,
            reason,
            wall_seconds: ending.wall_time.as_secs_f64(),
            rebirths: ending.rebirths.clone(),
            timing: ending.timing.clone(),
            laboratory: ending.laboratory.clone(),
        }
    }

    fn show(&self, summary: &Summary, ending: &Ending) {
        if !self.quiet {
            for warning in &ending.warnings {
                eprintln!("note: {warning}");
            }
            print(format!("{summary}\nresults: {}\n", self.folder.path().display()));
        }
        if let Outcome::Failed(failure) = &ending.outcome {
            eprintln!("{:?}", Report::msg(failure.to_string()));
        }
    }
}

fn exit(outcome: &Outcome) -> Exit {
    match outcome {
        Outcome::Completed => Exit::Success,
        Outcome::Interrupted { signal } => Exit::Signal(*signal),
        Outcome::Failed(FlightFailure::Log(_)) => Exit::NotWritten,
        Outcome::Failed(
            FlightFailure::Setup(_) | FlightFailure::NotReady { .. } | FlightFailure::NotPermitted { .. },
        ) => Exit::Trouble,
        Outcome::Failed(_) => Exit::FlightFailed,
    }
}
