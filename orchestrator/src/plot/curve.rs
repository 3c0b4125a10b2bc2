//! ‖z1‖ over time of one flight, as its log has it.

use std::path::{Path, PathBuf};

use shared_types::samples::ControlErrors;
use shared_types::scenario::Scenario;
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};

use super::downsample::Extremes;
use super::{COLUMNS, FLOOR, PlotError};
use crate::log::LogReader;
use crate::summary::faults::TrueError;
use crate::summary::{read, z1_norm};

/// Which part of a flight is drawn, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// From when; from the start unless stated.
    pub from: Option<f64>,
    /// Until when; to the end unless stated.
    pub to: Option<f64>,
}

impl Span {
    /// Begin and end of what is drawn of a flight of this length, s.
    pub(super) fn within(self, duration: f64) -> [f64; 2] {
        let to = self.to.unwrap_or(duration).min(duration);
        [self.from.unwrap_or(0.0).min(to), to]
    }
}

/// ‖z1‖ over time of one flight.
pub(super) struct Curve {
    pub(super) label: String,
    pub(super) scenario: Scenario,
    pub(super) stretches: Vec<Stretch>,
}

/// A part of a curve that is drawn in one go.
pub(super) struct Stretch {
    pub(super) source: Source,
    pub(super) points: Vec<(f64, f64)>,
}

/// Where a distance is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The controller told it.
    Controller,
    /// The controller was out, or its law was not asked: the true distance from the newest reference.
    Truth,
}

impl Curve {
    /// Reads the curve from a log.
    ///
    /// # Errors
    /// [`PlotError`] if the log cannot be read or holds nothing to draw.
    pub(super) fn read(log: &Path, span: Span) -> Result<Self, PlotError> {
        let mut reader = LogReader::open(log)?;
        let scenario = reader.manifest().scenario.clone();
        let schedule = scenario.schedule().ok();
        let mut gaps = schedule
            .filter(|_| !scenario.fault.is_empty())
            .map(|schedule| Gaps::new(&schedule));
        let mut pen = Pen::new(span.within(scenario.duration));
        while let Some(logged) = reader.next_sample()? {
            let errors = (logged.topic == Topic::ControlErrors).then(|| read::<ControlErrors>(logged.bytes));
            if let Some((errors, z1_norm)) = errors.and_then(|errors| Some((errors, z1_norm(&errors)?))) {
                let is_first_after_gap = gaps.as_mut().is_some_and(|gaps| gaps.close(errors.header.tick));
                if is_first_after_gap {
                    pen.lift();
                }
                pen.draw(Source::Controller, seconds(errors.header.stamp_ns), z1_norm);
            } else if let Some((time, error)) = gaps
                .as_mut()
                .and_then(|gaps| gaps.observe(logged.topic, logged.bytes))
            {
                pen.draw(Source::Truth, time, error);
            }
        }
        let stretches = pen.finish();
        if stretches.is_empty() {
            return Err(PlotError::Empty(log.to_owned()));
        }
        Ok(Self {
            label: label(log),
            scenario,
            stretches,
        })
    }
}

/// Tells the error where the controller does not.
struct Gaps {
    truth: TrueError,
    tick_ns: u64,
    /// Ticks from one sample of the errors to the next.
    period: u64,
    /// Tick of the last sample of the errors.
    told: Option<u64>,
}

impl Gaps {
    fn new(schedule: &Schedule) -> Self {
        Self {
            truth: TrueError::default(),
            tick_ns: schedule.tick_ns(),
            period: schedule.topic_rate(Topic::ControlErrors).period,
            told: None,
        }
    }

    /// The controller tells of a tick; whether that is the first after a gap.
    fn close(&mut self, tick: u64) -> bool {
        let before = self.told.replace(tick);
        before.is_some_and(|before| tick > before + self.period)
    }

    /// Time (s) and true error (m) of a tick of which the controller should have told and did not.
    fn observe(&mut self, topic: Topic, bytes: &[u8]) -> Option<(f64, f64)> {
        let (tick, error) = self.truth.observe(topic, bytes)?;
        let is_missing = tick >= self.told? + self.period;
        is_missing.then(|| (seconds(tick * self.tick_ns), error))
    }
}

/// Draws stretch after stretch.
struct Pen {
    span: [f64; 2],
    current: Option<(Source, Extremes)>,
    stretches: Vec<Stretch>,
}

impl Pen {
    fn new(span: [f64; 2]) -> Self {
        Self {
            span,
            current: None,
            stretches: Vec::new(),
        }
    }

    fn draw(&mut self, source: Source, time: f64, error: f64) {
        let [from, to] = self.span;
        if !(from..=to).contains(&time) {
            return;
        }
        if self
            .current
            .as_ref()
            .is_none_or(|(current, _)| *current != source)
        {
            self.lift();
            self.current = Some((source, Extremes::new(to - from, COLUMNS)));
        }
        if let Some((_, extremes)) = &mut self.current {
            extremes.add(time, error.max(FLOOR));
        }
    }

    fn lift(&mut self) {
        let finished = self.current.take().map(|(source, extremes)| Stretch {
            source,
            points: extremes.finish(),
        });
        self.stretches.extend(finished);
    }

    fn finish(mut self) -> Vec<Stretch> {
        self.lift();
        self.stretches
    }
}

/// What a log is called in a legend: its folder, which tells runs apart, or its own name.
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
    logs.iter().map(|log| Curve::read(log, span)).collect()
}
