//! The kill of a flight: its motors rest until the end of the run.

use std::fmt::{Display, Formatter, Result};

use serde::Serialize;
use shared_types::FlightPhase;
use shared_types::samples::{PathReference, RcFrame};
use shared_types::service::seconds;

/// The kill of a flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Kill {
    /// Time of the first frame that carries it, s.
    pub time: f64,
    /// Its origin in words.
    pub by: String,
    /// `true` if the vehicle had landed and was disarmed before: the flight was complete.
    pub after_landing: bool,
}

/// Detector of the kill.
#[derive(Clone, Debug, Default)]
pub(super) struct KillWatch {
    has_landed: bool,
    /// Time (ns), exceeded limit, and whether the vehicle had landed.
    found: Option<(u64, u8, bool)>,
}

impl KillWatch {
    /// Adds a reference, which states whether the vehicle has landed.
    #[inline]
    pub(super) fn observe_reference(&mut self, reference: &PathReference) {
        let disarmed = FlightPhase::from_code(reference.phase) == FlightPhase::Disarmed;
        self.has_landed = disarmed && reference.cause == PathReference::CAUSE_TOUCHED_DOWN;
    }

    /// Adds a frame; the first one with a kill counts.
    #[inline]
    pub(super) fn observe_frame(&mut self, frame: &RcFrame) {
        if frame.action == RcFrame::ACTION_KILL && self.found.is_none() {
            self.found = Some((frame.header.stamp_ns, frame.limit, self.has_landed));
        }
    }

    /// Returns the kill, if there was one; `in_words` describes its cause, as in [`PathReference`], at a time (ns).
    pub(super) fn finish(&self, in_words: impl Fn(u8, u64) -> Option<String>) -> Option<Kill> {
        let (stamp_ns, limit, after_landing) = self.found?;
        let by = match limit {
            RcFrame::LIMIT_NONE => in_words(PathReference::CAUSE_OPERATOR_KILLS, stamp_ns),
            limit => Some(super::limit_in_words(limit)),
        };
        Some(Kill {
            time: seconds(stamp_ns),
            by: by.unwrap_or_default(),
            after_landing,
        })
    }
}

impl Display for Kill {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let landed = if self.after_landing {
            ", after the landing"
        } else {
            ""
        };
        write!(formatter, "at {} s{landed}: {}", self.time, self.by)
    }
}
