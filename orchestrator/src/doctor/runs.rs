//! Other runs: live ones, which take time from this one, and dead ones, which have left something behind.

use std::io;
use std::path::PathBuf;

use super::check::Check;
use crate::run_root::Found;

/// Whether another run is alive.
#[must_use]
pub fn live(found: &io::Result<Found>) -> Check {
    const NAME: &str = "other runs";
    match found {
        Err(error) => unreadable(NAME, error),
        Ok(found) if found.live.is_empty() => Check::green(NAME, "none is alive"),
        Ok(found) => Check::yellow(
            NAME,
            format!(
                "alive: {}; they take time from this one's services",
                names(&found.live)
            ),
            "let them end, or keep them on cores of their own (`deployment.core`)",
        ),
    }
}

/// Whether dead runs have left something behind.
#[must_use]
pub fn leavings(found: &io::Result<Found>) -> Check {
    const NAME: &str = "leavings";
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
        "let this user write to $XDG_RUNTIME_DIR, or leave it unset for /dev/shm",
    )
}

fn names(places: &[PathBuf]) -> String {
    let names: Vec<_> = places.iter().map(|place| place.display().to_string()).collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{Green, Red, Yellow};
    use super::*;

    #[test]
    fn runs_are_poor_alive_and_dead() {
        let place = PathBuf::from("/dev/shm/gerono-0/77-0");
        let with = |dead: &[PathBuf], live: &[PathBuf]| {
            Ok(Found {
                dead: dead.to_vec(),
                live: live.to_vec(),
            })
        };
        let one = std::slice::from_ref(&place);
        for (found, verdicts) in [
            (with(&[], &[]), [Green, Green]),
            (with(one, &[]), [Green, Yellow]),
            (with(&[], one), [Yellow, Green]),
            (Err(io::Error::from(io::ErrorKind::PermissionDenied)), [Red, Red]),
        ] {
            assert_eq!(
                [live(&found).verdict, leavings(&found).verdict],
                verdicts,
                "{found:?}"
            );
        }
        let check = leavings(&with(one, &[]));
        assert!(check.figure.contains("77-0") && check.fix.unwrap().contains("gerono clean"));
    }
}
