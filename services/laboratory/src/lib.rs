//! A laboratory around the services: cameras, or what others have recorded, in the place of the simulated world; a radio link
//! behind the transmitter.
//!
//! Only a flight in real time has one; a service's process connects itself to its part of it, once it knows which service
//! it is.
//!
//! Failure policy: what cannot be had before the flight ends the run before it, with the fix. In flight nothing does: what
//! is lost is sought again, meanwhile services see no poses or receivers no frames, and what the scenario's
//! `[safety]` says happens. Whoever takes a dead process's place does not find out for the first time that something is missing.

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

/// Connects step logic to what a scenario says is in the laboratory, or puts something real in its place. The error says what
/// cannot be had, with the fix.
pub type Connect = fn(Box<dyn ErasedService>, &Scenario, &Arc<SharedPage>) -> Built;

/// A motion-capture system in place of the plant.
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

/// The captures of a recorded flight in place of the plant.
///
/// # Errors
/// As [`Connect`].
pub fn recorded_captures(_: Box<dyn ErasedService>, scenario: &Scenario, _: &Arc<SharedPage>) -> Built {
    let recording = scenario.recorded_captures().ok_or("no recording is stated")?;
    Ok(Box::new(RecordedCaptures::open(Path::new(recording))?))
}

/// A radio link behind the transmitter.
///
/// # Errors
/// As [`Connect`].
pub fn radio_link(service: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let link = scenario.rc_output.as_ref().ok_or("no radio link is stated")?;
    Ok(Box::new(RadioLinkDriver::open(service, link, Arc::clone(page))?))
}

/// Whether the flight is under way: another process was this service before.
fn is_under_way(page: &SharedPage) -> bool {
    page.control_block().start_ns.load(Ordering::Acquire) != 0
}
