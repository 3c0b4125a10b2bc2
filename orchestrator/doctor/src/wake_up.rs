//! Wake-up latency: the minimum delay of every step of a flight in real time.

use std::time::Duration;

use runtime::deployment::{self, Refusal};
use runtime::flight_clock::{monotonic_ns, nap_until};
use scenario::ServiceDeployment;
use serde::Serialize;
use shared_types::service::{nanoseconds, seconds};

use super::check::Check;
use super::host::HostFacts;
use super::needs::Needs;
use super::processor;

/// Period of the wake-ups, ns.
const PERIOD_NS: u64 = 1_000_000;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Lateness {
    pub count: usize,
    /// Median, s.
    pub p50: f64,
    /// 99th percentile, s.
    pub p99: f64,
    /// 99.9th percentile, s.
    pub p99_9: f64,
    /// Maximum, s.
    pub max: f64,
}

impl Lateness {
    /// Computes the quantiles of a non-empty list of measurements, ns.
    fn of(mut measured: Vec<u64>) -> Self {
        measured.sort_unstable();
        let last = measured.len() - 1;
        // The smallest measurement not exceeded by `share` of 1000.
        let per_mille = |share: usize| {
            let rank = (measured.len() * share).div_ceil(1000);
            seconds(measured[rank.saturating_sub(1)])
        };
        Self {
            count: measured.len(),
            p50: per_mille(500),
            p99: per_mille(990),
            p99_9: per_mille(999),
            max: seconds(measured[last]),
        }
    }

    /// Returns the quantiles with their names.
    #[must_use]
    pub fn rows(&self) -> [(&'static str, f64); 4] {
        [
            ("p50", self.p50),
            ("p99", self.p99),
            ("p99.9", self.p99_9),
            ("max", self.max),
        ]
    }
}

/// Sleeps until deadlines one millisecond apart, with the deployment of a service; `None` if it was stopped.
///
/// # Panics
/// Never: the measuring thread does not.
#[must_use]
pub fn measure(
    settings: ServiceDeployment,
    lasts: Duration,
    stopped: impl Fn() -> bool + Send,
) -> Option<Lateness> {
    std::thread::scope(|scope| {
        // A separate thread: core and priority do not outlive the measurement.
        let sleeper = scope.spawn(|| {
            let settings = ServiceDeployment {
                lock_memory: None,
                ..settings
            };
            // Refused settings are reported by the checks of the limits.
            let _reported_elsewhere: Vec<Refusal> = deployment::apply(&settings);
            measure_wake_ups(lasts, stopped)
        });
        sleeper.join().expect("the measuring thread does not panic")
    })
}

fn measure_wake_ups(lasts: Duration, stopped: impl Fn() -> bool) -> Option<Lateness> {
    let count = (nanoseconds(lasts.as_secs_f64()) / PERIOD_NS).max(1);
    let mut measured = Vec::with_capacity(usize::try_from(count).unwrap_or_default());
    let mut deadline = monotonic_ns();
    for _ in 0..count {
        deadline += PERIOD_NS;
        // A signal wakes the thread early: check for a stop, then sleep on.
        while monotonic_ns() < deadline {
            if stopped() {
                return None;
            }
            nap_until(deadline);
        }
        measured.push(monotonic_ns() - deadline);
    }
    Some(Lateness::of(measured))
}

/// Checks whether wake-ups are punctual: a step starts without missing inputs once its `grace` has passed.
#[must_use]
pub fn judge(lateness: &Lateness, host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "wake-ups";
    let fix = fix(host, needs);
    let figure = format!(
        "99 of 100 at most {} late, 999 of 1000 at most {}; a step waits {} for its inputs",
        microseconds(lateness.p99),
        microseconds(lateness.p99_9),
        microseconds(needs.grace)
    );
    if lateness.p99 > needs.grace {
        Check::red(NAME, figure, fix)
    } else if lateness.p99_9 > needs.grace / 2.0 {
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure)
    }
}

/// Returns the changes that would reduce the latency, without those already made.
fn fix(host: &HostFacts, needs: &Needs) -> String {
    let ServiceDeployment { core, priority, .. } = needs.highest_priority;
    let isolated = host.cores("isolated");
    let has_own_core = core.is_some_and(|core| isolated.contains(&core));
    let has_governor = processor::governor(host).fix.is_none();
    let changes = [
        (priority.is_none(), "set `deployment.priority`"),
        (!has_own_core, "set an isolated `deployment.core`"),
        (!has_governor, "choose the governor `performance`"),
        (true, "stop other programs"),
    ];
    let changes = changes.iter().filter(|(is_missing, _)| *is_missing);
    let changes: Vec<_> = changes.map(|(_, change)| *change).collect();
    changes.join("; ") + " (docs/deployment.md)"
}

/// Formats a time as microseconds.
#[must_use]
pub fn microseconds(time: f64) -> String {
    format!("{:.0} µs", 1e6 * time)
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{Green, Red, Yellow};
    use super::super::host::fake;
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let lateness = Lateness::of((1..=1000).rev().collect());
        assert_eq!(lateness.count, 1000);
        let nanoseconds = lateness.rows().map(|(_, value)| (value * 1e9).round());
        assert_eq!(nanoseconds, [500.0, 990.0, 999.0, 1000.0]);
        let one = Lateness::of(vec![7]);
        assert!(one.rows().iter().all(|(_, value)| *value == 7e-9));
    }

    #[test]
    fn wake_ups_are_judged_by_how_long_a_step_waits() {
        let needs = Needs::ordinary();
        for (p99, p99_9, verdict) in [
            (1e-4, 1e-3, Green),
            (1e-4, 1.1e-3, Yellow),
            (2e-3, 5e-3, Yellow),
            (2.1e-3, 5e-3, Red),
        ] {
            let lateness = Lateness {
                count: 3000,
                p50: 5e-5,
                p99,
                p99_9,
                max: 1e-2,
            };
            let (_folder, host) = fake(&[], None);
            let check = judge(&lateness, &host, &needs);
            assert_eq!(check.verdict, verdict, "{check:?}");
            assert_eq!(check.fix.is_none(), verdict == Green);
        }
    }

    #[test]
    fn what_is_set_already_is_no_fix() {
        const CPU: &str = "sys/devices/system/cpu";
        let isolated = format!("{CPU}/isolated");
        let governor = format!("{CPU}/cpu3/cpufreq/scaling_governor");
        let status = "Cpus_allowed_list:\t0-1\n";
        let fix_of = |core, priority, governs: &str| {
            let files = [
                ("proc/self/status", status),
                (isolated.as_str(), "3"),
                (governor.as_str(), governs),
            ];
            let (_folder, host) = fake(&files, None);
            let mut needs = Needs::ordinary();
            (needs.highest_priority.core, needs.highest_priority.priority) = (core, priority);
            fix(&host, &needs)
        };
        assert_eq!(
            fix_of(None, None, "powersave"),
            "set `deployment.priority`; set an isolated `deployment.core`; choose the governor `performance`; stop other \
             programs (docs/deployment.md)"
        );
        assert_eq!(
            fix_of(Some(3), Some(30), "performance"),
            "stop other programs (docs/deployment.md)"
        );
        assert_eq!(
            fix_of(Some(1), Some(30), "performance"),
            "set an isolated `deployment.core`; stop other programs (docs/deployment.md)"
        );
    }

    #[test]
    fn nobody_wakes_early_and_who_is_stopped_measures_nothing() {
        let settings = ServiceDeployment::default();
        let lateness = measure(settings, Duration::from_millis(20), || false).unwrap();
        assert_eq!(lateness.count, 20);
        assert!(lateness.p50 <= lateness.p99 && lateness.p99_9 <= lateness.max);
        assert_eq!(measure(settings, Duration::from_secs(3600), || true), None);
    }
}
