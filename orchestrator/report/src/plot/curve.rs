//! The distance from the path over time of one flight, read from its log.

use std::path::{Path, PathBuf};

use scenario::Scenario;
use shared_types::service::seconds;

use super::downsample::Extremes;
use super::{COLUMNS, FLOOR, PlotError};
use crate::run_facts;
use metrics::summary::{self, FlightSummary};
use metrics::tracker::{Moment, StateSource, Tracker};
use run_log::LogReader;

/// The part of a flight that is drawn, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// Start; that of the flight if `None`.
    pub from: Option<f64>,
    /// End; that of the flight if `None`.
    pub to: Option<f64>,
}

impl Span {
    /// Checks that the span is within flights that end at this time, s.
    fn check(self, ends: f64) -> Result<(), PlotError> {
        let mut bounds = [("--from", self.from), ("--to", self.to)].into_iter();
        let beyond =
            bounds.find_map(|(option, stated)| Some((option, stated.filter(|&stated| stated > ends)?)));
        match beyond {
            Some((option, stated)) => Err(PlotError::BeyondTheEnd { option, stated, ends }),
            None => Ok(()),
        }
    }

    /// Returns the start and end of the span within a flight of this duration, s.
    pub(super) fn within(self, duration: f64) -> [f64; 2] {
        let to = self.to.unwrap_or(duration).min(duration);
        [self.from.unwrap_or(0.0).min(to), to]
    }
}

/// The distance from the path over time of one flight.
pub(super) struct Curve {
    pub(super) label: String,
    pub(super) scenario: Scenario,
    pub(super) source: StateSource,
    /// Connected parts; between them there was no path to follow.
    pub(super) stretches: Vec<Vec<(f64, f64)>>,
    /// How the flight went other than as planned; empty if it did not.
    pub(super) misfortunes: String,
}

impl Curve {
    /// Reads the curve from a log.
    ///
    /// # Errors
    /// [`PlotError`] if the log cannot be read or holds nothing to draw.
    pub(super) fn read(log: &Path, span: Span) -> Result<Self, PlotError> {
        let mut reader = LogReader::open(log)?;
        let scenario = reader.manifest().scenario.clone();
        let schedule = flight::schedule_of(&scenario).map_err(|source| PlotError::Scenario {
            path: log.to_owned(),
            source,
        })?;
        let mut tracker = Tracker::new(&schedule, scenario.flight.is_some());
        let mut summary = FlightSummary::new(&scenario, &schedule);
        let mut pen = Pen::new(span.within(scenario.duration));
        while let Some(logged) = reader.next_sample()? {
            summary.observe(logged.topic, logged.bytes);
            if let Some(moment) = tracker.observe(logged.topic, logged.bytes) {
                pen.draw(&moment);
            }
        }
        tracker.last().iter().for_each(|moment| pen.draw(moment));
        let summary = summary.finish(summary::RunFacts::default());
        let misfortunes = run_facts::misfortunes(run_facts::beside(log).as_ref(), &summary);
        let stretches = pen.finish();
        if stretches.is_empty() {
            return Err(PlotError::Empty {
                log: log.to_owned(),
                why: if misfortunes.is_empty() {
                    "choose another span with --from and --to".to_owned()
                } else {
                    misfortunes
                },
            });
        }
        Ok(Self {
            label: label(log),
            scenario,
            source: tracker.source(),
            stretches,
            misfortunes,
        })
    }
}

/// Collects the stretches of a curve.
struct Pen {
    span: [f64; 2],
    current: Option<Extremes>,
    stretches: Vec<Vec<(f64, f64)>>,
}

impl Pen {
    fn new(span: [f64; 2]) -> Self {
        Self {
            span,
            current: None,
            stretches: Vec::new(),
        }
    }

    fn draw(&mut self, moment: &Moment) {
        let [from, to] = self.span;
        let time = seconds(moment.vehicle.time_ns);
        match moment.distance.filter(|_| (from..=to).contains(&time)) {
            Some(distance) => self
                .current
                .get_or_insert_with(|| Extremes::new(to - from, COLUMNS))
                .add(time, distance.max(FLOOR)),
            None => self.lift(),
        }
    }

    fn lift(&mut self) {
        self.stretches.extend(self.current.take().map(Extremes::finish));
    }

    fn finish(mut self) -> Vec<Vec<(f64, f64)>> {
        self.lift();
        self.stretches
    }
}

/// Returns a log's name in a legend: its folder, which differs between runs, or its file stem.
pub(crate) fn label(log: &Path) -> String {
    let folder = log.parent().and_then(Path::file_name);
    let name = if log.file_name().is_some_and(|name| name == "run.mcap") {
        folder
    } else {
        None
    };
    name.or(log.file_stem())
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Reads the curves of several logs.
pub(super) fn read_all(logs: &[PathBuf], span: Span) -> Result<Vec<Curve>, PlotError> {
    let mut ends: f64 = 0.0;
    for log in logs {
        ends = ends.max(LogReader::open(log)?.manifest().scenario.duration);
    }
    span.check(ends)?;
    logs.iter().map(|log| Curve::read(log, span)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_beyond_the_end_of_the_flight_is_refused() {
        let check = |from, to| Span { from, to }.check(60.0);
        assert!(check(None, None).is_ok() && check(Some(0.0), Some(60.0)).is_ok());
        let refused = [check(Some(61.0), None), check(None, Some(60.5))]
            .map(|refused| refused.unwrap_err().to_string());
        assert!(refused[0].contains("--from 61 s is beyond"), "{}", refused[0]);
        assert!(refused[1].contains("--to 60.5 s is beyond"), "{}", refused[1]);
    }
}
