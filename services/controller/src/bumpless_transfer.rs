//! Bumpless transfer: after a failsafe stage, commands return to the law's without a jump.
//!
//! The command is the law's plus an offset. The offset is the difference between the last command and the law's at the
//! return, and decays linearly to zero. Thrust, torque and rates are continuous whatever state the law finds at the
//! return.

use control_law::signals::Commanded;

shared_types::sample! {
    /// Transfer in progress; all zero if there is none.
    pub struct Transfer {
        /// Difference between the last command and the law's at the return.
        pub offset: Commanded,
        /// Remaining time of the transfer, ns.
        pub left_ns: u64,
        /// Duration of the whole transfer, ns.
        pub length_ns: u64,
    }
}

impl Transfer {
    /// No transfer.
    pub const NONE: Self = Self {
        offset: Commanded::NOTHING,
        left_ns: 0,
        length_ns: 0,
    };

    /// Makes a transfer from the last command to the law's that takes `length_ns`.
    #[must_use]
    pub fn new(last: &Commanded, law: &Commanded, length_ns: u64) -> Self {
        Self {
            offset: combined(last, law, -1.0),
            left_ns: length_ns,
            length_ns,
        }
    }

    /// Returns the transfer `elapsed_ns` later.
    #[must_use]
    pub fn advanced(self, elapsed_ns: u64) -> Self {
        let left_ns = self.left_ns.saturating_sub(elapsed_ns);
        if left_ns == 0 {
            Self::NONE
        } else {
            Self { left_ns, ..self }
        }
    }

    /// Returns whether commands still differ from the law's.
    #[must_use]
    pub fn is_under_way(&self) -> bool {
        self.left_ns > 0
    }

    /// Returns the command for the law's command `law`.
    #[must_use]
    #[expect(
        clippy::cast_precision_loss,
        reason = "2^53 ns are 104 days, longer than any flight"
    )]
    pub fn command(&self, law: &Commanded) -> Commanded {
        if self.is_under_way() {
            combined(law, &self.offset, self.left_ns as f64 / self.length_ns as f64)
        } else {
            *law
        }
    }
}

/// Returns one command plus a share of another.
fn combined(one: &Commanded, other: &Commanded, share: f64) -> Commanded {
    let sum = |one: [f64; 3], other: [f64; 3]| std::array::from_fn(|axis| one[axis] + share * other[axis]);
    Commanded {
        thrust: one.thrust + share * other.thrust,
        torque_body: sum(one.torque_body, other.torque_body),
        rates_body: sum(one.rates_body, other.rates_body),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn commands() -> impl Strategy<Value = Commanded> {
        let vector = || [-1.0..1.0, -1.0..1.0, -1.0..1.0];
        (0.0..5.0, vector(), vector()).prop_map(|(thrust, torque_body, rates_body)| Commanded {
            thrust,
            torque_body,
            rates_body,
        })
    }

    fn distance(one: &Commanded, other: &Commanded) -> f64 {
        let difference = combined(one, other, -1.0);
        let numbers = difference.torque_body.into_iter().chain(difference.rates_body);
        numbers.fold(difference.thrust.abs(), |most, number| most.max(number.abs()))
    }

    proptest! {
        /// Over a constant law, the command moves in a step by no more than the step's share of the transfer.
        #[test]
        fn a_transfer_begins_at_the_last_command_and_goes_evenly_to_the_law(last in commands(), law in commands()) {
            let mut transfer = Transfer::new(&last, &law, 100);
            prop_assert!(distance(&transfer.command(&law), &last) < 1e-12);
            let whole = distance(&last, &law);
            let mut before = transfer.command(&law);
            for _ in 0..10 {
                transfer = transfer.advanced(10);
                let now = transfer.command(&law);
                prop_assert!(distance(&now, &before) <= 0.1 * whole + 1e-12);
                before = now;
            }
            prop_assert!(!transfer.is_under_way());
            prop_assert_eq!(before, law);
        }
    }

    #[test]
    fn a_transfer_without_duration_has_no_effect() {
        let last = Commanded {
            thrust: 1.0,
            ..Commanded::NOTHING
        };
        let transfer = Transfer::new(&last, &Commanded::NOTHING, 0);
        assert_eq!(transfer.command(&Commanded::NOTHING), Commanded::NOTHING);
    }
}
