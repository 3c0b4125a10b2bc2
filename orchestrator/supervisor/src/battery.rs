//! Modelled battery of a flight, for clients.

use metrics::summary::limit_in_words;
use run_client::snapshot::BatterySnapshot;
use shared_types::samples::RcFrame;

/// Returns the modelled battery as a frame states it; `None` unless it is modelled.
#[must_use]
pub fn modelled(frame: Option<&RcFrame>) -> Option<BatterySnapshot> {
    let frame = frame?;
    let reading = frame.battery()?;
    let is_low = frame.limit == RcFrame::LIMIT_BATTERY;
    Some(BatterySnapshot {
        voltage: reading.voltage,
        age: None,
        factor: reading.factor,
        trouble: is_low.then(|| limit_in_words(frame.limit)),
    })
}
