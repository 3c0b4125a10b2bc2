//! Report of a flight in simulated time that does not advance, with the services that it waits for.
//!
//! A stopped service is waited for without a limit: a debugger needs any time, and the other services lose nothing.
//! A service that runs and does not end its step ends itself ([`host::watchdog`]).

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use shared_types::service::seconds;

use crate::supervision::Supervisor;
use runtime::activity::Pause;

/// Period of the checks.
const PERIOD: Duration = Duration::from_secs(1);

/// Checks in a row without a new tick after which the flight stalls. Checks are counted and not the time: an
/// orchestrator that was stopped itself has not waited for a service.
const CHECKS: u32 = 5;

/// Detector of a flight that does not advance.
pub(super) struct StallWatch {
    next: Instant,
    ticks: u64,
    checks: u32,
    /// Last report of this stall.
    said: Option<String>,
}

impl StallWatch {
    pub(super) fn new(now: Instant) -> Self {
        Self {
            next: now + PERIOD,
            ticks: 0,
            checks: 0,
            said: None,
        }
    }

    /// Checks a flight with `ticks` recorded ticks. Returns the report, once for each stall and cause.
    pub(super) fn check(
        &mut self,
        now: Instant,
        ticks: u64,
        awaited: impl FnOnce() -> Option<String>,
    ) -> Option<String> {
        if now < self.next {
            return None;
        }
        self.next = now + PERIOD;
        if ticks != self.ticks {
            (self.ticks, self.checks, self.said) = (ticks, 0, None);
            return None;
        }
        self.checks = self.checks.saturating_add(1);
        let found = (self.checks >= CHECKS).then(awaited).flatten();
        if found.is_none() || found == self.said {
            return None;
        }
        self.said.clone_from(&found);
        found
    }
}

/// Describes the services that a flight waits for at tick `ticks`; `None` if each waits for another.
pub(super) fn awaited(supervisor: &Supervisor<'_>, ticks: u64) -> Option<String> {
    let processes = || supervisor.processes();
    let name = |service| supervisor.name_of(service);
    let mut causes: Vec<_> = processes()
        .filter_map(|(service, pid)| {
            let cause = match Pause::read(pid)? {
                Pause::Stopped => format!("stopped by a signal; `kill -CONT {pid}` continues it"),
                Pause::Traced => "stopped by a debugger".to_owned(),
            };
            Some(format!("`{}` (process {pid}, {cause})", name(service)))
        })
        .collect();
    if causes.is_empty() {
        let cells = &supervisor.page().control_block().cells;
        // Relaxed: the value is only used in a message.
        let steps = |service: shared_types::ServiceId| {
            cells[service.index()].waiting_for.load(Ordering::Relaxed) == 0
        };
        causes = processes()
            .filter(|&(service, _)| supervisor.flies(service) && steps(service))
            .map(|(service, pid)| format!("`{}` (process {pid}, which does not end its step)", name(service)))
            .collect();
    }
    let time = seconds(supervisor.schedule().time_ns(ticks));
    (!causes.is_empty()).then(|| {
        format!(
            "the flight waits at {time} s for {}; Ctrl-C ends the flight",
            causes.join(" and ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_is_reported_after_five_seconds_and_again_only_for_another_cause() {
        let begin = Instant::now();
        let mut watch = StallWatch::new(begin);
        let mut check = |second: u64, ticks: u64, cause: &str| {
            watch.check(begin + PERIOD * u32::try_from(second).unwrap(), ticks, || {
                Some(cause.to_owned())
            })
        };
        assert_eq!(check(1, 10, "a"), None);
        for second in 2..6 {
            assert_eq!(check(second, 10, "a"), None, "{second}");
        }
        assert_eq!(check(6, 10, "a"), Some("a".to_owned()));
        assert_eq!(check(7, 10, "a"), None);
        assert_eq!(check(8, 10, "b"), Some("b".to_owned()));
        // A tick ends the stall; the orchestrator's own stop counts as one check.
        assert_eq!(check(9, 11, "b"), None);
        assert_eq!(check(1_000, 11, "b"), None);
        for second in 1_001..1_004 {
            assert_eq!(check(second, 11, "b"), None, "{second}");
        }
        assert_eq!(check(1_004, 11, "b"), Some("b".to_owned()));
    }

    #[test]
    fn nothing_is_said_before_its_time_or_without_a_cause() {
        let begin = Instant::now();
        let mut watch = StallWatch::new(begin);
        for second in 0..20 {
            // Several looks in a second are one check.
            for _ in 0..10 {
                assert_eq!(watch.check(begin + PERIOD * second, 0, || None), None);
            }
        }
    }
}
