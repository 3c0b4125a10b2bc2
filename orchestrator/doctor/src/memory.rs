//! Memory: shared memory, locked memory, huge pages.

use std::path::Path;

use runtime::deployment::{LOCKED_MEMORY, Setting};

use super::check::{Check, bytes};
use super::host::{CAP_IPC_LOCK, HostFacts};
use super::needs::Needs;

/// Number of runs whose shared memory must fit for a green verdict: several may run at once.
const GREEN_RUNS: u64 = 4;

/// Checks whether shared memory has room for the samples of a run.
#[must_use]
pub fn shared(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "shared memory";
    let fix = "mount a larger one: `mount -o remount,size=256M /dev/shm`; in a container start it with --shm-size=256m; \
               or remove what fills it";
    let space = match host.space(Path::new("/dev/shm")) {
        Ok(space) => space,
        Err(error) => {
            let fix = "mount it: `mount -t tmpfs tmpfs /dev/shm`";
            return Check::red(NAME, format!("there is no /dev/shm ({error})"), fix);
        }
    };
    let figure = format!(
        "{} of {} free in /dev/shm, a run needs {}",
        bytes(space.free),
        bytes(space.total),
        bytes(needs.shared_memory)
    );
    if space.free < needs.shared_memory {
        Check::red(NAME, figure, fix)
    } else if space.free < GREEN_RUNS * needs.shared_memory {
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure)
    }
}

/// Checks whether memory may be locked.
#[must_use]
pub fn locked(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "locked memory";
    let fix = Setting::LockMemory.fix();
    let limit = host.limit("Max locked memory");
    let is_privileged = host.has_capability(CAP_IPC_LOCK);
    let shown = match limit {
        _ if is_privileged => "no limit for this process (CAP_IPC_LOCK)".to_owned(),
        Some(u64::MAX) => "no limit".to_owned(),
        Some(limit) => format!(
            "at most {}, a service may need {}",
            bytes(limit),
            bytes(LOCKED_MEMORY)
        ),
        None => "the limit cannot be read".to_owned(),
    };
    let may = is_privileged || limit.is_some_and(|limit| limit >= LOCKED_MEMORY);
    match (may, needs.lock_memory, needs.has_scenario) {
        (true, _, _) => Check::green(NAME, shown),
        (false, true, _) => {
            let figure = format!("the scenario locks it, but {shown}");
            Check::refused(needs.is_strict, NAME, figure, fix)
        }
        (false, false, true) => Check::green(NAME, format!("{shown}; the scenario locks none")),
        (false, false, false) => {
            let figure = format!("{shown}; `deployment.lock_memory` would be refused");
            Check::yellow(NAME, figure, fix)
        }
    }
}

/// Checks transparent huge pages: with `always` the kernel migrates pages in flight and stalls their users.
#[must_use]
pub fn huge_pages(host: &HostFacts) -> Check {
    const NAME: &str = "huge pages";
    let choices = host.text("sys/kernel/mm/transparent_hugepage/enabled");
    let chosen = choices
        .as_deref()
        .and_then(|choices| Some(choices.split_once('[')?.1.split_once(']')?.0));
    match chosen {
        None => Check::green(NAME, "not in this system"),
        Some("always") => Check::yellow(
            NAME,
            "transparent for all (`always`): pages are moved in flight",
            "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled",
        ),
        Some(other) => Check::green(NAME, format!("`{other}`")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{self, Green, Red, Yellow};
    use super::super::host::{Space, fake};
    use super::*;

    #[test]
    fn shared_memory_is_judged_by_what_a_run_needs() {
        let needs = Needs::ordinary();
        let need = needs.shared_memory;
        for (free, verdict) in [
            (need - 1, Red),
            (need, Yellow),
            (4 * need - 1, Yellow),
            (4 * need, Green),
        ] {
            let (_folder, host) = fake(
                &[],
                Some(Space {
                    total: 5 * need,
                    free,
                }),
            );
            let check = shared(&host, &needs);
            assert_eq!(check.verdict, verdict, "{check:?}");
            assert_eq!(check.fix.is_none(), verdict == Green);
        }
        let (_folder, host) = fake(&[], None);
        assert_eq!(shared(&host, &needs).verdict, Red);
    }

    fn locked_verdict(limit: &str, capabilities: &str, needs: &Needs) -> CheckOutcome {
        let limits = format!("Max locked memory         65536              {limit}      bytes\n");
        let status = format!("CapEff:\t{capabilities}\n");
        let (_folder, host) = fake(
            &[("proc/self/limits", &limits), ("proc/self/status", &status)],
            None,
        );
        let check = locked(&host, needs);
        assert_eq!(check.fix.is_none(), check.verdict == Green);
        check.verdict
    }

    #[test]
    fn locked_memory_is_judged_by_what_the_scenario_asks_for() {
        const NONE: &str = "0000000000000000";
        const IPC_LOCK: &str = "0000000000004000";
        let unstated = Needs::ordinary();
        let indifferent = Needs {
            has_scenario: true,
            ..unstated.clone()
        };
        let asking = Needs {
            lock_memory: true,
            ..indifferent.clone()
        };
        let insisting = Needs {
            is_strict: true,
            ..asking.clone()
        };
        let enough = LOCKED_MEMORY.to_string();
        let cases = [&unstated, &indifferent, &asking, &insisting];
        for (limit, capabilities, verdicts) in [
            ("8388608", NONE, [Yellow, Green, Yellow, Red]),
            ("8388608", IPC_LOCK, [Green; 4]),
            ("unlimited", NONE, [Green; 4]),
            (&enough, NONE, [Green; 4]),
            ("nonsense", NONE, [Yellow, Green, Yellow, Red]),
        ] {
            let found = cases.map(|needs| locked_verdict(limit, capabilities, needs));
            assert_eq!(found, verdicts, "{limit} {capabilities}");
        }
    }

    #[test]
    fn huge_pages_are_poor_only_if_made_for_all() {
        for (choices, verdict) in [
            (Some("[always] madvise never"), Yellow),
            (Some("always [madvise] never"), Green),
            (Some("always madvise [never]"), Green),
            (None, Green),
        ] {
            let files: Vec<_> = choices
                .map(|text| ("sys/kernel/mm/transparent_hugepage/enabled", text))
                .into_iter()
                .collect();
            let (_folder, host) = fake(&files, None);
            assert_eq!(huge_pages(&host).verdict, verdict, "{choices:?}");
        }
    }
}
