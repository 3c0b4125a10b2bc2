//! State of one service: its process, the phase of its life cycle, and its history.

use std::time::Duration;

use host::step::NonFinite;
use shared_types::ServiceId;

use crate::event::News;
use crate::failure::ServiceFailure;
use crate::moment::Moment;
use crate::presentable::presentable;
use crate::process::{Process, Said};
use crate::starting::SlowStart;

/// Service with its process and its history.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    pub(crate) service: ServiceId,
    /// Process name.
    pub(crate) name: &'static str,
    /// `true` if a program that is not Gerono's takes its place.
    pub(crate) is_external: bool,
    pub(crate) process: Process,
    pub(crate) phase: Phase,
    /// `true` once its process has got the message to fly.
    pub(crate) has_flown: bool,
    /// Number of processes started so far.
    pub(crate) lives: u32,
    /// Number of processes that died without being killed by the supervisor.
    pub(crate) deaths: u32,
    /// Number of consecutive deaths without progress.
    pub(crate) fruitless: u32,
    /// 1 + the last stepped tick before the last death.
    pub(crate) flown_until: u64,
    /// Time at which the last death was detected, or of the last step of a hung process.
    pub(crate) died_at: Option<Moment>,
    /// Time of the last step of a hung process, until its end.
    pub(crate) silent_since: Option<Moment>,
    /// Number of this restart, and when it was announced to the other services.
    pub(crate) birth: Option<(u32, Moment)>,
    /// Time since which it is sent what it has missed, in real time.
    pub(crate) missed_since: Option<Moment>,
    /// `true` if its process was a prepared standby process.
    pub(crate) was_prepared: bool,
    /// Time of the last look at its starting process.
    pub(crate) looked_at: Option<Moment>,
    /// Time of its start in which the supervisor did not look: it, or the machine, was late.
    pub(crate) unobserved: Duration,
    /// Observations of its process, once that takes longer than usual to become ready.
    pub(crate) slow_start: Option<SlowStart>,
    /// Longest start-up time of its processes so far.
    pub(crate) longest_start: Duration,
    /// The number that is not finite for which its process has stopped and is to be replaced.
    not_finite: Option<NonFinite>,
    /// Reason for which its process is killed and replaced.
    pub(crate) blamed: Option<String>,
    /// The last report of its process on a fatal fault.
    fatal_report: FatalReport,
    /// Refused settings of its deployment, if reported before it was ready, as external services do.
    warnings: Vec<String>,
}

/// Report of a process on a fatal fault, and 1 + its last stepped tick at the report.
#[derive(Clone, Debug, Default)]
struct FatalReport(Option<(String, u64)>);

impl FatalReport {
    /// Takes the report, if the process has not stepped since, up to `steps_until`. A process that stepped on has
    /// survived that fault, as a library does that catches its own panic, and died of another.
    fn take(&mut self, steps_until: u64) -> Option<String> {
        let (words, reported_at) = self.0.take()?;
        (reported_at == steps_until).then_some(words)
    }
}

/// Phase in the life cycle of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The process creates its ports.
    Starting,
    /// The ports exist; the process waits for the others.
    Ready,
    Flying,
    /// Restarted and flying, but still getting missed samples.
    CatchingUp,
    /// The last step is done.
    Finished,
    /// The process was killed, and has not ended yet.
    Dying,
    /// The process has ended; another one is started at this time.
    Dead(Moment),
    /// Not to be restarted.
    GivenUp,
}

impl Member {
    /// Creates the state of a service whose first process was just started.
    pub(crate) fn new(service: ServiceId, name: &'static str, is_external: bool, process: Process) -> Self {
        Self {
            service,
            name,
            is_external,
            process,
            phase: Phase::Starting,
            has_flown: false,
            lives: 1,
            deaths: 0,
            fruitless: 0,
            flown_until: 0,
            died_at: None,
            silent_since: None,
            birth: None,
            missed_since: None,
            was_prepared: false,
            looked_at: None,
            unobserved: Duration::ZERO,
            slow_start: None,
            longest_start: Duration::ZERO,
            not_finite: None,
            blamed: None,
            fatal_report: FatalReport::default(),
            warnings: Vec::new(),
        }
    }

    /// Returns whether its process replaces another one and has not flown yet.
    pub(crate) fn is_replacement(&self) -> bool {
        self.lives > 1 && !self.has_flown
    }

    /// Returns whether it has ended for good, as far as the flight needs it.
    pub(crate) fn is_over(&self) -> bool {
        matches!(self.phase, Phase::Finished | Phase::GivenUp)
    }

    /// Notes the end of a process. `flown_until` is 1 + the last tick that the service has stepped.
    pub(crate) fn note_progress(&mut self, flown_until: u64) {
        self.fruitless = match flown_until > self.flown_until {
            true => 0,
            false => self.fruitless.saturating_add(1),
        };
        // A process that repeats steps is behind its predecessor.
        self.flown_until = self.flown_until.max(flown_until);
    }

    /// Takes what its process has said of its end: the number that is not finite, and the description.
    pub(crate) fn take_last_words(&mut self, flown_until: u64) -> (Option<NonFinite>, Option<String>) {
        let not_finite = self.not_finite.take();
        let report = self.fatal_report.take(flown_until);
        let words = report.or_else(|| not_finite.as_ref().map(ToString::to_string));
        (not_finite, words)
    }

    /// Gives it another process.
    pub(crate) fn begin(&mut self, process: Process, was_prepared: bool) {
        self.process = process;
        (self.was_prepared, self.slow_start, self.missed_since) = (was_prepared, None, None);
        (self.looked_at, self.unobserved) = (None, Duration::ZERO);
        (self.not_finite, self.fatal_report) = (None, FatalReport::default());
        self.warnings.clear();
        (self.phase, self.has_flown) = (Phase::Starting, false);
        self.lives += 1;
    }

    /// Returns whether an external service may send this message now.
    pub(crate) fn is_its_turn(&self, said: &Said) -> bool {
        matches!(
            (said, self.phase),
            (Said::Ready { .. } | Said::Deployed { .. }, Phase::Starting)
                | (Said::Connected | Said::Finished, Phase::Flying)
                // It was asked before its last message was read.
                | (Said::Connected, Phase::Finished)
                | (Said::Failed { .. }, _)
        )
    }

    /// Handles a message of the process. In real time, a number that is not finite ends only its process: the vehicle
    /// is in the air, and the next process gets other inputs. In lock step it would get the same ones. `steps_until` is
    /// 1 + the last tick that the process has stepped.
    pub(crate) fn hear(
        &mut self,
        said: Said,
        now: Moment,
        is_real_time: bool,
        steps_until: u64,
    ) -> Option<News> {
        match said {
            Said::Deployed { warnings } => self.warnings = warnings,
            Said::Ready { mut warnings } if self.phase == Phase::Starting => {
                self.longest_start = self.longest_start.max(now.since(self.process.asked_at));
                self.phase = Phase::Ready;
                self.birth = None;
                warnings.append(&mut self.warnings);
                let warnings = warnings.iter().map(|warning| presentable(warning)).collect();
                return Some(News::Ready(self.service, warnings));
            }
            Said::CaughtUp if self.phase == Phase::CatchingUp => self.phase = Phase::Flying,
            Said::Finished if matches!(self.phase, Phase::Flying | Phase::CatchingUp) => {
                self.phase = Phase::Finished;
                return Some(News::Finished(self.service));
            }
            Said::NonFinite(found) if is_real_time => self.not_finite = Some(found),
            Said::NonFinite(found) => return Some(self.give_up(found.into())),
            Said::Dying { reason } => {
                self.fatal_report = FatalReport(Some((presentable(&reason), steps_until)));
            }
            // If a later process is refused, it is a failure in flight: the first one was built from the same scenario.
            Said::Refused { reason } if self.lives == 1 => {
                return Some(self.give_up(ServiceFailure::Refused(presentable(&reason))));
            }
            Said::Failed { reason } | Said::Refused { reason } => {
                let service = self.name.to_owned();
                let reason = presentable(&reason);
                return Some(self.give_up(ServiceFailure::GaveUp { service, reason }));
            }
            // The last beat of a standby process that has since taken a role; and what is not its turn.
            Said::Connected
            | Said::Prepared
            | Said::CaughtUp
            | Said::Finished
            | Said::Stepped
            | Said::Ready { .. } => {}
        }
        None
    }

    pub(crate) fn give_up(&mut self, failure: ServiceFailure) -> News {
        self.phase = Phase::GivenUp;
        News::Lost(failure)
    }

    /// Returns the failure of an external service that did `what`.
    pub(crate) fn violation(&self, what: String) -> ServiceFailure {
        ServiceFailure::ExternalService {
            service: self.name.to_owned(),
            pid: self.process.pid,
            what,
        }
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
