//! The moment of a step, and what the people responsible for the flight ask for at it.

use serde::{Deserialize, Serialize};

/// The moment of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Now {
    /// Base tick since the start of the flight.
    pub tick: u64,
    /// Time of the tick since the start of the flight, ns.
    pub time_ns: u64,
    /// Time since this service's previous step, ns; 0 at its first.
    pub elapsed_ns: u64,
    /// What the people responsible for the flight ask for.
    pub operator: Operator,
}

/// What the people responsible for the flight ask for. Hosts say it, like the time. By default nothing: the motors rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The motors may turn. Whoever takes it back in the air stops them there.
    pub armed: bool,
    /// The vehicle shall come down, and rest disarmed.
    pub land: bool,
    /// The motors shall rest, now and for ever: it is not taken back in a flight.
    pub killed: bool,
}

impl Operator {
    /// The flight is flown: nothing else is asked for.
    pub const FLYING: Self = Self {
        armed: true,
        land: false,
        killed: false,
    };
}

impl Now {
    /// Time since the start of the flight, s.
    #[must_use]
    #[inline]
    pub fn time(&self) -> f64 {
        seconds(self.time_ns)
    }

    /// Time since this service's previous step, s; 0 at its first.
    #[must_use]
    #[inline]
    pub fn elapsed(&self) -> f64 {
        seconds(self.elapsed_ns)
    }
}

/// Nanoseconds as seconds, correctly rounded.
#[must_use]
#[inline]
#[expect(
    clippy::cast_precision_loss,
    reason = "2^53 ns are 104 days, longer than any flight"
)]
pub fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

/// Seconds as nanoseconds, to the nearest; what is below 0 counts as 0, and what is beyond any flight as its end.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast saturates"
)]
pub fn nanoseconds(seconds: f64) -> u64 {
    libm::round(seconds * 1e9) as u64
}
