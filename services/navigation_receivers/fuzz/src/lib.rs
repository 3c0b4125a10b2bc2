//! Invariants of the decoders of satellite receivers and autopilots for arbitrary bytes.

use navigation_receivers::Packet;
use navigation_receivers::counts::Counts;
use navigation_receivers::stream::Stream;

/// Asserts that bytes give the same packets and counts at once and in pieces, and only values in their ranges.
///
/// # Panics
/// If they do not.
pub fn check(bytes: &[u8]) {
    let (packets, counts) = decoded(bytes, usize::MAX);
    for piece in [1, 7, 100] {
        let in_pieces = decoded(bytes, piece);
        // NaN is no heading's deviation, and equals itself as a text.
        assert_eq!(format!("{packets:?}"), format!("{:?}", in_pieces.0));
        assert_eq!(counts, in_pieces.1);
    }
    assert_eq!(counts.total(), packets.len() as u64);
    assert_eq!(counts.bytes, bytes.len() as u64);
    assert!(counts.skipped <= counts.bytes);
    packets.iter().for_each(check_packet);
}

/// Decodes bytes that arrive in pieces of `piece` bytes.
fn decoded(bytes: &[u8], piece: usize) -> (Vec<Packet>, Counts) {
    let mut stream = Stream::default();
    let mut packets = Vec::new();
    for piece in bytes.chunks(piece) {
        stream.push(piece, &mut |packet| packets.push(*packet));
    }
    stream.finish(&mut |packet| packets.push(*packet));
    (packets, *stream.counts())
}

fn check_packet(packet: &Packet) {
    let is_on_earth = |latitude: f64, longitude: f64| latitude.abs() <= 90.0 && longitude.abs() <= 180.0;
    let is_finite =
        |vector: Option<[f64; 3]>| vector.is_none_or(|vector| vector.iter().all(|number| number.is_finite()));
    match packet {
        Packet::NavPvt(pvt) => assert!(is_on_earth(pvt.latitude, pvt.longitude)),
        Packet::GpsRawInt(_, fix) => assert!(is_on_earth(fix.latitude, fix.longitude)),
        Packet::HighresImu(_, sample) => {
            let vectors = [
                sample.specific_force_body,
                sample.angular_velocity_body,
                sample.field_body,
            ];
            assert!(vectors.into_iter().all(is_finite));
        }
        Packet::Odometry(_, motion) => {
            let squared_norm: f64 = motion
                .quaternion
                .iter()
                .map(|component| component * component)
                .sum();
            assert!((squared_norm - 1.0).abs() <= 2e-3);
            assert!(is_finite(Some(motion.position)) && is_finite(motion.velocity));
        }
        Packet::RelativePosition(_) | Packet::Heartbeat(..) => {}
    }
}
