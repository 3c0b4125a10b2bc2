//! MAVLink from an autopilot: what it measures and estimates.
//!
//! Axes are forward, right and down. Times are those of the autopilot: since it was switched on, or since 1970.

use mavlink_frame::{Definition, Frame, FrameError, Header, SIGNED};
use shared_types::gnss::FixKind;

use crate::Packet;
use crate::counts::{Message, Reason};
use crate::decoded::Decoded;
use crate::fields::Fields;
use crate::ubx::Heading;

/// Messages that are read, with their definitions in the dialect *common*.
const MESSAGES: [(Message, Definition); 4] = [
    (
        Message::Heartbeat,
        Definition {
            id: 0,
            base_length: 9,
            length: 9,
            crc_extra: 50,
        },
    ),
    (
        Message::GpsRawInt,
        Definition {
            id: 24,
            base_length: 30,
            length: 52,
            crc_extra: 24,
        },
    ),
    (
        Message::HighresImu,
        Definition {
            id: 105,
            base_length: 62,
            length: 63,
            crc_extra: 93,
        },
    ),
    (
        Message::Odometry,
        Definition {
            id: 331,
            base_length: 230,
            length: 233,
            crc_extra: 91,
        },
    ),
];

const DEFINITIONS: [Definition; MESSAGES.len()] = {
    let mut definitions = [MESSAGES[0].1; MESSAGES.len()];
    let mut index = 0;
    while index < MESSAGES.len() {
        definitions[index] = MESSAGES[index].1;
        index += 1;
    }
    definitions
};

/// Length of the longest payload, bytes.
const PAYLOAD: usize = 233;

/// `HEARTBEAT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// `MAV_AUTOPILOT`: 3 for ArduPilot, 12 for PX4, 8 for a component that is no autopilot.
    pub autopilot: u8,
    /// `MAV_TYPE`: 2 for a quadrotor, 6 for a ground station.
    pub kind: u8,
    /// `true` if the motors are armed.
    pub is_armed: bool,
}

/// `GPS_RAW_INT`: the fix of the autopilot's receiver. It has no vertical velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsRawInt {
    /// Time of the fix, or of its arrival at the autopilot, µs.
    pub time_us: u64,
    /// Number of the kind of fix, `GPS_FIX_TYPE`: 3 and 4 without carrier, 5 float, 6 fixed.
    pub fix_type: u8,
    /// Number of visible satellites; `None` if it is not known.
    pub satellites: Option<u8>,
    /// Geodetic latitude (WGS-84), degrees.
    pub latitude: f64,
    /// Longitude (WGS-84), degrees.
    pub longitude: f64,
    /// Height above mean sea level, m.
    pub height_above_sea: f64,
    /// Height above the ellipsoid, m; `None` from an autopilot that does not state it.
    pub height: Option<f64>,
    /// Speed over the ground, m/s; `None` if it is not known.
    pub ground_speed: Option<f64>,
    /// Direction of the motion, clockwise from north, rad; `None` if it is not known.
    pub course: Option<f64>,
    /// Standard deviations of the horizontal position (m), of the height (m) and of the speed (m/s), as reported; `None` from an
    /// autopilot that does not state them.
    pub accuracies: Option<[f64; 3]>,
    /// Heading by two antennas, without its deviation where that is not stated; `None` without it.
    pub heading: Option<Heading>,
}

impl GpsRawInt {
    /// Returns the kind of the fix; `None` without a position in three dimensions.
    #[must_use]
    pub fn kind(&self) -> Option<FixKind> {
        match self.fix_type {
            3 | 4 | 8 => Some(FixKind::SinglePoint),
            5 => Some(FixKind::RtkFloat),
            6 => Some(FixKind::RtkFixed),
            _ => None,
        }
    }
}

/// `HIGHRES_IMU`: numbers of sensors that were not read since the message before are `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HighresImu {
    /// Time of the measurement, µs.
    pub time_us: u64,
    /// Specific force in {B}, m/s².
    pub specific_force_body: Option<[f64; 3]>,
    /// Angular velocity in {B}, rad/s.
    pub angular_velocity_body: Option<[f64; 3]>,
    /// Magnetic field in {B}, G.
    pub field_body: Option<[f64; 3]>,
    /// Absolute pressure, Pa.
    pub pressure: Option<f64>,
    /// Altitude by the standard atmosphere, m.
    pub pressure_altitude: Option<f64>,
    /// Temperature, °C.
    pub temperature: Option<f64>,
    /// Number of the sensor.
    pub sensor: u8,
}

/// `ODOMETRY`: the motion of the vehicle, as the autopilot estimates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odometry {
    /// Time of the estimate, µs.
    pub time_us: u64,
    /// Frames of the pose, and of velocity and rates, `MAV_FRAME`: 1 for north-east-down, 12 for {B}.
    pub frames: [u8; 2],
    /// Position, m.
    pub position: [f64; 3],
    /// Quaternion of the attitude, the scalar first; its norm is 1 within 1e-3.
    pub quaternion: [f64; 4],
    /// Velocity in the second frame, m/s; `None` if it is not known.
    pub velocity: Option<[f64; 3]>,
    /// Angular velocity in {B}, rad/s; `None` if it is not known.
    pub angular_velocity_body: Option<[f64; 3]>,
    /// Variances of the position, m²; `None` if they are not known.
    pub position_variances: Option<[f64; 3]>,
    /// Variances of the velocity, (m/s)²; `None` if they are not known.
    pub velocity_variances: Option<[f64; 3]>,
    /// Counter of jumps of the estimate.
    pub resets: u8,
}

/// Decodes the packet at the start of the bytes.
pub(crate) fn decode(bytes: &[u8]) -> Decoded {
    let frame = match mavlink_frame::decode(bytes, &DEFINITIONS) {
        Ok(frame) => frame,
        Err(error) => return undecoded(bytes, error),
    };
    let Some(message) = message(frame.definition.id) else {
        return Decoded::Noise;
    };
    match packet(message, &frame) {
        Ok(packet) => Decoded::Packet(packet, frame.length),
        Err(reason) => Decoded::Refused(message, reason, frame.length),
    }
}

/// Returns the message with an ID.
fn message(id: u32) -> Option<Message> {
    let known = MESSAGES.iter().find(|(_, definition)| definition.id == id);
    known.map(|(message, _)| *message)
}

/// Returns what bytes are that do not begin with a packet that is read here.
fn undecoded(bytes: &[u8], error: FrameError) -> Decoded {
    let reason = match error {
        FrameError::Incomplete(_) => return Decoded::Incomplete,
        FrameError::Start => return Decoded::Noise,
        FrameError::Unknown => None,
        FrameError::Flags => Some(Reason::Flags),
        FrameError::Length => Some(Reason::Length),
        FrameError::Checksum => Some(Reason::Checksum),
    };
    let Ok(header) = Header::read(bytes) else {
        return Decoded::Noise;
    };
    // Start and flags tell it from noise.
    let is_likely = !header.is_first && header.incompatible & !SIGNED == 0 && header.compatible == 0;
    match (reason, message(header.id)) {
        (Some(reason), Some(message)) => Decoded::Unchecked(message, reason),
        _ if is_likely => Decoded::OtherMavlink,
        _ => Decoded::Noise,
    }
}

fn packet(message: Message, frame: &Frame<'_>) -> Result<Packet, Reason> {
    let mut payload = [0; PAYLOAD];
    payload[..frame.payload.len()].copy_from_slice(frame.payload);
    let fields = Fields(&payload);
    let sender = frame.sender;
    match message {
        Message::GpsRawInt => gps_raw_int(&fields).map(|fix| Packet::GpsRawInt(sender, fix)),
        Message::HighresImu => highres_imu(&fields).map(|sample| Packet::HighresImu(sender, sample)),
        Message::Odometry => odometry(&fields).map(|motion| Packet::Odometry(sender, motion)),
        _ => Ok(Packet::Heartbeat(
            sender,
            Heartbeat {
                kind: fields.u8(4),
                autopilot: fields.u8(5),
                is_armed: fields.u8(6) & 128 != 0,
            },
        )),
    }
}

fn gps_raw_int(fields: &Fields<'_>) -> Result<GpsRawInt, Reason> {
    let known = |offset: usize| Some(fields.u16(offset)).filter(|value| *value != u16::MAX);
    let accuracies = [34, 38, 42].map(|offset| fields.u32(offset));
    let yaw = fields.u16(50);
    let fix = GpsRawInt {
        time_us: fields.u64(0),
        latitude: f64::from(fields.i32(8)) / 1e7,
        longitude: f64::from(fields.i32(12)) / 1e7,
        height_above_sea: f64::from(fields.i32(16)) / 1e3,
        ground_speed: known(24).map(|speed| f64::from(speed) / 100.0),
        course: known(26).map(|course| (f64::from(course) / 100.0).to_radians()),
        fix_type: fields.u8(28),
        satellites: Some(fields.u8(29)).filter(|count| *count != u8::MAX),
        // Extensions that were not sent are zero, and so is a height that the sender does not know.
        height: (accuracies != [0; 3] && (fields.i32(30) != 0 || fields.i32(16) == 0))
            .then(|| f64::from(fields.i32(30)) / 1e3),
        accuracies: (accuracies != [0; 3]).then(|| accuracies.map(|value| f64::from(value) / 1e3)),
        // 0 and all ones stand for no heading, 36000 for north.
        heading: (1..=36_000).contains(&yaw).then(|| Heading {
            angle: (f64::from(yaw) / 100.0).to_radians(),
            deviation: match fields.u32(46) {
                0 => f64::NAN,
                deviation => (f64::from(deviation) / 1e5).to_radians(),
            },
        }),
    };
    if fix.latitude.abs() <= 90.0 && fix.longitude.abs() <= 180.0 {
        Ok(fix)
    } else {
        Err(Reason::Range)
    }
}

fn highres_imu(fields: &Fields<'_>) -> Result<HighresImu, Reason> {
    let updated = fields.u16(60);
    let all = |mask: u16| updated & mask == mask;
    let vector = |offset: usize, mask: u16| finite_if(all(mask), fields.floats::<3>(offset));
    let number =
        |offset: usize, mask: u16| Ok(finite_if(all(mask), fields.floats::<1>(offset))?.map(|[value]| value));
    Ok(HighresImu {
        time_us: fields.u64(0),
        specific_force_body: vector(8, 0b111)?,
        angular_velocity_body: vector(20, 0b111_000)?,
        field_body: vector(32, 0b111_000_000)?,
        // hPa.
        pressure: number(44, 1 << 9)?.map(|pressure: f64| 100.0 * pressure),
        pressure_altitude: number(52, 1 << 11)?,
        temperature: number(56, 1 << 12)?,
        sensor: fields.u8(62),
    })
}

/// Returns numbers that are there.
fn finite_if<const N: usize>(is_there: bool, numbers: [f64; N]) -> Result<Option<[f64; N]>, Reason> {
    match (is_there, numbers.iter().all(|number| number.is_finite())) {
        (false, _) => Ok(None),
        (true, true) => Ok(Some(numbers)),
        (true, false) => Err(Reason::NotFinite),
    }
}

fn odometry(fields: &Fields<'_>) -> Result<Odometry, Reason> {
    let quaternion: [f64; 4] = fields.floats(20);
    let squared_norm: f64 = quaternion.iter().map(|component| component * component).sum();
    // What is not known begins with NaN.
    let vector = |offset: usize| {
        let numbers: [f64; 3] = fields.floats(offset);
        finite_if(!numbers[0].is_nan(), numbers)
    };
    // The diagonal of a symmetric matrix of six rows, whose upper triangle is sent.
    let variances = |offset: usize| {
        let diagonal = [0, 6, 11].map(|index| f64::from(fields.f32(offset + 4 * index)));
        let is_known = !diagonal[0].is_nan() && diagonal[0] >= 0.0;
        finite_if(is_known, diagonal)
    };
    let motion = Odometry {
        time_us: fields.u64(0),
        position: finite_if(true, fields.floats(8))?.ok_or(Reason::NotFinite)?,
        quaternion: finite_if(true, quaternion)?.ok_or(Reason::NotFinite)?,
        velocity: vector(36)?,
        angular_velocity_body: vector(48)?,
        position_variances: variances(60)?,
        velocity_variances: variances(144)?,
        frames: [fields.u8(228), fields.u8(229)],
        resets: fields.u8(230),
    };
    if (squared_norm - 1.0).abs() <= 2e-3 {
        Ok(motion)
    } else {
        Err(Reason::Range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_height_above_the_ellipsoid_of_zero_is_unknown_unless_that_above_the_sea_is_zero() {
        let height = |above_sea: i32, height: i32| {
            let mut payload = [0; 52];
            payload[16..20].copy_from_slice(&above_sea.to_le_bytes());
            payload[30..34].copy_from_slice(&height.to_le_bytes());
            // Of the horizontal position.
            payload[34] = 14;
            gps_raw_int(&Fields(&payload)).unwrap().height
        };
        assert_eq!(height(518_000, 565_000), Some(565.0));
        assert_eq!(height(518_000, 0), None);
        assert_eq!(height(0, 0), Some(0.0));
    }
}
