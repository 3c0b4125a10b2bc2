//! What holds for every radio link: these tests go through [`RadioProtocol::ALL`], so that a new one is among them.

use std::collections::BTreeSet;

use radio_link::encoder::Encoder;
use radio_link::format::{self, Decoded};
use radio_link::frame::{CAPACITY, Frame};
use radio_link::port::Target;
use radio_link::receiver::Receiver;
use radio_link::sticks::Sticks;
use scenario::{ByteFormat, Mavlink, MavlinkMessage, RadioProtocol, RcLink, Transmitter};

use super::allocations;

/// Returns a link whose frames have channels, or, by MAVLink, body rates.
fn link(protocol: RadioProtocol, message: MavlinkMessage) -> (RcLink, Transmitter) {
    let is_serial = protocol.properties().serial;
    let transmitter = Transmitter {
        device: is_serial.then(|| "/dev/ttyUSB0".to_owned()),
        uri: (!is_serial).then(|| "radio://0/80/2M/E7E7E7E7E7".to_owned()),
        mavlink: Some(Mavlink {
            message,
            ..Mavlink::default()
        }),
        ..Transmitter::default()
    };
    let link = RcLink {
        link: protocol,
        ..RcLink::default()
    };
    (link, transmitter)
}

fn links() -> impl Iterator<Item = (RcLink, Transmitter)> {
    let messages = [MavlinkMessage::RcOverride, MavlinkMessage::AttitudeTarget];
    RadioProtocol::ALL
        .into_iter()
        .flat_map(move |protocol| messages.map(|message| link(protocol, message)))
}

/// Returns the frame of sticks at a time, ns.
fn frame(encoder: &mut Encoder, code: u16, now_ns: u64) -> Vec<u8> {
    let mut frame = Frame::default();
    encoder.encode(&Sticks::flying([code; 4]), false, now_ns, &mut frame);
    frame.bytes().to_vec()
}

#[test]
fn words_are_of_one_link_each_and_properties_are_plausible() {
    let mut words = BTreeSet::from([RadioProtocol::Simulated.name()]);
    for protocol in RadioProtocol::ALL {
        let properties = protocol.properties();
        assert!(words.insert(properties.name), "{protocol:?}");
        assert!(properties.largest_travel > 1.0, "{protocol:?}");
        // The line carries the usual rate.
        let bits = f64::from(protocol.bits_per_frame()) * properties.frame_rate;
        assert!(bits < f64::from(properties.baud), "{protocol:?}");
    }
}

#[test]
fn the_longest_frame_and_the_byte_of_the_line_are_those_of_the_record() {
    for (link, transmitter) in links() {
        let properties = link.link.properties();
        let mut encoder = Encoder::new(&link, &transmitter).unwrap();
        let lengths =
            (0..200).map(|code| frame(&mut encoder, 100 * code, 20_000_000 * u64::from(code)).len());
        let longest = lengths.max().unwrap();
        assert!(longest <= properties.longest_frame as usize, "{link:?} {longest}");
        assert!(properties.longest_frame as usize <= CAPACITY);
        let target = Target::new(link.link, &transmitter).unwrap();
        if !properties.serial {
            assert!(matches!(target, Target::Dongle(_)), "{target:?}");
            continue;
        }
        let Target::Serial { byte, baud, .. } = target else {
            panic!("{target:?}")
        };
        assert_eq!((byte, baud), (properties.byte, properties.baud));
        let bits = if byte == ByteFormat::EvenTwo { 12 } else { 10 };
        assert_eq!(link.link.bits_per_frame(), bits * properties.longest_frame);
    }
}

/// Beyond the largest travel the link has no code, or a flight controller takes the channel for broken.
#[test]
fn the_largest_travel_has_a_code_within_the_limits() {
    for (link, transmitter) in links() {
        let units = format::for_link(&link, &transmitter).unwrap().units();
        let largest = link.link.properties().largest_travel;
        let [low, high] = units.ends.map(f64::from);
        for travel in [-largest, largest] {
            let code = f64::midpoint(low, high) + travel * (high - low) / 2.0;
            let [least, most] = units.limits.map(f64::from);
            assert!((least..=most).contains(&code), "{link:?} {code}");
        }
    }
}

#[test]
fn a_frame_is_decoded_whole_unfinished_in_each_part_and_never_as_another_s_beginning() {
    for (link, transmitter) in links() {
        let mut encoder = Encoder::new(&link, &transmitter).unwrap();
        let decoder = format::for_link(&link, &transmitter).unwrap();
        let _with_heartbeat = frame(&mut encoder, 500, 0);
        let bytes = frame(&mut encoder, 1000, 20_000_000);
        let length = match decoder.decode(&bytes) {
            Decoded::Channels(length, ..) | Decoded::Override(length, _) | Decoded::Rates(length, ..) => {
                length
            }
            other => panic!("{link:?} {other:?}"),
        };
        assert_eq!(length, bytes.len());
        for end in 0..length {
            assert_eq!(
                decoder.decode(&bytes[..end]),
                Decoded::Incomplete,
                "{link:?} {end}"
            );
        }
        assert_eq!(decoder.decode(&[0xa5; CAPACITY]), Decoded::Noise, "{link:?}");
    }
}

#[test]
fn encoding_and_decoding_allocate_nothing() {
    for (link, transmitter) in links() {
        let mut encoder = Encoder::new(&link, &transmitter).unwrap();
        let mut receiver = Receiver::new(&link, &transmitter).unwrap();
        let mut frame = Frame::default();
        let count = allocations::allocations_during(|| {
            for number in 0..100 {
                let sticks = Sticks::flying([20 * number; 4]);
                encoder.encode(&sticks, false, 20_000_000 * u64::from(number), &mut frame);
                receiver.push(frame.bytes(), &mut |_| ());
            }
        });
        assert_eq!((count, receiver.received().frames), (0, 100), "{link:?}");
    }
}
