//! Stream: bytes in any pieces to packets.

use crate::counts::Counts;
use crate::decoded::Decoded;
use crate::{Packet, autopilot, ubx};

/// Length of the buffer for an incomplete packet, bytes.
const CAPACITY: usize = if mavlink_frame::LONGEST > ubx::LONGEST {
    mavlink_frame::LONGEST
} else {
    ubx::LONGEST
};

/// Start of an NMEA sentence: `$G`, the second letter of the system, three letters, a comma.
const SENTENCE: usize = 7;

/// Decoder of a byte stream. The packets and the counts do not depend on the pieces in which the bytes arrive.
#[derive(Clone, Debug)]
pub struct Stream {
    buffer: [u8; CAPACITY],
    length: usize,
    counts: Counts,
}

impl Default for Stream {
    fn default() -> Self {
        Self {
            buffer: [0; CAPACITY],
            length: 0,
            counts: Counts::default(),
        }
    }
}

impl Stream {
    /// Decodes received bytes and passes their packets to `sink`, oldest first.
    pub fn push(&mut self, mut bytes: &[u8], sink: &mut dyn FnMut(&Packet)) {
        self.counts.bytes += bytes.len() as u64;
        while !bytes.is_empty() {
            let (piece, rest) = bytes.split_at(bytes.len().min(CAPACITY - self.length));
            self.buffer[self.length..self.length + piece.len()].copy_from_slice(piece);
            self.length += piece.len();
            bytes = rest;
            self.scan(false, sink);
        }
    }

    /// Ends the stream: the beginning of a packet that is not complete is none, and what it may have hidden is decoded.
    pub fn finish(&mut self, sink: &mut dyn FnMut(&Packet)) {
        self.scan(true, sink);
    }

    /// Returns the counts since the start.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    fn scan(&mut self, is_end: bool, sink: &mut dyn FnMut(&Packet)) {
        let mut at = 0;
        while at < self.length {
            let length = match decode(&self.buffer[at..self.length]) {
                Decoded::Packet(packet, length) => {
                    self.counts.add(packet.message());
                    sink(&packet);
                    length
                }
                Decoded::Refused(message, reason, length) => {
                    self.counts.refuse(message, reason);
                    length
                }
                // A full buffer has to lose a byte, whatever it begins with: else nothing would ever be read again.
                Decoded::Incomplete if !is_end && self.length - at < CAPACITY => break,
                skipped => {
                    self.count(&skipped);
                    self.counts.skipped += 1;
                    1
                }
            };
            at += length;
        }
        self.buffer.copy_within(at..self.length, 0);
        self.length -= at;
    }

    /// Counts what begins at a byte that is skipped.
    fn count(&mut self, skipped: &Decoded) {
        match skipped {
            Decoded::Unchecked(message, reason) => self.counts.refuse(*message, *reason),
            Decoded::OtherUbx => self.counts.other_ubx += 1,
            Decoded::OtherMavlink => self.counts.other_mavlink += 1,
            Decoded::Sentence => self.counts.nmea += 1,
            _ => {}
        }
    }
}

fn decode(bytes: &[u8]) -> Decoded {
    match bytes[0] {
        byte if byte == ubx::START[0] => ubx::decode(bytes),
        mavlink_frame::START_1 | mavlink_frame::START_2 => autopilot::decode(bytes),
        b'$' => sentence(bytes),
        _ => Decoded::Noise,
    }
}

fn sentence(bytes: &[u8]) -> Decoded {
    let fits = |(index, byte): (usize, &u8)| match index {
        0 => *byte == b'$',
        1 => *byte == b'G',
        6 => *byte == b',',
        _ => byte.is_ascii_uppercase(),
    };
    match bytes.iter().take(SENTENCE).enumerate().all(fits) {
        false => Decoded::Noise,
        true if bytes.len() < SENTENCE => Decoded::Incomplete,
        true => Decoded::Sentence,
    }
}
