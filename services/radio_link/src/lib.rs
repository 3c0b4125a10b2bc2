//! Radio link: from a frame of the transmitter to bytes on a laboratory's serial line or socket.
//!
//! * [`sticks`]: the part of an [`RcFrame`](shared_types::samples::RcFrame) that a link needs, and a cell in which the
//!   newest sticks wait for the sender;
//! * [`channel_map`]: the meaning of each channel, and its travel;
//! * [`mod@format`]: all that depends on the link, one trait; [`crsf`], [`sbus`], [`multi`], [`msp`], [`mavlink`]: frames of one
//!   link each, from numbers to bytes and back;
//! * [`encoder`]: sticks to a frame of the scenario's link;
//! * [`port`]: a serial device or socket that never blocks;
//! * [`sender`]: a thread that sends frames at exact times;
//! * [`receiver`]: the vehicle's end of a link, for simulators.
//!
//! The formats are implemented here: each is some 26 bytes of packing. The existing crates encode into allocated memory
//! or not at all (`sbus-rs` has no flags and is a decoder; it checks our frames in the tests), and have large
//! dependencies: `crsf` 2.0 a derive of error types, `mavlink` 0.21 a generator that compiles hundreds of messages of
//! which three are sent here, `serialport` 4.10 a second set of system calls beside `rustix`, which has all that is
//! needed.
//!
//! Failure policy:
//! * a device that is missing, not permitted or in use when a link is opened is an error that names the fix;
//! * a device that vanishes later is opened again with back-off, in the sender's thread;
//! * a device that takes no bytes loses whole frames, which are counted, and never delays the service;
//! * without a command, failsafe values are sent; after a time the failsafe of the link is used as well.

#![warn(missing_docs)]

pub mod channel_map;
pub mod crsf;
pub mod encoder;
pub mod format;
pub mod frame;
pub mod link;
pub mod mavlink;
pub mod msp;
pub mod multi;
mod packing;
pub mod port;
pub mod receiver;
pub mod sbus;
pub mod sender;
pub mod sticks;

/// Codes of the channels, in the link's units, from the first channel to the last.
pub type ChannelCodes = [u16; 16];

/// Error of bytes that are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Fewer or more bytes than a frame has.
    #[error("a frame has {wanted} bytes, not {found}")]
    Length {
        /// Bytes of a frame.
        wanted: usize,
        /// Number of bytes.
        found: usize,
    },
    /// A byte that is the same in every frame is another one.
    #[error("byte {at} of a frame is not {found:#04x}")]
    Mark {
        /// Its place.
        at: usize,
        /// The byte.
        found: u8,
    },
    /// The check sum is not that of the bytes.
    #[error("the check sum is not that of the bytes")]
    CheckSum,
}
