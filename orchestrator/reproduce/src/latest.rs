//! The samples of a flight at one moment: vehicle and path, truth, and the controller's estimates.

use shared_types::samples::{ControlAdaptation, VehicleTruth};
use shared_types::{Schedule, Topic};

use metrics::read;
use metrics::tracker::{Moment, Tracker};

/// The samples at one moment.
#[derive(Clone, Debug)]
pub struct Known {
    /// Vehicle and path.
    pub moment: Moment,
    pub truth: VehicleTruth,
    /// Last estimates of the controller.
    pub adaptation: Option<ControlAdaptation>,
}

/// Combines the samples of a simulated flight into moments.
#[derive(Clone, Debug)]
pub struct Latest {
    tracker: Tracker,
    truth: Option<VehicleTruth>,
    adaptation: Option<ControlAdaptation>,
}

impl Latest {
    /// Starts a flight of `schedule`; `has_phases` if its scenario has `[flight]`.
    #[must_use]
    pub fn new(schedule: &Schedule, has_phases: bool) -> Self {
        Self {
            tracker: Tracker::new(schedule, has_phases),
            truth: None,
            adaptation: None,
        }
    }

    /// Records a sample. Returns the samples of the previous moment if it is now complete.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) -> Option<Known> {
        let moment = self.tracker.observe(topic, bytes);
        let known = self.known(moment);
        match topic {
            Topic::VehicleTruth => self.truth = Some(read(bytes)),
            Topic::ControlAdaptation => self.adaptation = Some(read(bytes)),
            _ => {}
        }
        known
    }

    /// Returns the samples of the last moment, at the end of the flight.
    pub fn last(&mut self) -> Option<Known> {
        let moment = self.tracker.last();
        self.known(moment)
    }

    fn known(&self, moment: Option<Moment>) -> Option<Known> {
        Some(Known {
            moment: moment?,
            truth: self.truth?,
            adaptation: self.adaptation,
        })
    }
}
