//! Results of a flight: the numbers of the paper, computed during the flight.
//!
//! [`FlightSummary`] reads every sample once, in the order of the log, in constant memory. [`Summary`] is the result:
//! `summary.json` for programs, a table for users.

mod at_bound;
pub mod battery;
mod cameras;
pub mod faults;
mod flight;
pub mod innovations;
mod kill;
pub mod laboratory;
mod phase;
pub mod restart;
mod table;
pub mod timing;

use scenario::{Bounds, EdgeName, Recorded, Scenario, Vector};
use serde::Serialize;
use shared_types::samples::{
    ControlAdaptation, PathReference, RcFrame, RunEvent, VehicleState, VehicleTruth,
};
use shared_types::schedule::Edge;
use shared_types::service::{header_of, nanoseconds, seconds};
use shared_types::{Schedule, ServiceId, Topic};

use self::restart::Restart;
use crate::loss::{Loss, LossWatch};
use crate::response::ResponseWatch;
use crate::stretch::{Metrics, Stretch};
use crate::tracker::{StateSource, Tracker, Vehicle};
use crate::{read, view};
pub use at_bound::AtBound;
use at_bound::Calibrated;
use battery::ModelledBattery;
use cameras::CameraWatch;
pub use cameras::LateCameras;
use faults::{FaultReport, FaultWatch, PlannedFault};
use flight::FlightWatch;
pub use flight::{FlightPhaseBegin, cause_in_words, limit_in_words, not_level_in_words, not_ready_in_words};
use innovations::{InnovationWatch, SourceInnovations};
pub use kill::Kill;
use kill::KillWatch;
use laboratory::LaboratoryReport;
use phase::PhaseRecords;
use timing::TimingReport;

/// Maximum ratio to the theorem's bound that counts as near it.
///
/// The theorem holds for a controller in continuous time and for t → ∞; a hold of 1 kHz and half a minute cause some percent.
pub const NEAR_THE_BOUND: f64 = 1.1;

/// Ultimate distance of a phase compared with the theorem's bound for Gerono's own law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AgainstBound {
    /// The distance from the path was within the bound.
    Within,
    /// It was above the bound, but not by more than [`NEAR_THE_BOUND`].
    Near,
    /// It was above that.
    Exceeded,
}

impl AgainstBound {
    /// Compares an ultimate distance (m) with a bound (m).
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

/// The end of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The last tick was flown, and the vehicle was not lost.
    #[default]
    Completed,
    /// The run did not fail, and the vehicle was lost.
    Lost,
    /// The run did not fail, the vehicle was not lost, and a kill ended the flight before it had landed.
    Killed,
    /// The user ended the run.
    Interrupted,
    /// The run failed.
    Failed,
}

/// Facts about a run that samples do not have; the default is that of a log without its run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunFacts {
    /// Name of the scenario.
    pub scenario: String,
    /// Which host flew it.
    pub host: String,
    /// The outcome of the run.
    pub outcome: Outcome,
    /// Reason for the outcome; empty if completed.
    pub reason: String,
    /// `true` if the flight continued to its last tick, which stops the motors of a real vehicle. Not in the log.
    #[serde(skip)]
    pub is_over: bool,
    /// Tick at which a service computed a number that is not finite, if that ended it.
    #[serde(skip)]
    pub not_finite_at: Option<u64>,
    /// Samples that are in the log, if it could not be written to the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub in_log: Option<u64>,
    /// Wall time from the first tick to the last, s.
    pub wall_seconds: f64,
    /// Restarts of services in flight, which leave no trace in the log.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub restarts: Vec<Restart>,
    /// The timing of the flight, if it was flown in real time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<TimingReport>,
    /// The performance of cameras and radio link, if it was flown in a laboratory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub laboratory: Option<LaboratoryReport>,
}

/// The result of a flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Facts about the run.
    #[serde(flatten)]
    pub run: RunFacts,
    /// Seed of the flight.
    pub seed: u64,
    /// Time of the last recorded tick, s.
    pub simulated_seconds: f64,
    /// Beginning of the observation, s: later than 0 after a take-over.
    #[serde(skip)]
    pub began_at: f64,
    /// Simulated seconds per wall second.
    pub real_time_factor: f64,
    /// The loss of the vehicle; none if it was not lost.
    pub lost: Option<Loss>,
    /// The kill of the flight; none unless it was killed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub killed: Option<Kill>,
    /// A wrong axis or sign in the response to the first commands off the ground; none unless found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<String>,
    /// The source of the vehicle's position: the truth, or in a laboratory the estimator.
    pub source: StateSource,
    /// Metrics of the steady state of the last phase, by which a flight is judged; `None` if it was not flown.
    pub steady: Option<Metrics>,
    /// Metrics of the whole flight; `None` if the vehicle never flew along its path.
    pub metrics: Option<Metrics>,
    /// Time until which they were measured, s.
    #[serde(skip)]
    pub measured_until: f64,
    /// atanh(δ/(k1 σmax)): the theorem's ultimate bound of the distance from the path, m; `None` for other controllers than
    /// Gerono's own.
    pub ultimate_bound: Option<f64>,
    /// The phases between the changes of the vehicle, as far as they were flown.
    pub phases: Vec<Phase>,
    /// Estimates at their bounds at the end of a phase.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at_bound: Vec<AtBound>,
    /// Flight phases from disarmed to disarmed, in order; empty for a flight that starts in the air.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flight: Vec<FlightPhaseBegin>,
    /// That no take-off led to the path, and why not, in a sentence; none if one did, or none was ordered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed_take_off: Option<String>,
    /// The planned faults, as far as they were flown.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultReport>,
    /// Late cameras of a laboratory; none if they were on time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_cameras: Option<LateCameras>,
    /// The sources of inertial navigation; empty without it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub innovations: Vec<SourceInnovations>,
    /// The modelled battery; none unless the scenario states one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub battery: Option<ModelledBattery>,
    /// The recorded samples of each topic.
    pub topics: Vec<TopicCount>,
}

/// A phase of a flight: from one change of the vehicle, or the start, to the next, or the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Phase {
    /// Time at which it begins, s.
    pub begins: f64,
    /// End of the phase, or of its flown part, s.
    pub ends: f64,
    /// `true` if it was flown to its end.
    pub is_complete: bool,
    /// Metrics of the whole phase; `None` if the vehicle did not fly along the path.
    pub metrics: Option<Metrics>,
    /// Metrics of the transient, before the steady state.
    pub transient: Option<Metrics>,
    /// Metrics of the steady state, from `judge.steady_after` on.
    pub steady: Option<Metrics>,
    /// Maximum distance from the path in the last [`ULTIMATE_WINDOW`](crate::ULTIMATE_WINDOW) of the phase, m, or in a
    /// shorter phase. Only for a complete phase in which the vehicle flew along the path at the end.
    pub ultimate: Option<f64>,
    /// `ultimate` against the theorem's bound, where there is one.
    pub against_bound: Option<AgainstBound>,
    /// Parameters at the end of the phase, and their estimates.
    pub parameters: Parameters,
    /// γ at the phase's end.
    pub gamma: Option<f64>,
}

/// Unknown parameters of the vehicle and their estimates; `None` without a sample.
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

/// Number of samples of a topic that were recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TopicCount {
    /// Name of the topic.
    pub topic: &'static str,
    /// Samples recorded.
    pub recorded: u64,
    /// Due samples up to the last recorded tick that were not published: in real time, those of skipped steps.
    pub not_flown: u64,
    /// Samples that were published and not recorded.
    pub not_recorded: u64,
}

/// Time in which an orchestrator that takes over connects to the services' topics, s.
const CONNECTING: f64 = 0.2;

/// Running [`Summary`] in constant memory.
#[derive(Clone, Debug)]
pub struct FlightSummary {
    seed: u64,
    bound: Option<f64>,
    /// Bounds of the estimates, for Gerono's own controller.
    bounds: Option<Bounds>,
    calibrated: Calibrated,
    schedule: Schedule,
    tracker: Tracker,
    loss: LossWatch,
    kill: KillWatch,
    /// `true` if the vehicle flies along its path, by the newest information.
    is_on_path: bool,
    /// Time of the last moment on the path, ns.
    on_path_until_ns: u64,
    phases: PhaseRecords,
    /// `None` without planned faults.
    faults: Option<Box<FaultWatch>>,
    flight: FlightWatch,
    /// `None` for a flight without phases.
    response: Option<Box<ResponseWatch>>,
    /// `None` without the cameras of a laboratory.
    cameras: Option<Box<CameraWatch>>,
    battery: Option<ModelledBattery>,
    /// `None` without inertial navigation.
    innovations: Option<Box<InnovationWatch>>,
    /// The estimator's input of inertial samples, with its planned faults, if all of them are recorded.
    imu_edge: Option<Edge>,
    /// `true` for a flight with phases.
    has_phases: bool,
    counts: [SequenceCount; Topic::ALL.len()],
    first_tick: u64,
    last_tick: Option<u64>,
}

/// Count of the samples of a topic that belong to the log, by the sequence numbers in their headers.
#[derive(Clone, Copy, Debug)]
struct SequenceCount {
    /// Recorded part of the topic.
    scope: Recorded,
    recorded: u64,
    /// Number of the next sample that belongs to the log.
    next: u64,
    gaps: u64,
    /// Number below which missing samples do not count: those before a take-over.
    may_skip_to: u64,
}

impl FlightSummary {
    /// Makes the running summary of a flight of `scenario` with its `schedule`.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        let faults = PlannedFault::all(scenario);
        let changes: Vec<u64> = crate::events_beside_faults(scenario)
            .map(|time| scenario.tick_of(time))
            .collect();
        let tracker = Tracker::new(schedule, scenario.flight.is_some());
        let recorded = Recorded::of_topics(scenario);
        Self {
            seed: scenario.seed,
            bound: scenario.theorem_bound(),
            bounds: (!scenario.is_foreign(ServiceId::Controller)).then(|| scenario.controller.bounds.clone()),
            calibrated: Calibrated::in_scenario(scenario),
            loss: LossWatch::new(scenario, tracker.source()),
            tracker,
            kill: KillWatch::default(),
            is_on_path: false,
            on_path_until_ns: 0,
            phases: PhaseRecords::new(scenario, schedule),
            faults: (!faults.is_empty()).then(|| Box::new(FaultWatch::new(faults, &changes, schedule))),
            flight: FlightWatch::new(scenario),
            response: scenario
                .flight
                .as_ref()
                .map(|_| Box::new(ResponseWatch::new(scenario))),
            cameras: scenario.capture_system().map(|_| {
                Box::new(CameraWatch::new(
                    scenario.flight.is_some(),
                    scenario.navigation.is_some(),
                ))
            }),
            battery: None,
            innovations: scenario
                .navigation
                .as_ref()
                .map(|_| Box::new(InnovationWatch::new(scenario))),
            imu_edge: EdgeName::between(Topic::ImuSample, ServiceId::Estimator)
                .filter(|edge| recorded[edge.topic.index()] == Recorded::All)
                .map(|edge| schedule.edge(edge.service, edge.input)),
            has_phases: scenario.flight.is_some(),
            counts: recorded.map(SequenceCount::new),
            first_tick: 0,
            last_tick: None,
            schedule: schedule.clone(),
        }
    }

    /// Begins at the tick of a take-over.
    pub fn begin_at(&mut self, tick: u64) {
        self.first_tick = tick;
        let connected = tick + nanoseconds(CONNECTING) / self.schedule.tick_ns();
        for topic in Topic::ALL {
            let count = &mut self.counts[topic.index()];
            count.may_skip_to = if topic.publisher().is_some() {
                let published = |tick| self.schedule.publications(topic).count_before(tick);
                count.next = count.scope.count_before(published(tick));
                count.scope.count_before(published(connected))
            } else {
                u64::MAX
            };
        }
    }

    /// Adds a recorded sample; call in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let header = header_of(bytes);
        self.counts[topic.index()].count(header.seq);
        self.last_tick = self.last_tick.max(Some(header.tick));
        match topic {
            Topic::VehicleTruth => view(bytes, |truth| self.observe_truth(truth)),
            Topic::VehicleState => view(bytes, |state| self.observe_state(state)),
            Topic::PathReference => view(bytes, |reference| self.observe_reference(reference)),
            Topic::ControlAdaptation => view(bytes, |adaptation| self.observe_adaptation(adaptation)),
            Topic::RcFrame => view(bytes, |frame| self.observe_frame(frame)),
            Topic::RunEvent => self.observe_event(&read(bytes)),
            Topic::MocapPose => {
                if let Some(cameras) = &mut self.cameras {
                    view(bytes, |pose| cameras.observe(pose));
                }
            }
            Topic::ControlCommand
            | Topic::ControlErrors
            | Topic::ControlTelemetry
            | Topic::GnssFix
            | Topic::BaroAltitude
            | Topic::MagField
            | Topic::GnssBaseline => {}
            Topic::ImuSample => {
                if let Some((innovations, edge)) = self.innovations.as_mut().zip(self.imu_edge.as_ref()) {
                    view(bytes, |sample| {
                        innovations.observe_imu(sample, edge.is_lost(header.tick));
                    });
                }
            }
            Topic::NavigationInnovations => {
                if let Some(innovations) = &mut self.innovations {
                    view(bytes, |sample| innovations.observe(sample));
                }
            }
            Topic::PoseInnovations => {
                if let Some(innovations) = &mut self.innovations {
                    view(bytes, |sample| innovations.observe_poses(sample));
                }
            }
            Topic::BaselineInnovations => {
                if let Some(innovations) = &mut self.innovations {
                    view(bytes, |sample| innovations.observe_baselines(sample));
                }
            }
        }
        if let Some(response) = &mut self.response {
            response.observe(topic, bytes);
        }
        if let Some(faults) = &mut self.faults {
            faults.observe(topic, bytes);
        }
    }

    #[inline]
    fn observe_truth(&mut self, truth: &VehicleTruth) {
        let tick = truth.header.tick;
        if self.tracker.source() == StateSource::Truth {
            self.end_moment();
            self.tracker.turn_to(truth);
            self.phases.at(tick).last_tick = Some(tick);
        }
        let parameters = &mut self.phases.at(tick).parameters;
        parameters.mass = Some(truth.mass);
        parameters.disturbance = Some(truth.disturbance_world);
    }

    #[inline]
    fn observe_state(&mut self, state: &VehicleState) {
        if self.has_phases {
            self.flight.observe_state(state);
        }
        let tick = state.header.tick;
        if self.tracker.source() == StateSource::Estimate {
            if let Some(vehicle) = Vehicle::tracked(state) {
                self.end_moment();
                self.tracker.turn_to(vehicle);
            }
            self.phases.at(tick).last_tick = Some(tick);
        }
    }

    /// Adds the moment of the newest vehicle, which is complete.
    #[inline]
    fn end_moment(&mut self) {
        let Self {
            tracker,
            loss,
            is_on_path,
            on_path_until_ns,
            phases,
            faults,
            ..
        } = self;
        let Some(moment) = tracker.moment() else {
            return;
        };
        *is_on_path = moment.distance_on_path().is_some();
        if *is_on_path {
            *on_path_until_ns = moment.vehicle.time_ns;
        }
        loss.observe(moment);
        phases.at(moment.vehicle.tick).observe(moment);
        if let Some(faults) = faults {
            faults.observe_moment(moment, None);
        }
    }

    #[inline]
    fn observe_reference(&mut self, reference: &PathReference) {
        self.tracker.observe_reference(reference);
        self.phases.at(reference.header.tick).gamma = Some(reference.gamma);
        self.loss.observe_reference(reference);
        self.kill.observe_reference(reference);
        self.flight.observe(reference);
        if self.has_phases
            && let Some(cameras) = &mut self.cameras
        {
            cameras.observe_reference(reference);
        }
    }

    #[inline]
    fn observe_adaptation(&mut self, adaptation: &ControlAdaptation) {
        // An external controller without estimates leaves the sample zero. On the ground they learn from its push.
        let is_flown = self.is_on_path || !self.has_phases;
        if is_flown && adaptation.mass_estimate > 0.0 {
            let parameters = &mut self.phases.at(adaptation.header.tick).parameters;
            parameters.mass_estimate = Some(adaptation.mass_estimate);
            parameters.disturbance_estimate = Some(adaptation.disturbance_projected_world);
        }
    }

    #[inline]
    fn observe_frame(&mut self, frame: &RcFrame) {
        self.loss.observe_frame(frame);
        self.kill.observe_frame(frame);
        ModelledBattery::observe(&mut self.battery, frame);
        if self.is_on_path {
            self.phases.at(frame.header.tick).parts.observe_frame(frame);
        }
    }

    fn observe_event(&mut self, event: &RunEvent) {
        // The theorem holds for constant gains.
        if event.kind == RunEvent::KIND_OPERATOR_TUNES {
            self.bound = None;
        }
        self.loss.observe_event(event);
        self.flight.observe_event(event);
    }

    /// Returns the loss, if the vehicle was lost.
    #[must_use]
    pub fn loss(&self) -> Option<&Loss> {
        self.loss.loss()
    }

    /// Returns the summary of the added samples.
    #[must_use]
    pub fn finish(mut self, run: RunFacts) -> Summary {
        self.end_moment();
        let lost = self.lost(&run);
        let killed = self
            .kill
            .finish(|cause, stamp_ns| self.flight.cause_in_words(cause, stamp_ns));
        let source = self.tracker.source();
        let simulated_ticks = self
            .last_tick
            .map_or(0, |tick| tick.saturating_sub(self.first_tick));
        let simulated_seconds = seconds(self.schedule.time_ns(simulated_ticks));
        let mut whole = Stretch::default();
        self.phases
            .all()
            .iter()
            .for_each(|phase| whole.join(&phase.parts.whole()));
        let flown = self.phases.all().iter().filter(|phase| phase.last_tick.is_some());
        let phases: Vec<Phase> = flown
            .map(|phase| phase.finish(&self.schedule, source.topic(), self.bound))
            .collect();
        let at_bound = self.bounds.iter().flat_map(|bounds| {
            let ends = phases.iter();
            let measured_until = seconds(self.on_path_until_ns);
            ends.flat_map(move |phase| {
                at_bound::at_bound(
                    (bounds, self.calibrated),
                    phase.ends.min(measured_until),
                    &phase.parameters,
                )
            })
        });
        Summary {
            seed: self.seed,
            simulated_seconds,
            began_at: seconds(self.schedule.time_ns(self.first_tick)),
            real_time_factor: if run.wall_seconds > 0.0 {
                simulated_seconds / run.wall_seconds
            } else {
                0.0
            },
            response: self
                .response
                .as_ref()
                .and_then(|response| response.verdict().map(str::to_owned)),
            source,
            steady: phases.last().and_then(|phase| phase.steady),
            metrics: whole.finish(),
            measured_until: seconds(self.on_path_until_ns),
            ultimate_bound: self.bound,
            at_bound: at_bound.collect(),
            phases,
            flight: if self.has_phases {
                self.flight.finish()
            } else {
                Vec::new()
            },
            failed_take_off: self.has_phases.then(|| self.flight.failed_take_off()).flatten(),
            faults: self
                .faults
                .as_ref()
                .map(|faults| faults.finish(&self.schedule, lost.as_ref()))
                .unwrap_or_default(),
            late_cameras: self
                .cameras
                .as_ref()
                .and_then(|cameras| cameras.finish(run.timing.as_ref())),
            innovations: self
                .innovations
                .as_ref()
                .map(|innovations| innovations.finish())
                .unwrap_or_default(),
            battery: self.battery,
            topics: Topic::ALL
                .into_iter()
                .filter(|&topic| self.schedule.has_topic(topic))
                .map(|topic| self.topic_count(topic, run.timing.as_ref()))
                .collect(),
            run: verdict(run, lost.as_ref(), killed.as_ref()),
            lost,
            killed,
        }
    }

    /// Returns the loss, if the vehicle was lost, with the origin of a request that stopped its motors.
    fn lost(&self, run: &RunFacts) -> Option<Loss> {
        if let Some(loss) = self.loss.loss() {
            return Some(Loss {
                cause: self
                    .flight
                    .cause_in_words(loss.stopped_by, nanoseconds(loss.time)),
                ..loss.clone()
            });
        }
        if let Some(tick) = run.not_finite_at {
            let seconds = seconds(self.schedule.time_ns(tick));
            return Some(Loss::not_finite(seconds, self.tracker.source()));
        }
        let last_tick = self.last_tick.filter(|_| run.is_over)?;
        self.loss.loss_at_the_end(self.schedule.time_ns(last_tick))
    }

    /// Returns the recorded samples of a topic; for the orchestrator's own topics only gaps can be detected.
    ///
    /// In simulated time every due sample is published. In real time `timing` has the published ones; for a topic that is not
    /// published at every step they are unknown, and missing samples count as not flown.
    fn topic_count(&self, topic: Topic, timing: Option<&TimingReport>) -> TopicCount {
        let SequenceCount {
            scope,
            recorded,
            next,
            gaps,
            ..
        } = self.counts[topic.index()];
        let due = match (topic.publisher(), self.last_tick) {
            (Some(_), Some(tick)) => self.schedule.publications(topic).count_before(tick + 1),
            _ => 0,
        };
        let missing = gaps + scope.count_before(due).saturating_sub(next);
        let not_recorded = timing.map_or(missing, |timing| timing.unrecorded_of(topic.name()).min(missing));
        TopicCount {
            topic: topic.name(),
            recorded,
            not_flown: missing - not_recorded,
            not_recorded,
        }
    }
}

impl RunFacts {
    /// Returns the lateness, as a phrase after "the". Services that died skip steps on any machine.
    fn lateness(&self) -> Option<String> {
        let lateness = self.timing.as_ref()?.lateness()?;
        Some(match self.restarts.len() {
            0 => format!("machine was late: {lateness}"),
            restarts => {
                format!("machine, or the death of services ({restarts} restarted), was late: {lateness}")
            }
        })
    }
}

/// Returns the facts of a run with its verdict: lost or killed instead of completed, and the lateness of the machine in the
/// reason of a loss.
fn verdict(run: RunFacts, lost: Option<&Loss>, killed: Option<&Kill>) -> RunFacts {
    let is_completed = run.outcome == Outcome::Completed;
    let Some(loss) = lost else {
        return match killed.filter(|kill| is_completed && !kill.after_landing) {
            Some(kill) => RunFacts {
                outcome: Outcome::Killed,
                reason: format!("killed {kill}"),
                ..run
            },
            None => run,
        };
    };
    let late = run.lateness().map(|lateness| format!("the {lateness}"));
    let (outcome, reason) = if is_completed {
        (Outcome::Lost, loss.to_string())
    } else {
        (run.outcome, run.reason)
    };
    RunFacts {
        outcome,
        reason: std::iter::once(reason).chain(late).collect::<Vec<_>>().join("; "),
        ..run
    }
}

impl SequenceCount {
    fn new(scope: Recorded) -> Self {
        Self {
            scope,
            recorded: 0,
            next: 0,
            gaps: 0,
            may_skip_to: 0,
        }
    }

    #[inline]
    fn count(&mut self, seq: u64) {
        if self.scope.has(seq) {
            let number = self.scope.count_before(seq);
            self.next = self.next.max(number.min(std::mem::take(&mut self.may_skip_to)));
            self.recorded += 1;
            self.gaps += number.saturating_sub(self.next);
            self.next = self.next.max(number + 1);
        }
    }
}

#[cfg(test)]
mod tests;
