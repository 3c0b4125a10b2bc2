//! A flight's samples about one moment: the vehicle beside its path, the truth about it, and the controller's
//! estimates.

use shared_types::samples::{ControlAdaptation, VehicleTruth};
use shared_types::{Schedule, Topic};

use metrics::read;
use metrics::tracker::{Moment, Tracker};

/// The samples about a moment.
#[derive(Clone, Debug)]
pub struct Known {
    /// The vehicle and its path.
    pub moment: Moment,
    /// The truth.
    pub truth: VehicleTruth,
    /// The controller's last estimates.
    pub adaptation: Option<ControlAdaptation>,
}

/// The latest samples of a simulated flight under way.
#[derive(Clone, Debug)]
pub struct Latest {
    tracker: Tracker,
    truth: Option<VehicleTruth>,
    adaptation: Option<ControlAdaptation>,
}

impl Latest {
    /// For a flight of `schedule`, with `[flight]` or without.
    #[must_use]
    pub fn new(schedule: &Schedule, has_phases: bool) -> Self {
        Self {
            tracker: Tracker::new(schedule, has_phases),
            truth: None,
            adaptation: None,
        }
    }

    /// Takes a sample into account; what is known of the moment before, if that is now whole.
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

    /// Returns the last moment, once nothing more of it comes.
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
