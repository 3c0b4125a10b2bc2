//! Frames of every link: what is decoded is what was encoded, and no bytes do harm.

use proptest::prelude::*;
use radio_link::crazyflie::supervisor::{SupervisorPort, SupervisorRequest};
use radio_link::crazyflie::{self, CrazyfliePacket, RateSetpoint};
use radio_link::frame::Frame;
use radio_link::mavlink::{AttitudeTarget, MavlinkPacket, Sender};
use radio_link::{ChannelCodes, DecodeError, crsf, mavlink, msp, multi, sbus};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

fn eleven_bits() -> impl Strategy<Value = ChannelCodes> {
    proptest::array::uniform16(0..=2047_u16)
}

fn sender() -> impl Strategy<Value = Sender> {
    (any::<u8>(), any::<u8>()).prop_map(|(system, component)| Sender { system, component })
}

fn message() -> impl Strategy<Value = MavlinkPacket> {
    let number = -1e3_f32..1e3;
    let target = any::<[u8; 2]>();
    prop_oneof![
        Just(MavlinkPacket::Heartbeat),
        (target, any::<ChannelCodes>())
            .prop_map(|(target, channels)| MavlinkPacket::RcOverride { target, channels }),
        (
            any::<u32>(),
            proptest::array::uniform3(number),
            0.0..=1.0_f32,
            any::<[u8; 2]>()
        )
            .prop_map(
                |(time_ms, rates_body, thrust, target)| MavlinkPacket::AttitudeTarget(AttitudeTarget {
                    time_ms,
                    rates_body,
                    thrust,
                    target,
                })
            ),
    ]
}

fn mavlink_frame(message: &MavlinkPacket, sender: Sender, sequence: u8) -> Frame {
    let mut frame = Frame::default();
    mavlink::encode(message, sender, sequence, &mut frame);
    frame
}

fn crazyflie_packet() -> impl Strategy<Value = CrazyfliePacket> {
    let rates = proptest::array::uniform3(-2e3_f32..2e3);
    prop_oneof![
        (rates, any::<u16>())
            .prop_map(|(rates, thrust)| CrazyfliePacket::Rates(RateSetpoint { rates, thrust })),
        Just(CrazyfliePacket::Stop),
        any::<u32>().prop_map(CrazyfliePacket::NotifySetpointsEnd),
        Just(CrazyfliePacket::Null),
        supervisor_packet(),
    ]
}

fn supervisor_packet() -> impl Strategy<Value = CrazyfliePacket> {
    let request = prop_oneof![
        any::<bool>().prop_map(SupervisorRequest::Arm),
        Just(SupervisorRequest::EmergencyStop)
    ];
    let port = prop_oneof![Just(SupervisorPort::Own), Just(SupervisorPort::Older)];
    (request, port).prop_map(|(request, port)| CrazyfliePacket::Supervisor(request, port))
}

fn crazyflie_frame(packet: &CrazyfliePacket) -> Frame {
    let mut frame = Frame::default();
    crazyflie::encode(packet, &mut frame);
    frame
}

/// Every decoder, on the same bytes. What one of them takes is encoded as the same bytes again.
fn decode_with_all(bytes: &[u8]) {
    if let Ok(channels) = crsf::decode(bytes) {
        assert_eq!(crsf::encode(&channels), bytes);
    }
    if let Ok((channels, flags)) = sbus::decode(bytes) {
        assert_eq!(sbus::encode(&channels, flags), bytes);
    }
    if let Ok((channels, settings)) = multi::decode(bytes) {
        assert_eq!(multi::encode(&channels, settings), bytes);
    }
    if let Ok(message) = msp::decode(bytes) {
        assert_eq!(message.payload.len() + 6, bytes.len());
        let (_, count) = message.channels();
        assert!(count <= 16 && 2 * count <= message.payload.len());
    }
    if let Ok((message, sender, sequence, length)) = mavlink::decode(bytes) {
        assert!(length <= bytes.len());
        // Others may leave zeros at the end, and say more of an attitude than we keep; but it is a message again.
        let again = mavlink_frame(&message, sender, sequence);
        let kept = mavlink::decode(again.bytes()).unwrap();
        assert_eq!((kept.1, kept.2), (sender, sequence));
    }
    if let Ok(packet) = crazyflie::decode(bytes) {
        // Radio links use two bits of the header for themselves.
        let again = crazyflie_frame(&packet);
        assert_eq!(
            (again.bytes()[0], &again.bytes()[1..]),
            (bytes[0] | 0b1100, &bytes[1..])
        );
    }
    let mut receiver = msp::Receiver::default();
    for &byte in bytes {
        receiver.push(byte);
    }
}

proptest! {
    #[test]
    fn crsf_carries_every_code(channels in eleven_bits()) {
        prop_assert_eq!(crsf::decode(&crsf::encode(&channels)), Ok(channels));
    }

    #[test]
    fn sbus_carries_every_code_and_flag(channels in eleven_bits(), bits in any::<[bool; 4]>()) {
        let [first, second, frame_lost, failsafe] = bits;
        let flags = sbus::Flags { switches: [first, second], frame_lost, failsafe };
        prop_assert_eq!(sbus::decode(&sbus::encode(&channels, flags)), Ok((channels, flags)));
    }

    #[test]
    fn multi_carries_every_code_and_setting(
        channels in eleven_bits(), model in 0..16_u8, sub_protocol in 0..8_u8, option in any::<u8>(), bits in any::<[bool; 2]>(),
    ) {
        let settings = multi::Settings { model, sub_protocol, option, low_power: bits[0], bind: bits[1] };
        prop_assert_eq!(multi::decode(&multi::encode(&channels, settings)), Ok((channels, settings)));
    }

    #[test]
    fn msp_carries_every_pulse(channels in any::<ChannelCodes>()) {
        let frame = msp::encode(&channels);
        let message = msp::decode(&frame).unwrap();
        prop_assert_eq!((message.direction, message.command), (msp::Direction::Request, msp::SET_RAW_RC));
        prop_assert_eq!(message.channels(), (channels, 16));
    }

    #[test]
    fn mavlink_carries_every_message(message in message(), sender in sender(), sequence in any::<u8>()) {
        let frame = mavlink_frame(&message, sender, sequence);
        let length = frame.bytes().len();
        prop_assert_eq!(mavlink::decode(frame.bytes()), Ok((message, sender, sequence, length)));
    }

    #[test]
    fn crtp_carries_every_packet(packet in crazyflie_packet()) {
        prop_assert_eq!(crazyflie::decode(crazyflie_frame(&packet).bytes()), Ok(packet));
    }

    #[test]
    fn crtp_carries_rates_about_forward_right_and_down_and_a_share_of_the_thrust(
        rates in proptest::array::uniform3(-35.0..35.0_f64), share in 0.0..=1.0_f64,
    ) {
        let setpoint = RateSetpoint::new(rates, share);
        let [right, nose_up, counter_clockwise] = setpoint.rates.map(f64::from);
        for (sent, meant) in [(right, rates[0]), (nose_up, rates[1]), (counter_clockwise, -rates[2])] {
            prop_assert!((sent - meant.to_degrees()).abs() < 1e-3);
        }
        for (read, meant) in setpoint.rates_body().into_iter().zip(rates) {
            prop_assert!((read - meant).abs() < 1e-5);
        }
        prop_assert!((setpoint.thrust_share() - share).abs() <= 0.5 / 65_535.0 + 1e-12);
    }

    #[test]
    fn a_crtp_packet_of_another_length_is_refused(packet in crazyflie_packet(), more in 1..15_usize, cut in any::<prop::sample::Index>()) {
        let frame = crazyflie_frame(&packet);
        let longer = [frame.bytes(), &[1; 15][..more]].concat();
        prop_assert!(crazyflie::decode(&longer).is_err());
        let shorter = &frame.bytes()[..cut.index(frame.bytes().len())];
        prop_assert!(crazyflie::decode(shorter).is_err());
    }

    #[test]
    fn no_bytes_do_harm(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        decode_with_all(&bytes);
    }

    /// Random bytes hardly ever look like a frame; spoilt frames do.
    #[test]
    fn a_frame_with_one_spoilt_bit_is_refused_or_another_whole_frame(
        channels in eleven_bits(), message in message(), sender in sender(), bit in any::<prop::sample::Index>(),
        cut in any::<prop::sample::Index>(), packet in crazyflie_packet(),
    ) {
        let frames = [
            crsf::encode(&channels).to_vec(),
            sbus::encode(&channels, sbus::Flags::default()).to_vec(),
            msp::encode(&channels).to_vec(),
            mavlink_frame(&message, sender, 7).bytes().to_vec(),
            crazyflie_frame(&packet).bytes().to_vec(),
        ];
        for (index, frame) in frames.iter().enumerate() {
            decode_with_all(&frame[..cut.index(frame.len())]);
            let mut spoilt = frame.clone();
            let bit = bit.index(8 * frame.len());
            spoilt[bit / 8] ^= 1 << (bit % 8);
            decode_with_all(&spoilt);
            // A checksum detects every single-bit error.
            match index {
                0 => prop_assert!(crsf::decode(&spoilt).is_err()),
                2 => prop_assert!(msp::decode(&spoilt).is_err() || bit / 8 == 2),
                3 => prop_assert!(mavlink::decode(&spoilt).is_err()),
                _ => {}
            }
        }
    }

    #[test]
    fn msp_is_found_in_a_stream_after_anything_else(
        noise in proptest::collection::vec(any::<u8>().prop_filter("begins no frame", |byte| *byte != b'$'), 0..50),
        channels in any::<ChannelCodes>(),
    ) {
        let mut receiver = msp::Receiver::default();
        let frame = msp::encode(&channels);
        let mut found = Vec::new();
        for &byte in noise.iter().chain(&frame) {
            if let msp::Step::Complete(message) = receiver.push(byte) {
                found.push(message.channels().0);
            }
        }
        prop_assert_eq!(found, [channels]);
    }
}

/// A third-party decoder of SBUS.
#[test]
fn ten_thousand_sbus_frames_are_read_by_another_decoder() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut parser = sbus_rs::StreamingParser::new();
    for _ in 0..10_000 {
        let channels = [(); 16]
            .map(|()| random.next_u32().to_le_bytes())
            .map(|[low, high, ..]| u16::from_le_bytes([low, high]) % 2048);
        let flags = random.next_u32();
        let bit = |at: u32| flags >> at & 1 == 1;
        let said = sbus::Flags {
            switches: [bit(0), bit(1)],
            frame_lost: bit(2),
            failsafe: bit(3),
        };
        let mut read = None;
        for byte in sbus::encode(&channels, said) {
            read = read.or(parser.push_byte(byte).unwrap());
        }
        let read = read.expect("the last byte completes the frame");
        assert_eq!(read.channels, channels);
        let told = (
            read.flags.d1,
            read.flags.d2,
            read.flags.frame_lost,
            read.flags.failsafe,
        );
        assert_eq!(told, (bit(0), bit(1), bit(2), bit(3)));
    }
}

/// The documentation of the MULTI module (`Multiprotocol.h`): byte by byte what it says of DSMX with frames of 22 ms.
#[test]
fn a_multi_frame_is_that_of_the_modules_documentation() {
    let settings = multi::Settings {
        model: 3,
        sub_protocol: 2,
        option: 7,
        low_power: true,
        bind: true,
    };
    let mut channels = [1024; 16];
    channels[0] = 204;
    let frame = multi::encode(&channels, settings);
    assert_eq!(frame[..4], [0x55, 0x06 | 0x80, 3 | 2 << 4 | 0x80, 7]);
    // Its channels are read as a number of 176 bits, of which the lowest 11 are the first channel.
    let bit = |at: usize| u16::from(frame[4 + at / 8] >> (at % 8) & 1);
    for (index, channel) in channels.iter().enumerate() {
        let read = (0..11).fold(0, |code, place| code | bit(11 * index + place) << place);
        assert_eq!(read, *channel);
    }
}

/// Frames and what looks like them: as captured, cut short, spoilt, too long.
#[test]
fn the_corpus_does_no_harm_and_its_good_frames_are_taken() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus");
    let mut taken = 0;
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        decode_with_all(&bytes);
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let is_taken = match name.split('_').next().unwrap() {
            "crsf" => crsf::decode(&bytes).is_ok(),
            "sbus" => sbus::decode(&bytes).is_ok(),
            "multi" => multi::decode(&bytes).is_ok(),
            "msp" => msp::decode(&bytes).is_ok(),
            "crazyflie" => crazyflie::decode(&bytes).is_ok(),
            _ => mavlink::decode(&bytes).is_ok(),
        };
        assert_eq!(is_taken, name.ends_with("good"), "{}", path.display());
        taken += usize::from(is_taken);
        seen += 1;
    }
    assert!(taken >= 8 && seen >= 20, "{taken} of {seen}");
}

#[test]
fn errors_name_what_is_wrong_with_the_bytes() {
    let frame = crsf::encode(&[992; 16]);
    let length = DecodeError::Length {
        expected: 26,
        found: 25,
    };
    assert_eq!(crsf::decode(&frame[1..]), Err(length));
    let mut spoilt = frame;
    spoilt[2] = 0x14;
    assert_eq!(
        crsf::decode(&spoilt),
        Err(DecodeError::Constant {
            offset: 2,
            found: 0x14
        })
    );
    let mut spoilt = frame;
    spoilt[10] ^= 1;
    assert_eq!(crsf::decode(&spoilt), Err(DecodeError::Checksum));
}
