//! Which sample of an input a service uses: the last one that can be true.
//!
//! Failure policy:
//! * a sample is judged once, when it is new. One that cannot be true is refused and counted, and the last good
//!   one stays in its place;
//! * a number that is not finite can never be true, nor in most samples one above [`LARGEST`]; what else cannot be, each service
//!   says by itself, and of a vehicle's state [`StateValidator`] does;
//! * a sample may also say nothing new. Then it is not counted, but the last good one goes on growing old;
//! * what was refused, however often, is no reason to refuse what comes next: no gate stays shut for ever.

mod state;

use zerocopy::FromZeros;

use crate::sample::{Flag, Sample};
use crate::service::{Input, Now};

pub use state::{Policy, StateGateState, StateValidator};

/// Magnitude above which a number is not one of a flight, SI units; powers and products of several stay finite.
pub const LARGEST: f64 = 1e9;

/// What a sample is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validity {
    /// It can be true and says something new.
    Good,
    /// It says nothing new.
    NothingNew,
    /// It cannot be true.
    Refused,
}

crate::sample! {
    /// What a gate remembers besides the sample.
    pub struct GateState {
        /// Number of the sample that was judged last, plus 1; 0 before the first.
        pub judged: u64,
        /// Samples refused since the start of the flight.
        pub refused: u32,
        /// Whether there was a good sample.
        pub has_held: Flag,
        /// Explicit padding.
        pub pad0: [u8; 3],
    }
}

/// An input with its last good sample.
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
    /// Judges the newest sample if it is new; `judge` is asked of numbers up to the magnitude `largest` only, with the
    /// last good sample beside it. Returns the verdict on a new sample.
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

    /// The last good sample. Whoever goes on from what another process remembered has it before it sees one itself.
    #[must_use]
    #[inline]
    pub fn held(&self) -> Option<&T> {
        self.memory.has_held.is_set().then_some(&self.held)
    }

    /// Whether the last good sample is also the newest one.
    #[must_use]
    #[inline]
    pub fn is_newest(&self, input: &Input<'_, T>) -> bool {
        let newest = input.newest().map(|sample| sample.header().seq);
        newest == self.held().map(|sample| sample.header().seq)
    }

    /// Time since the last good sample was published, ns.
    #[must_use]
    #[inline]
    pub fn age_ns(&self, now: &Now) -> Option<u64> {
        let held = self.held()?;
        Some(now.time_ns.saturating_sub(held.header().stamp_ns))
    }

    /// Samples refused since the start of the flight.
    #[must_use]
    #[inline]
    pub fn refused(&self) -> u32 {
        self.memory.refused
    }

    /// Counts a sample as refused that only its use has shown to be impossible.
    pub fn refuse(&mut self) {
        self.memory.refused = self.memory.refused.saturating_add(1);
    }

    /// What it remembers, and the last good sample, all zero before the first.
    #[must_use]
    pub fn save(&self) -> (GateState, T) {
        (self.memory, self.held)
    }

    /// Goes on with what was saved.
    pub fn restore(&mut self, state: &GateState, held: &T) {
        (self.memory, self.held) = (*state, *held);
    }
}

/// Whether a sample was published by now; one from the future would never grow old.
#[must_use]
#[inline]
pub fn is_of_the_past<T: Sample>(sample: &T, now: &Now) -> bool {
    sample.header().stamp_ns <= now.time_ns
}

#[cfg(test)]
mod tests;
