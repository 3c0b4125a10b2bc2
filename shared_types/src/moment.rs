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

/// Number of values of [`Operator::arm_count`]: five bits of a step record.
pub const ARM_COUNTS: u8 = 32;

/// Requests of the operator. Hosts provide them, like the time. The default is none, with the motors stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Operator {
    /// The motors may turn. Disarming in the air stops them there.
    pub armed: bool,
    /// Number of requests to arm so far, modulo [`ARM_COUNTS`]. A request that has been used or has lapsed keeps its
    /// number, so it cannot arm again; a new one has another number.
    pub arm_count: u8,
    /// The vehicle must land, and is disarmed then.
    pub land: bool,
    /// The motors are stopped until the end of the flight.
    pub killed: bool,
}

impl Operator {
    /// Armed from the start, without further requests.
    pub const FLYING: Self = Self {
        armed: true,
        arm_count: 1,
        land: false,
        killed: false,
    };
}

impl Operator {
    /// Number of bits of [`Operator::to_bits`].
    pub const BITS: u32 = 8;

    /// Returns the requests as a step record has them: bit 0 armed, bit 1 land, bit 2 killed, and from bit 3 on the
    /// number of requests to arm.
    #[must_use]
    #[inline]
    pub fn to_bits(self) -> u8 {
        let Self {
            armed,
            arm_count,
            land,
            killed,
        } = self;
        u8::from(armed) | u8::from(land) << 1 | u8::from(killed) << 2 | (arm_count % ARM_COUNTS) << 3
    }

    /// Returns the requests of a step record.
    #[must_use]
    pub fn from_bits(bits: u8) -> Self {
        let has = |bit: u8| bits & bit != 0;
        Self {
            armed: has(1),
            land: has(2),
            killed: has(4),
            arm_count: bits >> 3,
        }
    }
}

const _: () = assert!(
    8 * (ARM_COUNTS as u32) == 1 << Operator::BITS,
    "three requests and the number fill the bits"
);

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_requests_return_from_their_bits() {
        for bits in 0..=u8::MAX {
            assert_eq!(Operator::from_bits(bits).to_bits(), bits);
        }
    }
}
