//! Real inputs of flight outdoors: from bytes of a satellite receiver, or of an autopilot that measures, to numbers.
//!
//! * [`stream`]: bytes in any pieces to packets, with the count of everything that was refused;
//! * [`ubx`]: `NAV-PVT` and `NAV-RELPOSNED` of a u-blox receiver;
//! * [`autopilot`]: `HIGHRES_IMU`, `ODOMETRY` and `GPS_RAW_INT` of an autopilot, in MAVLink 1 or 2;
//! * [`counts`]: packets and refusals by message and reason.
//!
//! Both protocols may come on one line: their frames begin differently. The formats are implemented here, because five
//! messages are read. The crate `ublox` 0.10 compiles some hundred packets with a second `syn`, and takes twice as long to
//! compile as all of this; `mavlink` 0.21 brings a generator of hundreds of messages. The tests read bytes that pyubx2 and
//! pymavlink have written.
//!
//! Failure policy: a packet with a wrong checksum, length or value is counted by message and reason and dropped; the search
//! for the next one begins a byte after the start of one that could not be checked, so that no packet behind it is lost.
//! Messages that are not read here are counted, not checked. Nothing here does input or output, and no packet allocates.

#![warn(missing_docs)]

pub mod autopilot;
pub mod counts;
mod decoded;
mod fields;
pub mod stream;
pub mod ubx;

use autopilot::{GpsRawInt, Heartbeat, HighresImu, Odometry};
use mavlink_frame::Sender;
use ubx::{NavPvt, RelativePosition};

/// Packet with a correct checksum and values in their ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Packet {
    /// UBX `NAV-PVT`.
    NavPvt(NavPvt),
    /// UBX `NAV-RELPOSNED`.
    RelativePosition(RelativePosition),
    /// MAVLink `HEARTBEAT`.
    Heartbeat(Sender, Heartbeat),
    /// MAVLink `GPS_RAW_INT`.
    GpsRawInt(Sender, GpsRawInt),
    /// MAVLink `HIGHRES_IMU`.
    HighresImu(Sender, HighresImu),
    /// MAVLink `ODOMETRY`.
    Odometry(Sender, Odometry),
}

impl Packet {
    /// Returns the message of the packet.
    #[must_use]
    pub fn message(&self) -> counts::Message {
        match self {
            Self::NavPvt(_) => counts::Message::NavPvt,
            Self::RelativePosition(_) => counts::Message::NavRelposned,
            Self::Heartbeat(..) => counts::Message::Heartbeat,
            Self::GpsRawInt(..) => counts::Message::GpsRawInt,
            Self::HighresImu(..) => counts::Message::HighresImu,
            Self::Odometry(..) => counts::Message::Odometry,
        }
    }
}
