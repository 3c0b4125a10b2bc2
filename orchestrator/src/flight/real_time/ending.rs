//! How a flight in real time comes to its end when somebody wants it to: on the ground, or with the motors at rest.

use std::time::{Duration, Instant};

use runtime::shared_page::{Request, Words};
use shared_types::flight_phase::FlightPhase;

/// How long the frame that lets the motors rest is waited for.
const DISARM_LIMIT: Duration = Duration::from_millis(500);

/// What is wanted of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// That it goes on.
    FlyOn,
    /// That the vehicle lands first.
    Land,
    /// That the motors rest first.
    Disarm {
        /// When that was asked for.
        since: Instant,
    },
    /// That it ends at once.
    End,
}

impl Wish {
    /// Somebody wants the end of a flight in this phase, if it has phases: at first politely, then again.
    #[must_use]
    pub fn then_end(self, phase: Option<FlightPhase>, words: &Words) -> Self {
        match (self, phase) {
            (_, None | Some(FlightPhase::Disarmed)) => Self::End,
            (Self::FlyOn, Some(_)) => {
                words.ask(Request::Land);
                Self::Land
            }
            (Self::Land, Some(_)) => {
                words.ask(Request::Disarm);
                Self::Disarm {
                    since: Instant::now(),
                }
            }
            (Self::Disarm { .. } | Self::End, Some(_)) => Self::End,
        }
    }

    /// Whether it has come true, so that the flight may end; `at_rest` says whether the last frame lets the motors rest.
    #[must_use]
    pub fn is_fulfilled(self, phase: Option<FlightPhase>, at_rest: bool) -> bool {
        match self {
            Self::FlyOn => false,
            Self::Land => phase == Some(FlightPhase::Disarmed),
            Self::Disarm { since } => at_rest || since.elapsed() > DISARM_LIMIT,
            Self::End => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::service::Operator;

    #[test]
    fn in_the_air_the_first_wish_lands_the_second_disarms_the_third_ends() {
        let words = Words::default();
        words.ask(Request::Arm);
        let flying = Some(FlightPhase::Fly);
        let land = Wish::FlyOn.then_end(flying, &words);
        assert!(
            land == Wish::Land
                && words.operator(Operator::default()).land
                && words.operator(Operator::default()).armed
        );
        assert!(!land.is_fulfilled(Some(FlightPhase::Land), false));
        assert!(land.is_fulfilled(Some(FlightPhase::Disarmed), true));
        let disarm = land.then_end(Some(FlightPhase::Land), &words);
        assert!(!words.operator(Operator::default()).armed && !disarm.is_fulfilled(flying, false));
        assert!(disarm.is_fulfilled(flying, true));
        assert!(disarm.then_end(flying, &words).is_fulfilled(flying, false));
    }

    #[test]
    fn on_the_ground_and_without_phases_a_flight_ends_at_once() {
        for phase in [None, Some(FlightPhase::Disarmed)] {
            let words = Words::default();
            assert_eq!(Wish::FlyOn.then_end(phase, &words), Wish::End);
            assert_eq!(words.operator(Operator::default()), Operator::default());
        }
        assert!(!Wish::FlyOn.is_fulfilled(None, true));
    }
}
