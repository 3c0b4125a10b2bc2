//! When the people responsible for the flight are planned to ask for what.

use crate::service::Operator;

/// Planned requests, each with the tick from which on it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OperatorPlan {
    /// First tick at which the motors may turn.
    pub armed_from: u64,
    /// First tick at which the vehicle shall come down.
    pub land_from: u64,
    /// First tick at which the motors shall rest for ever.
    pub killed_from: u64,
}

impl OperatorPlan {
    /// The vehicle is flown from the first tick to the last.
    pub const FLYING: Self = Self {
        armed_from: 0,
        land_from: u64::MAX,
        killed_from: u64::MAX,
    };

    /// What is asked for at a tick.
    #[must_use]
    #[inline]
    pub fn at(&self, tick: u64) -> Operator {
        Operator {
            armed: tick >= self.armed_from,
            land: tick >= self.land_from,
            killed: tick >= self.killed_from,
        }
    }
}
