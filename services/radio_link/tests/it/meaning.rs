//! What was asked for is what a vehicle understands, on every link, for every description of it.
//!
//! Frames are decoded by programs that are not ours, or after the format's definition where there is none in Rust, and the
//! pulses go to vehicles that know nothing of the map ([`vehicles`](super::vehicles)). `tests/interop/radio.sh` lets
//! `pymavlink` and `crsf-parser` decode the same frames.

use radio_link::ChannelCodes;
use radio_link::encoder::Encoder;
use radio_link::frame::Frame;
use radio_link::receiver::Receiver;
use scenario::{RadioProtocol, Transmitter};

use super::vehicles::{Case, LARGEST, Vehicle, asked, cases};

impl Vehicle {
    /// Thrust, N, of a pulse, µs.
    fn thrust(&self, pulse: f64) -> f64 {
        let [none, full] = self.thrust;
        LARGEST * ((pulse - none) / (full - none)).clamp(0.0, 1.0)
    }

    /// Rate about an axis, rad/s, of a pulse, µs.
    fn rate(&self, axis: usize, pulse: f64) -> f64 {
        let [none, most] = self.rates[axis];
        self.rate[axis] * (pulse - none) / (most - none)
    }
}

/// Contents of a frame as another program reads them.
enum Read {
    /// Pulses of the channels as a flight controller has them, µs; `None` where the frame leaves a channel alone.
    Pulses(Box<[Option<f64>; 16]>),
    /// Body rates, rad/s, and the thrust as a share.
    Attitude([f64; 4]),
}

/// Field of a packed number of 11 bits, the first the lowest.
fn eleven_bits(bytes: &[u8], channel: usize) -> u16 {
    (0..11).fold(0, |code, place| {
        let bit = 11 * channel + place;
        code | u16::from(bytes[bit / 8] >> (bit % 8) & 1) << place
    })
}

fn crsf(bytes: &[u8]) -> ChannelCodes {
    let mut rest = bytes;
    let packet = uf_crsf::CrsfParser::new().next_packet(&mut rest);
    let Some(Ok(uf_crsf::packets::Packet::RCChannels(channels))) = packet else {
        panic!("{packet:?}")
    };
    channels.0
}

fn sbus(bytes: &[u8]) -> ChannelCodes {
    let mut parser = sbus_rs::StreamingParser::new();
    let read = bytes.iter().find_map(|&byte| parser.push_byte(byte).unwrap());
    read.expect("the last byte completes the frame").channels
}

/// The payload of the last message of a frame, with the zeros that MAVLink 2 cuts off.
fn mavlink_payload(bytes: &[u8]) -> (u32, [u8; 64]) {
    let mut at = 0;
    loop {
        let length = usize::from(bytes[at + 1]);
        let end = at + 10 + length;
        if end + 2 == bytes.len() {
            let mut payload = [0; 64];
            payload[..length].copy_from_slice(&bytes[at + 10..end]);
            return (
                u32::from_le_bytes([bytes[at + 7], bytes[at + 8], bytes[at + 9], 0]),
                payload,
            );
        }
        at = end + 2;
    }
}

/// Reads a frame. A pulse is that of Betaflight: `crsfReadRawRC` and `sbusChannelsReadRawRC`, and MSP's as it is. Of a MULTI
/// module the documentation gives percentages, here in the pulses that they stand for.
fn read(protocol: RadioProtocol, bytes: &[u8]) -> Read {
    let all = |pulse: &dyn Fn(usize) -> f64| {
        Read::Pulses(Box::new(std::array::from_fn(|channel| Some(pulse(channel)))))
    };
    match protocol {
        RadioProtocol::Crsf => {
            let codes = crsf(bytes);
            all(&|channel| 0.624_771_201_952_41 * f64::from(codes[channel]) + 881.0)
        }
        RadioProtocol::Sbus => {
            let codes = sbus(bytes);
            all(&|channel| f64::from(5 * codes[channel] / 8 + 880))
        }
        RadioProtocol::Multi => {
            all(&|channel| 1500.0 + 500.0 * (f64::from(eleven_bits(&bytes[4..], channel)) - 1024.0) / 819.5)
        }
        RadioProtocol::Msp => all(&|channel| {
            let at = 5 + 2 * channel;
            f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]))
        }),
        RadioProtocol::Mavlink => of_mavlink(mavlink_payload(bytes)),
        RadioProtocol::Crazyflie => of_crazyflie(bytes),
        RadioProtocol::Simulated => panic!("it has no frames"),
    }
}

/// After `manualDecoder` and `stopDecoder` of the firmware's `crtp_commander_generic.c`, and `controllerPid`, which compares
/// the setpoint with the gyro's x, −y and z; its axes are forward, left, up.
fn of_crazyflie(bytes: &[u8]) -> Read {
    assert_eq!(
        (bytes[0] >> 4, bytes[0] & 3),
        (7, 0),
        "the port and channel of setpoints"
    );
    if bytes[1] == 0 {
        assert_eq!(bytes.len(), 2);
        return Read::Attitude([0.0; 4]);
    }
    assert_eq!(
        (bytes[1], bytes.len(), bytes[16]),
        (11, 17, 1),
        "rates, of the asserted length"
    );
    let rate = |at: usize| f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[at + byte])));
    let gyro = [rate(2), -rate(6), rate(10)].map(f64::to_radians);
    let [forward, left, up] = gyro;
    let thrust = f64::from(u16::from_le_bytes([bytes[14], bytes[15]])) / f64::from(u16::MAX);
    Read::Attitude([forward, -left, -up, thrust])
}

/// After the definitions 70 and 82 of MAVLink's `common.xml`.
fn of_mavlink((id, payload): (u32, [u8; 64])) -> Read {
    if id == 82 {
        let number = |at: usize| f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[at + byte])));
        return Read::Attitude([20, 24, 28, 32].map(number));
    }
    assert_eq!(id, 70);
    Read::Pulses(Box::new(std::array::from_fn(|channel| {
        let at = 2 * channel + if channel < 8 { 0 } else { 2 };
        let field = u16::from_le_bytes([payload[at], payload[at + 1]]);
        match (field, channel) {
            (u16::MAX, _) | (0, 8..) => None,
            (0, _) | (0xfffe, 8..) => panic!("channel {channel} is given back to the radio"),
            _ => Some(f64::from(field)),
        }
    })))
}

/// The thrust, N, and the rates, rad/s, that the vehicle of a case takes from a frame.
fn understood(case: &Case, bytes: &[u8]) -> [f64; 4] {
    let transmitter = case.link.transmitter.as_ref().unwrap();
    match read(case.link.link, bytes) {
        Read::Attitude([roll, pitch, yaw, share]) => {
            assert!((0.0..=1.0).contains(&share), "{share}");
            let thrust = LARGEST * ((share - case.idle_share) / (1.0 - case.idle_share)).max(0.0);
            [thrust, roll, pitch, yaw]
        }
        Read::Pulses(pulses) => {
            let pulse = |letter| pulses[transmitter.order.find(letter).unwrap()].unwrap();
            let rate = |axis: usize| case.vehicle.rate(axis, pulse(['A', 'E', 'R'][axis]));
            [case.vehicle.thrust(pulse('T')), rate(0), rate(1), rate(2)]
        }
    }
}

fn frame(encoder: &mut Encoder, sticks: &radio_link::sticks::Sticks) -> Frame {
    let mut frame = Frame::default();
    encoder.encode(sticks, false, 0, &mut frame);
    frame
}

#[test]
fn every_vehicle_understands_what_was_asked_for_in_every_description_of_it() {
    let cases = cases();
    assert!(cases.len() > 1000);
    for case in &cases {
        let transmitter = case.link.transmitter.as_ref().unwrap();
        let mut encoder = Encoder::new(&case.link, transmitter).unwrap();
        let mut simulated = Receiver::new(&case.link, transmitter).unwrap();
        for (sticks, asked) in asked(case) {
            let frame = frame(&mut encoder, &sticks);
            let understood = understood(case, frame.bytes());
            let Some(asked) = asked else {
                assert!(
                    understood[0] <= case.stopped(),
                    "the motors turn: {sticks:?} {case:#?}"
                );
                assert!(
                    understood[1..].iter().all(|rate| rate.abs() < case.tolerance[1]),
                    "{case:#?}"
                );
                continue;
            };
            let mut heard = None;
            simulated.push(frame.bytes(), &mut |command| heard = Some(*command));
            let heard = heard.unwrap();
            let [roll, pitch, yaw] = heard.rates_body(&case.link);
            let by_receiver = [heard.thrust(&case.link), roll, pitch, yaw];
            for quantity in 0..4 {
                let tolerance = case.tolerance[quantity.min(1)];
                for taken in [understood[quantity], by_receiver[quantity]] {
                    let error = taken - asked[quantity];
                    assert!(
                        error.abs() <= tolerance,
                        "{quantity}: {taken} for {asked:?}, {sticks:?}, {case:#?}"
                    );
                }
            }
        }
    }
}

#[test]
fn an_override_leaves_every_channel_alone_that_is_not_stated() {
    let stated = |others, switch| Transmitter {
        arming_channel: Some(6),
        others,
        switch,
        ..Transmitter::default()
    };
    let switch = vec![scenario::ChannelSwitch {
        channel: 9,
        travel: 1.0,
    }];
    let case = cases().pop().unwrap();
    let mut link = case.link;
    for (transmitter, left_alone) in [
        (stated(None, vec![]), vec![5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]),
        (stated(None, switch), vec![5, 7, 8, 10, 11, 12, 13, 14, 15, 16]),
        (stated(Some(-1.0), vec![]), vec![]),
    ] {
        link.transmitter = Some(Transmitter {
            mavlink: Some(scenario::Mavlink {
                message: scenario::MavlinkMessage::RcOverride,
                ..scenario::Mavlink::default()
            }),
            ..transmitter
        });
        let mut encoder = Encoder::new(&link, link.transmitter.as_ref().unwrap()).unwrap();
        for sticks in [
            radio_link::sticks::Sticks::MOTORS_OFF,
            radio_link::sticks::Sticks::flying([1000; 4]),
        ] {
            let Read::Pulses(pulses) = read(link.link, frame(&mut encoder, &sticks).bytes()) else {
                panic!()
            };
            let alone: Vec<_> = (1..=16).filter(|channel| pulses[channel - 1].is_none()).collect();
            assert_eq!(alone, left_alone);
        }
    }
}
