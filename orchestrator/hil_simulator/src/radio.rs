//! The receiver: decodes bytes to frames and delays them by the radio's latency.
//!
//! A frame acts a stated latency, that of the air link and the flight controller, after its last byte has arrived. Without a
//! frame for [`LOST_AFTER_NS`](super::link_loss_timer::LOST_AFTER_NS) the receiver stops the motors; a Crazyflie does what
//! its [`Supervisor`] does. A flight controller with an arming switch does not arm unless the thrust stick is down when the
//! switch is turned on, as Betaflight (`min_check`) and PX4 do, and one that has lost the link disarms until the switch was off
//! and is on again, as the failsafe of Betaflight does.

use std::collections::VecDeque;

use radio_link::crazyflie::{self, CrazyfliePacket};
use radio_link::receiver::{Command, ReceivedCommands, Receiver};
use scenario::{RadioProtocol, RcLink, Transmitter};
use shared_types::samples::{RcFrame, VehicleTruth};
use zerocopy::FromZeros;

use super::crazyflie::Supervisor;
use super::link_loss_timer::LinkLossTimer;

/// Share of the thrust stick's way below which it is down: `min_check`, 1050 µs.
const DOWN: f64 = 0.05;

/// A receiver with its delayed frames.
#[derive(Debug)]
pub struct Radio {
    link: RcLink,
    receiver: Receiver,
    latency_ns: u64,
    /// Frames with the times at which they begin to act, oldest first.
    pending: VecDeque<(u64, RcFrame)>,
    loss: Loss,
    /// `None` for a vehicle without one.
    switch: Option<Switch>,
    /// Number of frames of a Crazyflie that have acted: the sequence number of the next one.
    acted: u64,
    /// Number of frames so far: the sequence number of the next one.
    count: u64,
}

/// Arming switch, as the flight controller has seen it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Switch {
    Off,
    /// Turned on while the thrust stick was down.
    Armed,
    /// Turned on while it was not, or still on after the link was lost.
    Refused,
}

impl Switch {
    /// Adds a command. Returns whether the vehicle is armed by it.
    fn arms(&mut self, command: &Command, link: &RcLink) -> bool {
        let is_down = command.thrust_share(link) <= DOWN;
        *self = match *self {
            _ if !command.is_armed => Self::Off,
            Self::Off if is_down => Self::Armed,
            Self::Off => Self::Refused,
            seen => seen,
        };
        *self == Self::Armed
    }

    /// Disarms the vehicle until the switch was off.
    fn disarm(&mut self) {
        if *self == Self::Armed {
            *self = Self::Refused;
        }
    }
}

/// What the vehicle does without frames.
#[derive(Debug)]
enum Loss {
    /// Stops its motors.
    Stops(LinkLossTimer),
    /// What the firmware of a Crazyflie does.
    Crazyflie(Box<Supervisor>),
}

impl Radio {
    /// Makes the receiver of a checked link, whose frames act after `latency_ns`; `None` for the simulated link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter, latency_ns: u64) -> Option<Self> {
        Some(Self {
            link: link.clone(),
            receiver: Receiver::new(link, transmitter)?,
            latency_ns,
            pending: VecDeque::new(),
            loss: if link.link == RadioProtocol::Crazyflie {
                Loss::Crazyflie(Box::default())
            } else {
                Loss::Stops(LinkLossTimer::default())
            },
            switch: transmitter
                .arming_channel
                .filter(|_| link.link != RadioProtocol::Crazyflie)
                .map(|_| Switch::Off),
            acted: 0,
            count: 0,
        })
    }

    /// Does not turn the motors of a Crazyflie before a request to arm.
    #[must_use]
    pub fn requiring_arming(mut self) -> Self {
        if let Loss::Crazyflie(supervisor) = &mut self.loss {
            supervisor.require_arming();
        }
        self
    }

    /// Receives bytes that have arrived by now. Requests to the supervisor of a Crazyflie act at once.
    pub fn receive(&mut self, bytes: &[u8], now_ns: u64) {
        let Self {
            link,
            receiver,
            latency_ns,
            pending,
            loss,
            switch,
            count,
            ..
        } = self;
        if let Loss::Crazyflie(supervisor) = loss
            && let Ok(CrazyfliePacket::Supervisor(request, _)) = crazyflie::decode(bytes)
        {
            supervisor.request(request);
        }
        receiver.push(bytes, &mut |command| {
            if let Loss::Stops(timer) = loss {
                timer.restart(now_ns);
            }
            let is_armed = match switch {
                Some(switch) => switch.arms(command, link),
                None => command.is_armed,
            };
            pending.push_back((now_ns + *latency_ns, frame_of(command, is_armed, link, *count)));
            *count += 1;
        });
    }

    /// Returns the newest frame that has begun to act since the last call, if any.
    pub fn acting(&mut self, at_ns: u64) -> Option<RcFrame> {
        let mut newest = None;
        while let Some((_, frame)) = self.pending.pop_front_if(|(acts_at, _)| *acts_at <= at_ns) {
            newest = Some(frame);
        }
        match &mut self.loss {
            Loss::Stops(timer) => {
                if !timer.expires(at_ns) {
                    return newest;
                }
                self.pending.clear();
                self.switch.iter_mut().for_each(Switch::disarm);
                Some(self.numbered(stopped_frame(0)))
            }
            Loss::Crazyflie(supervisor) => {
                let mut acting = supervisor.acting(newest, at_ns)?;
                // A frame of the vehicle's own may have acted while a command was under way.
                acting.header.seq = self.acted;
                self.acted += 1;
                Some(acting)
            }
        }
    }

    /// Gives a frame of the vehicle's own the next number.
    fn numbered(&mut self, mut frame: RcFrame) -> RcFrame {
        frame.header.seq = self.count;
        self.count += 1;
        frame
    }

    /// Updates the sensors of a vehicle that levels itself.
    pub fn update_sensors(&mut self, truth: &VehicleTruth) {
        if let Loss::Crazyflie(supervisor) = &mut self.loss {
            supervisor.update_sensors(truth);
        }
    }

    /// Returns the protocol of the link.
    #[must_use]
    pub fn protocol(&self) -> RadioProtocol {
        self.link.link
    }

    /// Returns the counts of commands since the start.
    #[must_use]
    pub fn received(&self) -> ReceivedCommands {
        self.receiver.received()
    }

    /// Returns the number of losses of the link.
    #[must_use]
    pub fn losses(&self) -> u64 {
        match &self.loss {
            Loss::Stops(timer) => timer.losses(),
            Loss::Crazyflie(supervisor) => supervisor.losses(),
        }
    }
}

fn stopped_frame(seq: u64) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    frame.header.seq = seq;
    frame.mode = RcFrame::MODE_RATES;
    frame.failsafe = true.into();
    frame
}

/// Returns the frame of a command, with the channels of the link.
fn frame_of(command: &Command, is_armed: bool, link: &RcLink, seq: u64) -> RcFrame {
    let mut frame = stopped_frame(seq);
    frame.channels = command.codes;
    if is_armed {
        frame.failsafe = false.into();
        frame.thrust = command.thrust(link);
        frame.rates_body = command.rates_body(link);
    }
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link_loss_timer::LOST_AFTER_NS;
    use radio_link::encoder::Encoder;
    use radio_link::frame::Frame;
    use radio_link::sticks::Sticks;
    use scenario::RadioProtocol;

    fn link(protocol: RadioProtocol) -> RcLink {
        RcLink {
            link: protocol,
            transmitter: Some(Transmitter {
                arming_channel: Some(5),
                ..Transmitter::default()
            }),
            ..RcLink::default()
        }
    }

    /// A radio whose vehicle is armed, and has had one frame.
    fn radio(latency_ns: u64) -> (Radio, impl FnMut(&Sticks) -> Vec<u8>) {
        let (mut radio, mut send) = radio_of(RadioProtocol::Crsf, latency_ns);
        radio.receive(&send(&IDLE), 0);
        radio.acting(latency_ns);
        (radio, send)
    }

    fn radio_of(protocol: RadioProtocol, latency_ns: u64) -> (Radio, impl FnMut(&Sticks) -> Vec<u8>) {
        let link = link(protocol);
        let transmitter = link.transmitter.as_ref().unwrap();
        let mut encoder = Encoder::new(&link, transmitter).unwrap();
        let radio = Radio::new(&link, transmitter, latency_ns).unwrap();
        let send = move |sticks: &Sticks| {
            let mut frame = Frame::default();
            encoder.encode(sticks, false, 0, &mut frame);
            frame.bytes().to_vec()
        };
        (radio, send)
    }

    const IDLE: Sticks = Sticks::flying([0, 1023, 1023, 1023]);

    fn armed() -> Sticks {
        Sticks::flying([1200, 1000, 1100, 1023])
    }

    #[test]
    fn a_frame_begins_to_act_once_and_when_its_time_has_come() {
        let (mut radio, mut send) = radio(5);
        radio.receive(&send(&armed()), 100);
        assert!(radio.acting(104).is_none());
        let frame = radio.acting(105).unwrap();
        assert!(!frame.failsafe.is_set() && frame.thrust > 2.3 && frame.rates_body[0] > 0.0);
        assert!(radio.acting(106).is_none());
    }

    #[test]
    fn of_several_frames_the_newest_acts_and_each_has_a_number_of_its_own() {
        let (mut radio, mut send) = radio(5);
        radio.receive(&send(&armed()), 100);
        radio.receive(&send(&Sticks::MOTORS_OFF), 101);
        radio.receive(&send(&armed()), 110);
        let frame = radio.acting(107).unwrap();
        assert!(frame.failsafe.is_set() && frame.thrust == 0.0 && frame.header.seq == 2);
        assert_eq!(radio.acting(115).unwrap().header.seq, 3);
    }

    #[test]
    fn a_vehicle_is_not_armed_while_the_thrust_stick_is_up() {
        let (mut radio, mut send) = radio_of(RadioProtocol::Crsf, 0);
        let mut thrust = |sticks: &Sticks, at_ns| {
            radio.receive(&send(sticks), at_ns);
            radio.acting(at_ns).unwrap().thrust
        };
        assert_eq!(
            [thrust(&armed(), 1), thrust(&IDLE, 2), thrust(&armed(), 3)],
            [0.0; 3]
        );
        assert_eq!([thrust(&Sticks::MOTORS_OFF, 4), thrust(&armed(), 5)], [0.0; 2]);
        assert_eq!(thrust(&Sticks::MOTORS_OFF, 6), 0.0);
        thrust(&IDLE, 7);
        assert!(thrust(&armed(), 8) > 2.3);
    }

    #[test]
    fn link_loss_stops_the_motors_once() {
        let (mut silent, _) = radio_of(RadioProtocol::Crsf, 0);
        assert!(
            silent.acting(3 * LOST_AFTER_NS).is_none(),
            "no frame was received"
        );
        let (mut radio, mut send) = radio(0);
        radio.receive(&send(&armed()), 100);
        assert!(radio.acting(100).is_some_and(|frame| !frame.failsafe.is_set()));
        assert!(radio.acting(100 + LOST_AFTER_NS).is_none());
        let lost = radio.acting(101 + LOST_AFTER_NS).unwrap();
        assert!(lost.failsafe.is_set() && lost.header.seq == 2);
        assert!(radio.acting(102 + LOST_AFTER_NS).is_none());
        assert_eq!(radio.losses(), 1);
    }

    #[test]
    fn a_vehicle_that_has_lost_the_link_arms_only_when_it_is_switched_off_and_on_again() {
        let (mut radio, mut send) = radio(0);
        let mut thrust = |sticks: &Sticks, at_ns| {
            radio.acting(at_ns);
            radio.receive(&send(sticks), at_ns);
            radio.acting(at_ns).unwrap().thrust
        };
        assert!(thrust(&armed(), 100) > 2.3);
        let again = 200 + LOST_AFTER_NS;
        assert_eq!([thrust(&armed(), again), thrust(&IDLE, again + 1)], [0.0; 2]);
        assert_eq!(thrust(&armed(), again + 2), 0.0);
        thrust(&Sticks::MOTORS_OFF, again + 3);
        thrust(&IDLE, again + 4);
        assert!(thrust(&armed(), again + 5) > 2.3);
    }

    #[test]
    fn a_crazyflie_levels_then_stops_and_its_frames_have_numbers_of_their_own() {
        let (mut radio, mut send) = radio_of(RadioProtocol::Crazyflie, 0);
        let mut truth = VehicleTruth::new_zeroed();
        truth.world_from_body = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        radio.update_sensors(&truth);
        radio.receive(&send(&armed()), 100);
        let flown = radio.acting(100).unwrap();
        assert!(radio.acting(100 + LOST_AFTER_NS).is_none());
        let level = radio.acting(101 + LOST_AFTER_NS).unwrap();
        assert_eq!((level.thrust, level.header.seq), (flown.thrust, 1));
        assert!(level.rates_body.iter().all(|rate| *rate == 0.0));
        let stopped = radio.acting(101 + 4 * LOST_AFTER_NS).unwrap();
        assert!(stopped.failsafe.is_set() && stopped.thrust == 0.0 && stopped.header.seq == 2);
        assert_eq!(radio.losses(), 1);
        // Locked until it is restarted.
        radio.receive(&send(&armed()), 5 * LOST_AFTER_NS);
        assert!(radio.acting(5 * LOST_AFTER_NS).is_none());
    }

    /// Packets have no numbers: the last to arrive acts, and one that comes twice acts as it did.
    #[test]
    fn packets_of_a_crazyflie_that_are_late_or_come_twice_act_until_the_next() {
        let (mut radio, mut send) = radio_of(RadioProtocol::Crazyflie, 0);
        let [late, newest] = [1200, 1300].map(|thrust| send(&Sticks::flying([thrust, 1000, 1100, 1023])));
        radio.receive(&newest, 1);
        let first = radio.acting(1).unwrap();
        radio.receive(&newest, 2);
        let again = radio.acting(2).unwrap();
        assert_eq!((again.thrust, again.rates_body), (first.thrust, first.rates_body));
        radio.receive(&late, 3);
        assert!(radio.acting(3).unwrap().thrust < first.thrust);
        radio.receive(&newest, 4);
        assert_eq!(radio.acting(4).unwrap().thrust, first.thrust);
        // A stop that is overtaken does not last, so it is repeated for as long as the motors must rest.
        radio.receive(&send(&Sticks::MOTORS_OFF), 5);
        radio.receive(&newest, 6);
        assert!(radio.acting(6).unwrap().thrust > 0.0);
        radio.receive(&send(&Sticks::MOTORS_OFF), 7);
        assert!(radio.acting(7).unwrap().failsafe.is_set());
    }
}
