//! Packets and refusals, by message and reason.

use std::fmt::{Display, Formatter, Result};

/// Message that is read here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Message {
    /// UBX `NAV-PVT`: time, position, velocity.
    NavPvt = 0,
    /// UBX `NAV-RELPOSNED`: baseline between two antennas.
    NavRelposned = 1,
    /// MAVLink `HEARTBEAT`.
    Heartbeat = 2,
    /// MAVLink `GPS_RAW_INT`: the fix of an autopilot's receiver.
    GpsRawInt = 3,
    /// MAVLink `HIGHRES_IMU`: an autopilot's inertial, magnetic and pressure sensors.
    HighresImu = 4,
    /// MAVLink `ODOMETRY`: the motion that an autopilot estimates.
    Odometry = 5,
}

/// Number of messages.
const MESSAGES: usize = 6;

impl Message {
    /// All messages.
    pub const ALL: [Self; MESSAGES] = [
        Self::NavPvt,
        Self::NavRelposned,
        Self::Heartbeat,
        Self::GpsRawInt,
        Self::HighresImu,
        Self::Odometry,
    ];

    /// Returns the name in the protocol's documentation.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NavPvt => "NAV-PVT",
            Self::NavRelposned => "NAV-RELPOSNED",
            Self::Heartbeat => "HEARTBEAT",
            Self::GpsRawInt => "GPS_RAW_INT",
            Self::HighresImu => "HIGHRES_IMU",
            Self::Odometry => "ODOMETRY",
        }
    }
}

/// Why a packet was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Reason {
    /// The checksum does not match.
    Checksum = 0,
    /// The length is not that of the message.
    Length = 1,
    /// The message has another version than the one that is read.
    Version = 2,
    /// The frame has flags of features that are not known.
    Flags = 3,
    /// A number is NaN or infinite.
    NotFinite = 4,
    /// A value is beyond its range.
    Range = 5,
}

/// Number of reasons.
const REASONS: usize = 6;

impl Reason {
    /// All reasons.
    pub const ALL: [Self; REASONS] = [
        Self::Checksum,
        Self::Length,
        Self::Version,
        Self::Flags,
        Self::NotFinite,
        Self::Range,
    ];
}

impl Display for Reason {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.write_str(match self {
            Self::Checksum => "wrong checksum",
            Self::Length => "another length",
            Self::Version => "another version",
            Self::Flags => "unknown flags",
            Self::NotFinite => "a value that is not a number",
            Self::Range => "a value out of its range",
        })
    }
}

/// Counts of a stream since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Packets by message.
    packets: [u64; MESSAGES],
    /// Refused packets by message and reason.
    refused: [[u64; REASONS]; MESSAGES],
    /// Headers of other UBX messages.
    pub other_ubx: u64,
    /// Headers of other messages of MAVLink 2.
    pub other_mavlink: u64,
    /// Starts of NMEA sentences.
    pub nmea: u64,
    /// All bytes.
    pub bytes: u64,
    /// Bytes outside of packets, those of other messages included.
    pub skipped: u64,
}

impl Counts {
    pub(crate) fn add(&mut self, message: Message) {
        self.packets[message as usize] += 1;
    }

    pub(crate) fn refuse(&mut self, message: Message, reason: Reason) {
        self.refused[message as usize][reason as usize] += 1;
    }

    /// Returns the number of packets of a message.
    #[must_use]
    pub fn packets(&self, message: Message) -> u64 {
        self.packets[message as usize]
    }

    /// Returns the number of refused packets of a message for a reason.
    #[must_use]
    pub fn refused(&self, message: Message, reason: Reason) -> u64 {
        self.refused[message as usize][reason as usize]
    }

    /// Returns whether an autopilot sends here: frames of MAVLink, used, refused or others.
    #[must_use]
    pub fn has_mavlink(&self) -> bool {
        let sent =
            |message: Message| self.packets(message) + self.refused[message as usize].iter().sum::<u64>();
        let is_mavlink = |message: &Message| !matches!(message, Message::NavPvt | Message::NavRelposned);
        let messages = Message::ALL.into_iter().filter(is_mavlink);
        self.other_mavlink > 0 || messages.map(sent).sum::<u64>() > 0
    }

    /// Returns the number of all packets.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.packets.iter().sum()
    }

    /// Returns the number of all refused packets.
    #[must_use]
    pub fn total_refused(&self) -> u64 {
        self.refused.iter().flatten().sum()
    }

    /// Returns the refusals that occurred, with their counts.
    pub fn refusals(&self) -> impl Iterator<Item = (Message, Reason, u64)> {
        Message::ALL.into_iter().flat_map(move |message| {
            let counted = Reason::ALL.map(|reason| (message, reason, self.refused(message, reason)));
            counted.into_iter().filter(|(.., count)| *count > 0)
        })
    }
}
