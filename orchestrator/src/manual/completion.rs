//! Completion of command lines by the program itself, which includes keys of scenarios, topics and services.
//!
//! The script of a shell calls `gerono` with `COMPLETE` set, and [`answer`] prints the candidates.

use std::ffi::OsStr;
use std::io;

use clap::Command;
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter, CompletionCandidate, PathCompleter};
use clap_complete::env::{CompleteEnv, Shells};
use shared_types::{ServiceId, Topic};

/// Environment variable with the name of the calling shell.
const VARIABLE: &str = "COMPLETE";

/// Returns the supported shells.
#[must_use]
pub fn shells() -> Vec<&'static str> {
    Shells::builtins().names().collect()
}

/// Prints the candidates and ends the process if a shell requests them.
pub fn answer(command: fn() -> Command) {
    CompleteEnv::with_factory(command).var(VARIABLE).complete();
}

/// Returns the completion script of a shell.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] for a shell that is not in [`shells`].
pub fn script(shell: &str) -> io::Result<Vec<u8>> {
    let shells = Shells::builtins();
    let shell = shells.completer(shell).ok_or(io::ErrorKind::InvalidInput)?;
    let mut script = Vec::new();
    shell.write_registration(VARIABLE, "gerono", "gerono", "gerono", &mut script)?;
    Ok(script)
}

/// Completes the path of a scenario file.
#[must_use]
pub fn scenario_file() -> ArgValueCompleter {
    let is_scenario = |path: &std::path::Path| path.extension() == Some(OsStr::new("toml"));
    ArgValueCompleter::new(PathCompleter::any().filter(is_scenario))
}

/// Completes `SECTION.KEY=` of `--set`.
#[must_use]
pub fn setting() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| -> Vec<CompletionCandidate> {
        let typed = current.to_string_lossy();
        let keys = scenario_file::keys_for_completion().into_iter();
        keys.filter(|(key, _)| key.starts_with(&*typed))
            .map(|(key, description)| {
                CompletionCandidate::new(format!("{key}=")).help(Some(description.into()))
            })
            .collect()
    })
}

/// Completes `KEY=` of `gerono set`.
#[must_use]
pub fn tunable_setting() -> ArgValueCompleter {
    ArgValueCompleter::new(|current: &OsStr| -> Vec<CompletionCandidate> {
        let typed = current.to_string_lossy();
        let mut keys = scenario_file::tuning::tunable_keys();
        keys.retain(|key| key.starts_with(&*typed));
        keys.into_iter()
            .map(|key| CompletionCandidate::new(format!("{key}=")))
            .collect()
    })
}

/// Returns the candidates for the name of a topic.
#[must_use]
pub fn topic() -> ArgValueCandidates {
    ArgValueCandidates::new(|| Vec::from(Topic::ALL.map(|topic| CompletionCandidate::new(topic.name()))))
}

/// Returns the candidates for the name of a service.
#[must_use]
pub fn service() -> ArgValueCandidates {
    ArgValueCandidates::new(|| {
        Vec::from(ServiceId::ALL.map(|service| CompletionCandidate::new(service.name())))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidates(completer: &ArgValueCompleter, typed: &str) -> Vec<String> {
        let found = completer.complete(OsStr::new(typed)).into_iter();
        found
            .map(|candidate| candidate.get_value().to_string_lossy().into_owned())
            .collect()
    }

    #[test]
    fn keys_of_scenarios_are_offered_with_the_sign_that_a_value_follows() {
        let found = candidates(&setting(), "controller.k");
        assert_eq!(found, ["controller.k1=", "controller.k2=", "controller.k3="]);
        assert!(candidates(&setting(), "vehicle.change.0.").contains(&"vehicle.change.0.mass=".to_owned()));
        assert_eq!(candidates(&setting(), "controler"), Vec::<String>::new());
    }

    #[test]
    fn every_shell_has_a_script_that_calls_the_program() {
        for shell in shells() {
            let script = String::from_utf8(script(shell).unwrap()).unwrap();
            assert!(script.contains("gerono"), "{shell}");
        }
        assert!(script("none").is_err());
    }
}
