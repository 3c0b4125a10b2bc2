//! Other runs: live ones, which compete for the processor, and dead ones, which left files behind.

use std::io;
use std::path::PathBuf;

use super::check::Check;
use run_client::run_root::RunRoots;
use run_client::runs::MachineRun;

/// Checks whether other runs of any user are alive on this machine.
#[must_use]
pub fn live(found: &io::Result<Vec<MachineRun>>) -> Check {
    const NAME: &str = "other runs";
    match found {
        Err(error) => Check::red(
            NAME,
            format!("cannot look for live runs in /proc: {error}"),
            "mount /proc; without it no command finds a run",
        ),
        Ok(found) if found.is_empty() => Check::green(NAME, "none is alive"),
        Ok(found) => Check::yellow(
            NAME,
            format!(
                "alive: {}; they take time from this one's services",
                described(found)
            ),
            "let them end, or keep them on cores of their own (`deployment.core`)",
        ),
    }
}

/// Checks whether dead runs left files behind.
#[must_use]
pub fn dead(found: &io::Result<RunRoots>) -> Check {
    const NAME: &str = "dead runs";
    match found {
        Err(error) => unreadable(NAME, error),
        Ok(found) if found.dead.is_empty() => Check::green(NAME, "dead runs have left nothing"),
        Ok(found) => Check::yellow(
            NAME,
            format!("left by dead runs: {}", names(&found.dead)),
            "gerono clean (the next run does it as well)",
        ),
    }
}

fn unreadable(name: &'static str, error: &io::Error) -> Check {
    Check::red(
        name,
        format!("a run would have no place for its bookkeeping: {error}"),
        "do as it says; or let this user write to $XDG_RUNTIME_DIR, or leave it unset for /dev/shm",
    )
}

fn described(runs: &[MachineRun]) -> String {
    let describe = |run: &MachineRun| format!("{} of {}", run.folder.display(), run.owner);
    runs.iter().map(describe).collect::<Vec<_>>().join(", ")
}

fn names(places: &[PathBuf]) -> String {
    let names: Vec<_> = places.iter().map(|place| place.display().to_string()).collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::CheckOutcome::{Green, Red, Yellow};
    use super::*;

    #[test]
    fn what_dead_runs_have_left_is_yellow_and_no_place_for_runs_is_red() {
        let place = PathBuf::from("/dev/shm/gerono-0/77-0");
        let with = |dead: &[PathBuf]| {
            Ok(RunRoots {
                dead: dead.to_vec(),
                live: Vec::new(),
            })
        };
        let one = std::slice::from_ref(&place);
        for (found, verdict) in [
            (with(&[]), Green),
            (with(one), Yellow),
            (Err(io::Error::from(io::ErrorKind::PermissionDenied)), Red),
        ] {
            assert_eq!(dead(&found).verdict, verdict, "{found:?}");
        }
        let check = dead(&with(one));
        assert!(check.figure.contains("77-0") && check.fix.unwrap().contains("gerono clean"));
    }

    #[test]
    fn no_other_run_is_green_and_no_view_of_the_processes_is_red() {
        assert_eq!(live(&Ok(Vec::new())).verdict, Green);
        let error = io::Error::from(io::ErrorKind::NotFound);
        assert_eq!(live(&Err(error)).verdict, Red);
    }
}
