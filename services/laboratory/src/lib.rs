//! A laboratory around the services: cameras, or what others have recorded, in the place of the simulated world; a radio link
//! behind the transmitter.
//!
//! Only a flight in real time has one; a service's process connects itself to its part of it, once it knows which service
//! it is.
//!
//! Failure policy: what cannot be had before the flight ends the run before it, with the fix. In flight nothing does: what
//! is lost is sought again, meanwhile services see no poses or receivers no frames, and what the scenario's
//! `[safety]` says happens. Whoever takes a dead process's place does not find out for the first time that something is missing.

mod cameras;
mod recorded_cameras;
mod transmitter;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use runtime::process::Built;
use runtime::shared_page::SharedPage;
use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::service::ErasedService;

use cameras::Cameras;
use recorded_cameras::RecordedCameras;
use transmitter::Transmitter;

/// Connects a service to what a scenario says is in the laboratory; most are connected to nothing.
///
/// # Errors
/// What cannot be had, with the fix, in words.
pub fn equip(service: Box<dyn ErasedService>, scenario: &Scenario, page: &Arc<SharedPage>) -> Built {
    let page = Arc::clone(page);
    Ok(match service.id() {
        ServiceId::Plant => match (scenario.capture_system(), scenario.recorded_captures()) {
            (Some((system, stated)), _) => Box::new(Cameras::open(system, stated, page)?),
            (None, Some(recording)) => Box::new(RecordedCameras::open(Path::new(recording))?),
            (None, None) => service,
        },
        ServiceId::RcOutput => match &scenario.rc_output {
            Some(link) if !link.link.is_simulated() => Box::new(Transmitter::open(service, link, page)?),
            _ => service,
        },
        ServiceId::Estimator | ServiceId::PathGenerator | ServiceId::Controller => service,
    })
}

/// Whether the flight is under way: another process was this service before.
fn is_under_way(page: &SharedPage) -> bool {
    page.words().start_ns.load(Ordering::Acquire) != 0
}
