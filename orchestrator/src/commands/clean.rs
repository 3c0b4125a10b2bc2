//! `gerono clean`: removes what dead runs have left.

use run_client::{run_root, runs};

use super::{Failure, print};

/// `gerono clean`.
///
/// # Errors
/// [`Failure`] if something cannot be removed.
pub fn clean() -> Result<(), Failure> {
    let failed = |error| Failure::trouble(format!("cannot remove what dead runs have left: {error}"));
    // First: a process holds the lock of its run's place.
    let ended = runs::end_dead().map_err(failed)?;
    let swept = run_root::clean().map_err(failed)?;
    for pid in &ended {
        print(format!("killed  process {pid}, which a signal had stopped\n"));
    }
    for place in &swept.removed {
        print(format!("removed {}\n", place.display()));
    }
    for place in &swept.live {
        print(format!("in use  {}\n", place.display()));
    }
    if swept.removed.is_empty() && ended.is_empty() {
        print("nothing was left by dead runs\n");
    }
    Ok(())
}
