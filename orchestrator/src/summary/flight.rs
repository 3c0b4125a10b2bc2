//! The phases of a flight from the ground to the ground.

use serde::Serialize;
use shared_types::FlightPhase;
use shared_types::samples::PathReference;
use shared_types::service::seconds;

/// Most begins of phases that are kept: eight flights with all of them.
const MOST: usize = 40;

/// When a phase of the flight began.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightPhaseBegin {
    /// Its name.
    pub phase: &'static str,
    /// When its first reference was published, s.
    pub begins: f64,
}

/// Watches the phases.
#[derive(Clone, Debug, Default)]
pub(super) struct FlightWatch {
    current: Option<FlightPhase>,
    begins: Vec<FlightPhaseBegin>,
}

impl FlightWatch {
    /// Takes a reference into account.
    pub(super) fn observe(&mut self, reference: &PathReference) {
        let phase = FlightPhase::from_code(reference.phase);
        if self.current != Some(phase) && self.begins.len() < MOST {
            self.begins.push(FlightPhaseBegin {
                phase: phase.name(),
                begins: seconds(reference.header.stamp_ns),
            });
        }
        self.current = Some(phase);
    }

    /// The phases in their order.
    pub(super) fn finish(&self) -> Vec<FlightPhaseBegin> {
        self.begins.clone()
    }
}

/// The phases in a sentence.
pub(super) fn in_words(begins: &[FlightPhaseBegin]) -> String {
    let parts: Vec<_> = begins
        .iter()
        .map(|begin| format!("{} at {} s", begin.phase, begin.begins))
        .collect();
    format!("flight: {}", parts.join(", "))
}
