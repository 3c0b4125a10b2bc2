//! Order of frames by their numbers, which wrap around and restart with the sender.

/// Maximum step between consecutive numbers of a restarted sender.
const LATE: i32 = 1000;
/// Maximum step ahead of a number that continues the sequence.
const AHEAD: i32 = 10_000;
/// Consecutive increasing numbers outside of the sequence after which the sender counts as restarted.
const RESTART: u32 = 8;

/// Order of a frame relative to the previous ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Newer than all previous ones.
    Next {
        /// Number of frames lost before this one.
        lost: u32,
    },
    /// Received before.
    Repeated,
    /// Older than the newest one.
    Late,
    /// The sender has restarted.
    Restarted,
}

/// The newest number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Numbering {
    newest: Option<u32>,
    /// The last number outside of the sequence, and the length of the sequence that it ends.
    stray: u32,
    strays: u32,
}

impl Numbering {
    /// Makes a sequence that continues after a number.
    pub(super) fn after(newest: u32) -> Self {
        Self {
            newest: Some(newest),
            ..Self::default()
        }
    }

    /// Returns the newest number.
    pub(super) fn newest(&self) -> Option<u32> {
        self.newest
    }

    /// Classifies the next frame by its number.
    pub(super) fn classify(&mut self, number: u32) -> Order {
        let Some(newest) = self.newest else {
            self.newest = Some(number);
            return Order::Next { lost: 0 };
        };
        let ahead = number.wrapping_sub(newest).cast_signed();
        if ahead == 0 {
            return Order::Repeated;
        }
        if (1..=AHEAD).contains(&ahead) {
            self.newest = Some(number);
            self.strays = 0;
            return Order::Next {
                lost: ahead.unsigned_abs() - 1,
            };
        }
        let follows = (1..=LATE).contains(&number.wrapping_sub(self.stray).cast_signed());
        self.strays = if follows { self.strays + 1 } else { 1 };
        self.stray = number;
        if self.strays < RESTART {
            return Order::Late;
        }
        self.newest = Some(number);
        self.strays = 0;
        Order::Restarted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn classified(numbers: &[u32]) -> Vec<Order> {
        let mut numbering = Numbering::default();
        numbers.iter().map(|&number| numbering.classify(number)).collect()
    }

    #[test]
    fn numbers_wrap_around() {
        let next = Order::Next { lost: 0 };
        assert_eq!(classified(&[u32::MAX - 1, u32::MAX, 0, 1]), [next; 4]);
    }

    #[test]
    fn lost_repeated_and_late_frames_are_told_apart() {
        let orders = classified(&[10, 13, 12, 13, 14]);
        let wanted = [
            Order::Next { lost: 0 },
            Order::Next { lost: 2 },
            Order::Late,
            Order::Repeated,
            Order::Next { lost: 0 },
        ];
        assert_eq!(orders, wanted);
    }

    #[test]
    fn one_wrong_number_does_not_make_those_after_it_late() {
        let orders = classified(&[100, 101, 3_000_000, 102, 103]);
        assert_eq!(orders[2], Order::Late);
        assert_eq!(orders[3..], [Order::Next { lost: 0 }; 2]);
    }

    #[test]
    fn a_restarted_sender_is_followed() {
        let orders = classified(&[&[5000][..], &(0..20).collect::<Vec<_>>()].concat());
        assert_eq!(orders.iter().filter(|order| **order == Order::Late).count(), 7);
        assert_eq!(orders[8], Order::Restarted);
        assert_eq!(orders[9..], [Order::Next { lost: 0 }; 12]);
    }
}
