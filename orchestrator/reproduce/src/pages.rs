//! Report pages of the figures: the first flight drawn in each, as `gerono report` shows it.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use host::in_process::TickSink;
use scenario::Scenario;
use shared_types::Topic;

use super::drawings::DRAWINGS;
use super::figures::Figure;
use super::traces::{Tracer, Traces};
use flight::failure::FlightFailure;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use flight::{Outcome, in_process};
use report::ReportError;
use run_log::{Compression, LogError, Manifest, RunLogWriter};

/// Reason why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The temporary log cannot be stored.
    #[error("cannot record into {}: {source}; choose a folder that you may write to with `--out`", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The page cannot be written.
    #[error(transparent)]
    ReproductionReport(#[from] ReportError),
}

/// The report page of a figure's flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlightPage {
    /// The figure.
    pub figure: Figure,
    /// Name of the flight.
    pub flight: &'static str,
}

impl FlightPage {
    /// Returns the page of a figure, if the figure has a drawing.
    #[must_use]
    pub fn for_figure(figure: Figure) -> Option<Self> {
        let drawing = DRAWINGS.iter().find(|drawing| drawing.figure == figure)?;
        let flight = drawing.flights.first()?;
        Some(Self { figure, flight })
    }

    /// Returns the path of the page relative to the gallery.
    #[must_use]
    pub fn link(&self) -> String {
        format!("{}/{}", self.folder(), report::PAGE)
    }

    fn folder(&self) -> String {
        format!("flight-{}", self.figure.name())
    }

    /// Flies `scenario`, records it, writes the page of the log into `gallery`'s folder and removes the log, which is much
    /// larger. Returns the traces of the flight; `None` if the flight was not completed.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn fly(
        &self,
        scenario: &Scenario,
        gallery: &Path,
        interrupt: &Interrupt,
    ) -> Result<Option<Traces>, PageError> {
        let folder = gallery.join(self.folder());
        let failed = |source| PageError::Folder {
            path: folder.clone(),
            source,
        };
        fs::create_dir_all(&folder).map_err(failed)?;
        let log = folder.join("run.mcap");
        let traces = record(scenario, &log, interrupt)?;
        if traces.is_some() {
            report::write_page(&log, &folder)?;
            fs::remove_file(&log).map_err(failed)?;
        } else {
            fs::remove_dir_all(&folder).map_err(failed)?;
        }
        Ok(traces)
    }
}

/// Flies a scenario into a log and traces. Returns `None` if the flight was not completed.
fn record(scenario: &Scenario, log: &Path, interrupt: &Interrupt) -> Result<Option<Traces>, LogError> {
    let Ok(schedule) = flight::schedule_of(scenario) else {
        return Ok(None);
    };
    let log = RunLogWriter::create_result(log, &Manifest::new(scenario), Compression::None)?;
    let mut sink = Both {
        sink: RecordingSink::new(scenario, &schedule, Some(log), Arc::default()),
        tracer: Tracer::new(scenario, &schedule),
    };
    let outcome = in_process::fly(scenario, &mut sink, interrupt).map(|ending| ending.outcome);
    let is_completed = match outcome {
        Ok(Outcome::Failed(FlightFailure::Log(error))) => return Err(error),
        outcome => matches!(outcome, Ok(Outcome::Completed)),
    };
    sink.sink.finish().1?;
    Ok(is_completed.then(|| sink.tracer.finish()))
}

/// Passes samples to the recording sink and the tracer.
struct Both<'a> {
    sink: RecordingSink<'a>,
    tracer: Tracer,
}

impl TickSink for Both<'_> {
    type Error = LogError;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        let Ok(()) = self.tracer.sample(topic, bytes);
        self.sink.sample(topic, bytes)
    }

    #[inline]
    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, LogError> {
        let Ok(_) = self.tracer.end_tick(tick);
        self.sink.end_tick(tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_has_a_page_of_one_of_its_own_flights() {
        let mut links: Vec<_> = Figure::ALL
            .into_iter()
            .map(|figure| {
                let page = FlightPage::for_figure(figure).unwrap();
                let specifications = figure.experiment().specifications;
                assert!(
                    specifications
                        .iter()
                        .any(|specification| specification.name == page.flight),
                    "{page:?}"
                );
                page.link()
            })
            .collect();
        links.dedup();
        assert_eq!(links.len(), Figure::ALL.len());
        assert_eq!(links[0], "flight-1/report.html");
    }
}
