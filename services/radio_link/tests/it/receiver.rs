//! The vehicle's end of a link decodes the sticks of the transmitter's end, whatever else is on the line.

use proptest::prelude::*;
use radio_link::encoder::Encoder;
use radio_link::frame::Frame;
use radio_link::receiver::{Command, Receiver};
use radio_link::sticks::Sticks;
use scenario::{Mavlink, RadioProtocol, RcLink, Transmitter};

use super::vehicles::protocols;

/// A link of every kind; channels in an order of their own, one of them reversed and with other ends.
fn links() -> Vec<RcLink> {
    let transmitter = Transmitter {
        order: "TAER".to_owned(),
        reversed: "E".to_owned(),
        thrust_ends: [-0.9, 0.95],
        arming_channel: Some(6),
        ..Transmitter::default()
    };
    let link = |link, message| RcLink {
        link,
        transmitter: Some(Transmitter {
            mavlink: Some(Mavlink {
                message,
                ..Mavlink::default()
            }),
            ..transmitter.clone()
        }),
        ..RcLink::default()
    };
    protocols()
        .map(|(protocol, message)| link(protocol, message))
        .collect()
}

fn ends(link: &RcLink) -> (Encoder, Receiver) {
    let transmitter = link.transmitter.as_ref().unwrap();
    let encoder = Encoder::new(link, transmitter).unwrap();
    (encoder, Receiver::new(link, transmitter).unwrap())
}

fn sent(encoder: &mut Encoder, sticks: &Sticks, failsafe: bool) -> Vec<u8> {
    let mut frame = Frame::default();
    encoder.encode(sticks, failsafe, 1_000_000_000, &mut frame);
    frame.bytes().to_vec()
}

fn heard(receiver: &mut Receiver, bytes: &[u8]) -> Vec<Command> {
    let mut commands = Vec::new();
    receiver.push(bytes, &mut |command| commands.push(*command));
    commands
}

/// Half a step of the coarsest link, whose shortest travel has 0.925 of its 1000 steps.
const HALF_A_STEP: f64 = 1.1e-3;

fn flying(codes: [u16; 4]) -> Sticks {
    Sticks::flying(codes)
}

proptest! {
    #[test]
    fn sticks_mean_what_they_meant_to_half_a_step(codes in proptest::array::uniform4(0..=2047_u16)) {
        for link in links() {
            let (mut encoder, mut receiver) = ends(&link);
            let bytes = sent(&mut encoder, &flying(codes), false);
            let [command] = heard(&mut receiver, &bytes)[..] else { panic!("{:?}", link.link) };
            prop_assert!(command.is_armed);
            for (stick, code) in codes.into_iter().enumerate() {
                let meant = encoder.map().travel(code).value();
                prop_assert!((command.travels[stick] - meant).abs() < HALF_A_STEP, "{:?}: {stick}", link.link);
            }
            let thrust = (2.3071 + 3.138 * encoder.map().travel(codes[0]).value()).max(0.0);
            prop_assert!((command.thrust(&link) - thrust).abs() < 3.138 * HALF_A_STEP);
        }
    }

    #[test]
    fn noise_between_frames_is_skipped_and_frames_may_come_in_pieces(
        noise in proptest::collection::vec(proptest::collection::vec(0_u8..=0x0e, 0..40), 4), piece in 1..60_usize,
    ) {
        for link in links().into_iter().filter(|link| link.link != RadioProtocol::Crazyflie) {
            let (mut encoder, mut receiver) = ends(&link);
            let mut bytes = Vec::new();
            for (count, noise) in noise.iter().enumerate() {
                bytes.extend(noise);
                bytes.extend(sent(&mut encoder, &flying([300 * count as u16; 4]), false));
            }
            let commands: Vec<_> = bytes.chunks(piece).flat_map(|piece| heard(&mut receiver, piece)).collect();
            prop_assert_eq!(commands.len(), noise.len(), "{:?}", link.link);
            prop_assert_eq!(receiver.received().skipped, noise.iter().map(|noise| noise.len() as u64).sum::<u64>());
        }
    }

    #[test]
    fn a_packet_is_taken_whole_or_not_at_all(
        before in proptest::collection::vec(any::<u8>(), 0..4), after in proptest::collection::vec(any::<u8>(), 0..4),
        codes in proptest::array::uniform4(0..=2047_u16), cut in any::<prop::sample::Index>(),
    ) {
        let crazyflie = links().into_iter().find(|link| link.link == RadioProtocol::Crazyflie).unwrap();
        let (mut encoder, mut receiver) = ends(&crazyflie);
        let packet = sent(&mut encoder, &flying(codes), false);
        let padded = [before.as_slice(), &packet, &after].concat();
        let is_whole = before.is_empty() && after.is_empty();
        prop_assert_eq!(heard(&mut receiver, &padded).len(), usize::from(is_whole));
        prop_assert_eq!(receiver.received().skipped, if is_whole { 0 } else { padded.len() as u64 });
        // The rest of a packet is not another one's beginning.
        let (first, rest) = packet.split_at(cut.index(packet.len()));
        prop_assert_eq!(heard(&mut receiver, first), []);
        if !first.is_empty() {
            prop_assert_eq!(heard(&mut receiver, rest), []);
        }
        prop_assert_eq!(heard(&mut receiver, &packet).len(), 1);
    }

    #[test]
    fn no_bytes_do_harm(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        for link in links() {
            let (_, mut receiver) = ends(&link);
            for command in heard(&mut receiver, &bytes) {
                prop_assert!(command.thrust(&link) >= 0.0 || command.thrust(&link).is_nan());
            }
        }
    }
}

#[test]
fn with_motors_off_no_motor_turns() {
    for link in links() {
        let (mut encoder, mut receiver) = ends(&link);
        let bytes = sent(&mut encoder, &Sticks::MOTORS_OFF, false);
        let [command] = heard(&mut receiver, &bytes)[..] else {
            panic!("{:?}", link.link)
        };
        assert!(
            !command.is_armed || command.thrust(&link) == 0.0,
            "{:?}: {command:?}",
            link.link
        );
    }
}

#[test]
fn the_flag_of_sbus_takes_the_arming_away() {
    let sbus = links().remove(1);
    let (mut encoder, mut receiver) = ends(&sbus);
    let bytes = sent(&mut encoder, &flying([1500; 4]), true);
    assert!(!heard(&mut receiver, &bytes)[0].is_armed);
}

#[test]
fn stop_and_failsafe_of_a_crazyflie_are_a_packet_of_their_own() {
    let crazyflie = links()
        .into_iter()
        .find(|link| link.link == RadioProtocol::Crazyflie)
        .unwrap();
    let (mut encoder, mut receiver) = ends(&crazyflie);
    for (sticks, failsafe) in [(Sticks::MOTORS_OFF, false), (flying([1500; 4]), true)] {
        let bytes = sent(&mut encoder, &sticks, failsafe);
        assert_eq!(bytes, [0x7c, 0]);
        let [command] = heard(&mut receiver, &bytes)[..] else {
            panic!("{bytes:?}")
        };
        assert!(!command.is_armed && command.thrust(&crazyflie) == 0.0);
    }
    // What asks for an answer or ends the setpoints commands nothing.
    for other in [&[0xff][..], &[0xf3], &[0x7d, 0, 0, 0, 0, 0]] {
        assert_eq!(heard(&mut receiver, other), []);
    }
    assert_eq!(receiver.received().skipped, 0);
}

#[test]
fn without_an_arming_switch_the_thrust_alone_stops_the_motors() {
    let mut link = links().remove(0);
    link.transmitter.as_mut().unwrap().arming_channel = None;
    let (mut encoder, mut receiver) = ends(&link);
    let bytes = sent(&mut encoder, &Sticks::MOTORS_OFF, false);
    let [command] = heard(&mut receiver, &bytes)[..] else {
        panic!()
    };
    assert!(command.is_armed);
    assert_eq!(command.thrust(&link), 0.0);
}
