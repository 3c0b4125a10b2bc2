//! The packets do not depend on the pieces in which bytes arrive, nor on what is between packets; no bytes do harm.

use navigation_receivers::Packet;
use navigation_receivers::counts::{Counts, Message, Reason};
use navigation_receivers::stream::Stream;
use proptest::prelude::*;

use crate::{allocations, vectors};

/// Decodes bytes that arrive in pieces of these lengths, in turn.
fn decoded(bytes: &[u8], lengths: &[usize]) -> (Vec<Packet>, Counts) {
    let mut stream = Stream::default();
    let mut packets = Vec::new();
    let (mut rest, mut lengths) = (bytes, lengths.iter().cycle());
    while !rest.is_empty() {
        let (piece, later) = rest.split_at((*lengths.next().unwrap()).min(rest.len()));
        stream.push(piece, &mut |packet| packets.push(*packet));
        rest = later;
    }
    stream.finish(&mut |packet| packets.push(*packet));
    (packets, *stream.counts())
}

/// Bytes between packets: any, and starts of packets.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        4 => any::<u8>(),
        1 => prop::sample::select(&[0xb5, 0x62, 0x01, 0x07, 0xfe, 0xfd, b'$', b'G'][..]),
    ];
    prop::collection::vec(byte, 0..60)
}

/// Packets of published libraries, some with a changed byte or cut, and noise between them.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let spoilt = prop::option::weighted(0.3, (any::<prop::sample::Index>(), any::<u8>()));
    let cut = prop::option::weighted(0.2, any::<prop::sample::Index>());
    let packet = (any::<prop::sample::Index>(), spoilt, cut, noise());
    prop::collection::vec(packet, 0..12).prop_map(|parts| {
        let vectors = vectors::committed();
        let mut bytes = Vec::new();
        for (which, spoilt, cut, noise) in parts {
            let mut packet = which.get(&vectors).bytes.clone();
            if let Some((place, byte)) = spoilt {
                let place = place.index(packet.len());
                packet[place] = byte;
            }
            if let Some(cut) = cut {
                packet.truncate(cut.index(packet.len()));
            }
            bytes.extend(packet);
            bytes.extend(noise);
        }
        bytes
    })
}

/// Asserts that packets are equal; NaN equals itself.
fn assert_same(first: &[Packet], second: &[Packet]) {
    assert_eq!(format!("{first:?}"), format!("{second:?}"));
}

proptest! {
    #[test]
    fn packets_do_not_depend_on_the_pieces(
        bytes in stream(), lengths in prop::collection::vec(1usize..90, 1..20),
    ) {
        let (packets, counts) = decoded(&bytes, &[usize::MAX]);
        let (in_pieces, counts_of_pieces) = decoded(&bytes, &lengths);
        assert_same(&packets, &in_pieces);
        prop_assert_eq!(counts, counts_of_pieces);
        prop_assert_eq!(counts.bytes, bytes.len() as u64);
        prop_assert!(counts.skipped <= counts.bytes);
        prop_assert_eq!(counts.total(), packets.len() as u64);
    }

    #[test]
    fn any_bytes_are_the_same_in_any_pieces(
        bytes in prop::collection::vec(any::<u8>(), 0..3000), lengths in prop::collection::vec(1usize..90, 1..20),
    ) {
        let (packets, counts) = decoded(&bytes, &[usize::MAX]);
        let (in_pieces, counts_of_pieces) = decoded(&bytes, &lengths);
        assert_same(&packets, &in_pieces);
        prop_assert_eq!(counts, counts_of_pieces);
    }

    #[test]
    fn noise_between_packets_costs_none(
        parts in prop::collection::vec((any::<prop::sample::Index>(), noise()), 1..12), length in 1usize..300,
    ) {
        let vectors = vectors::committed();
        let (mut bytes, mut sent) = (Vec::new(), Vec::new());
        for (which, noise) in parts {
            let vector = which.get(&vectors);
            // Noise may pretend to be a packet, which is refused without its bytes being lost.
            bytes.extend(noise);
            bytes.extend(&vector.bytes);
            sent.push(vector.message.clone());
        }
        let (packets, _) = decoded(&bytes, &[length]);
        let read: Vec<_> = packets.iter().map(|packet| packet.message().name().to_owned()).collect();
        prop_assert_eq!(read, sent);
    }

    /// What a checksum lets pass need not be plausible.
    #[test]
    fn any_payload_with_a_right_checksum_is_a_packet_or_refused(
        payload in prop::collection::vec(any::<u8>(), 92), known in 0u8..8, kind in 0u8..6, form in 0usize..5,
    ) {
        let mut payload = payload;
        let bytes = match form {
            0 => {
                // Known date and time, and a kind of solution.
                (payload[11], payload[20]) = (known, kind);
                ubx(0x07, &payload)
            }
            1 => {
                payload[0] = 1;
                ubx(0x3c, &payload[..64])
            }
            _ => mavlink(&[(24, 52, 24), (105, 63, 93), (331, 233, 91)][form - 2], &payload),
        };
        let (packets, counts) = decoded(&bytes, &[usize::MAX]);
        prop_assert_eq!(packets.len() as u64 + counts.total_refused(), 1);
    }

    #[test]
    fn a_changed_byte_is_refused_and_counted(
        which in any::<prop::sample::Index>(), place in any::<prop::sample::Index>(), change in 1u8..,
    ) {
        let vectors = vectors::committed();
        let vector = which.get(&vectors);
        let mut bytes = vector.bytes.clone();
        let signature = if bytes[0] == 0xfd && bytes[2] & 1 == 1 { 13 } else { 0 };
        let place = place.index(bytes.len() - signature);
        bytes[place] ^= change;
        let (packets, counts) = decoded(&bytes, &[usize::MAX]);
        prop_assert!(packets.is_empty(), "{} {place}", vector.message);
        // Start, length and identity make it something else.
        let header = if bytes[0] == 0xfd { 10 } else { 6 };
        if place >= header {
            prop_assert_eq!(counts.total_refused(), 1);
            prop_assert_eq!(counts.refusals().next().map(|(_, reason, _)| reason), Some(Reason::Checksum));
        }
    }
}

#[test]
fn packets_are_read_without_an_allocation() {
    let bytes: Vec<u8> = vectors::committed()
        .iter()
        .flat_map(|vector| vector.bytes.clone())
        .collect();
    let mut stream = Stream::default();
    let mut packets = 0;
    let count = allocations::allocations_during(|| {
        for piece in bytes.chunks(50) {
            stream.push(piece, &mut |_| packets += 1);
        }
    });
    assert_eq!((count, packets), (0, 36));
}

/// Packet with a payload, and a right checksum.
fn ubx(id: u8, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).unwrap().to_le_bytes();
    let mut packet = vec![0xb5, 0x62, 0x01, id, length[0], length[1]];
    packet.extend(payload);
    let sum = navigation_receivers::ubx::checksum(&packet[2..]);
    packet.extend(sum);
    packet
}

/// Packet of MAVLink 2 of a message (ID, length, `CRC_EXTRA`), whose payload repeats the given one.
fn mavlink(&(id, length, crc_extra): &(u32, usize, u8), payload: &[u8]) -> Vec<u8> {
    let definition = mavlink_frame::Definition {
        id,
        base_length: length,
        length,
        crc_extra,
    };
    let sender = mavlink_frame::Sender {
        system: 1,
        component: 1,
    };
    let payload: Vec<u8> = payload.iter().copied().cycle().take(length).collect();
    let mut bytes = Vec::new();
    mavlink_frame::encode(&definition, &payload, sender, 0, |part| {
        bytes.extend_from_slice(part);
    });
    bytes
}

#[test]
fn each_refusal_has_its_message_and_its_reason() {
    let mut beyond_the_pole = [0; 92];
    beyond_the_pole[28..32].copy_from_slice(&900_000_001_i32.to_le_bytes());
    let mut bytes = ubx(0x07, &beyond_the_pole);
    // A date whose nanoseconds do not fit.
    let mut far_future = [0; 92];
    far_future[4..12].copy_from_slice(&[0xff, 0xff, 1, 1, 0, 0, 0, 0b111]);
    bytes.extend(ubx(0x07, &far_future));
    bytes.extend(ubx(0x07, &[0; 84]));
    bytes.extend(ubx(0x3c, &[0; 64]));
    bytes.extend(ubx(0x35, &[0; 20]));
    bytes.extend(b"$GNGGA,001043.00,4404.14036,N,12118.85961,W,1,12,0.98,1113.0,M,-21.3,M,,*47\r\n");
    let (packets, counts) = decoded(&bytes, &[7]);
    assert!(packets.is_empty());
    let refusals: Vec<_> = counts.refusals().collect();
    assert_eq!(
        refusals,
        [
            (Message::NavPvt, Reason::Length, 1),
            (Message::NavPvt, Reason::Range, 2),
            (Message::NavRelposned, Reason::Version, 1),
        ]
    );
    assert_eq!((counts.other_ubx, counts.nmea), (1, 1));
}

#[test]
fn a_number_that_is_none_is_refused() {
    let vector = vectors::committed()
        .into_iter()
        .find(|vector| {
            vector.message == "HIGHRES_IMU"
                && vector
                    .numbers
                    .iter()
                    .any(|(name, number)| name == "force0" && !number.is_nan())
        })
        .unwrap();
    let header = if vector.bytes[0] == 0xfd { 10 } else { 6 };
    let mut payload = [0; 63];
    let sent = &vector.bytes[header..header + usize::from(vector.bytes[1])];
    payload[..sent.len()].copy_from_slice(sent);
    payload[8..12].copy_from_slice(&f32::NAN.to_le_bytes());
    let bytes = mavlink(&(105, 63, 93), &payload);
    let (packets, counts) = decoded(&bytes, &[1]);
    assert!(packets.is_empty());
    assert_eq!(counts.refused(Message::HighresImu, Reason::NotFinite), 1);
}

/// A single wrong byte on the line makes such a header, which once stopped the decoder for ever.
#[test]
fn the_longest_frame_that_a_header_can_claim_is_waited_for_and_no_longer() {
    let vector = &vectors::committed()[0];
    for length in 230..=255_u8 {
        for signed in [0, 1] {
            let header = [0xfd, length, signed, 0, 0, 1, 1, 105, 0, 0];
            let mut bytes = header.to_vec();
            bytes.extend([0; 300]);
            bytes.extend(&vector.bytes);
            for pieces in [&[usize::MAX][..], &[1], &[7, 64]] {
                let (packets, counts) = decoded(&bytes, pieces);
                assert_eq!(packets.len(), 1, "{length} {signed}: {counts:?}");
            }
        }
    }
}
