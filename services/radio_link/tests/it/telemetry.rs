//! Battery voltage in what vehicles send back: bytes of published libraries, in pieces, spoilt and among others.
//!
//! CRSF comes from the crate `uf-crsf`, MAVLink from pymavlink 2.4.50, CRTP from cflib 0.1.34; `tests/interop/radio.sh`
//! compares random ones.

use std::net::UdpSocket;

use proptest::prelude::*;
use radio_link::crazyflie::log::{ASKS_FOR_NS, LogServer};
use radio_link::frame::Frame;
use radio_link::link::RadioLink;
use radio_link::sticks::Sticks;
use radio_link::telemetry::{Reply, Telemetry};
use radio_link::{crsf, format, mavlink, msp};
use scenario::{LinkBattery, RadioProtocol, RcLink, Transmitter};
use uf_crsf::packets::{Battery, PacketAddress, write_packet_to_buffer};

use super::allocations;

const MS: u64 = 1_000_000;

fn link(link: RadioProtocol) -> (RcLink, Transmitter) {
    let link = RcLink {
        link,
        ..RcLink::default()
    };
    (link, Transmitter::default())
}

/// Returns the voltages that a link reads in bytes that arrive in pieces.
fn voltages(protocol: RadioProtocol, bytes: &[u8], piece: usize) -> Vec<f64> {
    let (link, transmitter) = link(protocol);
    let mut format = format::for_link(&link, &transmitter).unwrap();
    let mut telemetry = Telemetry::default();
    bytes
        .chunks(piece)
        .filter_map(|piece| telemetry.push(&mut *format, piece))
        .collect()
}

/// A battery sensor of the crate `uf-crsf`.
fn battery(tenths: i16, id: u8, address: PacketAddress) -> Vec<u8> {
    let mut packet = Battery::new(tenths, 123, 456, 78).unwrap();
    packet.id = id;
    let mut bytes = [0; 64];
    let length = write_packet_to_buffer(&mut bytes, address, &packet).unwrap();
    bytes[..length].to_vec()
}

fn hexadecimal(text: &str) -> Vec<u8> {
    (0..text.len() / 2)
        .map(|at| u8::from_str_radix(&text[2 * at..2 * at + 2], 16).unwrap())
        .collect()
}

proptest! {
    #[test]
    fn a_battery_sensor_of_another_library_is_read_in_any_pieces_among_noise_and_other_frames(
        tenths in 10..1000_i16, piece in 1..40_usize, noise in proptest::collection::vec(0..0xc0_u8, 0..30),
        address in prop_oneof![
            Just(PacketAddress::FlightController), Just(PacketAddress::Handset), Just(PacketAddress::Transmitter),
        ],
    ) {
        // On a half-duplex line our own frames come back.
        let echo = crsf::encode(&[992; 16]);
        let bytes = [&noise[..], &echo, &battery(tenths, 0, address), &echo].concat();
        let read = voltages(RadioProtocol::Crsf, &bytes, piece);
        prop_assert_eq!(read.len(), 1);
        prop_assert!((read[0] - 0.1 * f64::from(tenths)).abs() < 1e-9);
    }

    #[test]
    fn a_spoilt_bit_of_a_battery_sensor_is_never_a_voltage(tenths in 10..1000_i16, bit in 0..96_usize) {
        let mut bytes = battery(tenths, 0, PacketAddress::FlightController);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let read = voltages(RadioProtocol::Crsf, &bytes, 100);
        // The address is not part of the checksum.
        let is_address = bit / 8 == 0;
        prop_assert!(read.is_empty() || is_address, "{:?}", read);
    }

    #[test]
    fn another_library_reads_the_simulated_battery_sensor(voltage in 0.0..100.0_f64) {
        let frame = crsf::encode_battery(voltage);
        let mut rest = &frame[..];
        let packet = uf_crsf::CrsfParser::new().next_packet(&mut rest);
        let Some(Ok(uf_crsf::packets::Packet::Battery(read))) = packet else {
            panic!("{packet:?}")
        };
        prop_assert!((0.1 * f64::from(read.voltage) - voltage).abs() <= 0.05 + 1e-9);
    }

    #[test]
    fn no_bytes_from_a_vehicle_do_harm_and_pieces_change_nothing(
        bytes in proptest::collection::vec(any::<u8>(), 0..1500), piece in 1..100_usize,
    ) {
        for protocol in RadioProtocol::ALL {
            let read = voltages(protocol, &bytes, piece);
            prop_assert!(read.iter().all(|voltage| (1.0..=100.0).contains(voltage)));
        }
    }
}

#[test]
fn further_batteries_and_impossible_voltages_are_skipped() {
    let address = PacketAddress::Handset;
    for bytes in [
        battery(80, 1, address),
        battery(0, 0, address),
        battery(-5, 0, address),
        battery(5, 0, address),
        battery(20_000, 0, address),
    ] {
        assert_eq!(voltages(RadioProtocol::Crsf, &bytes, 100), [0.0; 0]);
    }
}

#[test]
fn the_status_messages_of_pymavlink_are_read() {
    const SYS_STATUS: &str =
        "fd1f0000070101010000010000000200000003000000f401f41cffff0000000000000000000000003c4135";
    const UNKNOWN: &str =
        "fd1f0000080101010000010000000200000003000000f401ffffffff0000000000000000000000003c37bc";
    const SIGNED: &str = "fd1f01000c0101010000010000000200000003000000f401f41cffff0000000000000000000000003c27b2\
                          01050000000000c04f896f8083";
    const CELLS: &str =
        "fd24000009010193000020030000ffffffffc4097e0e760effffffffffffffffffffffffffffffffb004000101376521";
    const BEYOND_A_FIELD: &str = "fd2900000a010193000020030000ffffffffc409feffa209ffffffffffffffffffffffffffffffffb004\
                                  000101372c010000012240";
    const SECOND: &str =
        "fd2400000b010193000020030000ffffffffc4097e0e760effffffffffffffffffffffffffffffffb00401010137a9f5";
    for (message, voltage) in [
        (SYS_STATUS, Some(7.412)),
        (UNKNOWN, None),
        (SIGNED, Some(7.412)),
        (CELLS, Some(7.412)),
        (BEYOND_A_FIELD, Some(68.0)),
        (SECOND, None),
    ] {
        let bytes = hexadecimal(message);
        match (mavlink::read_reply(&bytes, [1, 1]), voltage) {
            (Reply::Voltage(length, read), Some(voltage)) => {
                assert!(
                    length == bytes.len() && (read - voltage).abs() < 1e-9,
                    "{message}: {read}"
                );
            }
            (Reply::Other(length), None) => assert_eq!(length, bytes.len()),
            (other, _) => panic!("{message}: {other:?}"),
        }
        for other in [[2, 1], [1, 180]] {
            assert_eq!(
                mavlink::read_reply(&bytes, other),
                Reply::Other(bytes.len()),
                "of {other:?}"
            );
        }
        for end in 0..bytes.len() {
            assert_eq!(
                mavlink::read_reply(&bytes[..end], [1, 0]),
                Reply::Incomplete,
                "{end}"
            );
        }
        let stream = [&[0xfd, 0, 1][..], &bytes, &bytes].concat();
        let count = voltages(RadioProtocol::Mavlink, &stream, 11).len();
        assert_eq!(count, if voltage.is_some() { 2 } else { 0 }, "{message}");
    }
}

/// The layout of `MSP_BATTERY_STATE` in Betaflight's `msp.c`: cells, capacity, voltage in 0.1 V, used capacity, current,
/// state, voltage in 0.01 V.
#[test]
fn the_battery_state_of_betaflight_is_read() {
    let payload = [2, 0x14, 0x05, 74, 0, 0, 0, 0, 0, 0xe5, 0x02];
    let sum = payload
        .iter()
        .fold(11 ^ msp::BATTERY_STATE, |sum, byte| sum ^ byte);
    let frame = [&[b'$', b'M', b'>', 11, msp::BATTERY_STATE][..], &payload, &[sum]].concat();
    let Reply::Voltage(17, voltage) = msp::read_reply(&frame) else {
        panic!("{:?}", msp::read_reply(&frame))
    };
    assert!((voltage - 7.41).abs() < 1e-9);
    // The answer to the frame of channels comes between.
    let acknowledged = [b'$', b'M', b'>', 0, msp::SET_RAW_RC, msp::SET_RAW_RC];
    let stream = [&acknowledged[..], &frame, &acknowledged].concat();
    for piece in 1..stream.len() {
        assert_eq!(voltages(RadioProtocol::Msp, &stream, piece).len(), 1);
    }
    let request = msp::request(msp::BATTERY_STATE);
    assert_eq!(msp::read_reply(&request), Reply::Other(6));
}

/// Packets of cflib 0.1.34 for a block of `pm.vbat` every 200 ms: its item, its deletion, its creation, its start.
const CFLIB: [&str; 4] = ["5c022c01", "5d02e7", "5d06e7772c01", "5d03e714"];

#[test]
fn the_log_of_a_crazyflie_is_asked_for_as_its_library_does_and_only_with_the_motors_off() {
    let (link, transmitter) = link(RadioProtocol::Crazyflie);
    let mut format = format::for_link(&link, &transmitter).unwrap();
    let request = |format: &mut Box<dyn format::Format>, now_ns, are_motors_off| {
        let mut frame = Frame::default();
        format.request_voltage(now_ns, are_motors_off, &mut frame);
        frame.bytes().to_vec()
    };
    assert!(request(&mut format, 0, false).is_empty(), "in flight");
    // The variable is number 300 of the table.
    for index in 0..300_u16 {
        let [low, high] = index.to_le_bytes();
        assert_eq!(request(&mut format, MS, true), [0x5c, 2, low, high]);
        assert!(
            request(&mut format, 2 * MS, true).is_empty(),
            "it waits for the answer"
        );
        let item = [&[0x5c, 2, low, high, 7][..], b"pm\0vbatMV\0"].concat();
        assert_eq!(format.read_reply(&item), Reply::Other(item.len()));
    }
    let answers = [
        [&[0x5c, 2, 0x2c, 1, 7][..], b"pm\0vbat\0"].concat(),
        vec![0x5d, 2, 0xe7, 2],
        vec![0x5d, 6, 0xe7, 0],
        vec![0x5d, 3, 0xe7, 0],
    ];
    for (packet, answer) in CFLIB.iter().zip(answers) {
        assert_eq!(request(&mut format, 3 * MS, true), hexadecimal(packet));
        assert_eq!(request(&mut format, 104 * MS, true), hexadecimal(packet), "again");
        format.read_reply(&answer);
    }
    assert!(request(&mut format, 1000 * MS, true).is_empty());
    let data = [&[0x5e, 0xe7, 1, 2, 3][..], &3.75_f32.to_le_bytes()].concat();
    assert_eq!(format.read_reply(&data), Reply::Voltage(9, 3.75));
}

#[test]
fn a_log_that_cannot_be_had_is_not_asked_for_ever() {
    let (link, transmitter) = link(RadioProtocol::Crazyflie);
    let requests = |answer: Option<&[u8]>| {
        let mut format = format::for_link(&link, &transmitter).unwrap();
        let mut count = 0;
        for ms in (0..3 * ASKS_FOR_NS / MS).step_by(5) {
            let mut frame = Frame::default();
            format.request_voltage(ms * MS, true, &mut frame);
            if !frame.bytes().is_empty() {
                count += 1;
                answer.map(|answer| format.read_reply(answer));
            }
        }
        count
    };
    // Beyond the last item the firmware answers with the command alone.
    assert_eq!(requests(Some(&[0x5c, 2])), 1);
    assert!((500..700).contains(&requests(None)));
}

#[test]
fn a_link_to_a_simulated_crazyflie_measures_its_battery() {
    let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut stated = RcLink {
        link: RadioProtocol::Crazyflie,
        battery: Some(LinkBattery::default()),
        ..RcLink::default()
    };
    stated.transmitter = Some(Transmitter {
        uri: Some(format!("udp://{}", vehicle.local_addr().unwrap())),
        ..Transmitter::default()
    });
    let mut link = RadioLink::reopen(&stated).unwrap();
    let mut server = LogServer::default();
    vehicle.set_nonblocking(true).unwrap();
    let mut bytes = [0; 64];
    for step in 0..200_u64 {
        let now_ns = step * 5 * MS;
        link.transmit(Some((Sticks::MOTORS_OFF, now_ns)), now_ns);
        while let Ok((count, from)) = vehicle.recv_from(&mut bytes) {
            let mut answer = Frame::default();
            server.answer(&bytes[..count], &mut answer);
            if !answer.bytes().is_empty() {
                vehicle.send_to(answer.bytes(), from).unwrap();
            }
            let mut data = Frame::default();
            server.report(3.8, now_ns, &mut data);
            if !data.bytes().is_empty() {
                vehicle.send_to(data.bytes(), from).unwrap();
            }
        }
    }
    let reading = link.battery(1000 * MS).unwrap();
    assert!(
        (reading.voltage - 3.8).abs() < 1e-6 && reading.age < 0.3,
        "{reading:?}"
    );
    let requests = link.port().counts();
    assert_eq!((requests.sent, requests.losses, requests.recoveries), (200, 1, 1));
}

#[test]
fn reading_telemetry_allocates_nothing() {
    let bytes = battery(74, 0, PacketAddress::Handset);
    for protocol in RadioProtocol::ALL {
        let (link, transmitter) = link(protocol);
        let mut format = format::for_link(&link, &transmitter).unwrap();
        let (mut telemetry, mut frame) = (Telemetry::default(), Frame::default());
        let count = allocations::allocations_during(|| {
            for step in 0..100 {
                telemetry.push(&mut *format, &bytes);
                frame.clear();
                format.request_voltage(step * 200 * MS, true, &mut frame);
            }
        });
        assert_eq!(count, 0, "{protocol:?}");
    }
}
