//! Early end of a flight in real time: the vehicle lands, and recording continues until it is on the ground.
//!
//! Ctrl-C, SIGTERM, the end of the terminal, `gerono stop` and every failure outside of the control path make the same
//! request. Repetitions change nothing: in the air only `gerono kill` and `gerono disarm` stop the motors.

use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::samples::RcFrame;
use shared_types::service::nanoseconds;

/// Age of a frame, ns, above which it gives no information on the motors: without frames a receiver stops them.
const SILENT_NS: u64 = 500_000_000;

/// Maximum time between two observations that counts as observed, ns.
const LONGEST_GAP_NS: u64 = 100_000_000;

/// Requested end of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shutdown {
    /// No request.
    #[default]
    None,
    /// The flight ends once the vehicle is on the ground.
    Land,
    /// The flight ends now: a flight without phases cannot land.
    Now,
}

/// Time for which the motors have been stopped, as far as it was observed: while the orchestrator waits for a slow disk
/// or is stopped, it receives no frames.
#[derive(Clone, Copy, Debug)]
pub struct Motors {
    stopped_ns: u64,
    observed_ns: u64,
}

impl Motors {
    /// Motors that have not turned yet.
    pub const AT_REST: Self = Self {
        stopped_ns: u64::MAX,
        observed_ns: 0,
    };

    /// Motors after a take-over: they may turn.
    pub const UNKNOWN: Self = Self {
        stopped_ns: 0,
        observed_ns: 0,
    };

    /// Evaluates the newest frame at a time of the flight. A missing frame counts only if frames can be received.
    pub fn observe(&mut self, frame: Option<&RcFrame>, elapsed_ns: u64, can_receive: bool) {
        let recent = frame.filter(|frame| elapsed_ns.saturating_sub(frame.header.stamp_ns) <= SILENT_NS);
        let gap_ns = elapsed_ns.saturating_sub(self.observed_ns).min(LONGEST_GAP_NS);
        self.observed_ns = elapsed_ns;
        match recent {
            Some(frame) if !frame.failsafe.is_set() => self.stopped_ns = 0,
            None if !can_receive => {}
            _ => self.stopped_ns = self.stopped_ns.saturating_add(gap_ns),
        }
    }

    /// Returns whether they have been stopped long enough for the vehicle to be on the ground, from any height.
    #[must_use]
    pub fn are_grounded(&self) -> bool {
        self.stopped_ns >= nanoseconds(GROUNDED_AFTER)
    }
}

impl Shutdown {
    /// Returns the shutdown for a request; `has_phases` states whether the vehicle can land.
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
        assert!(landing.permits_end(&Motors::AT_REST) && !landing.permits_end(&Motors::UNKNOWN));
        assert!(now.permits_end(&Motors::UNKNOWN));
    }

    /// Looks at a frame every 10 ms, up to a time.
    fn look(motors: &mut Motors, until_ns: u64, can_receive: bool, newest: impl Fn(u64) -> Option<RcFrame>) {
        while motors.observed_ns < until_ns {
            let now_ns = motors.observed_ns + 10_000_000;
            motors.observe(newest(now_ns).as_ref(), now_ns, can_receive);
        }
    }

    #[test]
    fn motors_turn_by_frames_that_are_recent_and_carry_a_command() {
        let turns = |frame: Option<RcFrame>, elapsed_ns| {
            let mut motors = Motors::AT_REST;
            motors.observe(frame.as_ref(), elapsed_ns, true);
            !motors.are_grounded()
        };
        assert!(turns(Some(frame(7, false)), 7 + SILENT_NS));
        assert!(!turns(Some(frame(7, false)), 8 + SILENT_NS));
        assert!(!turns(Some(frame(7, true)), 7));
        assert!(!turns(None, 7));
    }

    #[test]
    fn motors_that_have_just_come_to_rest_leave_the_vehicle_in_the_air() {
        for stopped in [Some(()), None] {
            let newest = |now_ns| stopped.map(|()| frame(now_ns, true));
            let mut motors = Motors::UNKNOWN;
            look(&mut motors, 1_990_000_000, true, newest);
            assert!(!motors.are_grounded());
            look(&mut motors, 2_010_000_000, true, newest);
            assert!(motors.are_grounded());
        }
    }

    /// A disk that takes three seconds, or an orchestrator that was stopped.
    #[test]
    fn what_nobody_has_seen_is_no_rest() {
        let mut motors = Motors::AT_REST;
        look(&mut motors, 1_000_000_000, true, |now_ns| {
            Some(frame(now_ns, false))
        });
        for newest in [
            Some(frame(1_000_000_000, false)),
            Some(frame(3_990_000_000, true)),
            None,
        ] {
            let mut motors = motors;
            motors.observe(newest.as_ref(), 4_000_000_000, true);
            assert!(!motors.are_grounded(), "{newest:?}");
        }
    }

    #[test]
    fn silence_of_frames_that_cannot_be_received_is_no_rest() {
        let mut motors = Motors::UNKNOWN;
        look(&mut motors, 10_000_000_000, false, |_| None);
        assert!(!motors.are_grounded());
        look(&mut motors, 13_000_000_000, false, |now_ns| {
            Some(frame(now_ns, true))
        });
        assert!(motors.are_grounded());
    }
}
