//! What a flight came to: the numbers of the paper, computed while it flies.
//!
//! [`FlightSummary`] sees every sample once, in the order of the log, and keeps a fixed amount of memory however
//! long the flight is. [`Summary`] is what comes of it: `summary.json` for programs, a table for people.

pub mod faults;
mod flight;
pub mod laboratory;
mod phase;
mod table;
pub mod timing;

use serde::Serialize;
use shared_types::samples::{ControlAdaptation, ControlErrors, PathReference, VehicleTruth};
use shared_types::scenario::{Controller, Scenario, Vector};
use shared_types::service::{header_of, seconds};
use shared_types::{Header, Sample, Schedule, Topic};

use crate::flight::crew::Rebirth;
use faults::{FaultReport, FaultWatch, PlannedFault};
pub use flight::FlightPhaseBegin;
use flight::FlightWatch;
use laboratory::LaboratoryReport;
use phase::PhaseRecord;
use timing::TimingReport;

/// How much of the end of a phase counts as its ultimate behaviour, s: what the paper's figures show.
pub const ULTIMATE_WINDOW: f64 = 5.0;

/// ‖z1‖ below which the vehicle counts as settled on the path, m: the theorem's bound for the paper's gains and a fifth.
pub const SETTLED: f64 = 0.02;

/// How far above the theorem's bound still counts as near it.
///
/// The theorem speaks of a controller in continuous time and of the limit t → ∞; a 1 kHz hold and half a minute
/// leave some percent.
pub const NEAR_THE_BOUND: f64 = 1.1;

/// How a phase ended, compared with what the theorem promises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// ‖z1‖ was within the bound.
    Within,
    /// ‖z1‖ was above the bound, but not by more than [`NEAR_THE_BOUND`].
    Near,
    /// ‖z1‖ was above that.
    Exceeded,
}

impl Verdict {
    /// The verdict on an ultimate ‖z1‖ (m) under a bound (m).
    #[must_use]
    pub fn of(ultimate: f64, bound: f64) -> Self {
        if ultimate <= bound {
            Self::Within
        } else if ultimate <= NEAR_THE_BOUND * bound {
            Self::Near
        } else {
            Self::Exceeded
        }
    }
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The last tick was flown.
    Completed,
    /// Somebody asked for the end.
    Interrupted,
    /// It could not go on.
    Failed,
}

/// What only the caller knows of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunFacts {
    /// Name of the scenario.
    pub scenario: String,
    /// Which host flew it.
    pub host: String,
    /// How it ended.
    pub outcome: Outcome,
    /// Why it ended, in words; empty when it was completed.
    pub reason: String,
    /// Wall time from the first tick to the last, s.
    pub wall_seconds: f64,
    /// Deaths of services in flight that were mended; nothing of them is in the log.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rebirths: Vec<Rebirth>,
    /// How well the flight kept time, if it was flown in real time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingReport>,
    /// How cameras and radio link fared, if it was flown in a laboratory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub laboratory: Option<LaboratoryReport>,
}

/// What a flight came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// What only the caller knew.
    #[serde(flatten)]
    pub run: RunFacts,
    /// Seed of the flight.
    pub seed: u64,
    /// Time of the last recorded tick, s.
    pub simulated_seconds: f64,
    /// Simulated seconds per wall second.
    pub real_time_factor: f64,
    /// atanh(δ/(k1 σmax)): what the theorem bounds ‖z1‖ by ultimately, m.
    pub ultimate_bound: f64,
    /// The phases between the changes of the vehicle, as far as they were flown.
    pub phases: Vec<Phase>,
    /// The phases from disarmed to disarmed, in their order; none in a flight that is in the air from the start.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flight: Vec<FlightPhaseBegin>,
    /// The planned faults, as far as they were flown.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultReport>,
    /// What was recorded of each topic.
    pub topics: Vec<TopicCount>,
}

/// A phase of a flight: from one change of the vehicle, or the start, to the next, or the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Phase {
    /// When it begins, s.
    pub begins: f64,
    /// When it ends, or for a phase that was not flown to its end when it was left, s.
    pub ends: f64,
    /// Whether it was flown to its end.
    pub is_complete: bool,
    /// Largest ‖z1‖, m: after a change, the transient's peak.
    pub peak: f64,
    /// Largest ‖z1‖ in the last [`ULTIMATE_WINDOW`] of the phase, m; of all of it, if it is shorter. Only of a
    /// complete phase, and only if the law was asked there: not of a vehicle that stands on the ground by then.
    pub ultimate: Option<f64>,
    /// `ultimate` against the bound.
    pub verdict: Option<Verdict>,
    /// Time after which ‖z1‖ stayed below [`SETTLED`], s from the begin of the phase; none if it did not.
    pub settling_time: Option<f64>,
    /// The parameters at the phase's end and what the controller took them for.
    pub parameters: Parameters,
    /// γ at the phase's end.
    pub gamma: Option<f64>,
}

/// Unknown parameters of the vehicle and their estimates; none where no sample came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Parameters {
    /// m, kg.
    pub mass: Option<f64>,
    /// m̂ = 1/π(η̂), kg.
    pub mass_estimate: Option<f64>,
    /// b in {I}, m/s².
    pub disturbance: Option<Vector>,
    /// π(b̂) in {I}, m/s².
    pub disturbance_estimate: Option<Vector>,
}

/// How many samples of a topic were recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TopicCount {
    /// Name of the topic.
    pub topic: &'static str,
    /// Samples recorded.
    pub recorded: u64,
    /// Samples that the schedule had due up to the last recorded tick and that were not recorded.
    pub lost: u64,
}

/// Gathers a [`Summary`] while a flight goes on, in constant memory.
#[derive(Clone, Debug)]
pub struct FlightSummary {
    seed: u64,
    bound: f64,
    schedule: Schedule,
    phases: Vec<PhaseRecord>,
    /// Only where faults are planned: who plans none does not pay for them.
    faults: Option<Box<FaultWatch>>,
    /// Only of a flight with phases.
    flight: Option<FlightWatch>,
    current: usize,
    counts: [SequenceCount; Topic::ALL.len()],
    first_tick: u64,
    last_tick: Option<u64>,
}

/// Counts the samples of a topic by the sequence numbers in their headers.
#[derive(Clone, Copy, Debug, Default)]
struct SequenceCount {
    recorded: u64,
    next_seq: u64,
    gaps: u64,
}

impl FlightSummary {
    /// For a flight of `scenario`, whose schedule is `schedule`.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        let faults = PlannedFault::all(scenario);
        Self {
            seed: scenario.seed,
            bound: Controller::ultimate_bound(&scenario.controller),
            phases: phase::phases(scenario, schedule),
            faults: (!faults.is_empty()).then(|| Box::new(FaultWatch::new(faults, schedule))),
            flight: scenario.flight.as_ref().map(|_| FlightWatch::default()),
            current: 0,
            counts: [SequenceCount::default(); Topic::ALL.len()],
            first_tick: 0,
            last_tick: None,
            schedule: schedule.clone(),
        }
    }

    /// Expects nothing before a tick: the flight was taken over there.
    pub fn begin_at(&mut self, tick: u64) {
        self.first_tick = tick;
        for topic in Topic::ALL.into_iter().filter(|topic| topic.publisher().is_some()) {
            self.counts[topic.index()].next_seq = self.schedule.publications(topic).count_before(tick);
        }
    }

    /// Takes a recorded sample into account; they come in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let header = header_of(bytes);
        self.counts[topic.index()].count(&header);
        self.last_tick = self.last_tick.max(Some(header.tick));
        if let Some(faults) = &mut self.faults {
            faults.observe(topic, bytes);
        }
        match topic {
            Topic::VehicleTruth => {
                let truth = read::<VehicleTruth>(bytes);
                let parameters = &mut self.phase_at(header.tick).parameters;
                parameters.mass = Some(truth.mass);
                parameters.disturbance = Some(truth.disturbance_world);
            }
            Topic::ControlAdaptation => {
                let adaptation = read::<ControlAdaptation>(bytes);
                let parameters = &mut self.phase_at(header.tick).parameters;
                parameters.mass_estimate = Some(adaptation.mass_estimate);
                parameters.disturbance_estimate = Some(adaptation.disturbance_projected_world);
            }
            Topic::PathReference => {
                let reference = read::<PathReference>(bytes);
                self.phase_at(header.tick).gamma = Some(reference.gamma);
                if let Some(flight) = &mut self.flight {
                    flight.observe(&reference);
                }
            }
            Topic::ControlErrors => {
                let z1_norm = z1_norm(&read::<ControlErrors>(bytes));
                self.phase_at(header.tick).observe_error(header.tick, z1_norm);
            }
            Topic::MocapPose
            | Topic::VehicleState
            | Topic::ControlCommand
            | Topic::RcFrame
            | Topic::RunEvent => {}
        }
    }

    /// The summary of all that was observed.
    #[must_use]
    pub fn finish(self, run: RunFacts) -> Summary {
        let simulated_ticks = self
            .last_tick
            .map_or(0, |tick| tick.saturating_sub(self.first_tick));
        let simulated_seconds = seconds(self.schedule.time_ns(simulated_ticks));
        let flown = self.phases.iter().filter(|phase| phase.last_tick.is_some());
        Summary {
            seed: self.seed,
            simulated_seconds,
            real_time_factor: if run.wall_seconds > 0.0 {
                simulated_seconds / run.wall_seconds
            } else {
                0.0
            },
            ultimate_bound: self.bound,
            phases: flown
                .map(|phase| phase.finish(&self.schedule, self.bound))
                .collect(),
            flight: self.flight.as_ref().map(FlightWatch::finish).unwrap_or_default(),
            faults: self
                .faults
                .as_ref()
                .map(|faults| faults.finish(&self.schedule))
                .unwrap_or_default(),
            topics: Topic::ALL.map(|topic| self.topic_count(topic)).into(),
            run,
        }
    }

    /// The phase of a tick, entering it if it has not been.
    #[inline]
    fn phase_at(&mut self, tick: u64) -> &mut PhaseRecord {
        while tick >= self.phases[self.current].end_tick && self.current + 1 < self.phases.len() {
            self.current += 1;
        }
        &mut self.phases[self.current]
    }

    /// What was recorded of a topic; of the orchestrator's own topics only gaps can be told.
    fn topic_count(&self, topic: Topic) -> TopicCount {
        let SequenceCount {
            recorded,
            next_seq,
            gaps,
        } = self.counts[topic.index()];
        let due = match (topic.publisher(), self.last_tick) {
            (Some(_), Some(tick)) => self.schedule.publications(topic).count_before(tick + 1),
            _ => 0,
        };
        TopicCount {
            topic: topic.name(),
            recorded,
            lost: gaps + due.saturating_sub(next_seq),
        }
    }
}

impl SequenceCount {
    #[inline]
    fn count(&mut self, header: &Header) {
        self.recorded += 1;
        self.gaps += header.seq.saturating_sub(self.next_seq);
        self.next_seq = self.next_seq.max(header.seq + 1);
    }
}

/// ‖z1‖, the distance of the vehicle from its point on the path, m; `None` where the law was not asked: its ζ is
/// never zero, being what holds the vehicle against gravity.
#[must_use]
#[inline]
pub fn z1_norm(errors: &ControlErrors) -> Option<f64> {
    let [x, y, z] = errors.z1;
    let was_asked = (errors.z1, errors.zeta) != ([0.0; 3], [0.0; 3]);
    was_asked.then(|| (x * x + y * y + z * z).sqrt())
}

#[inline]
pub(crate) fn read<T: Sample>(bytes: &[u8]) -> T {
    T::read_from_bytes(bytes).expect("hosts hand out samples of their topic")
}

#[cfg(test)]
mod tests;
