//! Readiness of a vehicle on the ground: what must hold before the motors turn.

use crate::rotation::tilt;
use crate::samples::{PathReference, RcFrame, VehicleState};

/// Speed above which a vehicle does not stand, m/s: a falling one exceeds it after 50 ms, and the estimate of a
/// standing one stays below.
const MOVES: f64 = 0.5;

/// Limits within which a vehicle is ready to take off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadyLimits {
    /// Largest age of the vehicle's state, ns.
    pub state_age_ns: u64,
    /// Largest age of the transmitter's newest frame, ns.
    pub frame_age_ns: u64,
    /// Largest standard deviation of the estimated position, m.
    pub position_sigma: f64,
    /// Largest angle between the vehicle's thrust axis and the vertical, rad.
    pub tilt: f64,
}

/// Condition of readiness that a vehicle does not meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotReady {
    /// There is no state of the vehicle, or it is too old.
    State,
    /// The vehicle is not tracked, or its state is predicted without captures.
    Sight,
    /// The estimated position is not accurate enough.
    Estimate,
    /// The vehicle does not stand level.
    Level,
    /// The vehicle moves: it is carried, or falls.
    Motion,
    /// There is no frame of the transmitter, it is too old, or the transmitter lacks an input.
    Transmitter,
    /// The newest frame demands a landing or a kill.
    Demand,
}

impl NotReady {
    /// All conditions, in the order in which they are tested.
    pub const ALL: [Self; 7] = [
        Self::State,
        Self::Sight,
        Self::Estimate,
        Self::Level,
        Self::Motion,
        Self::Transmitter,
        Self::Demand,
    ];

    /// Returns the first condition that the newest state and frame, each with its age in ns, do not meet; `None` if the
    /// vehicle is ready.
    #[must_use]
    pub fn find(
        limits: &ReadyLimits,
        state: Option<(&VehicleState, u64)>,
        frame: Option<(&RcFrame, u64)>,
    ) -> Option<Self> {
        let Some((state, _)) = state.filter(|(_, age_ns)| *age_ns <= limits.state_age_ns) else {
            return Some(Self::State);
        };
        if !state.tracked.is_set() || state.coasting.is_set() {
            return Some(Self::Sight);
        }
        if state.position_sigma > limits.position_sigma {
            return Some(Self::Estimate);
        }
        if tilt(&state.world_from_body) > limits.tilt {
            return Some(Self::Level);
        }
        if state.velocity_world().norm() > MOVES {
            return Some(Self::Motion);
        }
        let is_recent =
            |(frame, age_ns): &(&RcFrame, u64)| *age_ns <= limits.frame_age_ns && frame.inputs_fresh.is_set();
        let Some((frame, _)) = frame.filter(is_recent) else {
            return Some(Self::Transmitter);
        };
        (frame.action > RcFrame::ACTION_WARN).then_some(Self::Demand)
    }

    /// Returns the cause as references state it.
    #[must_use]
    pub fn cause(self) -> u8 {
        match self {
            Self::State => PathReference::CAUSE_NOT_READY_STATE,
            Self::Sight => PathReference::CAUSE_NOT_READY_SIGHT,
            Self::Estimate => PathReference::CAUSE_NOT_READY_ESTIMATE,
            Self::Level => PathReference::CAUSE_NOT_READY_LEVEL,
            Self::Motion => PathReference::CAUSE_NOT_READY_MOTION,
            Self::Transmitter => PathReference::CAUSE_NOT_READY_TRANSMITTER,
            Self::Demand => PathReference::CAUSE_NOT_READY_DEMAND,
        }
    }

    /// Returns the condition of a cause; `None` of a cause that states no condition of readiness.
    #[must_use]
    pub fn from_cause(cause: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|not_ready| not_ready.cause() == cause)
    }

    /// Returns the reason as a clause that follows "was not ready:".
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::State => "there was no recent state of a tracked vehicle",
            Self::Sight => "the vehicle was not tracked",
            Self::Estimate => "the estimator had not converged",
            Self::Level => "the vehicle did not stand level",
            Self::Motion => "the vehicle moved",
            Self::Transmitter => "the transmitter lacked an input, or its frames were old",
            Self::Demand => "the transmitter demanded a landing or a kill",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::{exp, to_row_major};
    use nalgebra::Vector3;
    use zerocopy::FromZeros;

    const LIMITS: ReadyLimits = ReadyLimits {
        state_age_ns: 100,
        frame_age_ns: 200,
        position_sigma: 0.02,
        tilt: 0.35,
    };

    fn state(angle: f64) -> VehicleState {
        VehicleState {
            tracked: true.into(),
            position_sigma: 0.02,
            world_from_body: to_row_major(&exp(&Vector3::new(0.6 * angle, 0.8 * angle, 0.0))),
            ..VehicleState::new_zeroed()
        }
    }

    fn frame() -> RcFrame {
        RcFrame {
            inputs_fresh: true.into(),
            action: RcFrame::ACTION_WARN,
            ..RcFrame::new_zeroed()
        }
    }

    #[test]
    fn each_condition_is_found_by_itself() {
        let find = |change: fn(&mut VehicleState, &mut RcFrame), ages: [u64; 2]| {
            let (mut state, mut frame) = (state(0.349), frame());
            change(&mut state, &mut frame);
            NotReady::find(&LIMITS, Some((&state, ages[0])), Some((&frame, ages[1])))
        };
        let at_the_limits = [100, 200];
        assert_eq!(find(|_, _| (), at_the_limits), None);
        assert_eq!(find(|_, _| (), [101, 200]), Some(NotReady::State));
        assert_eq!(find(|_, _| (), [100, 201]), Some(NotReady::Transmitter));
        type Change = fn(&mut VehicleState, &mut RcFrame);
        let changes: [(Change, NotReady); 7] = [
            (|state, _| state.tracked = false.into(), NotReady::Sight),
            (|state, _| state.coasting = true.into(), NotReady::Sight),
            (|state, _| state.position_sigma = 0.0201, NotReady::Estimate),
            (
                |state, _| state.world_from_body = self::state(0.351).world_from_body,
                NotReady::Level,
            ),
            (|state, _| state.velocity_body[2] = 0.51, NotReady::Motion),
            (
                |_, frame| frame.inputs_fresh = false.into(),
                NotReady::Transmitter,
            ),
            (|_, frame| frame.action = RcFrame::ACTION_LAND, NotReady::Demand),
        ];
        for (change, expected) in changes {
            assert_eq!(find(change, at_the_limits), Some(expected));
        }
        assert_eq!(NotReady::find(&LIMITS, None, None), Some(NotReady::State));
        let state = state(0.0);
        assert_eq!(
            NotReady::find(&LIMITS, Some((&state, 0)), None),
            Some(NotReady::Transmitter)
        );
    }

    #[test]
    fn causes_are_those_of_no_other_condition() {
        for not_ready in NotReady::ALL {
            assert_eq!(NotReady::from_cause(not_ready.cause()), Some(not_ready));
        }
        assert_eq!(NotReady::from_cause(PathReference::CAUSE_NOT_READY), None);
        assert_eq!(NotReady::from_cause(PathReference::CAUSE_STRAYED), None);
    }
}
