//! Where the path was at any moment: γ(t) between the references, each of which speaks of a time of its own.
//!
//! A reference is made for the state that it was made from, and that state may be a prediction. So references
//! are put aside until the time they speak of has come, and from then on γ moves by their γ̇ and γ̈ until the
//! next one's time.

use std::collections::VecDeque;

use shared_types::samples::PathReference;
use shared_types::service::seconds;

/// What is kept of a reference.
#[derive(Clone, Copy, Debug)]
struct Moment {
    time_ns: u64,
    gamma: f64,
    gamma_dot: f64,
    gamma_ddot: f64,
    yaw: f64,
}

/// What the path asks for at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// γ.
    pub gamma: f64,
    /// ψd, rad.
    pub yaw: f64,
}

/// Tells γ(t), given all references in the order in which they were published.
#[derive(Clone, Debug, Default)]
pub struct PathClock {
    acting: Option<Moment>,
    /// Those whose time is still to come: as many as are made during a prediction.
    coming: VecDeque<Moment>,
}

impl PathClock {
    /// Takes a reference into account.
    pub fn observe(&mut self, reference: &PathReference) {
        self.coming.push_back(Moment {
            time_ns: reference.reference_time_ns,
            gamma: reference.gamma,
            gamma_dot: reference.gamma_dot,
            gamma_ddot: reference.gamma_ddot,
            yaw: reference.yaw,
        });
    }

    /// What the path asks for at a time, which must not go back; nothing before the first reference's.
    pub fn at(&mut self, time_ns: u64) -> Option<Demand> {
        while let Some(next) = self.coming.pop_front_if(|next| next.time_ns <= time_ns) {
            self.acting = Some(next);
        }
        let Moment {
            time_ns: since_ns,
            gamma,
            gamma_dot,
            gamma_ddot,
            yaw,
        } = self.acting?;
        let t = seconds(time_ns - since_ns);
        Some(Demand {
            gamma: gamma + t * (gamma_dot + 0.5 * t * gamma_ddot),
            yaw,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    fn reference(time_ms: u64, gamma: f64, gamma_dot: f64, gamma_ddot: f64) -> PathReference {
        PathReference {
            reference_time_ns: time_ms * 1_000_000,
            gamma,
            gamma_dot,
            gamma_ddot,
            yaw: gamma,
            ..PathReference::new_zeroed()
        }
    }

    #[test]
    fn there_is_no_path_before_the_time_of_the_first_reference() {
        let mut clock = PathClock::default();
        assert_eq!(clock.at(0), None);
        clock.observe(&reference(5, 1.0, 0.0, 0.0));
        assert_eq!(clock.at(4_999_999), None);
        assert_eq!(clock.at(5_000_000), Some(Demand { gamma: 1.0, yaw: 1.0 }));
    }

    #[test]
    fn gamma_moves_by_its_derivatives_until_the_time_of_the_next_reference() {
        let mut clock = PathClock::default();
        clock.observe(&reference(5, 1.0, 2.0, 100.0));
        // Published early: a prediction by more than a period.
        clock.observe(&reference(27, 9.0, 0.0, 0.0));
        clock.observe(&reference(49, 10.0, 0.0, 0.0));
        let just_before = clock.at(26_000_000).unwrap();
        assert!((just_before.gamma - (1.0 + 2.0 * 0.021 + 50.0 * 0.021 * 0.021)).abs() < 1e-14);
        assert_eq!(just_before.yaw, 1.0);
        assert_eq!(clock.at(27_000_000).unwrap().gamma, 9.0);
        assert_eq!(clock.at(60_000_000).unwrap().gamma, 10.0);
    }
}
