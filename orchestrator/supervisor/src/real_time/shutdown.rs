//! The early end of a flight in real time: the vehicle lands, and the log goes on to the ground.
//!
//! Ctrl-C, SIGTERM, the end of the terminal, `gerono stop` and every failure outside of the control path are the same
//! request. Asked again they change nothing: in the air only `gerono kill` and `gerono disarm` stop the motors.

use std::time::{Duration, Instant};

use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::samples::RcFrame;
use shared_types::service::nanoseconds;

/// Age of a frame, ns, above which it says nothing of the motors: without frames a receiver stops them.
const SILENT_NS: u64 = 500_000_000;

/// The end that was asked of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shutdown {
    /// Nothing: it goes on.
    #[default]
    None,
    /// It ends once the vehicle is on the ground.
    Land,
    /// It ends now: a flight without phases has no ground.
    Now,
}

/// Since when the motors have rested.
#[derive(Clone, Copy, Debug)]
pub struct Motors {
    turned_at: Option<Instant>,
}

impl Motors {
    /// Motors that have not turned yet.
    pub const AT_REST: Self = Self { turned_at: None };

    /// Motors of a flight that is taken over: they may turn.
    #[must_use]
    pub fn unknown() -> Self {
        Self {
            turned_at: Some(Instant::now()),
        }
    }

    /// Takes note of the newest frame at a time of the flight.
    pub fn observe(&mut self, frame: Option<&RcFrame>, elapsed_ns: u64) {
        let turns = frame.is_some_and(|frame| {
            let age = elapsed_ns.saturating_sub(frame.header.stamp_ns);
            !frame.failsafe.is_set() && age <= SILENT_NS
        });
        if turns {
            self.turned_at = Some(Instant::now());
        }
    }

    /// Returns whether they have rested for so long that the vehicle is on the ground, wherever it was.
    #[must_use]
    pub fn are_grounded(&self) -> bool {
        let fall = Duration::from_nanos(nanoseconds(GROUNDED_AFTER));
        self.turned_at.is_none_or(|at| at.elapsed() >= fall)
    }
}

impl Shutdown {
    /// The flight shall end; `has_phases` says whether the vehicle can land.
    #[must_use]
    pub fn requested(has_phases: bool) -> Self {
        if has_phases { Self::Land } else { Self::Now }
    }

    /// Returns whether the flight may end now.
    #[must_use]
    pub fn permits_end(self, motors: &Motors) -> bool {
        match self {
            Self::None => false,
            Self::Land => motors.are_grounded(),
            Self::Now => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    fn frame(stamp_ns: u64, failsafe: bool) -> RcFrame {
        let mut frame = RcFrame::new_zeroed();
        frame.header.stamp_ns = stamp_ns;
        frame.failsafe = failsafe.into();
        frame
    }

    #[test]
    fn a_flight_with_phases_ends_on_the_ground_and_one_without_at_once() {
        let (landing, now) = (Shutdown::requested(true), Shutdown::requested(false));
        assert!(!Shutdown::None.permits_end(&Motors::AT_REST));
        assert!(landing.permits_end(&Motors::AT_REST) && !landing.permits_end(&Motors::unknown()));
        assert!(now.permits_end(&Motors::unknown()));
    }

    #[test]
    fn motors_turn_by_frames_that_are_recent_and_carry_a_command() {
        let turns = |frame: Option<RcFrame>, elapsed_ns| {
            let mut motors = Motors::AT_REST;
            motors.observe(frame.as_ref(), elapsed_ns);
            !motors.are_grounded()
        };
        assert!(turns(Some(frame(7, false)), 7 + SILENT_NS));
        assert!(!turns(Some(frame(7, false)), 8 + SILENT_NS));
        assert!(!turns(Some(frame(7, true)), 7));
        assert!(!turns(None, 7));
    }

    #[test]
    fn motors_that_have_just_come_to_rest_leave_the_vehicle_in_the_air() {
        let mut motors = Motors::AT_REST;
        motors.observe(Some(&frame(0, false)), 0);
        motors.observe(Some(&frame(1, true)), 1);
        assert!(!motors.are_grounded());
        let long_ago = Instant::now().checked_sub(Duration::from_secs(3)).unwrap();
        assert!(
            Motors {
                turned_at: Some(long_ago)
            }
            .are_grounded()
        );
    }
}
