//! Arguments of several commands.

use doctor::HostFacts;
use scenario_file::values::{ValueError, between};
use shared_types::ServiceId;

/// Longest time of an argument, s.
const LONGEST: f64 = 1e9;

/// Returns a parser of times of a flight, s.
pub(super) fn time() -> impl Fn(&str) -> Result<f64, ValueError> + Clone + Send + Sync + 'static {
    between(0.0, LONGEST, "s")
}

/// Returns a parser of durations, s.
pub(super) fn duration() -> impl Fn(&str) -> Result<f64, ValueError> + Clone + Send + Sync + 'static {
    between(1e-6, LONGEST, "s")
}

pub(super) fn service_process(name: &str) -> Result<String, ValueError> {
    if name != runtime::process::SPARE {
        service(name)?;
    }
    Ok(name.to_owned())
}

pub(super) fn service(name: &str) -> Result<ServiceId, ValueError> {
    scenario::role_of_process(name).ok_or_else(|| ValueError::Unknown {
        what: "service",
        there_is: scenario::suggest::known_names(name, &ServiceId::ALL.map(ServiceId::name)),
    })
}

/// Parses a core of this machine.
pub(super) fn core(text: &str) -> Result<usize, ValueError> {
    let core: usize = text.parse().map_err(|_| ValueError::NoNumber)?;
    let cores = HostFacts::this().cores("present");
    // If the cores are unknown, the system refuses an invalid one later.
    if cores.is_empty() || cores.iter().any(|&known| known as usize == core) {
        return Ok(core);
    }
    let last = cores.iter().max().copied().unwrap_or_default();
    let count = cores.len();
    Err(ValueError::Unknown {
        what: "core",
        there_is: format!("this machine has {count}; the last one is {last}"),
    })
}
