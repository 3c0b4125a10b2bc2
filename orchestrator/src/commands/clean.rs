//! `gerono clean`: removes leftovers of dead runs.

use run_client::{run_root, runs};

use super::{Failure, print};

/// `gerono clean`.
///
/// # Errors
/// [`Failure`] if a leftover cannot be removed.
pub fn clean() -> Result<(), Failure> {
    let failed = |error| Failure::trouble(format!("cannot remove leftovers of dead runs: {error}"));
    // First, because a process holds the lock of its run's folder.
    let ended = runs::end_dead().map_err(failed)?;
    let swept = run_root::clean().map_err(failed)?;
    for pid in &ended {
        print(format!("killed  process {pid}, which a signal had stopped\n"));
    }
    for path in &swept.removed {
        print(format!("removed {}\n", path.display()));
    }
    for path in &swept.live {
        print(format!("in use  {}\n", path.display()));
    }
    if swept.removed.is_empty() && ended.is_empty() {
        print("no leftovers of dead runs\n");
    }
    Ok(())
}
