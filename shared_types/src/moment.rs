//! Time of a step, and the operator's requests at it.

use serde::{Deserialize, Serialize};

/// Time of a step, with the operator's requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Now {
    /// Base tick since the start of the flight.
    pub tick: u64,
    /// Time of the tick since the start of the flight, ns.
    pub time_ns: u64,
    /// Time since this service's previous step, ns; 0 at its first.
    pub elapsed_ns: u64,
    /// Requests of the operator.
    pub operator: Operator,
}

/// Requests of the operator. Hosts provide them, like the time. By default none: the motors stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The motors may turn. A withdrawal in the air stops them there.
    pub armed: bool,
    /// The vehicle must land, and is disarmed then.
    pub land: bool,
    /// The motors stop for ever: no withdrawal in a flight.
    pub killed: bool,
}

impl Operator {
    /// The flight is flown, without further requests.
    pub const FLYING: Self = Self {
        armed: true,
        land: false,
        killed: false,
    };
}

impl Now {
    /// Returns the time since the start of the flight, s.
    #[must_use]
    #[inline]
    pub fn time(&self) -> f64 {
        seconds(self.time_ns)
    }

    /// Returns the time since this service's previous step, s; 0 at its first.
    #[must_use]
    #[inline]
    pub fn elapsed(&self) -> f64 {
        seconds(self.elapsed_ns)
    }
}

/// Converts nanoseconds to seconds, correctly rounded.
#[must_use]
#[inline]
#[expect(
    clippy::cast_precision_loss,
    reason = "2^53 ns are 104 days, longer than any flight"
)]
pub fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

/// Converts seconds to nanoseconds, to the nearest; a time below 0 counts as 0, and one beyond any flight as its end.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates"
)]
pub fn nanoseconds(seconds: f64) -> u64 {
    libm::round(seconds * 1e9) as u64
}
