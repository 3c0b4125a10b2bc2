//! Result of decoding the start of bytes.

use crate::Packet;
use crate::counts::{Message, Reason};

/// What the bytes begin with; lengths are in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "it is matched at once, and a box would allocate"
)]
pub(crate) enum Decoded {
    /// A packet, with its length.
    Packet(Packet, usize),
    /// A packet with a correct checksum whose values are refused, with its length.
    Refused(Message, Reason, usize),
    /// Something like a packet, which could not be checked.
    Unchecked(Message, Reason),
    /// The header of another UBX message.
    OtherUbx,
    /// The header of another message of MAVLink 2.
    OtherMavlink,
    /// The start of an NMEA sentence.
    Sentence,
    /// A part of something.
    Incomplete,
    /// None of these.
    Noise,
}
