//! The processor: cores, isolation, frequency governor and clock source.

use runtime::deployment::Setting;

use super::check::Check;
use super::host::{HostFacts, shown_cores};
use super::needs::Needs;

/// Clock sources that are read without a system call.
const FAST_CLOCKS: [&str; 5] = [
    "tsc",
    "kvm-clock",
    "hyperv_clocksource_tsc_page",
    "arch_sys_counter",
    "riscv_clocksource",
];

/// Clock sources that advance with the timer interrupt, in steps of milliseconds.
const COARSE_CLOCKS: [&str; 2] = ["jiffies", "refined-jiffies"];

/// Returns the cores that a run may use: those in the affinity mask, and isolated ones, which are in no mask by
/// default.
fn usable_cores(host: &HostFacts) -> Vec<u32> {
    let mut cores = host.allowed_cores();
    cores.extend(host.cores("isolated"));
    cores.sort_unstable();
    cores.dedup();
    cores
}

/// Checks whether a core is left for the recorder, and whether the cores that the scenario sets are usable.
#[must_use]
pub fn cores(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "cores";
    let usable = usable_cores(host);
    let missing: Vec<u32> = needs
        .cores
        .iter()
        .copied()
        .filter(|core| !usable.contains(core))
        .collect();
    let left = usable.iter().filter(|core| !needs.cores.contains(core)).count();
    let figure = format!("this process may use {}", shown_cores(&usable));
    if usable.is_empty() {
        Check::yellow(NAME, "cannot be read", "mount /proc")
    } else if !missing.is_empty() {
        let figure = format!("{figure}; the scenario states {}", shown_cores(&missing));
        Check::refused(needs.is_strict, NAME, figure, Setting::Core.fix())
    } else if left == 0 || usable.len() == 1 {
        let figure = format!("{figure}: the recorder shares one with services");
        let fix = "leave a core free of services, or give the machine another one";
        Check::yellow(NAME, figure, fix)
    } else {
        Check::green(NAME, figure)
    }
}

/// Checks whether the cores that the scenario sets are isolated from other work.
#[must_use]
pub fn isolation(host: &HostFacts, needs: &Needs) -> Check {
    const NAME: &str = "isolation of cores";
    let isolated = host.cores("isolated");
    let tickless = host.cores("nohz_full");
    let figure = format!(
        "isolated: {}; without timer ticks: {}",
        shown_cores(&isolated),
        shown_cores(&tickless)
    );
    let shared: Vec<u32> = needs
        .cores
        .iter()
        .copied()
        .filter(|core| !isolated.contains(core))
        .collect();
    if !shared.is_empty() {
        let list: Vec<_> = shared.iter().map(u32::to_string).collect();
        let list = list.join(",");
        let figure = format!("{figure}; other work comes to {}, too", shown_cores(&shared));
        let fix = format!("boot the kernel with `isolcpus={list} nohz_full={list}` (docs/deployment.md)");
        Check::yellow(NAME, figure, fix)
    } else if needs.has_scenario && needs.cores.is_empty() && !isolated.is_empty() {
        let fix = format!("state `deployment.core`, for example {}", isolated[0]);
        Check::yellow(NAME, format!("{figure}; the scenario does not use them"), fix)
    } else {
        Check::green(NAME, figure)
    }
}

/// Checks whether the cores run at full frequency.
#[must_use]
pub fn governor(host: &HostFacts) -> Check {
    const NAME: &str = "frequency governor";
    let governor_of = |core: &u32| {
        let file = format!("sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor");
        Some((*core, host.text(&file)?))
    };
    let governors: Vec<(u32, String)> = usable_cores(host).iter().filter_map(governor_of).collect();
    let slow = governors.iter().find(|(_, governor)| governor != "performance");
    match (governors.first(), slow) {
        (None, _) => Check::green(NAME, "none: the frequency is not this system's to choose"),
        (Some(_), None) => Check::green(NAME, "`performance`"),
        (Some(_), Some((core, governor))) => Check::yellow(
            NAME,
            format!("`{governor}` on core {core}: it may sleep deeply and wake slowly"),
            "cpupower frequency-set -g performance",
        ),
    }
}

/// Checks the cost and the resolution of the clock.
#[must_use]
pub fn clock_source(host: &HostFacts) -> Check {
    const NAME: &str = "clock source";
    const FOLDER: &str = "sys/devices/system/clocksource/clocksource0";
    let Some(current) = host.text(&format!("{FOLDER}/current_clocksource")) else {
        return Check::yellow(NAME, "cannot be read", "mount /sys");
    };
    let available = host
        .text(&format!("{FOLDER}/available_clocksource"))
        .unwrap_or_default();
    let better = available
        .split_whitespace()
        .find(|clock| FAST_CLOCKS.contains(clock));
    let fix = match better {
        Some(better) => format!("echo {better} > /{FOLDER}/current_clocksource"),
        None => {
            "no better one is available: see `dmesg | grep -i clocksource` for why, or choose another machine"
                .to_owned()
        }
    };
    if FAST_CLOCKS.contains(&current.as_str()) {
        Check::green(NAME, format!("`{current}`"))
    } else if COARSE_CLOCKS.contains(&current.as_str()) {
        Check::red(
            NAME,
            format!("`{current}` counts milliseconds: no step can be timed"),
            fix,
        )
    } else {
        Check::yellow(
            NAME,
            format!("`{current}`: every look at the clock costs about 1 µs"),
            fix,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{self, Green, Red, Yellow};
    use super::super::host::fake;
    use super::*;

    const CPU: &str = "sys/devices/system/cpu";

    fn judged(
        check: impl Fn(&HostFacts, &Needs) -> Check,
        allowed: &str,
        isolated: &str,
        needs: &Needs,
    ) -> Check {
        let status = format!("Cpus_allowed_list:\t{allowed}\n");
        let file = format!("{CPU}/isolated");
        let (_folder, host) = fake(&[("proc/self/status", &status), (&file, isolated)], None);
        let check = check(&host, needs);
        assert_eq!(check.fix.is_none(), check.verdict == Green);
        check
    }

    fn on(cores: &[u32], is_strict: bool) -> Needs {
        Needs {
            has_scenario: true,
            cores: cores.to_vec(),
            is_strict,
            ..Needs::ordinary()
        }
    }

    #[test]
    fn cores_are_judged_by_those_that_are_stated() {
        for (allowed, isolated, stated, verdicts) in [
            ("0-3", "", &[][..], [Green, Green]),
            ("0-3", "", &[3], [Green, Green]),
            ("0-3", "", &[4], [Yellow, Red]),
            ("0-1", "2-3", &[3], [Green, Green]),
            ("0-1", "", &[0, 1], [Yellow, Yellow]),
            ("0", "", &[], [Yellow, Yellow]),
            ("", "", &[], [Yellow, Yellow]),
        ] {
            let found: [CheckOutcome; 2] = [false, true]
                .map(|is_strict| judged(cores, allowed, isolated, &on(stated, is_strict)).verdict);
            assert_eq!(found, verdicts, "{allowed} {isolated} {stated:?}");
        }
    }

    #[test]
    fn stated_cores_are_to_be_isolated_and_isolated_ones_to_be_used() {
        for (isolated, needs, verdict) in [
            ("", on(&[], false), Green),
            ("", on(&[1], false), Yellow),
            ("2-3", on(&[2], false), Green),
            ("2-3", on(&[1, 2], true), Yellow),
            ("2-3", on(&[], false), Yellow),
            ("2-3", Needs::ordinary(), Green),
        ] {
            let check = judged(isolation, "0-1", isolated, &needs);
            assert_eq!(check.verdict, verdict, "{isolated} {:?}", needs.cores);
        }
        let fix = judged(isolation, "0-3", "", &on(&[2, 3], false)).fix.unwrap();
        assert!(fix.contains("isolcpus=2,3 nohz_full=2,3"), "{fix}");
    }

    #[test]
    fn one_slow_governor_is_enough() {
        for (governors, verdict) in [
            (&[][..], Green),
            (&["performance", "performance"], Green),
            (&["performance", "powersave"], Yellow),
            (&["schedutil", "schedutil"], Yellow),
        ] {
            let paths: Vec<String> = (0..governors.len())
                .map(|core| format!("{CPU}/cpu{core}/cpufreq/scaling_governor"))
                .collect();
            let mut files: Vec<(&str, &str)> = paths
                .iter()
                .zip(governors)
                .map(|(path, governor)| (path.as_str(), *governor))
                .collect();
            files.push(("proc/self/status", "Cpus_allowed_list:\t0-1\n"));
            let (_folder, host) = fake(&files, None);
            let check = governor(&host);
            assert_eq!(check.verdict, verdict, "{check:?}");
        }
    }

    #[test]
    fn clocks_are_judged_by_what_a_look_at_them_costs() {
        for (current, available, verdict, fix) in [
            ("tsc\n", "tsc hpet acpi_pm", Green, ""),
            ("kvm-clock", "kvm-clock tsc", Green, ""),
            ("hpet", "hpet acpi_pm", Yellow, "no better one is available"),
            ("acpi_pm", "tsc acpi_pm", Yellow, "echo tsc > "),
            ("jiffies", "jiffies", Red, "no better one is available"),
        ] {
            const FOLDER: &str = "sys/devices/system/clocksource/clocksource0";
            let files = [
                (&*format!("{FOLDER}/current_clocksource"), current),
                (&*format!("{FOLDER}/available_clocksource"), available),
            ];
            let (_folder, host) = fake(&files, None);
            let check = clock_source(&host);
            assert_eq!(check.verdict, verdict, "{check:?}");
            assert!(check.fix.unwrap_or_default().starts_with(fix), "{current}");
        }
        let (_folder, host) = fake(&[], None);
        assert_eq!(clock_source(&host).verdict, Yellow);
    }
}
