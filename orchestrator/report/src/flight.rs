//! The page's data of a log, gathered in one pass over it.

use std::path::Path;

use scenario::Scenario;
use shared_types::samples::{ControlAdaptation, ControlTelemetry, VehicleTruth};
use shared_types::{Schedule, Topic};

use super::figures::Figures;
use super::latency::Histogram;
use super::marks::{Mark, Marks};
use super::run_facts::RunFacts;
use super::table::{PageTable, Table};
use super::track::{PageTrack, Track};
use super::{ReportError, channels, latency, run_facts};
use crate::plot::label;
use metrics::read;
use metrics::summary::{self, FlightSummary, Summary};
use metrics::tracker::{Moment, StateSource, Tracker};
use run_log::{LogReadError, LogReader};

/// The page's data of a flight.
pub(super) struct Flight {
    /// Name in legends.
    pub(super) label: String,
    pub(super) scenario: Scenario,
    /// Reason why only a part of the log could be read, if so.
    pub(super) broken: Option<String>,
    pub(super) tables: Vec<(Topic, PageTable)>,
    pub(super) track: PageTrack,
    pub(super) marks: Vec<Mark>,
    pub(super) summary: Summary,
    pub(super) facts: Option<RunFacts>,
    pub(super) histograms: Vec<Histogram>,
}

impl Flight {
    /// Reads a log, keeping at most `buckets` buckets of each topic. Passes the samples to `figures` as well.
    pub(super) fn read(log: &Path, buckets: u64, figures: &mut dyn Figures) -> Result<Self, ReportError> {
        let mut reader = LogReader::open(log)?;
        let scenario = reader.manifest().scenario.clone();
        let schedule = flight::schedule_of(&scenario).map_err(|source| ReportError::Scenario {
            path: log.to_owned(),
            source,
        })?;
        figures.begin(&scenario, &schedule);
        let mut gatherer = Gatherer::new(&scenario, &schedule, figures, buckets);
        let broken = gather(&mut reader, &mut gatherer)?;
        let Some(_) = gatherer.tick else {
            return Err(ReportError::Empty(log.to_owned()));
        };
        let facts = run_facts::beside(log);
        let is_timed = facts.as_ref().is_some_and(|facts| facts.timing.is_some());
        let (tables, track, marks, summary) = gatherer.finish();
        let marks = marks.finish(&scenario, summary.simulated_seconds);
        let (histograms, unread) = if is_timed {
            latency::histograms(log, &scenario, &schedule)
        } else {
            (Vec::new(), None)
        };
        Ok(Self {
            label: label(log),
            broken: broken.or(unread.map(|error| error.to_string())),
            tables,
            track,
            marks,
            summary,
            facts,
            histograms,
            scenario,
        })
    }
}

impl Flight {
    /// Returns how the flight went other than as planned, after its name.
    pub(super) fn misfortunes(&self) -> Option<String> {
        let told = run_facts::misfortunes(self.facts.as_ref(), &self.summary);
        (!told.is_empty()).then(|| format!("{}: {told}", self.label))
    }
}

/// Reads to the end of the log. Returns the error if the log breaks off after its first sample.
fn gather(reader: &mut LogReader, gatherer: &mut Gatherer<'_>) -> Result<Option<String>, LogReadError> {
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => gatherer.observe(sample.header.tick, sample.topic, sample.bytes),
            Ok(None) => return Ok(None),
            Err(error) if gatherer.tick.is_none() => return Err(error),
            Err(error) => return Ok(Some(error.to_string())),
        }
    }
}

/// Collects the page's data while the log is read.
struct Gatherer<'a> {
    last_tick: u64,
    /// Tick of the last sample read.
    tick: Option<u64>,
    tracker: Tracker,
    /// Truth of the incomplete current moment; `None` for a laboratory flight, whose track is the estimator's.
    truth: Option<VehicleTruth>,
    /// `true` if there is a reference to follow, as far as known.
    has_reference: bool,
    /// `true` if the command comes from the control law, not from a failsafe stage.
    is_law_active: bool,
    has_observer: bool,
    truths: Table,
    states: Table,
    errors: Table,
    commands: Table,
    adaptations: Table,
    references: Table,
    telemetry: Table,
    innovations: Table,
    poses: Table,
    baselines: Table,
    track: Track,
    marks: Marks,
    summary: FlightSummary,
    figures: &'a mut dyn Figures,
}

type Gathered = (Vec<(Topic, PageTable)>, PageTrack, Marks, Summary);

impl<'a> Gatherer<'a> {
    fn new(scenario: &Scenario, schedule: &Schedule, figures: &'a mut dyn Figures, buckets: u64) -> Self {
        let table = |topic, names: &[&'static str]| Table::new(topic, names, schedule, buckets);
        Self {
            last_tick: schedule.last_tick(),
            tick: None,
            tracker: Tracker::new(schedule, scenario.flight.is_some()),
            truth: None,
            has_reference: true,
            is_law_active: true,
            has_observer: scenario.controller.observer_gain.is_some(),
            truths: table(Topic::VehicleTruth, &channels::TRUTH),
            states: table(Topic::VehicleState, &channels::STATE),
            errors: table(Topic::ControlErrors, &channels::ERRORS),
            commands: table(Topic::ControlCommand, &channels::COMMAND),
            adaptations: table(Topic::ControlAdaptation, &channels::ADAPTATION),
            references: table(Topic::PathReference, &channels::REFERENCE),
            telemetry: Table::new(
                Topic::ControlTelemetry,
                &scenario.controller.telemetry,
                schedule,
                buckets,
            ),
            innovations: table(
                Topic::NavigationInnovations,
                match scenario.navigation {
                    Some(_) => &channels::INNOVATIONS,
                    None => &[],
                },
            ),
            poses: table(
                Topic::PoseInnovations,
                match scenario.fuses_poses() {
                    Some(true) => &channels::POSES,
                    _ => &[],
                },
            ),
            baselines: table(
                Topic::BaselineInnovations,
                match scenario.baseline() {
                    Some(_) => &channels::BASELINES,
                    None => &[],
                },
            ),
            track: Track::new(schedule),
            marks: Marks::default(),
            summary: FlightSummary::new(scenario, schedule),
            figures,
        }
    }

    /// Records a sample; ignores ticks beyond the schedule.
    fn observe(&mut self, tick: u64, topic: Topic, bytes: &[u8]) {
        if tick > self.last_tick {
            return;
        }
        self.tick = Some(tick);
        if let Some(moment) = self.tracker.observe(topic, bytes) {
            self.record(&moment);
        }
        match topic {
            Topic::VehicleTruth => self.truth = Some(read(bytes)),
            Topic::PathReference => self.references.add(tick, &channels::reference(&read(bytes))),
            Topic::ControlErrors => {
                let is_law_active = self.has_reference && self.is_law_active;
                self.errors
                    .add(tick, &channels::errors(&read(bytes), is_law_active));
            }
            Topic::ControlCommand => self.commands.add(tick, &channels::command(&read(bytes))),
            Topic::ControlAdaptation => {
                let adaptation: ControlAdaptation = read(bytes);
                self.is_law_active = adaptation.stage == ControlAdaptation::STAGE_LAW;
                let values = channels::adaptation(&adaptation, self.has_observer);
                self.adaptations.add(tick, &values);
            }
            Topic::ControlTelemetry => {
                let telemetry: ControlTelemetry = read(bytes);
                self.telemetry.add(tick, &telemetry.values);
            }
            Topic::MocapPose
            | Topic::VehicleState
            | Topic::RcFrame
            | Topic::RunEvent
            | Topic::ImuSample
            | Topic::GnssFix
            | Topic::BaroAltitude
            | Topic::MagField
            | Topic::GnssBaseline => {}
            Topic::NavigationInnovations => {
                self.innovations.add(tick, &channels::innovations(&read(bytes)));
            }
            Topic::PoseInnovations => self.poses.add(tick, &channels::poses(&read(bytes))),
            Topic::BaselineInnovations => self.baselines.add(tick, &channels::baselines(&read(bytes))),
        }
        self.marks.observe(topic, bytes);
        self.summary.observe(topic, bytes);
        self.figures.sample(topic, bytes);
    }

    fn record(&mut self, moment: &Moment) {
        let tick = moment.vehicle.tick;
        self.has_reference = moment.path.is_none() || moment.distance.is_some();
        if let Some(truth) = &self.truth {
            let yaw_desired = moment.path.map(|path| path.yaw);
            let values = channels::truth(truth, moment.distance, yaw_desired);
            self.truths.add(tick, &values);
        } else {
            self.states.add(tick, &channels::state(moment.distance));
        }
        self.track.add(moment);
    }

    fn finish(mut self) -> Gathered {
        if let Some(moment) = self.tracker.last() {
            self.record(&moment);
        }
        let tables = [
            (Topic::VehicleTruth, self.truths),
            (Topic::VehicleState, self.states),
            (Topic::ControlErrors, self.errors),
            (Topic::ControlCommand, self.commands),
            (Topic::ControlAdaptation, self.adaptations),
            (Topic::PathReference, self.references),
            (Topic::ControlTelemetry, self.telemetry),
            (Topic::NavigationInnovations, self.innovations),
            (Topic::PoseInnovations, self.poses),
            (Topic::BaselineInnovations, self.baselines),
        ];
        // A laboratory flight has no truth; for all others the truth replaces the estimate.
        let omitted = match self.tracker.source() {
            StateSource::Truth => Topic::VehicleState,
            StateSource::Estimate => Topic::VehicleTruth,
        };
        let tables = tables.into_iter().filter(|(topic, _)| *topic != omitted);
        (
            tables.map(|(topic, table)| (topic, table.finish())).collect(),
            self.track.finish(),
            self.marks,
            self.summary.finish(summary::RunFacts::default()),
        )
    }
}
