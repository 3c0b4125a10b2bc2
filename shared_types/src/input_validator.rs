//! Input validator: it accepts or refuses the samples of an input; a service uses the last valid one.
//!
//! Failure policy:
//! * a sample is validated once, when it is new. An impossible one is refused and counted, and the last good one stays
//!   in use;
//! * a number that is not finite is impossible, and in most samples one above [`LARGEST`]; each service adds its own
//!   tests, and [`StateValidator`] those of a vehicle's state;
//! * a sample may carry nothing new. It is not counted, but the age of the last good one keeps growing;
//! * earlier refusals are no reason to refuse the next sample: no validator refuses permanently.

mod state;

use zerocopy::FromZeros;

use crate::sample::{Flag, Sample};
use crate::service::{Input, Now};

pub use state::{Policy, StateGateState, StateValidator};

/// Largest magnitude of a number in a flight, SI units; powers and products of several such numbers stay finite.
pub const LARGEST: f64 = 1e9;

/// Result of the validation of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validity {
    /// It is possible and carries something new.
    Good,
    /// It carries nothing new.
    NothingNew,
    /// It is impossible.
    Refused,
}

crate::sample! {
    /// State of an input validator besides the sample.
    pub struct GateState {
        /// Number of the last tested sample, plus 1; 0 before the first.
        pub judged: u64,
        /// Samples refused since the start of the flight.
        pub refused: u32,
        /// `true` if there was a good sample.
        pub has_held: Flag,
        /// Explicit padding.
        pub pad0: [u8; 3],
    }
}

/// Input with its last good sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InputValidator<T> {
    memory: GateState,
    /// All zero before the first good sample.
    held: T,
}

impl<T: Sample> Default for InputValidator<T> {
    fn default() -> Self {
        Self {
            memory: GateState::new_zeroed(),
            held: T::new_zeroed(),
        }
    }
}

impl<T: Sample> InputValidator<T> {
    /// Validates the newest sample if it is new. `judge` is called only for numbers up to the magnitude `largest`, with
    /// the last good sample. Returns the result for a new sample.
    #[inline]
    pub fn look(
        &mut self,
        input: &Input<'_, T>,
        largest: f64,
        judge: impl FnOnce(&T, Option<&T>) -> Validity,
    ) -> Option<Validity> {
        let newest = input.newest()?;
        let number = newest.header().seq.wrapping_add(1);
        if input.fresh().is_none() && number == self.memory.judged {
            return None;
        }
        self.memory.judged = number;
        let verdict = if newest.is_within(largest) {
            judge(newest, self.held())
        } else {
            Validity::Refused
        };
        match verdict {
            Validity::Good => (self.held, self.memory.has_held) = (*newest, true.into()),
            Validity::NothingNew => {}
            Validity::Refused => self.refuse(),
        }
        Some(verdict)
    }

    /// Returns the last good sample. After a restart this is the one of the checkpoint, until another is received.
    #[must_use]
    #[inline]
    pub fn held(&self) -> Option<&T> {
        self.memory.has_held.is_set().then_some(&self.held)
    }

    /// Returns whether the last good sample is also the newest one.
    #[must_use]
    #[inline]
    pub fn is_newest(&self, input: &Input<'_, T>) -> bool {
        let newest = input.newest().map(|sample| sample.header().seq);
        newest == self.held().map(|sample| sample.header().seq)
    }

    /// Returns the time since the last good sample was published, ns.
    #[must_use]
    #[inline]
    pub fn age_ns(&self, now: &Now) -> Option<u64> {
        let held = self.held()?;
        Some(now.time_ns.saturating_sub(held.header().stamp_ns))
    }

    /// Returns the number of samples refused since the start of the flight.
    #[must_use]
    #[inline]
    pub fn refused(&self) -> u32 {
        self.memory.refused
    }

    /// Counts a sample as refused that turned out to be impossible when it was used.
    pub fn refuse(&mut self) {
        self.memory.refused = self.memory.refused.saturating_add(1);
    }

    /// Returns its state and the last good sample, all zero before the first.
    #[must_use]
    pub fn save(&self) -> (GateState, T) {
        (self.memory, self.held)
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: &GateState, held: &T) {
        (self.memory, self.held) = (*state, *held);
    }
}

/// Returns whether a sample was published by now; one from the future would never grow old.
#[must_use]
#[inline]
pub fn is_of_the_past<T: Sample>(sample: &T, now: &Now) -> bool {
    sample.header().stamp_ns <= now.time_ns
}

#[cfg(test)]
mod tests;
