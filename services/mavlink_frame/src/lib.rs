//! Frames of MAVLink 1 and 2: header, checksum, truncation. The messages themselves are their users'.
//!
//! ```text
//! 1   0xFE, length, sequence, system, component, message ID, payload, checksum
//! 2   0xFD, length, two bytes of flags, sequence, system, component, message ID in three bytes,
//!     payload without trailing zeros, checksum, and a signature of 13 bytes if a flag says so
//! ```
//!
//! The checksum is the CRC-16/MCRF4XX of everything but the first byte, and of `CRC_EXTRA`, a byte derived from the message's
//! definition: a frame of an unknown message cannot be checked. Signatures are not verified.

#![warn(missing_docs)]

/// First byte of a frame of MAVLink 1.
pub const START_1: u8 = 0xfe;
/// First byte of a frame of MAVLink 2.
pub const START_2: u8 = 0xfd;

/// Bytes before the payload in MAVLink 1.
pub const HEADER_1: usize = 6;
/// Bytes before the payload in MAVLink 2.
pub const HEADER_2: usize = 10;

/// Flag of a frame that ends with a signature.
pub const SIGNED: u8 = 1;

/// Bytes of the checksum.
const CHECKSUM: usize = 2;
/// Bytes of a signature.
const SIGNATURE: usize = 13;

/// Length of the longest frame, bytes. A known message may have extensions that are not, up to the longest payload.
pub const LONGEST: usize = HEADER_2 + u8::MAX as usize + CHECKSUM + SIGNATURE;

/// Initial value of the checksum.
const INITIAL: u16 = 0xffff;

/// Sender of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// System ID.
    pub system: u8,
    /// Component ID.
    pub component: u8,
}

/// Definition of a message, as far as frames depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Definition {
    /// Message ID.
    pub id: u32,
    /// Length of the payload without extensions, which is that in MAVLink 1, bytes.
    pub base_length: usize,
    /// Length of the payload with all extensions, bytes.
    pub length: usize,
    /// Byte derived from the definition.
    pub crc_extra: u8,
}

/// Frame with a correct checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Definition of its message.
    pub definition: &'a Definition,
    /// Payload; in MAVLink 2 missing bytes are zero.
    pub payload: &'a [u8],
    /// Its sender.
    pub sender: Sender,
    /// Sequence number of the sender's frames.
    pub sequence: u8,
    /// Length of the frame, bytes.
    pub length: usize,
}

/// Why bytes do not begin with a frame of a known message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The frame is longer; its least length, bytes.
    Incomplete(usize),
    /// No start of a frame.
    Start,
    /// The message is not known.
    Unknown,
    /// Flags of a known message that change its frame in an unknown way.
    Flags,
    /// A known message with a length that it cannot have.
    Length,
    /// The checksum of a known message does not match.
    Checksum,
}

/// Header of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// `true` for MAVLink 1.
    pub is_first: bool,
    /// Bytes before the payload.
    pub header: usize,
    /// Length of the payload, bytes.
    pub payload: usize,
    /// Flags of features without which the frame cannot be read.
    pub incompatible: u8,
    /// Flags of other features.
    pub compatible: u8,
    /// Sequence number of the sender's frames.
    pub sequence: u8,
    /// Its sender.
    pub sender: Sender,
    /// Message ID.
    pub id: u32,
}

impl Header {
    /// Reads the header at the start of the bytes.
    ///
    /// # Errors
    /// [`FrameError::Start`] or [`FrameError::Incomplete`].
    #[inline]
    pub fn read(bytes: &[u8]) -> Result<Self, FrameError> {
        let sender = |system, component| Sender { system, component };
        match *bytes {
            [
                START_2,
                length,
                incompatible,
                compatible,
                sequence,
                system,
                component,
                id0,
                id1,
                id2,
                ..,
            ] => Ok(Self {
                is_first: false,
                header: HEADER_2,
                payload: usize::from(length),
                incompatible,
                compatible,
                sequence,
                sender: sender(system, component),
                id: u32::from_le_bytes([id0, id1, id2, 0]),
            }),
            [START_1, length, sequence, system, component, id, ..] => Ok(Self {
                is_first: true,
                header: HEADER_1,
                payload: usize::from(length),
                incompatible: 0,
                compatible: 0,
                sequence,
                sender: sender(system, component),
                id: u32::from(id),
            }),
            [START_2, ..] => Err(FrameError::Incomplete(HEADER_2)),
            [START_1, ..] | [] => Err(FrameError::Incomplete(HEADER_1)),
            _ => Err(FrameError::Start),
        }
    }
}

/// Decodes the frame at the start of the bytes.
///
/// # Errors
/// [`FrameError`] if the bytes do not begin with a frame of one of the messages.
#[inline]
pub fn decode<'a>(bytes: &'a [u8], messages: &'a [Definition]) -> Result<Frame<'a>, FrameError> {
    let header = Header::read(bytes)?;
    let known = |message: &&Definition| message.id == header.id;
    let definition = messages.iter().find(known).ok_or(FrameError::Unknown)?;
    if header.incompatible & !SIGNED != 0 {
        return Err(FrameError::Flags);
    }
    // One byte of start and one of ID do not tell a frame from noise. Some programs send extensions in MAVLink 1 too.
    let is_known_length = [definition.base_length, definition.length].contains(&header.payload);
    if header.is_first && !is_known_length {
        return Err(FrameError::Unknown);
    }
    // Of trailing zeros the first byte remains. A longer payload has later extensions at its end.
    if header.payload == 0 {
        return Err(FrameError::Length);
    }
    let end = header.header + header.payload;
    let signature = if header.incompatible & SIGNED == 0 {
        0
    } else {
        SIGNATURE
    };
    let length = end + CHECKSUM + signature;
    if bytes.len() < length {
        return Err(FrameError::Incomplete(length));
    }
    if bytes[end..end + CHECKSUM] != checksum(&[&bytes[1..end]], definition.crc_extra).to_le_bytes() {
        return Err(FrameError::Checksum);
    }
    Ok(Frame {
        definition,
        payload: &bytes[header.header..end.min(header.header + definition.length)],
        sender: header.sender,
        sequence: header.sequence,
        length,
    })
}

/// Gives the parts of a frame of MAVLink 2 to `push`, in their order. The payload has its whole length.
#[inline]
pub fn encode(
    definition: &Definition,
    payload: &[u8],
    sender: Sender,
    sequence: u8,
    mut push: impl FnMut(&[u8]),
) {
    // Trailing zeros are truncated; the first byte always remains.
    let zeros = payload[1..].iter().rev().take_while(|&&byte| byte == 0).count();
    let payload = &payload[..payload.len() - zeros];
    let [id0, id1, id2, _] = definition.id.to_le_bytes();
    let length = payload.len().to_le_bytes()[0];
    let header = [
        START_2,
        length,
        0,
        0,
        sequence,
        sender.system,
        sender.component,
        id0,
        id1,
        id2,
    ];
    push(&header);
    push(payload);
    push(&checksum(&[&header[1..], payload], definition.crc_extra).to_le_bytes());
}

/// Returns the checksum of a frame's parts and of `CRC_EXTRA`.
#[inline]
fn checksum(parts: &[&[u8]], crc_extra: u8) -> u16 {
    let sum = parts.iter().fold(INITIAL, |sum, part| accumulate(sum, part));
    accumulate(sum, &[crc_extra])
}

/// Continues a CRC-16/MCRF4XX over further bytes.
#[inline]
fn accumulate(sum: u16, bytes: &[u8]) -> u16 {
    bytes.iter().fold(sum, |sum, &byte| {
        let low = byte ^ sum.to_le_bytes()[0];
        let low = u16::from(low ^ (low << 4));
        (sum >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEARTBEAT: Definition = Definition {
        id: 0,
        base_length: 9,
        length: 9,
        crc_extra: 50,
    };

    /// The check value of CRC-16/MCRF4XX in the catalogue of parametrised CRC algorithms.
    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        assert_eq!(accumulate(INITIAL, b"123456789"), 0x6f91);
    }

    fn heartbeat() -> Vec<u8> {
        let sender = Sender {
            system: 1,
            component: 2,
        };
        let mut frame = Vec::new();
        let payload = [1, 2, 3, 4, 6, 8, 0, 4, 3];
        encode(&HEARTBEAT, &payload, sender, 7, |part| {
            frame.extend_from_slice(part);
        });
        frame
    }

    #[test]
    fn every_shorter_piece_of_a_frame_is_incomplete() {
        let frame = heartbeat();
        for end in 0..frame.len() {
            let error = decode(&frame[..end], &[HEARTBEAT]).unwrap_err();
            assert!(
                matches!(error, FrameError::Incomplete(length) if length > end),
                "{end}: {error:?}"
            );
        }
        assert_eq!(decode(&frame, &[HEARTBEAT]).unwrap().length, frame.len());
    }

    #[test]
    fn of_a_payload_with_later_extensions_the_known_part_is_read() {
        let longer = Definition {
            length: 14,
            ..HEARTBEAT
        };
        let sender = Sender {
            system: 1,
            component: 2,
        };
        let mut frame = Vec::new();
        let payload = [1, 2, 3, 4, 6, 8, 0, 4, 3, 90, 91, 92, 93, 94];
        encode(&longer, &payload, sender, 7, |part| frame.extend_from_slice(part));
        let decoded = decode(&frame, &[HEARTBEAT]).unwrap();
        assert_eq!((decoded.payload, decoded.length), (&payload[..9], frame.len()));
        // The checksum covers all of it.
        frame[HEADER_2 + 12] ^= 1;
        assert_eq!(decode(&frame, &[HEARTBEAT]), Err(FrameError::Checksum));
        // MAVLink 1 has no extensions.
        let frame = [&[START_1, 14, 7, 1, 2, 0], &payload[..], &[0, 0]].concat();
        assert_eq!(decode(&frame, &[HEARTBEAT]), Err(FrameError::Unknown));
    }

    #[test]
    fn a_signature_belongs_to_its_frame_and_other_flags_are_refused() {
        let mut frame = heartbeat();
        let end = frame.len() - CHECKSUM;
        frame[2] = SIGNED;
        let sum = checksum(&[&frame[1..end]], HEARTBEAT.crc_extra).to_le_bytes();
        frame[end..].copy_from_slice(&sum);
        let length = frame.len() + SIGNATURE;
        assert_eq!(decode(&frame, &[HEARTBEAT]), Err(FrameError::Incomplete(length)));
        frame.extend([0; SIGNATURE]);
        assert_eq!(decode(&frame, &[HEARTBEAT]).unwrap().length, length);
        frame[2] = 2;
        assert_eq!(decode(&frame, &[HEARTBEAT]), Err(FrameError::Flags));
    }
}
