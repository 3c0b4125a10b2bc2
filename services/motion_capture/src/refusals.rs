//! Refusals by reason: the count of each, and the values of the last one.

use std::fmt::{Display, Formatter, Result};

use crate::wire::{PoseError, WireError};

/// Maximum number of distinguished reasons; further ones are counted together.
const REASONS: usize = 8;

/// Reason of a refusal.
pub trait Reason: Copy + Display {
    /// Returns whether two refusals have the same reason, regardless of their values.
    fn is_same(&self, other: &Self) -> bool;
}

impl Reason for WireError {
    fn is_same(&self, other: &Self) -> bool {
        self == other
    }
}

impl Reason for PoseError {
    fn is_same(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }
}

/// Counters by reason, of fixed size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tally<R> {
    reasons: [Option<(R, u64)>; REASONS],
    others: u64,
}

impl<R> Default for Tally<R>
where
    R: Copy,
{
    fn default() -> Self {
        Self {
            reasons: [None; REASONS],
            others: 0,
        }
    }
}

impl<R: Reason> Tally<R> {
    /// Counts a refusal.
    pub fn add(&mut self, reason: R) {
        for slot in &mut self.reasons {
            match slot {
                Some((known, count)) if known.is_same(&reason) => {
                    *known = reason;
                    *count += 1;
                    return;
                }
                Some(_) => {}
                None => {
                    *slot = Some((reason, 1));
                    return;
                }
            }
        }
        self.others += 1;
    }

    /// Returns the number of refusals.
    #[must_use]
    pub fn total(&self) -> u64 {
        let counted = self.reasons.iter().flatten().map(|(_, count)| count);
        counted.sum::<u64>() + self.others
    }

    /// Returns the most frequent reason and its count.
    #[must_use]
    pub fn most_frequent(&self) -> Option<(R, u64)> {
        let reasons = self.reasons.iter().flatten();
        reasons.max_by_key(|(_, count)| *count).copied()
    }
}

/// `221 times Motive sends NatNet 2.8; …`, the reasons in the order in which they first occurred.
impl<R: Reason> Display for Tally<R> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let mut separator = "";
        for (reason, count) in self.reasons.iter().flatten() {
            write!(formatter, "{separator}{count} times {reason}")?;
            separator = "; ";
        }
        if self.others > 0 {
            write!(formatter, "{separator}{} times for other reasons", self.others)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_its_count_and_its_last_numbers() {
        let mut tally = Tally::default();
        for reason in [
            PoseError::Far(1200.0),
            PoseError::Norm(1.1),
            PoseError::Far(1234.0),
        ] {
            tally.add(reason);
        }
        assert_eq!(tally.total(), 3);
        assert_eq!(tally.most_frequent(), Some((PoseError::Far(1234.0), 2)));
        assert_eq!(
            tally.to_string(),
            "2 times 1234 m from the origin: millimetres?; 1 times a quaternion of norm 1.1000 is not a rotation"
        );
    }

    #[test]
    fn reasons_beyond_the_memory_are_counted_together() {
        let mut tally = Tally::default();
        for minor in 0..10 {
            tally.add(WireError::Version(2, minor));
        }
        assert_eq!(tally.total(), 10);
        assert!(
            tally.to_string().ends_with("; 2 times for other reasons"),
            "{tally}"
        );
    }
}
