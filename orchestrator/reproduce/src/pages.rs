//! Report pages of the figures: the first flight drawn in each, as `gerono report` shows it.

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
    #[error("cannot record into {}: {source}", .path.display())]
    Log {
        /// The folder.
        path: PathBuf,
        /// The error of the log.
        source: LogError,
    },
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

    /// Flies `scenario`, records it and writes the page of the log into a folder of `gallery`. The log is much larger and gets
    /// no name. Returns the traces of the flight; `None` if the flight was not completed, which changes no file.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn fly(
        &self,
        scenario: &Scenario,
        gallery: &Path,
        interrupt: &Interrupt,
    ) -> Result<Option<Traces>, PageError> {
        let path = gallery.to_owned();
        let file = match result_file::scratch_file(gallery) {
            Ok(file) => file,
            Err(source) => return Err(PageError::Folder { path, source }),
        };
        let log = result_file::descriptor_path(&file);
        let traces = record(scenario, &log, interrupt).map_err(|source| PageError::Log { path, source })?;
        if traces.is_some() {
            report::write_page(&log, &gallery.join(self.folder()))?;
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
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::fs;

    use super::*;
    use crate::flight::ScenarioSource;

    #[test]
    fn only_the_page_is_written_and_an_interrupt_keeps_the_earlier_one() {
        let gallery = tempfile::tempdir().unwrap();
        let page = FlightPage::for_figure(Figure::Fig7).unwrap();
        let folder = gallery.path().join("flight-7");
        fs::create_dir(&folder).unwrap();
        for name in ["notes", "run.mcap", "summary.json"] {
            fs::write(folder.join(name), "mine").unwrap();
        }
        let settings = ["duration=0.5".to_owned(), "vehicle.change=[]".to_owned()];
        let scenario = |seed| ScenarioSource::FIG3_6.load(&settings, seed).unwrap();
        let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
        let fly = |seed, interrupt: &Interrupt| page.fly(&scenario(seed), gallery.path(), interrupt).unwrap();

        assert!(fly(1, &Interrupt::never()).is_some());
        let earlier = read("report.html");
        assert!(earlier.contains("flight-7"));

        let interrupt = Interrupt::never();
        interrupt.raise(2);
        assert!(fly(2, &interrupt).is_none());
        assert_eq!(read("report.html"), earlier);

        assert!(fly(2, &Interrupt::never()).is_some());
        assert_ne!(read("report.html"), earlier);
        for name in ["notes", "run.mcap", "summary.json"] {
            assert_eq!(read(name), "mine", "{name}");
        }
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 4);
        assert_eq!(fs::read_dir(gallery.path()).unwrap().count(), 1);
    }

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
