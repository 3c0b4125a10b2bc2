//! Telemetry: the battery's voltage in what the vehicle sends back over the link.
//!
//! | link | what has the voltage | resolution |
//! | --- | --- | --- |
//! | CRSF | battery sensor (0x08), which a receiver with telemetry sends unasked | 0.1 V |
//! | MSP | response to `MSP_BATTERY_STATE`, requested five times a second | 0.01 V |
//! | `MAVLink` | `SYS_STATUS` or `BATTERY_STATUS` of the target system | 0.001 V |
//! | CRTP | log block of `pm.vbat`, five times a second | that of a number of 32 bits |
//!
//! The thread that sends frames reads it. It never waits for a response and allocates nothing.
//!
//! Failure policy: bytes outside of frames, unknown frames and impossible voltages are skipped.

use crate::format::Format;

/// Largest plausible voltage of a vehicle's battery, V.
const LARGEST: f64 = 100.0;

/// Least plausible voltage, V. A flight controller on USB without a battery reports less.
const LEAST: f64 = 1.0;

/// Buffer for an incomplete frame, bytes: more than the longest frame.
const BUFFER: usize = 512;

/// Result of reading the start of the bytes from a vehicle; lengths are in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reply {
    /// A frame with the battery's voltage, V.
    Voltage(usize, f64),
    /// Any other frame.
    Other(usize),
    /// An incomplete frame.
    Incomplete,
    /// No frame.
    Noise,
}

/// Decoder from a byte stream to voltages.
#[derive(Clone, Debug)]
pub struct Telemetry {
    bytes: [u8; BUFFER],
    length: usize,
}

impl Default for Telemetry {
    fn default() -> Self {
        Self {
            bytes: [0; BUFFER],
            length: 0,
        }
    }
}

/// Returns whether a battery can have this voltage, V.
#[must_use]
pub(crate) fn is_plausible(voltage: f64) -> bool {
    (LEAST..=LARGEST).contains(&voltage)
}

impl Telemetry {
    /// Decodes received bytes and returns the newest voltage among them, V. Of a format of packets these are the bytes of
    /// one packet.
    pub fn push(&mut self, format: &mut dyn Format, mut bytes: &[u8]) -> Option<f64> {
        if format.has_packets() {
            return match format.read_reply(bytes) {
                Reply::Voltage(_, voltage) => Some(voltage).filter(|voltage| is_plausible(*voltage)),
                _ => None,
            };
        }
        let mut newest = None;
        while !bytes.is_empty() {
            let (piece, rest) = bytes.split_at(bytes.len().min(BUFFER - self.length));
            self.bytes[self.length..self.length + piece.len()].copy_from_slice(piece);
            self.length += piece.len();
            bytes = rest;
            newest = self.read(format).or(newest);
        }
        newest
    }

    /// Reads the frames of the buffer, and keeps an incomplete one at its end.
    fn read(&mut self, format: &mut dyn Format) -> Option<f64> {
        let (mut newest, mut at) = (None, 0);
        while at < self.length {
            at += match format.read_reply(&self.bytes[at..self.length]) {
                Reply::Incomplete if self.length - at < BUFFER => break,
                Reply::Incomplete | Reply::Noise => 1,
                Reply::Other(length) => length.max(1),
                Reply::Voltage(length, voltage) => {
                    newest = Some(voltage).filter(|voltage| is_plausible(*voltage)).or(newest);
                    length.max(1)
                }
            };
        }
        let at = at.min(self.length);
        self.bytes.copy_within(at..self.length, 0);
        self.length -= at;
        newest
    }
}
