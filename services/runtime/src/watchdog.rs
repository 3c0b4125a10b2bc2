//! Watchdog over a service process: ends it when its work takes too long ([`host::watchdog`]), and before its first step
//! also when its orchestrator is gone.
//!
//! In flight other parts detect the loss of the orchestrator: the system in simulated time
//! ([`crate::deployment::die_with_parent`]), the service itself in real time ([`crate::orchestrator_watchdog`]).

use std::sync::atomic::{AtomicBool, Ordering};

use host::watchdog;

use crate::crash;

/// `true` after the first step of this process as a service.
static HAS_FLOWN: AtomicBool = AtomicBool::new(false);

/// Records that this service flies: it may survive its orchestrator from now on.
pub fn take_off() {
    HAS_FLOWN.store(true, Ordering::Relaxed);
}

/// Starts the watchdog. It ends the process when its work takes too long, after `report` has sent the reason to the
/// orchestrator, and when `is_orphaned` returns `true` before the service flies.
///
/// # Errors
/// If the system has no thread left.
pub fn watch_service(
    report: impl Fn(String) + Send + 'static,
    is_orphaned: impl Fn() -> bool + Send + 'static,
) -> std::io::Result<()> {
    watchdog::watch(move |too_long| {
        if let Some(work) = too_long {
            report(work.complaint());
            crash::die();
        }
        if !HAS_FLOWN.load(Ordering::Relaxed) && is_orphaned() {
            crash::die();
        }
    })
}
