//! State of one service in the supervisor: its process, and the phase of its life cycle.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use host::step::NonFinite;
use runtime::control::{Host, ToOrchestrator, ToService};
use shared_types::ServiceId;
use shared_types::schedule::MAX_PORTS;

use super::ServiceEvent;
use super::presentable::presentable;
use super::process::Process;
use super::starting::SlowStart;
use flight::failure::FlightFailure;

use crate::RunFailure;

/// Service with its process and its history.
pub(super) struct ManagedService {
    pub(super) service: ServiceId,
    /// Process name.
    pub(super) name: &'static str,
    pub(super) process: Process,
    pub(super) phase: Phase,
    /// Number of processes started so far.
    pub(super) lives: u32,
    /// Number of processes that died without being killed by the supervisor.
    pub(super) deaths: u32,
    /// Number of consecutive deaths without progress.
    pub(super) fruitless: u32,
    /// 1 + the last stepped tick before the last death.
    pub(super) flown_until: u64,
    /// Time at which the last death was detected, or of the last step of a hung process.
    pub(super) died_at: Option<Instant>,
    /// Time of the last step of a hung process, until its end.
    pub(super) silent_since: Option<Instant>,
    /// Number of this restart, and when it was announced to the other services.
    pub(super) birth: Option<(u32, Instant)>,
    /// `true` if its process was a prepared standby process.
    pub(super) was_prepared: bool,
    /// Observations of its process, once that takes longer than usual to become ready.
    pub(super) slow_start: Option<SlowStart>,
    /// Longest start-up time of its processes so far.
    pub(super) longest_start: Duration,
    /// The number that is not finite for which its process has stopped and is to be replaced.
    pub(super) not_finite: Option<NonFinite>,
    /// Reason for which its process is killed and replaced.
    pub(super) blamed: Option<String>,
    /// The last report of its process on a fatal fault.
    pub(super) fatal_report: FatalReport,
    /// Refused settings of its deployment, if reported before it was ready, as external services do.
    pub(super) warnings: Vec<String>,
    /// Samples that planned faults repeat from long before those that it may have missed: input and tick.
    pub(super) remembered: Vec<(usize, u64)>,
    /// Missed samples that were not sent yet, in real time, and the time of the first attempt.
    pub(super) missed: Option<(Instant, VecDeque<ToService>)>,
}

/// Report of a process on a fatal fault, and 1 + its last stepped tick at the report.
#[derive(Debug, Default)]
pub(super) struct FatalReport(Option<(String, u64)>);

impl FatalReport {
    /// Takes the report, if the process has not stepped since, up to `steps_until`. A process that stepped on has
    /// survived that fault, as a library does that catches its own panic, and died of another.
    pub(super) fn take(&mut self, steps_until: u64) -> Option<String> {
        let (words, reported_at) = self.0.take()?;
        (reported_at == steps_until).then_some(words)
    }
}

/// Phase in the life cycle of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// The process creates its ports.
    Starting,
    /// The ports exist; the process waits for the others.
    Ready,
    Flying,
    /// Restarted and flying, but still getting missed samples: the next sequence number to send for each input.
    CatchingUp([u64; MAX_PORTS]),
    /// The last step is done.
    Finished,
    /// Dead; to be restarted at this time.
    Dead(Instant),
    /// Dead; not to be restarted.
    GivenUp,
}

impl ManagedService {
    /// Creates the state of a service whose first process has just started.
    pub(super) fn new(service: ServiceId, name: &'static str, process: Process) -> Self {
        Self {
            service,
            name,
            process,
            phase: Phase::Starting,
            lives: 1,
            deaths: 0,
            fruitless: 0,
            flown_until: 0,
            died_at: None,
            silent_since: None,
            birth: None,
            was_prepared: false,
            slow_start: None,
            longest_start: Duration::ZERO,
            not_finite: None,
            blamed: None,
            fatal_report: FatalReport::default(),
            warnings: Vec::new(),
            remembered: Vec::new(),
            missed: None,
        }
    }

    /// Returns whether its process replaces another one and has not flown yet.
    pub(super) fn is_replacement(&self) -> bool {
        self.lives > 1 && matches!(self.phase, Phase::Starting | Phase::Ready)
    }

    /// Handles a message of the process. In real time, a number that is not finite ends only its process: the vehicle
    /// is in the air, and the next process gets other inputs. In lock step it would get the same ones. `steps_until` is
    /// 1 + the last tick that the process has stepped.
    pub(super) fn handle(
        &mut self,
        message: ToOrchestrator,
        host: Host,
        steps_until: u64,
    ) -> Option<ServiceEvent> {
        Some(match message {
            ToOrchestrator::Deployed { warnings } => {
                self.warnings = warnings;
                return None;
            }
            ToOrchestrator::Ready { mut warnings, .. } => {
                self.longest_start = self.longest_start.max(self.process.asked_at.elapsed());
                self.phase = Phase::Ready;
                self.birth = None;
                warnings.append(&mut self.warnings);
                let warnings = warnings.iter().map(|warning| presentable(warning)).collect();
                ServiceEvent::Ready(self.service, warnings)
            }
            ToOrchestrator::CaughtUp => {
                if matches!(self.phase, Phase::CatchingUp(_)) {
                    self.phase = Phase::Flying;
                }
                return None;
            }
            // Messages of replays, messages of external services that were handled before, and the last heartbeat of a
            // standby process that has since taken a role.
            ToOrchestrator::Stepped { .. } | ToOrchestrator::Connected { .. } | ToOrchestrator::Prepared => {
                return None;
            }
            ToOrchestrator::Finished => {
                self.phase = Phase::Finished;
                ServiceEvent::Finished(self.service)
            }
            ToOrchestrator::NonFinite(found) if host == Host::RealTime => {
                self.not_finite = Some(found);
                return None;
            }
            ToOrchestrator::NonFinite(found) => {
                self.phase = Phase::GivenUp;
                ServiceEvent::Lost(found.into())
            }
            ToOrchestrator::Dying { reason } => {
                self.fatal_report = FatalReport(Some((presentable(&reason), steps_until)));
                return None;
            }
            // If a later process is refused, it is a failure in flight: the first one was built from the same scenario.
            ToOrchestrator::Refused { reason } if self.lives == 1 => {
                self.phase = Phase::GivenUp;
                ServiceEvent::Lost(FlightFailure::Refused(presentable(&reason).into()).into())
            }
            ToOrchestrator::Failed { reason } | ToOrchestrator::Refused { reason } => {
                self.phase = Phase::GivenUp;
                ServiceEvent::Lost(RunFailure::GaveUp {
                    service: self.name.to_owned(),
                    reason: presentable(&reason),
                })
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_that_was_survived_is_not_the_cause_of_a_later_death() {
        let reported = || FatalReport(Some(("a panic".to_owned(), 7)));
        assert_eq!(reported().take(7).as_deref(), Some("a panic"));
        let mut survived = reported();
        assert_eq!((survived.take(8), survived.take(7)), (None, None));
    }
}
