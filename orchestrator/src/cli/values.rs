//! What several commands are given.

use shared_types::ServiceId;

use doctor::Host;

pub(super) fn service_process(name: &str) -> Result<String, String> {
    if name != runtime::process::SPARE {
        service(name)?;
    }
    Ok(name.to_owned())
}

pub(super) fn service(name: &str) -> Result<ServiceId, String> {
    scenario::role_of_process(name)
        .ok_or_else(|| scenario::suggest::known_names(name, &ServiceId::ALL.map(ServiceId::name)))
}

/// A core that this machine has.
pub(super) fn core(text: &str) -> Result<usize, String> {
    let core: usize = text.parse().map_err(|_| "this is no number".to_owned())?;
    let cores = Host::this().cores("present");
    // A system that does not tell refuses by itself.
    if cores.is_empty() || cores.iter().any(|&known| known as usize == core) {
        return Ok(core);
    }
    let last = cores.iter().max().copied().unwrap_or_default();
    let count = cores.len();
    Err(format!(
        "there is no such core; this machine has {count}, the last of which is {last}"
    ))
}
