//! Supervision of setpoints by the firmware of a Crazyflie (`supervisor.c` and `supervisor_state_machine.c`).
//!
//! In flight a vehicle without a new setpoint for [`LEVELS_AFTER_NS`] flies level with the last thrust, and after
//! [`STOPS_AFTER_NS`] it stops its motors and locks until it is restarted. It counts as flying for
//! [`FLIES_AFTER_NS`] after its motors turned; on the ground missing setpoints do nothing. An emergency stop stops its motors and
//! locks it at once.
//!
//! A Crazyflie 2.x arms by itself; another turns its motors only between requests to arm and to disarm.
//!
//! Not simulated: tumbling, crashes, the time in which motors spin up, and those after which a vehicle disarms itself.

use radio_link::crazyflie::supervisor::SupervisorRequest;
use shared_types::samples::{RcFrame, VehicleTruth};

/// Age of a setpoint after which the vehicle flies level, ns.
pub const LEVELS_AFTER_NS: u64 = 500_000_000;
/// Age of a setpoint after which the vehicle stops its motors, ns.
pub const STOPS_AFTER_NS: u64 = 2_000_000_000;
/// Time after motors turned for which the vehicle counts as flying, ns.
pub const FLIES_AFTER_NS: u64 = 2_000_000_000;

/// Rate per angle with which the firmware levels, 1/s: `PID_ROLL_KP`, without its integral part.
const LEVEL_GAIN: f64 = 6.0;

/// The firmware's supervision of setpoints.
#[derive(Debug, Default)]
pub struct Supervisor {
    state: State,
    /// The newest setpoint with the time at which it began to act, ns.
    setpoint: Option<(RcFrame, u64)>,
    /// Time at which motors turned last, ns.
    turned_ns: Option<u64>,
    /// Gravity's direction in {B}.
    down_body: [f64; 3],
    losses: u64,
    requires_arming: bool,
    is_armed: bool,
    is_emergency: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// Ready to fly, or landed.
    #[default]
    Ready,
    Flying,
    /// Flies level, because setpoints are missing.
    Level,
    /// Stopped its motors until it is restarted.
    Locked,
}

impl Supervisor {
    /// Updates the attitude.
    pub fn update_sensors(&mut self, truth: &VehicleTruth) {
        let [.., x, y, z] = truth.world_from_body;
        self.down_body = [x, y, z];
    }

    /// Does not turn the motors before a request to arm.
    pub fn require_arming(&mut self) {
        self.requires_arming = true;
    }

    /// Handles a request.
    pub fn request(&mut self, request: SupervisorRequest) {
        match request {
            SupervisorRequest::Arm(arm) => self.is_armed = arm,
            SupervisorRequest::EmergencyStop => self.is_emergency = true,
        }
    }

    /// Returns the frame that begins to act at a time, ns: `newest`, or what the vehicle does by itself.
    pub fn acting(&mut self, newest: Option<RcFrame>, at_ns: u64) -> Option<RcFrame> {
        if self.state == State::Locked {
            return None;
        }
        if self.requires_arming && !self.is_armed {
            self.state = State::Ready;
            self.turned_ns = None;
            let last = self.setpoint.take().map(|(frame, _)| frame);
            return newest.or(last).map(|frame| stopped(&frame));
        }
        self.setpoint = newest.map(|frame| (frame, at_ns)).or(self.setpoint);
        let (setpoint, since_ns) = self.setpoint.as_ref()?;
        let age_ns = at_ns.saturating_sub(*since_ns);
        if setpoint.thrust > 0.0 {
            self.turned_ns = Some(at_ns);
        }
        let is_flying = self
            .turned_ns
            .is_some_and(|turned| at_ns.saturating_sub(turned) < FLIES_AFTER_NS);
        let before = self.state;
        self.state = match before {
            _ if self.is_emergency => State::Locked,
            State::Flying | State::Level if age_ns > STOPS_AFTER_NS => State::Locked,
            State::Flying | State::Level if age_ns > LEVELS_AFTER_NS => State::Level,
            State::Level => State::Flying,
            State::Flying | State::Ready if is_flying => State::Flying,
            State::Flying | State::Ready => State::Ready,
            State::Locked => State::Locked,
        };
        match self.state {
            State::Ready | State::Flying => newest,
            State::Level => {
                self.losses += u64::from(before != State::Level);
                Some(self.level(setpoint))
            }
            State::Locked => Some(stopped(setpoint)),
        }
    }

    /// Returns the number of times that setpoints were missing in flight.
    #[must_use]
    pub fn losses(&self) -> u64 {
        self.losses
    }

    /// Returns the frame that levels the vehicle with the thrust of its last setpoint.
    fn level(&self, setpoint: &RcFrame) -> RcFrame {
        let [x, y, z] = self.down_body;
        let roll = libm::atan2(y, z);
        let pitch = libm::asin((-x).clamp(-1.0, 1.0));
        RcFrame {
            rates_body: [-LEVEL_GAIN * roll, -LEVEL_GAIN * pitch, 0.0],
            ..*setpoint
        }
    }
}

/// Returns a frame with the motors off.
fn stopped(frame: &RcFrame) -> RcFrame {
    RcFrame {
        thrust: 0.0,
        rates_body: [0.0; 3],
        failsafe: true.into(),
        ..*frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    const MS: u64 = 1_000_000;

    fn setpoint(thrust: f64) -> RcFrame {
        let mut frame = RcFrame::new_zeroed();
        frame.mode = RcFrame::MODE_RATES;
        frame.thrust = thrust;
        frame.failsafe = (thrust == 0.0).into();
        frame.rates_body = [1.0, 2.0, 3.0];
        frame
    }

    /// A vehicle that is tilted by roll or pitch, rad.
    fn tilted(roll: f64, pitch: f64) -> VehicleTruth {
        let mut truth = VehicleTruth::new_zeroed();
        truth.world_from_body[6] = -libm::sin(pitch);
        truth.world_from_body[7] = libm::sin(roll) * libm::cos(pitch);
        truth.world_from_body[8] = libm::cos(roll) * libm::cos(pitch);
        truth
    }

    #[test]
    fn without_setpoints_a_flying_vehicle_levels_then_stops_and_stays_stopped() {
        let mut supervisor = Supervisor::default();
        let start = 10_000 * MS;
        assert!(supervisor.acting(Some(setpoint(0.3)), start).is_some());
        assert!(supervisor.acting(None, start + 500 * MS).is_none());
        for (roll, pitch) in [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.3), (0.0, -0.3)] {
            supervisor.update_sensors(&tilted(roll, pitch));
            let level = supervisor.acting(None, start + 501 * MS).unwrap();
            let expected = [-6.0 * roll, -6.0 * pitch, 0.0];
            for (rate, expected) in level.rates_body.iter().zip(expected) {
                assert!((rate - expected).abs() < 1e-9, "{level:?}");
            }
            assert!(level.thrust == 0.3 && !level.failsafe.is_set());
        }
        assert!(supervisor.acting(None, start + 2000 * MS).unwrap().thrust > 0.0);
        let stopped = supervisor.acting(None, start + 2001 * MS).unwrap();
        assert!(stopped.failsafe.is_set() && stopped.thrust == 0.0);
        assert!(
            supervisor
                .acting(Some(setpoint(0.3)), start + 2002 * MS)
                .is_none()
        );
        assert_eq!(supervisor.losses(), 1);
    }

    #[test]
    fn an_emergency_stop_stops_and_locks_the_vehicle_at_once() {
        let mut supervisor = Supervisor::default();
        assert!(supervisor.acting(Some(setpoint(0.3)), 0).is_some());
        supervisor.request(SupervisorRequest::EmergencyStop);
        let stopped = supervisor.acting(None, MS).unwrap();
        assert!(stopped.failsafe.is_set() && stopped.thrust == 0.0);
        assert!(supervisor.acting(Some(setpoint(0.3)), 2 * MS).is_none());
    }

    #[test]
    fn a_vehicle_that_requires_arming_turns_its_motors_only_while_it_is_armed() {
        let mut supervisor = Supervisor::default();
        supervisor.require_arming();
        let thrust = |frame: Option<RcFrame>| frame.map(|frame| frame.thrust);
        assert_eq!(thrust(supervisor.acting(Some(setpoint(0.3)), 0)), Some(0.0));
        supervisor.request(SupervisorRequest::Arm(true));
        assert_eq!(thrust(supervisor.acting(Some(setpoint(0.3)), MS)), Some(0.3));
        supervisor.request(SupervisorRequest::Arm(false));
        assert_eq!(thrust(supervisor.acting(None, 2 * MS)), Some(0.0));
        assert_eq!(thrust(supervisor.acting(None, 3 * MS)), None);
    }

    #[test]
    fn setpoints_that_come_back_are_followed() {
        let mut supervisor = Supervisor::default();
        supervisor.acting(Some(setpoint(0.3)), 0);
        assert!(supervisor.acting(None, 1000 * MS).is_some());
        let followed = supervisor.acting(Some(setpoint(0.2)), 1001 * MS).unwrap();
        assert_eq!((followed.thrust, followed.rates_body[2]), (0.2, 3.0));
        assert!(supervisor.acting(None, 1002 * MS).is_none());
        assert_eq!(supervisor.losses(), 1);
    }

    #[test]
    fn on_the_ground_missing_setpoints_do_nothing_but_right_after_a_stop_they_lock() {
        let mut supervisor = Supervisor::default();
        assert!(supervisor.acting(None, 0).is_none());
        supervisor.acting(Some(setpoint(0.0)), 0);
        assert!(supervisor.acting(None, 60_000 * MS).is_none());
        assert!(supervisor.acting(Some(setpoint(0.3)), 60_001 * MS).is_some());
        // Stopped for as long as it counts as flying, with setpoints: it is ready again.
        for ms in (60_002..62_500).step_by(100) {
            supervisor.acting(Some(setpoint(0.0)), ms * MS);
        }
        assert!(supervisor.acting(None, 90_000 * MS).is_none());
        assert_eq!(supervisor.losses(), 0);
        // Setpoints that end with the stop itself lock it.
        supervisor.acting(Some(setpoint(0.3)), 90_001 * MS);
        supervisor.acting(Some(setpoint(0.0)), 90_002 * MS);
        supervisor.acting(None, 91_000 * MS);
        assert!(supervisor.acting(None, 92_003 * MS).is_some());
        assert!(supervisor.acting(Some(setpoint(0.3)), 93_000 * MS).is_none());
    }
}
