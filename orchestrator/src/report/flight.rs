//! What is shown of a log, gathered in one pass over it.

use std::ops::ControlFlow;
use std::path::Path;

use runtime::in_process::TickSink;
use shared_types::samples::{PathReference, VehicleState, VehicleTruth};
use shared_types::scenario::Scenario;
use shared_types::{Schedule, Topic};

use super::latency::Histogram;
use super::marks::{Mark, Marks};
use super::run_facts::RunFacts;
use super::table::{PageTable, Table};
use super::track::{PageTrack, Place, Track};
use super::{ReportError, channels, figures, latency, run_facts};
use crate::log::{LogReadError, LogReader};
use crate::plot::label;
use crate::reproduce::traces::{Tracer, Traces};
use crate::summary::faults::TrueError;
use crate::summary::{FlightSummary, Outcome, Summary, read};

/// What is shown of a flight.
pub(super) struct Flight {
    /// What it is called in legends.
    pub(super) label: String,
    pub(super) scenario: Scenario,
    /// Why only a part of the log could be read, if so.
    pub(super) broken: Option<String>,
    pub(super) tables: Vec<(Topic, PageTable)>,
    pub(super) track: PageTrack,
    pub(super) marks: Vec<Mark>,
    pub(super) summary: Summary,
    pub(super) facts: Option<RunFacts>,
    pub(super) histograms: Vec<Histogram>,
    /// The paper's name for the flight, and what its figures are drawn of, if it is one of the paper's.
    pub(super) paper: Option<(String, Traces)>,
}

impl Flight {
    /// Reads a log; of each topic at most so many buckets are kept.
    pub(super) fn read(log: &Path, buckets: u64) -> Result<Self, ReportError> {
        let mut reader = LogReader::open(log)?;
        let scenario = reader.manifest().scenario.clone();
        let schedule = scenario.schedule().map_err(|problems| ReportError::Scenario {
            path: log.to_owned(),
            reason: format!("{problems:?}"),
        })?;
        let paper = figures::name_in_the_paper(&scenario);
        let tracer = paper.as_ref().and_then(|_| Tracer::new(&scenario).ok());
        let mut gatherer = Gatherer::new(&scenario, &schedule, tracer, buckets);
        let broken = gather(&mut reader, &mut gatherer)?;
        let Some(_) = gatherer.tick else {
            return Err(ReportError::Empty(log.to_owned()));
        };
        let facts = run_facts::beside(log);
        let is_timed = facts.as_ref().is_some_and(|facts| facts.timing.is_some());
        let (tables, track, marks, summary, traces) = gatherer.finish();
        let marks = marks.finish(&scenario, summary.simulated_seconds);
        Ok(Self {
            label: label(log),
            broken,
            tables,
            track,
            marks,
            summary,
            facts,
            histograms: if is_timed {
                latency::histograms(log, &schedule)
            } else {
                Vec::new()
            },
            paper: paper.zip(traces),
            scenario,
        })
    }
}

/// Reads to the end, or to where the log breaks off: then, why.
fn gather(reader: &mut LogReader, gatherer: &mut Gatherer) -> Result<Option<String>, LogReadError> {
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => gatherer.observe(sample.header.tick, sample.topic, sample.bytes),
            Ok(None) => return Ok(None),
            Err(error) if gatherer.tick.is_none() => return Err(error),
            Err(error) => return Ok(Some(error.to_string())),
        }
    }
}

/// Gathers while the log is read.
struct Gatherer {
    last_tick: u64,
    /// The tick that is being read.
    tick: Option<u64>,
    /// Whether the truth is known: not of a flight in a laboratory, whose way is the estimator's.
    knows_the_truth: bool,
    truth: Option<VehicleTruth>,
    state: Option<VehicleState>,
    reference: Option<PathReference>,
    true_error: TrueError,
    truths: Table,
    errors: Table,
    commands: Table,
    adaptations: Table,
    references: Table,
    track: Track,
    marks: Marks,
    summary: FlightSummary,
    tracer: Option<Tracer>,
}

type Gathered = (Vec<(Topic, PageTable)>, PageTrack, Marks, Summary, Option<Traces>);

impl Gatherer {
    fn new(scenario: &Scenario, schedule: &Schedule, tracer: Option<Tracer>, buckets: u64) -> Self {
        let table = |topic, names: &[&'static str]| Table::new(topic, names, schedule, buckets);
        Self {
            last_tick: schedule.last_tick(),
            tick: None,
            knows_the_truth: schedule.simulates_the_world(),
            truth: None,
            state: None,
            reference: None,
            true_error: TrueError::default(),
            truths: table(Topic::VehicleTruth, &channels::TRUTH),
            errors: table(Topic::ControlErrors, &channels::ERRORS),
            commands: table(Topic::ControlCommand, &channels::COMMAND),
            adaptations: table(Topic::ControlAdaptation, &channels::ADAPTATION),
            references: table(Topic::PathReference, &channels::REFERENCE),
            track: Track::new(schedule),
            marks: Marks::default(),
            summary: FlightSummary::new(scenario, schedule),
            tracer,
        }
    }

    /// Takes a sample into account; one of a tick that the flight cannot have is none of it.
    fn observe(&mut self, tick: u64, topic: Topic, bytes: &[u8]) {
        if tick > self.last_tick {
            return;
        }
        if let Some(before) = self.tick.replace(tick)
            && before != tick
        {
            self.end_tick(before);
        }
        match topic {
            Topic::VehicleTruth => self.truth = Some(read(bytes)),
            Topic::PathReference => {
                let reference = read(bytes);
                self.references.add(tick, &channels::reference(&reference));
                self.reference = Some(reference);
            }
            Topic::ControlErrors => self.errors.add(tick, &channels::errors(&read(bytes))),
            Topic::ControlCommand => self.commands.add(tick, &channels::command(&read(bytes))),
            Topic::ControlAdaptation => self.adaptations.add(tick, &channels::adaptation(&read(bytes))),
            Topic::VehicleState if !self.knows_the_truth => self.state = Some(read(bytes)),
            Topic::MocapPose | Topic::VehicleState | Topic::RcFrame | Topic::RunEvent => {}
        }
        self.true_error.observe(topic, bytes);
        self.marks.observe(topic, bytes);
        self.summary.observe(topic, bytes);
        if let Some(tracer) = &mut self.tracer {
            let Ok(()) = tracer.sample(topic, bytes);
        }
    }

    /// The truth comes first in a tick, and is compared with what comes after it.
    fn end_tick(&mut self, tick: u64) {
        if let Some(truth) = self.truth.take() {
            let error = self.true_error.last().map(|(_, error)| error);
            let yaw_desired = self.reference.as_ref().map(|reference| reference.yaw);
            let values = channels::truth(&truth, error, yaw_desired);
            self.truths.add(truth.header.tick, &values);
            self.track.add(&Place::from(&truth), self.true_error.point());
        }
        if let Some(state) = self.state.take().filter(|state| state.tracked.is_set()) {
            let point = self.true_error.point_at(state.state_time_ns);
            self.track.add(&Place::from(&state), point);
        }
        if let Some(tracer) = &mut self.tracer {
            let Ok(ControlFlow::Continue(()) | ControlFlow::Break(())) = tracer.end_tick(tick);
        }
    }

    fn finish(mut self) -> Gathered {
        if let Some(tick) = self.tick {
            self.end_tick(tick);
        }
        let tables = [
            (Topic::VehicleTruth, self.truths),
            (Topic::ControlErrors, self.errors),
            (Topic::ControlCommand, self.commands),
            (Topic::ControlAdaptation, self.adaptations),
            (Topic::PathReference, self.references),
        ];
        let is_known = |topic: &Topic| *topic != Topic::VehicleTruth || self.knows_the_truth;
        let tables = tables.into_iter().filter(|(topic, _)| is_known(topic));
        (
            tables.map(|(topic, table)| (topic, table.finish())).collect(),
            self.track.finish(),
            self.marks,
            self.summary.finish(unknown_run()),
            self.tracer.map(Tracer::finish),
        )
    }
}

/// A log alone does not tell of its run.
fn unknown_run() -> crate::summary::RunFacts {
    crate::summary::RunFacts {
        scenario: String::new(),
        host: String::new(),
        outcome: Outcome::Completed,
        reason: String::new(),
        wall_seconds: 0.0,
        rebirths: Vec::new(),
        timing: None,
        laboratory: None,
    }
}
