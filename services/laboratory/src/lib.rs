//! Laboratory of a flight in real time: cameras, or recorded captures, in place of the simulated plant; a radio link
//! behind the transmitter.
//!
//! Only a flight in real time has one. A service's process connects itself to its part of the laboratory once it has
//! its role.
//!
//! Failure policy: hardware that is missing before the flight ends the run before it, with the fix. In flight nothing
//! ends it: a lost connection is retried in the background. Meanwhile services receive no poses or receivers no frames,
//! and the scenario's `[safety]` applies. A process that replaces a dead one tolerates missing hardware too.

mod motion_capture_driver;
mod radio_link_driver;
mod recorded_captures;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use runtime::shared_page::SharedPage;
use scenario::Scenario;
use shared_types::service::{Built, ErasedService};

use motion_capture_driver::MotionCaptureDriver;
use radio_link_driver::RadioLinkDriver;
use recorded_captures::RecordedCaptures;

/// Connects step logic to the hardware that a scenario names, or replaces the step logic by it. The error names the
/// missing hardware, with the fix.
pub type Connect = fn(Box<dyn ErasedService>, &Scenario, &Arc<SharedPage>) -> Built;

/// Makes a motion-capture system in place of the plant.
///
/// # Errors
/// As [`Connect`].
pub fn motion_capture(_: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let (system, stated) = scenario
        .capture_system()
        .ok_or("no motion-capture system is stated")?;
    Ok(Box::new(MotionCaptureDriver::open(
        system,
        stated,
        Arc::clone(page),
    )?))
}

/// Makes the captures of a recorded flight in place of the plant.
///
/// # Errors
/// As [`Connect`].
pub fn recorded_captures(_: Box<dyn ErasedService>, scenario: &Scenario, _: &Arc<SharedPage>) -> Built {
    let recording = scenario.recorded_captures().ok_or("no recording is stated")?;
    Ok(Box::new(RecordedCaptures::open(Path::new(recording))?))
}

/// Makes a radio link behind the transmitter.
///
/// # Errors
/// As [`Connect`].
pub fn radio_link(service: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let link = scenario.rc_output.as_ref().ok_or("no radio link is stated")?;
    Ok(Box::new(RadioLinkDriver::open(service, link, Arc::clone(page))?))
}

/// Returns whether the flight is under way: another process had this role before.
fn is_under_way(page: &SharedPage) -> bool {
    page.control_block().start_ns.load(Ordering::Acquire) != 0
}
