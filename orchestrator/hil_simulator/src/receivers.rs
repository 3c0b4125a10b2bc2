//! Simulated receivers: a satellite receiver that sends UBX `NAV-PVT`, and `NAV-RELPOSNED` with a second antenna, and an autopilot
//! that sends MAVLink `HIGHRES_IMU`.
//!
//! The samples are those of the plant's sensors. A packet is sent the stated latency after its measurement: those of the satellite
//! receiver to the first source of the flight, those of the autopilot to the last one.

use std::collections::VecDeque;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use mavlink_frame::{Definition, Sender};
use runtime::flight_clock::monotonic_ns;
use scenario::{Receivers, Scenario};
use shared_types::receiver_source::{ReceiverSource, ReceiverSourceError};
use shared_types::samples::{BaroAltitude, GnssBaseline, GnssFix, ImuSample, MagField};
use shared_types::service::nanoseconds;

use super::LateCaptures;

/// `HIGHRES_IMU` in the dialect *common*.
const HIGHRES_IMU: Definition = Definition {
    id: 105,
    base_length: 62,
    length: 63,
    crc_extra: 93,
};
/// Bits of its updated fields: specific force and rates, field, pressure altitude.
const INERTIAL: u16 = 0b11_1111;
const FIELD: u16 = 0b111 << 6;
const ALTITUDE: u16 = 1 << 11;

/// Sender of the autopilot.
const AUTOPILOT: Sender = Sender {
    system: 1,
    component: 1,
};

/// Time since the autopilot was switched on at the start of the simulation, ns.
const UP_NS: u64 = 30_000_000_000;
/// Time of the week at the start of the simulation, ms.
const WEEK_MS: u64 = 200_000_000;
/// Satellites of a fix.
const SATELLITES: u8 = 21;

/// Error of receivers that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum ReceiversError {
    /// A source is not an address.
    #[error(transparent)]
    Address(#[from] ReceiverSourceError),
    /// A source is no UDP socket.
    #[error(
        "the simulated receivers send over UDP only, and `{0}` is no such source; state `receivers.sources = [\"udp:127.0.0.1:14550\"]`"
    )]
    NotUdp(ReceiverSource),
    /// A source is that of another machine, where the packets of a simulation could be taken for those of a vehicle.
    #[error(
        "`udp:{0}` is no address of this machine, and the simulated receivers send to a flight on the same machine only; state \
         `receivers.sources = [\"udp:127.0.0.1:14550\"]`"
    )]
    OtherMachine(SocketAddr),
    /// The flight has a second antenna, and the simulation has none.
    #[error(
        "`navigation.baseline` is stated, and the simulated receiver has no second antenna; state `sensors.gnss.baseline` as well, its \
         true place"
    )]
    OneAntenna,
    /// The socket could not be opened.
    #[error("cannot open a socket: {0}")]
    Socket(#[from] std::io::Error),
}

/// Samples of a tick, each if it is due.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measured {
    pub imu: Option<ImuSample>,
    pub fix: Option<GnssFix>,
    pub baseline: Option<GnssBaseline>,
    pub altitude: Option<BaroAltitude>,
    pub field: Option<MagField>,
}

/// Packet to be sent; times are ns of `CLOCK_MONOTONIC`.
#[derive(Debug)]
struct Packet {
    due_ns: u64,
    bytes: Vec<u8>,
}

/// Packets to a destination, oldest first.
#[derive(Debug)]
struct Line {
    socket: UdpSocket,
    to: SocketAddr,
    latency_ns: u64,
    pending: VecDeque<Packet>,
}

/// Simulated receivers.
#[derive(Debug)]
pub struct ReceiverSender {
    fixes: Line,
    motion: Line,
    /// Height of the origin of {I} above the pressure level, m.
    height: f64,
    sequence: u8,
    sent: u64,
    late: LateCaptures,
}

impl ReceiverSender {
    /// Makes the receivers of a scenario.
    ///
    /// # Errors
    /// [`ReceiversError`].
    pub fn open(scenario: &Scenario, stated: &Receivers) -> Result<Self, ReceiversError> {
        let sensors = scenario.sensors.as_ref();
        if scenario.baseline().is_some() && sensors.is_none_or(|sensors| sensors.gnss.baseline.is_none()) {
            return Err(ReceiversError::OneAntenna);
        }
        let destinations = stated
            .addresses()?
            .into_iter()
            .map(destination)
            .collect::<Result<Vec<_>, _>>()?;
        let line = |to: Option<&SocketAddr>, latency: f64| {
            let to = to.copied().unwrap_or_else(|| (Ipv4Addr::LOCALHOST, 0).into());
            let from: IpAddr = match to {
                SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
                SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
            };
            UdpSocket::bind((from, 0)).map(|socket| Line {
                socket,
                to,
                latency_ns: nanoseconds(latency),
                pending: VecDeque::new(),
            })
        };
        Ok(Self {
            fixes: line(destinations.first(), stated.fix_latency)?,
            motion: line(destinations.last(), stated.latency)?,
            height: scenario.datum_or_default().height,
            sequence: 0,
            sent: 0,
            late: LateCaptures::default(),
        })
    }

    /// Schedules the packets of samples that were measured at a time, ns of `CLOCK_MONOTONIC`, in a simulation that started at
    /// `start_ns`.
    pub(super) fn schedule(&mut self, measured: &Measured, measured_ns: u64, start_ns: u64) {
        let since_start_ns = measured_ns - start_ns;
        // Without a position a receiver's packet is not used: none is sent.
        if let Some(fix) = measured.fix.as_ref().filter(|fix| fix.measured.is_set()) {
            self.fixes.push(measured_ns, nav_pvt(fix, since_start_ns));
        }
        if let Some(baseline) = measured
            .baseline
            .as_ref()
            .filter(|baseline| baseline.measured.is_set())
        {
            self.fixes
                .push(measured_ns, nav_relposned(baseline, since_start_ns));
        }
        if measured.imu.is_some() || measured.altitude.is_some() || measured.field.is_some() {
            let bytes = highres_imu(measured, since_start_ns, self.height, self.sequence);
            self.sequence = self.sequence.wrapping_add(1);
            self.motion.push(measured_ns, bytes);
        }
    }

    /// Returns the time at which the next packet is due, ns of `CLOCK_MONOTONIC`.
    pub(super) fn due_ns(&self) -> u64 {
        let due = |line: &Line| line.pending.front().map_or(u64::MAX, |packet| packet.due_ns);
        due(&self.fixes).min(due(&self.motion))
    }

    /// Sends the packets that are due.
    pub(super) fn send(&mut self, now_ns: u64) {
        for line in [&mut self.fixes, &mut self.motion] {
            while let Some(packet) = line.pending.pop_front_if(|packet| packet.due_ns <= now_ns) {
                // Without a flight nobody receives them.
                let _ = line.socket.send_to(&packet.bytes, line.to);
                self.late.add(monotonic_ns().saturating_sub(packet.due_ns));
                self.sent += 1;
            }
        }
    }

    /// Returns the packets that were sent late.
    pub(super) fn late(&self) -> LateCaptures {
        self.late
    }

    /// Returns the number of packets sent.
    pub(super) fn sent(&self) -> u64 {
        self.sent
    }
}

impl Line {
    fn push(&mut self, measured_ns: u64, bytes: Vec<u8>) {
        self.pending.push_back(Packet {
            due_ns: measured_ns + self.latency_ns,
            bytes,
        });
    }
}

/// Returns the address to which packets for a source are sent.
fn destination(source: ReceiverSource) -> Result<SocketAddr, ReceiversError> {
    match source {
        ReceiverSource::Udp(at) if at.ip().is_unspecified() => Ok((Ipv4Addr::LOCALHOST, at.port()).into()),
        // A socket can be bound to an address of this machine, to those of groups, and to that of all machines of its network; to the
        // last it cannot send unless it is permitted to.
        ReceiverSource::Udp(at)
            if is_group(at.ip())
                || UdpSocket::bind((at.ip(), 0))
                    .and_then(|socket| socket.connect(at))
                    .is_err() =>
        {
            Err(ReceiversError::OtherMachine(at))
        }
        ReceiverSource::Udp(at) => Ok(at),
        other => Err(ReceiversError::NotUdp(other)),
    }
}

/// Returns whether an address is that of several machines.
fn is_group(address: IpAddr) -> bool {
    address.is_multicast() || matches!(address, IpAddr::V4(address) if address.is_broadcast())
}

/// Returns the time of the week at a time since the start, ns, in ms.
fn week_ms(since_start_ns: u64) -> [u8; 4] {
    let week_ms = (WEEK_MS + since_start_ns / 1_000_000) % 604_800_000;
    u32::try_from(week_ms).expect("a week has 6e8 ms").to_le_bytes()
}

/// Returns the packet of class `NAV` with a payload.
fn ubx(id: u8, payload: &[u8]) -> Vec<u8> {
    let length = u8::try_from(payload.len()).expect("payloads are short");
    let mut packet = vec![0xb5, 0x62, 0x01, id, length, 0];
    packet.extend(payload);
    let sum = packet[2..].iter().fold([0_u8, 0], |[first, second], byte| {
        let first = first.wrapping_add(*byte);
        [first, second.wrapping_add(first)]
    });
    packet.extend(sum);
    packet
}

/// Encodes `NAV-PVT` of a fix without UTC, valid at a time since the start, ns.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "coordinates and accuracies in the protocol's units; rounded"
)]
fn nav_pvt(fix: &GnssFix, since_start_ns: u64) -> Vec<u8> {
    let mut payload = [0; 92];
    let mut put = |offset: usize, bytes: [u8; 4]| payload[offset..offset + 4].copy_from_slice(&bytes);
    let signed = |value: f64| (libm::round(value) as i32).to_le_bytes();
    let millimetres = |value: f64| (libm::round(1e3 * value) as u32).to_le_bytes();
    put(0, week_ms(since_start_ns));
    put(24, signed(1e7 * fix.longitude));
    put(28, signed(1e7 * fix.latitude));
    put(32, signed(1e3 * fix.height));
    put(36, signed(1e3 * fix.height));
    put(40, millimetres(fix.horizontal_accuracy));
    put(44, millimetres(fix.vertical_accuracy));
    for (offset, component) in [48, 52, 56].into_iter().zip(fix.velocity_ned) {
        put(offset, signed(1e3 * component));
    }
    put(68, millimetres(fix.speed_accuracy));
    // A position in three dimensions, which is valid, and the solution of the carrier.
    payload[20] = 3;
    payload[21] = 1 | u8::from(fix.kind > 0) << 1 | fix.kind << 6;
    payload[23] = SATELLITES;
    ubx(0x07, &payload)
}

/// Encodes `NAV-RELPOSNED` of a baseline between a moving base and its rover, valid at a time since the start, ns.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lengths and angles in the protocol's units; rounded"
)]
fn nav_relposned(baseline: &GnssBaseline, since_start_ns: u64) -> Vec<u8> {
    let mut payload = [0; 64];
    let [north, east, down] = baseline.baseline_ned;
    let length = libm::sqrt(north * north + east * east + down * down);
    let horizontal = libm::hypot(north, east).max(f64::MIN_POSITIVE);
    let hundred_thousandths = |angle: f64| libm::round(1e5 * angle.to_degrees());
    let heading = libm::atan2(east, north).rem_euclid(std::f64::consts::TAU);
    payload[0] = 1;
    payload[4..8].copy_from_slice(&week_ms(since_start_ns));
    // Centimetres, and the tenths of millimetres that are left.
    for (index, component) in [north, east, down, length].into_iter().enumerate() {
        let tenths = libm::round(1e4 * component) as i32;
        payload[8 + 4 * index..][..4].copy_from_slice(&(tenths / 100).to_le_bytes());
        payload[32 + index] = ((tenths % 100) as i8).to_le_bytes()[0];
    }
    payload[24..28].copy_from_slice(&(hundred_thousandths(heading) as i32).to_le_bytes());
    let [accuracy, _, vertical] = baseline.accuracies_ned;
    for (index, deviation) in [accuracy, accuracy, vertical, accuracy].into_iter().enumerate() {
        payload[36 + 4 * index..][..4].copy_from_slice(&(libm::round(1e4 * deviation) as u32).to_le_bytes());
    }
    payload[52..56].copy_from_slice(&(hundred_thousandths(accuracy / horizontal) as u32).to_le_bytes());
    // A fix and a baseline that are valid, with corrections, the solution of the carrier, a base that moves, and a valid heading.
    let carrier = 1 + u32::from(baseline.fixed.is_set());
    payload[60..64].copy_from_slice(&(0b1_0010_0111 | carrier << 3).to_le_bytes());
    ubx(0x3c, &payload)
}

/// Encodes `HIGHRES_IMU` of the samples that are there, at a time since the start, ns.
fn highres_imu(measured: &Measured, since_start_ns: u64, height: f64, sequence: u8) -> Vec<u8> {
    let mut payload = [0; 63];
    payload[..8].copy_from_slice(&((UP_NS + since_start_ns) / 1000).to_le_bytes());
    let mut updated = 0;
    let mut put = |offset: usize, numbers: &[f64], mask: u16| {
        updated |= mask;
        for (index, number) in numbers.iter().enumerate() {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "the protocol has single precision"
            )]
            let bytes = (*number as f32).to_le_bytes();
            payload[offset + 4 * index..][..4].copy_from_slice(&bytes);
        }
    };
    if let Some(imu) = &measured.imu {
        put(8, &imu.specific_force_body, INERTIAL);
        put(20, &imu.angular_velocity_body, INERTIAL);
    }
    if let Some(field) = &measured.field {
        put(32, &field.field_body, FIELD);
    }
    if let Some(altitude) = &measured.altitude {
        put(52, &[altitude.altitude + height], ALTITUDE);
    }
    payload[60..62].copy_from_slice(&u16::to_le_bytes(updated));
    let mut bytes = Vec::with_capacity(mavlink_frame::LONGEST);
    mavlink_frame::encode(&HIGHRES_IMU, &payload, AUTOPILOT, sequence, |part| {
        bytes.extend_from_slice(part);
    });
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_are_sent_to_a_flight_on_this_machine_only() {
        let sent_to = |source: &str| {
            let found = destination(source.parse().unwrap());
            found
                .map(|address| address.to_string())
                .map_err(|error| error.to_string())
        };
        for source in ["udp:127.0.0.1:14550", "udp:0.0.0.0:14550"] {
            assert_eq!(sent_to(source).as_deref(), Ok("127.0.0.1:14550"));
        }
        for source in [
            "udp:192.0.2.1:14550",
            "udp:224.0.0.1:14550",
            "udp:255.255.255.255:14550",
            "udp:127.255.255.255:14550",
            "udp:[2001:db8::1]:14550",
            "udp:[ff02::1]:14550",
        ] {
            let refused = sent_to(source).unwrap_err();
            assert!(
                refused.contains(&format!("`{source}` is no address of this machine"))
                    && refused.contains("udp:127.0.0.1:14550"),
                "{refused}"
            );
        }
        for source in ["/dev/ttyACM0", "tcp:127.0.0.1:5760"] {
            assert!(sent_to(source).unwrap_err().contains("send over UDP only"));
        }
    }
}
