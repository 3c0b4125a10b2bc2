//! The USB dongle of a Crazyflie.
//!
//! The vehicle acknowledges each packet; the dongle repeats an unacknowledged one three times by itself, and then reports
//! it. It is not repeated here, because the next frame is newer, except one that stops the motors: it may be the last.

use std::fmt;
use std::panic::catch_unwind;
use std::path::Path;

use crazyradio::{Channel, Crazyradio, Datarate, Error, Power};
use rustix::io::Errno;
use scenario::{RadioAddress, RadioRate};

use super::{OpenError, Sent};
use crate::crazyflie::decode;

/// Folder of the USB devices of a machine that has any.
const USB_DEVICES: &str = "/dev/bus/usb";

/// Length of the longest packet that comes back, bytes.
const LONGEST_ANSWER: usize = 32;

/// Attempts at a packet that stops the motors. Each takes some milliseconds at most.
const STOPS: usize = 10;

/// A dongle set to a vehicle's channel and address.
pub(super) struct Dongle {
    radio: Crazyradio,
    /// The last packet that came back with an acknowledgement, and its length: 0 once it was taken.
    answer: [u8; LONGEST_ANSWER],
    answer_length: usize,
}

impl fmt::Debug for Dongle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Dongle")
    }
}

impl Dongle {
    /// Opens and configures a dongle.
    ///
    /// # Errors
    /// [`OpenError`], with the fix.
    pub(super) fn open(address: &RadioAddress) -> Result<Self, OpenError> {
        let index = address.dongle;
        let failed = |error: Error| open_error(index, &error);
        if !Path::new(USB_DEVICES).exists() {
            return Err(OpenError::NoDongle { index });
        }
        // The driver panics if libusb cannot be initialised, as in a container without USB events.
        let opened = catch_unwind(|| Crazyradio::open_nth(index)).map_err(|_| OpenError::Dongle {
            index,
            reason: "libusb cannot be initialised".to_owned(),
        })?;
        let mut radio = opened.map_err(failed)?;
        radio
            .set_channel(Channel::from_number(address.channel).map_err(failed)?)
            .map_err(failed)?;
        radio.set_datarate(data_rate(address.rate)).map_err(failed)?;
        radio.set_address(&address.address).map_err(failed)?;
        radio.set_power(Power::P0dBm).map_err(failed)?;
        Ok(Self {
            radio,
            answer: [0; LONGEST_ANSWER],
            answer_length: 0,
        })
    }

    /// Sends a packet and waits until it is acknowledged or given up.
    ///
    /// # Errors
    /// [`Errno::IO`] if the dongle does not work, or does not answer within a second.
    pub(super) fn send(&mut self, frame: &[u8]) -> Result<Sent, Errno> {
        let attempts = if decode(frame).is_ok_and(|packet| packet.stops()) {
            STOPS
        } else {
            1
        };
        for _ in 0..attempts {
            let mut answer = [0; LONGEST_ANSWER];
            let ack = self
                .radio
                .send_packet(frame, &mut answer)
                .map_err(|_| Errno::IO)?;
            if ack.received {
                (self.answer, self.answer_length) = (answer, ack.length.min(LONGEST_ANSWER));
                return Ok(Sent::Accepted);
            }
        }
        Ok(Sent::Busy)
    }

    /// Takes the packet that came back last, if it was not taken yet. Returns its length.
    pub(super) fn take_answer(&mut self, bytes: &mut [u8]) -> usize {
        let length = std::mem::take(&mut self.answer_length).min(bytes.len());
        bytes[..length].copy_from_slice(&self.answer[..length]);
        length
    }
}

fn data_rate(rate: RadioRate) -> Datarate {
    match rate {
        RadioRate::Kilobits250 => Datarate::Dr250K,
        RadioRate::Megabit1 => Datarate::Dr1M,
        RadioRate::Megabits2 => Datarate::Dr2M,
    }
}

fn open_error(index: usize, error: &Error) -> OpenError {
    match error {
        Error::NotFound => OpenError::NoDongle { index },
        error => OpenError::Dongle {
            index,
            reason: error.to_string(),
        },
    }
}
