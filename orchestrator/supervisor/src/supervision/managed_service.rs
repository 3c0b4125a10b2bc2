//! The supervisor's facts about one service: its process, and where it is in its life.

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

/// A service of the supervisor.
pub(super) struct ManagedService {
    pub(super) service: ServiceId,
    /// The name of its process.
    pub(super) name: &'static str,
    pub(super) process: Process,
    pub(super) phase: Phase,
    /// Number of processes that have been started.
    pub(super) lives: u32,
    /// Number of times that in a row one has died without flying a tick more.
    pub(super) fruitless: u32,
    /// 1 + the last tick that was flown before the last death.
    pub(super) flown_until: u64,
    /// Time at which the last death was noticed, or at which a process that hung had stepped last.
    pub(super) died_at: Option<Instant>,
    /// That time of a process that hangs, until its end.
    pub(super) silent_since: Option<Instant>,
    /// Number of this birth, and when it was announced to the others.
    pub(super) birth: Option<(u32, Instant)>,
    /// `true` if its process was a standby process that was prepared for its role.
    pub(super) was_prepared: bool,
    /// What is seen of its process since it takes longer to become ready than usual.
    pub(super) slow_start: Option<SlowStart>,
    /// The longest that one of its processes has taken so far to become ready.
    pub(super) longest_start: Duration,
    /// The number that is not finite at which its process has stopped, to be replaced.
    pub(super) not_finite: Option<NonFinite>,
    /// The fault of its process, for which it is killed, to be replaced.
    pub(super) blamed: Option<String>,
    /// The fault of its code by which its process ends, as it reported.
    pub(super) last_words: LastWords,
    /// The parts of its deployment that it could not have, told before it was ready: as external_services do.
    pub(super) warnings: Vec<String>,
    /// Samples that it needs from long before those that it may have missed, as planned: input and tick.
    pub(super) remembered: Vec<(usize, u64)>,
    /// Samples that it has missed in real time and was not given yet, and when it was given the first.
    pub(super) missed: Option<(Instant, VecDeque<ToService>)>,
}

/// Report of a process on the fault by which it is about to end, and 1 + the last tick that it had stepped by then.
#[derive(Debug, Default)]
pub(super) struct LastWords(Option<(String, u64)>);

impl LastWords {
    /// Takes the report, if the process ended that has stepped up to `steps_until`. One that stepped on after its report
    /// has survived that fault, as a library that catches its own panic does, and ended by another.
    pub(super) fn take(&mut self, steps_until: u64) -> Option<String> {
        let (words, reported_at) = self.0.take()?;
        (reported_at == steps_until).then_some(words)
    }
}

/// Stage of a service in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// It makes its ports.
    Starting,
    /// It has made them and waits for the others.
    Ready,
    /// It flies.
    Flying,
    /// It flies again and may have missed samples: the next of each input to be handed over, by place.
    CatchingUp([u64; MAX_PORTS]),
    /// It has flown its last tick.
    Finished,
    /// It is dead and is to be started again at this time.
    Dead(Instant),
    /// It is dead and stays so.
    GivenUp,
}

impl ManagedService {
    /// A service whose first process has just been started.
    pub(super) fn new(service: ServiceId, name: &'static str, process: Process) -> Self {
        Self {
            service,
            name,
            process,
            phase: Phase::Starting,
            lives: 1,
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
            last_words: LastWords::default(),
            warnings: Vec::new(),
            remembered: Vec::new(),
            missed: None,
        }
    }

    /// Returns whether its process replaces another one and has not flown yet.
    pub(super) fn is_newborn(&self) -> bool {
        self.lives > 1 && matches!(self.phase, Phase::Starting | Phase::Ready)
    }

    /// Takes note of what the process says. In real time a number that is not finite ends its process and no more: a
    /// vehicle is in the air, and what the next process sees is something else. In lock-step it would see the same.
    /// `steps_until` is 1 + the last tick that the process has stepped by now.
    pub(super) fn understand(
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
            // What is said in replays only, what the supervisor has heard of an external service, and the last beat of a standby
            // process that has got its role since.
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
                self.last_words = LastWords(Some((presentable(&reason), steps_until)));
                return None;
            }
            // Of a later process it is a failure in flight: the first one was made of the same scenario.
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
        let reported = || LastWords(Some(("a panic".to_owned(), 7)));
        assert_eq!(reported().take(7).as_deref(), Some("a panic"));
        let mut survived = reported();
        assert_eq!((survived.take(8), survived.take(7)), (None, None));
    }
}
