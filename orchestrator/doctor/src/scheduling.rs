//! Scheduling: real-time priority and throttling.

use runtime::deployment::{FIFO_PRIORITY, Setting};

use super::check::Check;
use super::host::{CAP_SYS_NICE, HostFacts};
use super::needs::Needs;

/// Share of a core below which throttling stops services that behave well.
const LEAST_SHARE: f64 = 0.5;

/// Checks whether real-time priorities are permitted.
#[must_use]
pub fn priority(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "real-time priority";
    let fix = Setting::Priority.fix();
    let limit = host.limit("Max realtime priority");
    let is_privileged = host.has_capability(CAP_SYS_NICE);
    let shown = match limit {
        _ if is_privileged => "up to 99 (CAP_SYS_NICE)".to_owned(),
        Some(u64::MAX) => "up to 99".to_owned(),
        Some(0) => "not permitted".to_owned(),
        Some(limit) => format!("up to {limit}"),
        None => "the limit cannot be read".to_owned(),
    };
    let wanted = needs.priority.unwrap_or(FIFO_PRIORITY);
    let may = is_privileged || limit.is_some_and(|limit| limit >= u64::from(wanted));
    match (may, needs.priority, needs.has_scenario) {
        (true, _, _) => Check::green(NAME, shown),
        (false, Some(priority), _) => {
            let figure = format!("the scenario states {priority}, but: {shown}");
            Check::refused(needs.is_strict, NAME, figure, fix)
        }
        (false, None, true) => Check::green(NAME, format!("{shown}; the scenario states none")),
        (false, None, false) => {
            let figure = format!("{shown}; `deployment.priority` would be refused");
            Check::yellow(NAME, figure, fix)
        }
    }
}

/// Checks the share of a core that real-time work may use before it is throttled.
#[must_use]
pub fn throttling(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "real-time throttling";
    let fix = "sysctl -w kernel.sched_rt_runtime_us=950000";
    let number = |name: &str| -> Option<i64> { host.text(&format!("proc/sys/kernel/{name}"))?.parse().ok() };
    let (Some(runtime), Some(period)) = (number("sched_rt_runtime_us"), number("sched_rt_period_us")) else {
        return Check::green(NAME, "not in this system");
    };
    let share = runtime as f64 / period.max(1) as f64;
    let figure = format!(
        "real-time work may take {:.0} % of a core",
        100.0 * share.min(1.0)
    );
    if runtime < 0 || share >= 1.0 {
        Check::green(
            NAME,
            "none: a real-time service that never ends keeps its core for itself",
        )
    } else if runtime == 0 && needs.priority.is_some() {
        Check::refused(needs.is_strict, NAME, figure, fix)
    } else if share < LEAST_SHARE {
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure + ", far more than the services do")
    }
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{self, Green, Red, Yellow};
    use super::super::host::fake;
    use super::*;

    fn cases() -> [Needs; 4] {
        let unstated = Needs::ordinary();
        let indifferent = Needs {
            has_scenario: true,
            ..unstated.clone()
        };
        let asking = Needs {
            priority: Some(30),
            ..indifferent.clone()
        };
        let insisting = Needs {
            is_strict: true,
            ..asking.clone()
        };
        [unstated, indifferent, asking, insisting]
    }

    fn priority_verdict(limit: &str, capabilities: &str, needs: &Needs) -> CheckOutcome {
        let limits = format!("Max realtime priority     0                    {limit}\n");
        let status = format!("CapEff:\t{capabilities}\n");
        let (_folder, host) = fake(
            &[("proc/self/limits", &limits), ("proc/self/status", &status)],
            None,
        );
        let check = priority(&host, needs);
        assert_eq!(check.fix.is_none(), check.verdict == Green);
        check.verdict
    }

    #[test]
    fn a_priority_is_judged_by_what_the_scenario_states() {
        const NONE: &str = "0000000000000000";
        const SYS_NICE: &str = "0000000000800000";
        for (limit, capabilities, verdicts) in [
            ("0", NONE, [Yellow, Green, Yellow, Red]),
            ("20", NONE, [Green, Green, Yellow, Red]),
            ("30", NONE, [Green; 4]),
            ("unlimited", NONE, [Green; 4]),
            ("0", SYS_NICE, [Green; 4]),
            ("nonsense", NONE, [Yellow, Green, Yellow, Red]),
        ] {
            let found = cases().map(|needs| priority_verdict(limit, capabilities, &needs));
            assert_eq!(found, verdicts, "{limit} {capabilities}");
        }
    }

    #[test]
    fn throttling_is_poor_only_if_it_holds_back_who_does_no_wrong() {
        for (runtime, verdicts) in [
            ("-1", [Green; 4]),
            ("1000000", [Green; 4]),
            ("950000", [Green; 4]),
            ("300000", [Yellow; 4]),
            ("0", [Yellow, Yellow, Yellow, Red]),
        ] {
            let (_folder, host) = fake(
                &[
                    ("proc/sys/kernel/sched_rt_runtime_us", runtime),
                    ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
                ],
                None,
            );
            let found = cases().map(|needs| throttling(&host, &needs).verdict);
            assert_eq!(found, verdicts, "{runtime}");
        }
        let (_folder, host) = fake(&[], None);
        assert_eq!(throttling(&host, &Needs::ordinary()).verdict, Green);
    }
}
