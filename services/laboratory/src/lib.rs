//! Laboratory hardware of a flight in real time: cameras, recorded captures, receivers, or receivers with cameras, in place of the
//! simulated plant, and a radio link behind the transmitter.
//!
//! A service's process connects to its hardware after it has received its role.
//!
//! Failure policy: hardware that is missing before the flight ends the run, with the fix. In flight a lost connection does
//! not end the run and is retried in the background; meanwhile there are no poses, samples or frames, and the scenario's
//! `[safety]` applies. A restarted process tolerates missing hardware as well.

mod motion_capture_driver;
mod radio_link_driver;
mod receiver_driver;
mod receiver_feed;
pub mod receiver_port;
mod receivers_and_cameras;
mod recorded_captures;
mod status_text;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use runtime::shared_page::SharedPage;
use scenario::Scenario;
use shared_types::service::{BuildError, Built, ErasedService};

use motion_capture_driver::MotionCaptureDriver;
use radio_link_driver::RadioLinkDriver;
use receiver_driver::ReceiverDriver;
use receivers_and_cameras::ReceiversAndCameras;
use recorded_captures::RecordedCaptures;

/// Connects step logic to the hardware that a scenario names, or replaces the step logic. The error names the missing
/// hardware, with the fix.
pub type Connect = fn(Box<dyn ErasedService>, &Scenario, &Arc<SharedPage>) -> Built;

/// Makes a motion-capture system in place of the plant.
///
/// # Errors
/// As [`Connect`].
pub fn motion_capture(_: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let cameras = cameras(scenario, page)?.ok_or("no motion-capture system is stated")?;
    Ok(Box::new(cameras))
}

/// Opens the motion-capture system of a scenario; `None` if there is none.
fn cameras(scenario: &Scenario, page: &Arc<SharedPage>) -> Result<Option<MotionCaptureDriver>, BuildError> {
    let system = scenario.capture_system();
    system
        .map(|(system, stated)| MotionCaptureDriver::open(system, stated, Arc::clone(page)))
        .transpose()
}

/// Makes the captures of a recorded flight in place of the plant.
///
/// # Errors
/// As [`Connect`].
pub fn recorded_captures(_: Box<dyn ErasedService>, scenario: &Scenario, _: &Arc<SharedPage>) -> Built {
    let recording = scenario.recorded_captures().ok_or("no recording is stated")?;
    Ok(Box::new(RecordedCaptures::open(Path::new(recording))?))
}

/// Makes receivers in place of the plant, with the cameras whose poses the scenario fuses beside them.
///
/// # Errors
/// As [`Connect`].
pub fn receivers(_: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let stated = scenario.real_receivers().ok_or("no receivers are stated")?;
    let receivers = ReceiverDriver::open(stated, scenario, Arc::clone(page))?;
    Ok(match cameras(scenario, page)? {
        Some(cameras) => Box::new(ReceiversAndCameras { cameras, receivers }),
        None => Box::new(receivers),
    })
}

/// Makes a radio link behind the transmitter.
///
/// # Errors
/// As [`Connect`].
pub fn radio_link(service: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let link = scenario.rc_output.as_ref().ok_or("no radio link is stated")?;
    Ok(Box::new(RadioLinkDriver::open(service, link, Arc::clone(page))?))
}

/// Returns whether the flight has started, so that this process is a restart.
fn is_under_way(page: &SharedPage) -> bool {
    page.control_block().start_ns.load(Ordering::Acquire) != 0
}
