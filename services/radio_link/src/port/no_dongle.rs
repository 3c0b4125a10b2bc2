//! Place of the driver of USB dongles in a program without it.

use std::convert::Infallible;

use rustix::io::Errno;
use scenario::RadioAddress;

use super::{OpenError, Sent};

/// A dongle that cannot be.
#[derive(Debug)]
pub(super) struct Dongle(Infallible);

impl Dongle {
    /// Names the fix.
    pub(super) fn open(_address: &RadioAddress) -> Result<Self, OpenError> {
        Err(OpenError::NoDriver)
    }

    pub(super) fn send(&mut self, _frame: &[u8]) -> Result<Sent, Errno> {
        match self.0 {}
    }

    pub(super) fn take_answer(&mut self, _bytes: &mut [u8]) -> usize {
        match self.0 {}
    }
}
