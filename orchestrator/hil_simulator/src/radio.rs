//! From bytes that arrive to the frame that acts on the motors.
//!
//! A frame acts a stated time after its last byte has arrived, as the air and the flight controller need it. Without a
//! frame for [`LOST_AFTER_NS`](super::link_loss_timer::LOST_AFTER_NS) receivers stop the motors.

use std::collections::VecDeque;

use radio_link::receiver::{Command, ReceivedCommands, Receiver};
use scenario::{RcLink, Transmitter};
use shared_types::samples::RcFrame;
use zerocopy::FromZeros;

use super::link_loss_timer::LinkLossTimer;

/// A receiver, and its frames on their way to the motors.
#[derive(Debug)]
pub struct Radio {
    link: RcLink,
    receiver: Receiver,
    latency_ns: u64,
    /// Frames and when they begin to act, oldest first.
    coming: VecDeque<(u64, RcFrame)>,
    silence: LinkLossTimer,
    /// Frames so far, by which they are told apart.
    count: u64,
}

impl Radio {
    /// The receiver of a link that has been checked, whose frames act after so long; `None` for the simulated link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter, latency_ns: u64) -> Option<Self> {
        Some(Self {
            link: link.clone(),
            receiver: Receiver::new(link, transmitter)?,
            latency_ns,
            coming: VecDeque::new(),
            silence: LinkLossTimer::default(),
            count: 0,
        })
    }

    /// Takes bytes that have arrived by now.
    pub fn hear(&mut self, bytes: &[u8], now_ns: u64) {
        let Self {
            link,
            receiver,
            latency_ns,
            coming,
            silence,
            count,
            ..
        } = self;
        receiver.push(bytes, &mut |command| {
            silence.ends_at(now_ns);
            coming.push_back((now_ns + *latency_ns, frame_of(command, link, *count)));
            *count += 1;
        });
    }

    /// The frame that begins to act, if one does that has not by the last time; the newest whose time has come.
    pub fn acting(&mut self, at_ns: u64) -> Option<RcFrame> {
        let mut newest = None;
        while let Some((_, frame)) = self.coming.pop_front_if(|(acts_at, _)| *acts_at <= at_ns) {
            newest = Some(frame);
        }
        if self.silence.becomes_too_long(at_ns) {
            self.count += 1;
            self.coming.clear();
            return Some(at_rest(self.count - 1));
        }
        newest
    }

    /// Returns the commands that have arrived since the start.
    #[must_use]
    pub fn heard(&self) -> ReceivedCommands {
        self.receiver.heard()
    }

    /// Returns the number of losses of the link.
    #[must_use]
    pub fn losses(&self) -> u64 {
        self.silence.losses()
    }
}

fn at_rest(seq: u64) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    frame.header.seq = seq;
    frame.mode = RcFrame::MODE_RATES;
    frame.failsafe = true.into();
    frame
}

/// The frame as the vehicle takes it; its channels are those of the link.
fn frame_of(command: &Command, link: &RcLink, seq: u64) -> RcFrame {
    let mut frame = at_rest(seq);
    frame.channels = command.codes;
    if command.is_armed {
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

    fn link() -> RcLink {
        RcLink {
            link: RadioProtocol::Crsf,
            transmitter: Some(Transmitter {
                arming_channel: Some(5),
                ..Transmitter::default()
            }),
            ..RcLink::default()
        }
    }

    fn radio(latency_ns: u64) -> (Radio, impl FnMut(&Sticks) -> Vec<u8>) {
        let link = link();
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

    fn armed() -> Sticks {
        Sticks::flying([1200, 1000, 1100, 1023])
    }

    #[test]
    fn a_frame_begins_to_act_once_and_when_its_time_has_come() {
        let (mut radio, mut send) = radio(5);
        radio.hear(&send(&armed()), 100);
        assert!(radio.acting(104).is_none());
        let frame = radio.acting(105).unwrap();
        assert!(!frame.failsafe.is_set() && frame.thrust > 2.3 && frame.rates_body[0] > 0.0);
        assert!(radio.acting(106).is_none());
    }

    #[test]
    fn of_several_frames_the_newest_acts_and_each_has_a_number_of_its_own() {
        let (mut radio, mut send) = radio(5);
        radio.hear(&send(&armed()), 100);
        radio.hear(&send(&Sticks::AT_REST), 101);
        radio.hear(&send(&armed()), 110);
        let frame = radio.acting(107).unwrap();
        assert!(frame.failsafe.is_set() && frame.thrust == 0.0 && frame.header.seq == 1);
        assert_eq!(radio.acting(115).unwrap().header.seq, 2);
    }

    #[test]
    fn who_hears_nothing_for_too_long_lets_the_motors_rest_once() {
        let (mut radio, mut send) = radio(0);
        assert!(
            radio.acting(3 * LOST_AFTER_NS).is_none(),
            "nothing was ever heard"
        );
        radio.hear(&send(&armed()), 100);
        assert!(radio.acting(100).is_some_and(|frame| !frame.failsafe.is_set()));
        assert!(radio.acting(100 + LOST_AFTER_NS).is_none());
        let lost = radio.acting(101 + LOST_AFTER_NS).unwrap();
        assert!(lost.failsafe.is_set() && lost.header.seq == 1);
        assert!(radio.acting(102 + LOST_AFTER_NS).is_none());
        radio.hear(&send(&armed()), 200 + LOST_AFTER_NS);
        let frame = radio.acting(200 + LOST_AFTER_NS).unwrap();
        assert!(!frame.failsafe.is_set() && radio.losses() == 1);
    }
}
