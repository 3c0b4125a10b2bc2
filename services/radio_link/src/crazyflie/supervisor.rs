//! Requests to the supervisor of a Crazyflie's firmware: arming, and the emergency stop.
//!
//! | request | port 9, channel 1 | older port |
//! | --- | --- | --- |
//! | arm, disarm | 1; 1 or 0 | 13, channel 0: 1; 1 or 0 |
//! | emergency stop | 3 | 6, channel 1: 3 |
//!
//! The firmware reads port 9 since its release 2026.04 and drops packets to it before; the older ports are deprecated since.
//! Both are sent in turn, so nothing depends on the release. Each request is idempotent.
//!
//! They go out beside the frames, which set the rates or stop the motors as ever. A lost one is repeated: all in a burst, the
//! emergency stop for as long as the motors are killed, and arming until the first thrust. Later a vehicle that has disarmed
//! itself, because it has crashed, must not be armed again.

use crate::frame::Frame;
use crate::sticks::Sticks;

use super::header;

const SUPERVISOR: u8 = header(9, 1);
const PLATFORM: u8 = header(13, 0);
const LOCALIZATION: u8 = header(6, 1);
const ARM: u8 = 1;
const EMERGENCY_STOP: u8 = 3;

/// Frames beside which a new request goes out.
const BURST: u32 = 8;
/// Period of later repetitions, frames: one to each port.
const PERIOD: u32 = 16;

/// Request to the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SupervisorRequest {
    /// Arms the motors, or disarms them.
    Arm(bool),
    /// Stops the motors and locks the vehicle until it is switched off and on.
    EmergencyStop,
}

/// Port of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SupervisorPort {
    /// That of the supervisor.
    Own,
    /// Those of releases before 2026.04.
    Older,
}

/// Appends a request.
pub(super) fn encode(request: SupervisorRequest, port: SupervisorPort, frame: &mut Frame) {
    match (request, port) {
        (SupervisorRequest::Arm(arm), SupervisorPort::Own) => frame.push(&[SUPERVISOR, ARM, arm.into()]),
        (SupervisorRequest::Arm(arm), SupervisorPort::Older) => frame.push(&[PLATFORM, ARM, arm.into()]),
        (SupervisorRequest::EmergencyStop, SupervisorPort::Own) => frame.push(&[SUPERVISOR, EMERGENCY_STOP]),
        (SupervisorRequest::EmergencyStop, SupervisorPort::Older) => {
            frame.push(&[LOCALIZATION, EMERGENCY_STOP]);
        }
    }
}

/// Decodes a packet with the bits of its link set; `None` if it is no request.
pub(super) fn decode(first: u8, payload: &[u8]) -> Option<(SupervisorRequest, SupervisorPort)> {
    let port = if first == SUPERVISOR {
        SupervisorPort::Own
    } else {
        SupervisorPort::Older
    };
    let request = match (first, payload) {
        (SUPERVISOR | PLATFORM, &[ARM, arm @ (0 | 1)]) => SupervisorRequest::Arm(arm == 1),
        (SUPERVISOR | LOCALIZATION, &[EMERGENCY_STOP]) => SupervisorRequest::EmergencyStop,
        _ => return None,
    };
    Some((request, port))
}

/// Client of the supervisor.
#[derive(Clone, Debug, Default)]
pub(crate) struct SupervisorClient {
    wanted: Option<SupervisorRequest>,
    /// Frames since it is wanted.
    frames: u32,
    /// `true` from the first thrust after arming on.
    has_pulled: bool,
}

impl SupervisorClient {
    /// Appends the request that is due beside a frame of these sticks, if any.
    pub(crate) fn request(&mut self, sticks: &Sticks, has_thrust: bool, frame: &mut Frame) {
        let wanted = match sticks.codes {
            _ if sticks.is_killed => SupervisorRequest::EmergencyStop,
            // Motors that stop in the air may turn again there, and sticks without arming test the link.
            None if !sticks.rests => return,
            Some(_) if sticks.disarmed => return,
            codes => SupervisorRequest::Arm(codes.is_some()),
        };
        if self.wanted != Some(wanted) {
            // The first sticks of a process that replaces a dead one fly already.
            let is_replacement = self.wanted.is_none() && wanted == SupervisorRequest::Arm(true);
            self.frames = if is_replacement { BURST } else { 0 };
            self.wanted = Some(wanted);
            self.has_pulled = false;
        }
        self.has_pulled |= has_thrust;
        let repeats = match wanted {
            SupervisorRequest::EmergencyStop => true,
            SupervisorRequest::Arm(arm) => arm && !self.has_pulled,
        };
        if self.frames < BURST || (repeats && self.frames % PERIOD < 2) {
            let port = if self.frames.is_multiple_of(2) {
                SupervisorPort::Own
            } else {
                SupervisorPort::Older
            };
            encode(wanted, port, frame);
        }
        self.frames = self.frames.wrapping_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KILLED: Sticks = Sticks {
        is_killed: true,
        ..Sticks::MOTORS_OFF
    };
    const LOST: Sticks = Sticks {
        is_lost: true,
        rests: false,
        ..Sticks::MOTORS_OFF
    };
    const STOPPED_IN_THE_AIR: Sticks = Sticks {
        rests: false,
        ..Sticks::MOTORS_OFF
    };
    const FLYING: Sticks = Sticks::flying([0; 4]);

    /// Returns the requests beside frames of the same sticks, and the frames without one.
    fn requests(
        client: &mut SupervisorClient,
        sticks: &Sticks,
        has_thrust: bool,
        count: usize,
    ) -> (Vec<(SupervisorRequest, SupervisorPort)>, usize) {
        let mut found = Vec::new();
        for _ in 0..count {
            let mut frame = Frame::default();
            client.request(sticks, has_thrust, &mut frame);
            if let Some((&first, payload)) = frame.bytes().split_first() {
                found.push(decode(first, payload).unwrap());
            }
        }
        let without = count - found.len();
        (found, without)
    }

    /// Requests in turn to both ports.
    fn in_turn(request: SupervisorRequest, count: usize) -> Vec<(SupervisorRequest, SupervisorPort)> {
        let ports = [SupervisorPort::Own, SupervisorPort::Older];
        let both = ports.map(|port| (request, port));
        both.into_iter().cycle().take(count).collect()
    }

    #[test]
    fn arming_is_requested_until_the_first_thrust_and_disarming_once() {
        let mut client = SupervisorClient::default();
        let (arm, disarm) = (SupervisorRequest::Arm(true), SupervisorRequest::Arm(false));
        let mut of = |sticks, has_thrust, count| requests(&mut client, sticks, has_thrust, count);
        assert_eq!(of(&Sticks::MOTORS_OFF, false, 100), (in_turn(disarm, 8), 92));
        assert_eq!(of(&FLYING, false, 16), (in_turn(arm, 8), 8));
        assert_eq!(of(&FLYING, false, 160), (in_turn(arm, 20), 140));
        assert_eq!(of(&FLYING, true, 160), (vec![], 160));
        assert_eq!(of(&FLYING, false, 160), (vec![], 160), "in flight");
        let lost_at_rest = Sticks {
            is_lost: true,
            ..Sticks::MOTORS_OFF
        };
        assert_eq!(of(&lost_at_rest, false, 1), (in_turn(disarm, 1), 0));
    }

    #[test]
    fn an_emergency_stop_is_requested_for_as_long_as_the_motors_are_killed() {
        let mut client = SupervisorClient::default();
        requests(&mut client, &FLYING, true, 100);
        let stop = SupervisorRequest::EmergencyStop;
        assert_eq!(requests(&mut client, &KILLED, false, 16), (in_turn(stop, 8), 8));
        let lost = Sticks {
            is_lost: true,
            ..KILLED
        };
        assert_eq!(requests(&mut client, &lost, false, 160), (in_turn(stop, 20), 140));
    }

    #[test]
    fn motors_that_stop_in_the_air_a_test_of_the_link_and_a_process_that_takes_over_in_flight_request_nothing()
     {
        let probed = Sticks {
            disarmed: true,
            ..FLYING
        };
        let mut client = SupervisorClient::default();
        for (sticks, has_thrust) in [
            (probed, true),
            (FLYING, true),
            (LOST, false),
            (FLYING, true),
            (STOPPED_IN_THE_AIR, false),
            (FLYING, true),
        ] {
            assert_eq!(
                requests(&mut client, &sticks, has_thrust, 100),
                (vec![], 100),
                "{sticks:?}"
            );
        }
    }
}
