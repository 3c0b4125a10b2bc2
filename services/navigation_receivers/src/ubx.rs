//! UBX, the protocol of u-blox receivers: `NAV-PVT` and `NAV-RELPOSNED`.
//!
//! `0xB5 0x62`, class, ID, length in two bytes, payload, and an 8-bit Fletcher checksum over all but the first two bytes. The
//! layouts are those of the interface description of the F9 (HPG 1.32); `NAV-PVT` has them since u-blox 8.

use shared_types::gnss::FixKind;

use crate::Packet;
use crate::counts::{Message, Reason};
use crate::decoded::Decoded;
use crate::fields::Fields;

/// First two bytes of a packet.
pub const START: [u8; 2] = [0xb5, 0x62];
/// Bytes before the payload.
pub const HEADER: usize = 6;
/// Bytes of the checksum.
pub const CHECKSUM: usize = 2;

/// Class of navigation results.
const NAV: u8 = 0x01;
/// Length of the payload of `NAV-PVT`, and of `NAV-RELPOSNED`, bytes.
const NAV_PVT: usize = 92;
const NAV_RELPOSNED: usize = 64;
/// Length of the longest packet that is read, bytes.
pub const LONGEST: usize = HEADER + NAV_PVT + CHECKSUM;

/// Classes of the protocol; other numbers are noise.
const CLASSES: [u8; 15] = [
    0x01, 0x02, 0x04, 0x05, 0x06, 0x09, 0x0a, 0x0b, 0x0d, 0x10, 0x13, 0x21, 0x27, 0x28, 0x29,
];

/// Largest time of a week, ms: a leap second included.
const WEEK_MS: u32 = 604_801_000;

/// What a receiver has solved for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Solution {
    /// Nothing.
    None = 0,
    /// A motion from inertial sensors alone.
    DeadReckoning = 1,
    /// A position at an assumed height.
    TwoDimensional = 2,
    /// A position.
    ThreeDimensional = 3,
    /// A position, with inertial sensors.
    Combined = 4,
    /// The time.
    TimeOnly = 5,
}

/// Solution of the carrier's phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Carrier {
    /// None.
    None = 0,
    /// With real numbers of carrier waves.
    Float = 1,
    /// With integer numbers of carrier waves.
    Fixed = 2,
}

/// Direction with its standard deviation, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// Clockwise from true north.
    pub angle: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// `NAV-PVT`: the solution of one epoch. Latitude and longitude have steps of 1e-7° (11 mm to the north).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavPvt {
    /// GPS time of the week, at which the solution is valid, ms.
    pub time_of_week_ms: u32,
    /// The same in UTC since 1970, ns; `None` until the receiver knows date, time and leap seconds.
    pub utc_ns: Option<i64>,
    /// Standard deviation of this time, s.
    pub time_accuracy: f64,
    /// What was solved for.
    pub solution: Solution,
    /// `true` if the receiver finds its accuracies good enough.
    pub is_valid: bool,
    /// `true` if corrections were used.
    pub has_corrections: bool,
    /// Solution of the carrier's phase.
    pub carrier: Carrier,
    /// Number of satellites used.
    pub satellites: u8,
    /// Geodetic latitude (WGS-84), degrees.
    pub latitude: f64,
    /// Longitude (WGS-84), degrees.
    pub longitude: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
    /// Height above mean sea level, m.
    pub height_above_sea: f64,
    /// Velocity to the north, to the east and downwards, m/s.
    pub velocity_ned: [f64; 3],
    /// Standard deviation of the horizontal position over both directions, as reported, m.
    pub horizontal_accuracy: f64,
    /// Standard deviation of the height, as reported, m.
    pub vertical_accuracy: f64,
    /// Standard deviation of the speed, as reported, m/s.
    pub speed_accuracy: f64,
    /// Dilution of precision of the position.
    pub position_dilution: f64,
    /// Heading of the vehicle, where the receiver has it from inertial sensors.
    pub heading: Option<Heading>,
}

impl NavPvt {
    /// Returns the kind of the fix; `None` without a position in three dimensions that the receiver finds good enough.
    #[must_use]
    pub fn kind(&self) -> Option<FixKind> {
        let has_position = matches!(self.solution, Solution::ThreeDimensional | Solution::Combined);
        (has_position && self.is_valid).then_some(match self.carrier {
            Carrier::None => FixKind::SinglePoint,
            Carrier::Float => FixKind::RtkFloat,
            Carrier::Fixed => FixKind::RtkFixed,
        })
    }
}

/// `NAV-RELPOSNED`, version 1: the second antenna's place from the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePosition {
    /// GPS time of the week, at which the solution is valid, ms.
    pub time_of_week_ms: u32,
    /// Baseline to the north, to the east and downwards, m.
    pub baseline_ned: [f64; 3],
    /// Its standard deviations, m.
    pub accuracies_ned: [f64; 3],
    /// Its length, m.
    pub length: f64,
    /// Solution of the carrier's phase.
    pub carrier: Carrier,
    /// `true` if the baseline is valid.
    pub is_valid: bool,
    /// `true` if the first antenna moves with the second. Else it is that of a base station, far away.
    pub is_moving: bool,
    /// Direction of the baseline; `None` if it is not valid.
    pub heading: Option<Heading>,
}

/// Decodes the packet at the start of the bytes.
pub(crate) fn decode(bytes: &[u8]) -> Decoded {
    let (class, id, length) = match *bytes {
        [first, second, class, id, low, high, ..] if [first, second] == START => {
            (class, id, usize::from(u16::from_le_bytes([low, high])))
        }
        [] => return Decoded::Incomplete,
        _ if bytes.iter().zip(START).any(|(byte, start)| *byte != start) => return Decoded::Noise,
        _ => return Decoded::Incomplete,
    };
    let (message, expected) = match (class, id) {
        (NAV, 0x07) => (Message::NavPvt, NAV_PVT),
        (NAV, 0x3c) => (Message::NavRelposned, NAV_RELPOSNED),
        _ if CLASSES.contains(&class) => return Decoded::OtherUbx,
        _ => return Decoded::Noise,
    };
    if length != expected {
        return Decoded::Unchecked(message, Reason::Length);
    }
    let end = HEADER + length;
    let Some(sum) = bytes.get(end..end + CHECKSUM) else {
        return Decoded::Incomplete;
    };
    if sum != checksum(&bytes[START.len()..end]) {
        return Decoded::Unchecked(message, Reason::Checksum);
    }
    let fields = Fields(&bytes[HEADER..end]);
    let packet = match message {
        Message::NavPvt => nav_pvt(&fields).map(Packet::NavPvt),
        _ => relative_position(&fields).map(Packet::RelativePosition),
    };
    match packet {
        Ok(packet) => Decoded::Packet(packet, end + CHECKSUM),
        Err(reason) => Decoded::Refused(message, reason, end + CHECKSUM),
    }
}

/// Returns the Fletcher checksum of bytes.
#[must_use]
pub fn checksum(bytes: &[u8]) -> [u8; 2] {
    bytes.iter().fold([0, 0], |[first, second]: [u8; 2], byte| {
        let first = first.wrapping_add(*byte);
        [first, second.wrapping_add(first)]
    })
}

fn nav_pvt(fields: &Fields<'_>) -> Result<NavPvt, Reason> {
    let solution = match fields.u8(20) {
        0 => Solution::None,
        1 => Solution::DeadReckoning,
        2 => Solution::TwoDimensional,
        3 => Solution::ThreeDimensional,
        4 => Solution::Combined,
        5 => Solution::TimeOnly,
        _ => return Err(Reason::Range),
    };
    let flags = fields.u8(21);
    let has_position = !matches!(solution, Solution::None | Solution::TimeOnly);
    let pvt = NavPvt {
        time_of_week_ms: fields.u32(0),
        utc_ns: utc(fields)?,
        time_accuracy: f64::from(fields.u32(12)) * 1e-9,
        solution,
        // Without a position that is valid by another flag there is none.
        is_valid: flags & 1 != 0 && (!has_position || fields.u16(78) & 1 == 0),
        has_corrections: flags & 2 != 0,
        carrier: carrier(flags >> 6)?,
        satellites: fields.u8(23),
        longitude: f64::from(fields.i32(24)) / 1e7,
        latitude: f64::from(fields.i32(28)) / 1e7,
        height: f64::from(fields.i32(32)) / 1e3,
        height_above_sea: f64::from(fields.i32(36)) / 1e3,
        horizontal_accuracy: f64::from(fields.u32(40)) / 1e3,
        vertical_accuracy: f64::from(fields.u32(44)) / 1e3,
        velocity_ned: [48, 52, 56].map(|offset| f64::from(fields.i32(offset)) / 1e3),
        speed_accuracy: f64::from(fields.u32(68)) / 1e3,
        position_dilution: f64::from(fields.u16(76)) / 100.0,
        heading: (flags & 0x20 != 0).then(|| heading(fields.i32(84), fields.u32(72))),
    };
    let is_on_earth = pvt.latitude.abs() <= 90.0 && pvt.longitude.abs() <= 180.0;
    if pvt.time_of_week_ms <= WEEK_MS && is_on_earth {
        Ok(pvt)
    } else {
        Err(Reason::Range)
    }
}

fn relative_position(fields: &Fields<'_>) -> Result<RelativePosition, Reason> {
    if fields.u8(0) != 1 {
        return Err(Reason::Version);
    }
    let flags = fields.u32(60);
    // Centimetres, and tenths of a millimetre.
    let length = |coarse: usize, fine: usize| {
        f64::from(fields.i32(coarse)) / 100.0 + f64::from(fields.i8(fine)) / 10_000.0
    };
    let relative = RelativePosition {
        time_of_week_ms: fields.u32(4),
        baseline_ned: [length(8, 32), length(12, 33), length(16, 34)],
        accuracies_ned: [36, 40, 44].map(|offset| f64::from(fields.u32(offset)) / 10_000.0),
        length: length(20, 35),
        carrier: carrier((flags >> 3).to_le_bytes()[0] & 3)?,
        is_valid: flags & 0b101 == 0b101,
        is_moving: flags & 0x20 != 0,
        heading: (flags & 0x100 != 0).then(|| heading(fields.i32(24), fields.u32(52))),
    };
    if relative.time_of_week_ms <= WEEK_MS {
        Ok(relative)
    } else {
        Err(Reason::Range)
    }
}

fn carrier(bits: u8) -> Result<Carrier, Reason> {
    match bits {
        0 => Ok(Carrier::None),
        1 => Ok(Carrier::Float),
        2 => Ok(Carrier::Fixed),
        _ => Err(Reason::Range),
    }
}

/// Makes a heading of numbers in 1e-5°.
fn heading(angle: i32, deviation: u32) -> Heading {
    Heading {
        angle: (f64::from(angle) / 1e5).to_radians(),
        deviation: (f64::from(deviation) / 1e5).to_radians(),
    }
}

/// Returns the time of `NAV-PVT` in UTC, ns since 1970.
fn utc(fields: &Fields<'_>) -> Result<Option<i64>, Reason> {
    // Date, time and leap seconds are known.
    if fields.u8(11) & 0b111 != 0b111 {
        return Ok(None);
    }
    let [month, day, hour, minute, second] = [6, 7, 8, 9, 10].map(|offset| i64::from(fields.u8(offset)));
    let year = i64::from(fields.u16(4));
    let limits = [
        // Nanoseconds since 1970 fit into 64 bits until 2262.
        (year, 1980, 2200),
        (month, 1, 12),
        (day, 1, 31),
        (hour, 0, 23),
        (minute, 0, 59),
        (second, 0, 60),
    ];
    let nanoseconds = fields.i32(16);
    if limits
        .iter()
        .any(|(value, least, most)| value < least || value > most)
        || nanoseconds.unsigned_abs() > 1_000_000_000
    {
        return Err(Reason::Range);
    }
    let days = days_since_1970(year, month, day);
    let seconds = ((24 * days + hour) * 60 + minute) * 60 + second;
    Ok(Some(seconds * 1_000_000_000 + i64::from(nanoseconds)))
}

/// Returns the number of days from 1970-01-01 to a date of the Gregorian calendar: years begin in March, so that the leap day is
/// the last of a year.
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    // Months of 31 and 30 days alternate, and again from August and from January on.
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        for (date, days) in [
            ((1970, 1, 1), 0),
            ((2000, 2, 29), 11_016),
            ((2000, 3, 1), 11_017),
            ((2024, 12, 31), 20_088),
            ((2100, 3, 1), 47_541),
        ] {
            let (year, month, day) = date;
            assert_eq!(days_since_1970(year, month, day), days, "{date:?}");
        }
    }
}
