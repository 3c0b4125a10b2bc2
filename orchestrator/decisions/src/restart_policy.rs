//! Policies for restarts: limits, back-off and time-outs.

use std::str::FromStr;
use std::time::Duration;

use scenario::suggest::known_names;
use scenario_file::values::ValueError;
use shared_types::ServiceId;

/// Number of consecutive deaths at the same tick that are followed by an immediate restart; later restarts are delayed
/// by a growing back-off.
const AT_ONCE: u32 = 3;

/// First back-off.
const FIRST_PAUSE: Duration = Duration::from_millis(5);

/// Pause after the system has refused to start a process of a service: short, because an attempt costs little.
pub(crate) const NOT_STARTED_PAUSE: Duration = Duration::from_millis(10);

/// Start-up limit of a service while the run is set up, and in lock step, where no vehicle is in the air.
pub const READY_LIMIT: Duration = Duration::from_secs(30);

/// Start-up limit of an external service while the run is set up, and its limit in lock step to connect to a restarted
/// service.
pub const EXTERNAL_LIMIT: Duration = Duration::from_secs(10);

/// Start-up time in flight after which a process is slow: a standby process is prepared, and replaces the slow one if
/// that is asleep or stopped.
pub const HEDGE_AFTER: Duration = Duration::from_millis(25);

/// Start-up limit of a prepared standby process in real time.
pub const PREPARED_LIMIT: Duration = Duration::from_millis(150);

/// Start-up limit of any process in real time.
pub const FRESH_LIMIT: Duration = Duration::from_secs(1);

/// Maximum start-up limit of an external service in flight, however long it took before.
const EXTERNAL_LIMIT_IN_FLIGHT: Duration = Duration::from_secs(5);

/// Maximum number of doublings of the limits in flight, one for each consecutive process that has not flown: hardware
/// may open more slowly, and a machine be slower, than the limits assume.
const MAX_DOUBLINGS: u32 = 3;

/// Returns a limit in flight after `missed` consecutive processes that have not flown.
pub(crate) fn doubled(limit: Duration, missed: u32) -> Duration {
    limit * (1 << missed.min(MAX_DOUBLINGS))
}

/// Returns the limit in flight for the start-up of an external service, and again for its first step, after start-ups
/// of up to `longest`: a program may load an interpreter, and compile its first step. It is bounded because the vehicle
/// flies without the service meanwhile.
#[must_use]
pub fn external_start_limit(longest: Duration) -> Duration {
    (2 * longest).clamp(FRESH_LIMIT, EXTERNAL_LIMIT_IN_FLIGHT)
}

/// Heartbeat period of the standby process.
pub const BEAT_PERIOD: Duration = Duration::from_secs(1);

/// Timeout for the answer of a standby process.
pub const BEAT_LIMIT: Duration = Duration::from_secs(2);

/// Timeout for the preparation of a standby process.
pub const PREPARATION_LIMIT: Duration = Duration::from_secs(10);

/// Timeout of a process that was told to stop, before it is killed.
pub const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Time for which a process may live after it has closed its channel: an ending process closes it shortly before.
pub const AFTER_CLOSING: Duration = Duration::from_millis(100);

/// Timeout for the end of a killed process, which may wait for the system, such as for a slow disk.
pub const END_LIMIT: Duration = Duration::from_secs(1);

/// Timeout for the end of a killed process in real time, after which the flight has failed and the vehicle lands: until its
/// end no other process can take its place. It is longer than pauses of a machine.
pub const STUCK_LIMIT: Duration = Duration::from_secs(5);

/// Timeout for a restarted service to receive the samples that it has missed, in real time.
pub const MISSED_LIMIT: Duration = Duration::from_millis(500);

/// State of the run in which a process starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Situation {
    /// The run is being set up; no service flies yet.
    SetUp,
    /// In flight in lock step: all other services wait.
    LockStep,
    /// In flight in real time: a vehicle is in the air.
    RealTime,
}

/// Process with a role that is not ready yet.
#[derive(Clone, Copy, Debug)]
pub struct StartingProcess {
    pub situation: Situation,
    /// Time since its start, or since it got its role.
    pub elapsed: Duration,
    /// Part of that time in which it waited for a processor.
    pub waited: Duration,
    /// `true` if it was a prepared standby process.
    pub was_prepared: bool,
    /// `true` if a prepared standby process could replace it.
    pub is_other_prepared: bool,
    /// `true` if it has not run for some time and does not wait for a processor.
    pub is_asleep: bool,
    /// Longest start-up of a process of its service so far.
    pub longest: Duration,
    /// Number of consecutive processes before it that have not flown.
    pub missed: u32,
}

/// Decision on a starting process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Wait on.
    Wait,
    /// Wait on, and prepare another process.
    Hedge,
    /// Kill and replace it.
    Replace,
    /// End the run.
    Fail,
}

impl StartingProcess {
    fn exceeds(&self, limit: Duration) -> bool {
        self.elapsed > doubled(limit, self.missed)
    }

    /// Returns whether it takes longer than `limit`, without the time in which it waited for a processor: its successor
    /// would wait as well, and start over.
    fn exceeds_by_itself(&self, limit: Duration) -> bool {
        self.elapsed.saturating_sub(self.waited) > doubled(limit, self.missed)
    }

    /// Returns whether it takes longer than usual, so that another process is to be prepared.
    #[must_use]
    pub fn is_slow(&self) -> bool {
        self.situation != Situation::SetUp && self.exceeds_by_itself(HEDGE_AFTER)
    }

    /// Returns the decision on an external service, for which no standby process exists.
    #[must_use]
    pub fn verdict_on_external_service(&self) -> Verdict {
        match self.situation {
            Situation::RealTime if self.exceeds(external_start_limit(self.longest)) => Verdict::Replace,
            Situation::SetUp | Situation::LockStep if self.elapsed > EXTERNAL_LIMIT => Verdict::Fail,
            _ => Verdict::Wait,
        }
    }

    /// Returns the decision. The table is in docs/restarts_in_real_time.md.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let is_past_all = match self.situation {
            Situation::SetUp if self.elapsed > READY_LIMIT => return Verdict::Fail,
            Situation::SetUp => return Verdict::Wait,
            Situation::LockStep => self.elapsed > READY_LIMIT,
            Situation::RealTime => self.exceeds(FRESH_LIMIT),
        };
        // The first process that is ready flies; one that is asleep will not be.
        let is_overtaken = self.is_slow() && self.is_asleep && self.is_other_prepared;
        let is_late = self.situation == Situation::RealTime
            && self.was_prepared
            && self.exceeds_by_itself(PREPARED_LIMIT)
            // If no successor is prepared and this process only waits for a processor, a successor would be later.
            && (self.is_asleep || self.is_other_prepared);
        if is_past_all || is_overtaken || is_late {
            Verdict::Replace
        } else if self.is_slow() {
            Verdict::Hedge
        } else {
            Verdict::Wait
        }
    }
}

/// Policy for restarts of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RestartPolicy {
    /// Maximum number of consecutive restarts without progress; with 0 the first death ends the run.
    pub limit: u32,
    /// Maximum back-off.
    pub longest_pause: Duration,
}

impl Default for RestartPolicy {
    fn default() -> Self {
        Self {
            limit: 8,
            longest_pause: Duration::from_millis(100),
        }
    }
}

impl RestartPolicy {
    /// Returns the back-off after `fruitless` consecutive deaths at the same tick; `None` if the service is given up.
    #[must_use]
    pub fn pause(&self, fruitless: u32) -> Option<Duration> {
        if self.limit == 0 || fruitless > self.limit {
            return None;
        }
        let doublings = fruitless.saturating_sub(AT_ONCE);
        Some(if doublings == 0 {
            Duration::ZERO
        } else {
            (FIRST_PAUSE * (1 << doublings.min(8))).min(self.longest_pause)
        })
    }
}

/// Value for one service, as `SERVICE=VALUE`, or for all, as `VALUE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PerService<T> {
    /// The service; all if `None`.
    pub service: Option<ServiceId>,
    pub value: T,
}

impl<T: FromStr> FromStr for PerService<T> {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let (service, value) = match text.split_once('=') {
            None => (None, text),
            Some((name, value)) => {
                let service = scenario::role_of_process(name).ok_or_else(|| {
                    let names = ServiceId::ALL.map(ServiceId::name);
                    ValueError::Unknown {
                        what: "service",
                        there_is: known_names(name, &names),
                    }
                })?;
                (Some(service), value)
            }
        };
        let value = value
            .parse()
            .map_err(|_| ValueError::unfit(format!("`{value}` is not such a number")))?;
        Ok(Self { service, value })
    }
}

impl<T: Copy> PerService<T> {
    /// Returns the last of `values` that applies to `service`.
    pub fn of(values: &[Self], service: ServiceId) -> Option<T> {
        let mut values = values.iter().rev();
        let own = values.find(|value| value.service.is_none_or(|named| named == service));
        own.map(|own| own.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_begin_after_some_deaths_grow_and_end() {
        let policy = RestartPolicy {
            limit: 12,
            longest_pause: Duration::from_millis(50),
        };
        let pauses: Vec<_> = (0..=14).map(|deaths| policy.pause(deaths)).collect();
        assert_eq!(pauses[..4], [Some(Duration::ZERO); 4]);
        assert!(pauses[3..13].is_sorted() && pauses[12] == Some(policy.longest_pause));
        assert_eq!(pauses[13..], [None; 2]);
        assert_eq!(RestartPolicy { limit: 0, ..policy }.pause(0), None);
    }

    #[test]
    fn a_value_is_for_one_service_or_for_all_and_the_last_one_counts() {
        let values: Vec<PerService<u32>> = ["7", "controller=2", "plant=3", "controller=4"]
            .map(|text| text.parse().unwrap())
            .into();
        let of = |service| PerService::of(&values, service);
        assert_eq!(of(ServiceId::Estimator), Some(7));
        assert_eq!(of(ServiceId::Controller), Some(4));
        assert!(
            "contoller=1"
                .parse::<PerService<u32>>()
                .unwrap_err()
                .to_string()
                .contains("`controller`")
        );
        assert!("controller=-1".parse::<PerService<u32>>().is_err());
    }

    /// In flight the limit is that of the other processes: the vehicle is in the air.
    #[test]
    fn an_external_service_that_starts_has_the_limits_of_the_set_up_only_before_the_flight() {
        use Situation::{LockStep, RealTime, SetUp};
        use Verdict::{Fail, Replace, Wait};
        let rows = [
            (SetUp, 10_000, 0, Wait),
            (SetUp, 10_001, 0, Fail),
            (LockStep, 10_001, 0, Fail),
            (RealTime, 1_000, 0, Wait),
            (RealTime, 1_001, 0, Replace),
            (RealTime, 1_001, 1, Wait),
            (RealTime, 2_001, 1, Replace),
            (RealTime, 8_001, 9, Replace),
        ];
        let rows =
            rows.map(|(situation, elapsed, missed, verdict)| (situation, 400, elapsed, missed, verdict));
        let slow = [
            (SetUp, 3_000, 10_001, 0, Fail),
            (RealTime, 2_000, 4_000, 0, Wait),
            (RealTime, 2_000, 4_001, 0, Replace),
            (RealTime, 3_000, 5_001, 0, Replace),
            (RealTime, 3_000, 10_000, 1, Wait),
        ];
        for row in rows.into_iter().chain(slow) {
            let (situation, longest, milliseconds, missed, verdict) = row;
            let starting = StartingProcess {
                situation,
                elapsed: Duration::from_millis(milliseconds),
                waited: Duration::ZERO,
                was_prepared: false,
                is_other_prepared: true,
                is_asleep: true,
                longest: Duration::from_millis(longest),
                missed,
            };
            assert_eq!(starting.verdict_on_external_service(), verdict, "{row:?}");
        }
    }

    /// Rows of the table in docs/restarts_in_real_time.md: situation, time in ms, prepared, other prepared, asleep, missed before; verdict.
    #[test]
    fn a_process_that_starts_is_waited_for_hedged_or_replaced_as_the_table_says() {
        use Situation::{LockStep, RealTime, SetUp};
        use Verdict::{Fail, Hedge, Replace, Wait};
        let (yes, no) = (true, false);
        let rows = [
            (SetUp, 29_999, no, yes, yes, 0, Wait),
            (SetUp, 30_001, no, no, no, 0, Fail),
            (LockStep, 25, yes, yes, yes, 0, Wait),
            (LockStep, 26, yes, no, yes, 0, Hedge),
            (LockStep, 26, yes, yes, yes, 0, Replace),
            (LockStep, 26, no, yes, yes, 0, Replace),
            (LockStep, 29_999, yes, yes, no, 0, Hedge),
            (LockStep, 30_001, yes, no, no, 0, Replace),
            (RealTime, 25, yes, yes, yes, 0, Wait),
            (RealTime, 26, yes, no, no, 0, Hedge),
            (RealTime, 26, yes, yes, no, 0, Hedge),
            (RealTime, 26, yes, yes, yes, 0, Replace),
            (RealTime, 26, no, yes, yes, 0, Replace),
            (RealTime, 26, yes, yes, yes, 1, Wait),
            (RealTime, 51, yes, yes, yes, 1, Replace),
            (RealTime, 150, yes, no, yes, 0, Hedge),
            (RealTime, 151, yes, no, no, 0, Hedge),
            (RealTime, 151, yes, no, yes, 0, Replace),
            (RealTime, 151, yes, yes, no, 0, Replace),
            (RealTime, 151, no, yes, no, 0, Hedge),
            (RealTime, 151, yes, yes, no, 1, Hedge),
            (RealTime, 1_000, no, no, no, 0, Hedge),
            (RealTime, 1_001, no, no, no, 0, Replace),
            (RealTime, 1_001, yes, no, no, 0, Replace),
            (RealTime, 7_999, no, no, no, 20, Hedge),
            (RealTime, 8_001, no, no, no, 20, Replace),
        ];
        for row in rows {
            let (situation, milliseconds, was_prepared, is_other_prepared, is_asleep, missed, verdict) = row;
            let starting = StartingProcess {
                situation,
                elapsed: Duration::from_millis(milliseconds),
                waited: Duration::ZERO,
                was_prepared,
                is_other_prepared,
                is_asleep,
                longest: Duration::ZERO,
                missed,
            };
            assert_eq!(starting.verdict(), verdict, "{row:?}");
        }
    }

    /// On a busy machine a prepared process takes 0.4 s, of which it waits 0.35 s for a processor. Those in its place
    /// would start again, one after another, each to be killed after 0.15, 0.3 and 0.6 s.
    #[test]
    fn a_process_that_waits_for_a_processor_is_neither_hedged_nor_replaced_for_that() {
        let busy = |elapsed, waited| StartingProcess {
            situation: Situation::RealTime,
            elapsed: Duration::from_millis(elapsed),
            waited: Duration::from_millis(waited),
            was_prepared: true,
            is_other_prepared: true,
            is_asleep: false,
            longest: Duration::ZERO,
            missed: 0,
        };
        assert_eq!(busy(400, 375).verdict(), Verdict::Wait);
        assert_eq!(busy(400, 350).verdict(), Verdict::Hedge);
        assert_eq!(busy(400, 249).verdict(), Verdict::Replace);
        assert_eq!(busy(1_001, 1_000).verdict(), Verdict::Replace, "in any case");
    }
}
