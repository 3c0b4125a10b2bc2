//! CRTP, the packets of a Crazyflie: setpoints of body rates and thrust, stop, and requests to its supervisor.
//!
//! A header of `port << 4 | 0b11 << 2 | channel`, then up to 30 bytes. A packet states no length and has no checksum:
//! each is one datagram, or one packet on the air. Numbers are little-endian.
//!
//! | packet | port, channel | payload |
//! | --- | --- | --- |
//! | manual setpoint | 7, 0 | 11; roll, pitch and yaw rate as `f32`, °/s; thrust as `u16`; 1 for rates |
//! | stop | 7, 0 | 0 |
//! | setpoints end | 7, 1 | 0; time for which the last one remains valid as `u32`, ms |
//! | null packet | any | header 0xFF without a payload |
//!
//! The firmware's setpoint has roll to the right, **pitch nose up and yaw counter-clockwise seen from above** as positive:
//! its rate loop compares them with the gyro's x, −y and z about the axes forward, left, up. About forward, right, down
//! that is roll and pitch as they are, and yaw with the opposite sign. (`Commander` of the Python library negates pitch:
//! its users state nose down as positive.)
//!
//! The firmware restarts if a manual setpoint has another length, so the decoder accepts exact lengths only. It has the
//! manual setpoint since its release 2025.09. The thrust of this packet is not locked, unlike that of the older one of
//! port 3.
//!
//! Requests for arming and the emergency stop go out beside the setpoints ([`supervisor`]). The battery's voltage comes back in
//! a log block ([`log`]).

pub mod log;
pub mod supervisor;

use std::f64::consts::PI;

use scenario::RcLink;

use crate::DecodeError;
use crate::channel_map::{ChannelMap, CodeUnit, PULSES, Units};
use crate::format::{Content, Decoded, Format};
use crate::frame::Frame;
use crate::sticks::Sticks;
use crate::telemetry::Reply;
use log::LogClient;
use supervisor::{SupervisorClient, SupervisorPort, SupervisorRequest};

/// Length of the longest packet, bytes: a manual setpoint.
pub const LONGEST: usize = 17;
/// Null packet: requests an answer, and commands nothing.
pub const NULL: u8 = 0xff;

/// Thrust at the largest of the calibration.
const FULL: f64 = 65_535.0;
const RADIANS_PER_DEGREE: f64 = PI / 180.0;

const PORT: u8 = 7;
const SETPOINTS: u8 = header(PORT, 0);
const META_COMMANDS: u8 = header(PORT, 1);
const STOP: u8 = 0;
const MANUAL: u8 = 11;
const NOTIFY_SETPOINTS_END: u8 = 0;
/// Bits of a header that radio links use for themselves.
const LINK_BITS: u8 = 0b1100;

const fn header(port: u8, channel: u8) -> u8 {
    port << 4 | LINK_BITS | channel
}

/// Packet to a Crazyflie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrazyfliePacket {
    /// Body rates and thrust.
    Rates(RateSetpoint),
    /// Stops the motors.
    Stop,
    /// Setpoints end, and the last one remains valid for a time, ms.
    NotifySetpointsEnd(u32),
    /// Requests arming, or an emergency stop.
    Supervisor(SupervisorRequest, SupervisorPort),
    /// Requests an answer, and commands nothing.
    Null,
}

impl CrazyfliePacket {
    /// Returns whether the packet stops the motors.
    #[must_use]
    pub fn stops(&self) -> bool {
        matches!(
            self,
            Self::Stop | Self::Supervisor(SupervisorRequest::EmergencyStop, _)
        )
    }
}

/// Setpoint of body rates and thrust, in the firmware's signs and units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateSetpoint {
    /// Rate to the right, nose up, and counter-clockwise seen from above, °/s.
    pub rates: [f32; 3],
    /// Thrust, 65535 at the largest.
    pub thrust: u16,
}

impl RateSetpoint {
    /// Makes the setpoint of body rates about forward, right, down, rad/s, and of a share of the largest thrust.
    #[must_use]
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the packet has numbers of 32 and 16 bits, and the share is limited"
    )]
    pub fn new([roll, pitch, yaw]: [f64; 3], thrust_share: f64) -> Self {
        let rates = [roll, pitch, -yaw].map(|rate| (rate / RADIANS_PER_DEGREE) as f32);
        Self {
            rates,
            thrust: libm::round(thrust_share.clamp(0.0, 1.0) * FULL) as u16,
        }
    }

    /// Returns the body rates about forward, right, down, rad/s.
    #[must_use]
    pub fn rates_body(&self) -> [f64; 3] {
        let [roll, pitch, yaw] = self.rates.map(|rate| f64::from(rate) * RADIANS_PER_DEGREE);
        [roll, pitch, -yaw]
    }

    /// Returns the share of the largest thrust.
    #[must_use]
    pub fn thrust_share(&self) -> f64 {
        f64::from(self.thrust) / FULL
    }
}

/// Appends a packet to a frame.
#[inline]
pub fn encode(packet: &CrazyfliePacket, frame: &mut Frame) {
    match packet {
        CrazyfliePacket::Rates(setpoint) => {
            frame.push(&[SETPOINTS, MANUAL]);
            for rate in setpoint.rates {
                frame.push(&rate.to_le_bytes());
            }
            frame.push(&setpoint.thrust.to_le_bytes());
            frame.push(&[1]);
        }
        CrazyfliePacket::Stop => frame.push(&[SETPOINTS, STOP]),
        CrazyfliePacket::NotifySetpointsEnd(milliseconds) => {
            frame.push(&[META_COMMANDS, NOTIFY_SETPOINTS_END]);
            frame.push(&milliseconds.to_le_bytes());
        }
        CrazyfliePacket::Supervisor(request, port) => supervisor::encode(*request, *port, frame),
        CrazyfliePacket::Null => frame.push(&[NULL]),
    }
}

/// Decodes a packet.
///
/// # Errors
/// [`DecodeError`] if the bytes are not one of the known packets: another port or type, angles instead of rates, a rate
/// that is not finite, or another length.
pub fn decode(bytes: &[u8]) -> Result<CrazyfliePacket, DecodeError> {
    let at = |offset: usize, expected: usize| {
        bytes.get(offset).copied().ok_or(DecodeError::Length {
            expected,
            found: bytes.len(),
        })
    };
    let first = at(0, 1)? | LINK_BITS;
    if first == NULL {
        // A link sends its own commands to the same port, with a payload.
        return has_length(bytes, 1).map(|()| CrazyfliePacket::Null);
    }
    if let Some((request, port)) = supervisor::decode(first, &bytes[1..]) {
        return Ok(CrazyfliePacket::Supervisor(request, port));
    }
    if first != SETPOINTS && first != META_COMMANDS {
        return Err(unexpected(0, first));
    }
    match (first, at(1, 2)?) {
        (SETPOINTS, STOP) => has_length(bytes, 2).map(|()| CrazyfliePacket::Stop),
        (SETPOINTS, MANUAL) => has_length(bytes, LONGEST).and_then(|()| decode_rates(bytes)),
        (META_COMMANDS, NOTIFY_SETPOINTS_END) => has_length(bytes, 6).map(|()| {
            let milliseconds = [2, 3, 4, 5].map(|offset| bytes[offset]);
            CrazyfliePacket::NotifySetpointsEnd(u32::from_le_bytes(milliseconds))
        }),
        (_, other) => Err(unexpected(1, other)),
    }
}

/// Decodes a manual setpoint of the right length.
fn decode_rates(bytes: &[u8]) -> Result<CrazyfliePacket, DecodeError> {
    let rate = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[at + byte]));
    if bytes[16] != 1 {
        return Err(unexpected(16, bytes[16]));
    }
    let rates = [2, 6, 10].map(rate);
    if let Some(axis) = rates.iter().position(|rate| !rate.is_finite()) {
        let most_significant = 4 * axis + 5;
        return Err(unexpected(most_significant, bytes[most_significant]));
    }
    Ok(CrazyfliePacket::Rates(RateSetpoint {
        rates,
        thrust: u16::from_le_bytes([bytes[14], bytes[15]]),
    }))
}

fn has_length(bytes: &[u8], expected: usize) -> Result<(), DecodeError> {
    if bytes.len() == expected {
        Ok(())
    } else {
        Err(DecodeError::Length {
            expected,
            found: bytes.len(),
        })
    }
}

fn unexpected(offset: usize, found: u8) -> DecodeError {
    DecodeError::Constant { offset, found }
}

/// Frame format of a Crazyflie: a setpoint, or stop.
#[derive(Clone, Debug)]
pub(crate) struct Crazyflie {
    /// Body rates per unit of travel, rad/s.
    rate_slope: [f64; 3],
    supervisor: SupervisorClient,
    log: LogClient,
}

impl Crazyflie {
    pub(crate) fn new(link: &RcLink) -> Self {
        Self {
            rate_slope: link.rate_slope,
            supervisor: SupervisorClient::default(),
            log: LogClient::default(),
        }
    }

    #[inline]
    fn packet(&self, map: &ChannelMap, sticks: &Sticks) -> CrazyfliePacket {
        let Some([_, rates @ ..]) = sticks.codes else {
            return CrazyfliePacket::Stop;
        };
        let rate = |axis: usize| self.rate_slope[axis] * map.travel(rates[axis]).value();
        CrazyfliePacket::Rates(RateSetpoint::new([0, 1, 2].map(rate), map.thrust_share(sticks)))
    }
}

impl Format for Crazyflie {
    /// The packets have no channels.
    fn units(&self) -> Units {
        Units {
            ends: [1000, 2000],
            limits: PULSES,
            unstated: [0; 16],
            unit: CodeUnit::Pulse,
        }
    }

    #[inline]
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame) {
        let packet = if content.failsafe {
            CrazyfliePacket::Stop
        } else {
            self.packet(content.map, content.sticks)
        };
        encode(&packet, frame);
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        match decode(bytes) {
            Ok(CrazyfliePacket::Rates(setpoint)) => {
                Decoded::Rates(bytes.len(), setpoint.rates_body(), setpoint.thrust_share())
            }
            Ok(packet) if packet.stops() => Decoded::Stop(bytes.len()),
            Ok(_) => Decoded::Other(bytes.len()),
            Err(DecodeError::Length { expected, found }) if found < expected => Decoded::Incomplete,
            Err(_) => Decoded::Noise,
        }
    }

    fn request(&mut self, map: &ChannelMap, sticks: &Sticks, frame: &mut Frame) {
        let has_thrust = sticks.codes.is_some() && map.thrust_share(sticks) > 0.0;
        self.supervisor.request(sticks, has_thrust, frame);
    }

    fn read_reply(&mut self, bytes: &[u8]) -> Reply {
        self.log.read(bytes)
    }

    fn request_voltage(&mut self, now_ns: u64, are_motors_off: bool, frame: &mut Frame) {
        self.log.request(now_ns, are_motors_off, frame);
    }

    /// Stop is a packet of its own. If packets ended, the vehicle would keep its thrust for 2 s.
    fn has_failsafe_flag(&self) -> bool {
        true
    }

    fn has_packets(&self) -> bool {
        true
    }
}
