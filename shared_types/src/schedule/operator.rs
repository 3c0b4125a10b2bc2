//! Planned requests of the operator.

use crate::service::Operator;

/// Planned requests, each with the tick from which it holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OperatorPlan {
    /// First tick at which the motors may turn.
    pub armed_from: u64,
    /// First tick at which the vehicle must land.
    pub land_from: u64,
    /// First tick at which the motors are stopped permanently.
    pub killed_from: u64,
}

impl OperatorPlan {
    /// Armed from the first tick to the last.
    pub const FLYING: Self = Self {
        armed_from: 0,
        land_from: u64::MAX,
        killed_from: u64::MAX,
    };

    /// Returns the requests at a tick.
    #[must_use]
    #[inline]
    pub fn at(&self, tick: u64) -> Operator {
        let armed = tick >= self.armed_from;
        Operator {
            armed,
            arm_count: armed.into(),
            land: tick >= self.land_from,
            killed: tick >= self.killed_from,
        }
    }
}
