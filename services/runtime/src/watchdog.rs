//! Watchdog over a service process: it ends when its work takes too long ([`host::watchdog`]), and while it has not flown yet
//! also when its orchestrator is gone.
//!
//! In flight other parts do the latter: the system in simulated time ([`crate::deployment::die_with_parent`]), the service
//! itself in real time ([`crate::orchestrator_watchdog`]).

use std::sync::atomic::{AtomicBool, Ordering};

use host::watchdog;

use crate::crash;

/// `true` once this process has flown as a service.
static HAS_FLOWN: AtomicBool = AtomicBool::new(false);

/// Records that this service flies: from now on it may outlive its orchestrator.
pub fn take_off() {
    HAS_FLOWN.store(true, Ordering::Relaxed);
}

/// Watches over a service process. Ends it when its work takes too long, after `tell` has told the orchestrator why;
/// and when `is_alone` says that the orchestrator is gone before the service flies.
///
/// # Errors
/// If the system has no thread left.
pub fn watch_service(
    tell: impl Fn(String) + Send + 'static,
    is_alone: impl Fn() -> bool + Send + 'static,
) -> std::io::Result<()> {
    watchdog::watch(move |too_long| {
        if let Some(work) = too_long {
            tell(work.complaint());
            crash::die();
        }
        if !HAS_FLOWN.load(Ordering::Relaxed) && is_alone() {
            crash::die();
        }
    })
}
