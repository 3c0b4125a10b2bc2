//! The latest of what a flight published that is compared with something else.

use shared_types::Topic;
use shared_types::samples::{ControlAdaptation, PathReference, VehicleTruth};

use super::path_clock::PathClock;
use crate::summary::read;

/// The latest samples of a flight under way.
#[derive(Clone, Debug, Default)]
pub struct Latest {
    /// The truth of this tick, until it is taken.
    pub truth: Option<VehicleTruth>,
    /// What the controller believes.
    pub adaptation: Option<ControlAdaptation>,
    /// Where the path is.
    pub clock: PathClock,
}

impl Latest {
    /// Takes a sample into account, if it is one of these.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        match topic {
            Topic::VehicleTruth => self.truth = Some(read(bytes)),
            Topic::PathReference => self.clock.observe(&read::<PathReference>(bytes)),
            Topic::ControlAdaptation => self.adaptation = Some(read(bytes)),
            _ => {}
        }
    }
}
