//! Which reference the law flies by.
//!
//! Failure policy: a reference whose numbers are none of a flight is refused and counted, and the last good one stays
//! in its place. With a policy one that is too old is flown by with the path at rest: the vehicle goes to where the
//! path was last and stays there. One that repeats the γ of a path that moves is a repetition of old news, and makes
//! nothing young.

use shared_types::gate::{Gate, GateState, Verdict, is_of_the_past};
use shared_types::samples::PathReference;
use shared_types::scenario::InputSafety;
use shared_types::service::nanoseconds;
use shared_types::{Input, Now};

use crate::signals::Reference;

/// γ̇ above which γ is different from one reference to the next, 1/s.
const MOVES: f64 = 1e-6;

/// The input of references.
#[derive(Clone, Debug)]
pub struct References {
    max_age_ns: Option<u64>,
    gate: Gate<PathReference>,
}

impl References {
    /// The input before the first reference.
    #[must_use]
    pub fn new(safety: Option<&InputSafety>) -> Self {
        Self {
            max_age_ns: safety.map(|safety| nanoseconds(safety.max_age)),
            gate: Gate::default(),
        }
    }

    /// Judges the newest reference if it is new.
    #[inline]
    pub fn look(&mut self, now: &Now, input: &Input<'_, PathReference>) {
        let has_policy = self.max_age_ns.is_some();
        self.gate.look(input, |reference, held| {
            if !has_policy {
                Verdict::Good
            } else if !is_of_the_past(reference, now) {
                Verdict::Refused
            } else if held.is_some_and(|held| held.gamma == reference.gamma && held.gamma_dot.abs() > MOVES) {
                Verdict::Mute
            } else {
                Verdict::Good
            }
        });
    }

    /// The last good reference; `None` where the input has none at all.
    #[must_use]
    #[inline]
    pub fn held(&self, input: &Input<'_, PathReference>) -> Option<&PathReference> {
        self.gate.held(input)
    }

    /// What the law is to fly by: a reference, at rest if it is too old.
    #[must_use]
    #[inline]
    pub fn target(&self, now: &Now, reference: &PathReference) -> Reference {
        let age_ns = self.gate.age_ns(now).unwrap_or(0);
        let target = Reference::from(reference);
        if self.max_age_ns.is_some_and(|oldest| age_ns > oldest) {
            target.at_rest()
        } else {
            target
        }
    }

    /// References refused since the start of the flight.
    #[must_use]
    pub fn refused(&self) -> u32 {
        self.gate.refused()
    }

    /// What it remembers, and the last good reference.
    #[must_use]
    pub fn save(&self) -> (GateState, PathReference) {
        self.gate.save()
    }

    /// Goes on with what was saved.
    pub fn restore(&mut self, state: &GateState, held: &PathReference) {
        self.gate.restore(state, held);
    }
}
