//! `gerono clean`: removes what dead runs have left.

use live::run_root;

use super::{Failure, print};

/// `gerono clean`.
///
/// # Errors
/// [`Failure`] if something cannot be removed.
pub fn clean() -> Result<(), Failure> {
    let swept = run_root::clean().map_err(|error| {
        let reason = format!("cannot remove what dead runs have left: {error}");
        Failure::trouble(reason)
    })?;
    for place in &swept.removed {
        print(format!("removed {}\n", place.display()));
    }
    for place in &swept.live {
        print(format!("in use  {}\n", place.display()));
    }
    if swept.removed.is_empty() {
        print("nothing was left by dead runs\n");
    }
    Ok(())
}
