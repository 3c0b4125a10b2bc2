//! Radio link: from a frame of the transmitter to bytes on a laboratory's serial line or socket.
//!
//! * [`sticks`]: the part of an [`RcFrame`](shared_types::samples::RcFrame) that a link needs, and a cell that hands the
//!   newest sticks to the sender thread;
//! * [`channel_map`]: the function of each channel, and its travel;
//! * [`mod@format`]: the trait of a link's frame format, implemented by [`crsf`], [`sbus`], [`multi`], [`msp`],
//!   [`mavlink`] and [`crazyflie`];
//! * [`encoder`]: sticks to a frame of the scenario's link;
//! * [`port`]: a serial device or socket that never blocks;
//! * [`sender`]: a thread that sends frames at exact times;
//! * [`telemetry`]: the battery's voltage in what the vehicle sends back;
//! * [`receiver`]: the vehicle's end of a link, for simulators.
//!
//! The formats are implemented here, because each only packs some 26 bytes. Existing crates allocate or only decode
//! (`sbus-rs`, which checks our frames in the tests), and have large dependencies: `crsf` 2.0 a derive of error types,
//! `mavlink` 0.21 a generator that compiles hundreds of messages, of which we send three in the frames of [`mavlink_frame`],
//! `serialport` 4.10 a second set of system calls beside `rustix`. The USB dongle of a Crazyflie is driven by the crate `crazyradio`, with the feature of
//! that name: it needs libusb, which it builds from source where the system has none.
//!
//! Failure policy:
//! * a device that is missing, not permitted or in use when a link is opened is an error that names the fix;
//! * a device that disconnects later is reopened with back-off, in the sender thread;
//! * if a device accepts no bytes, whole frames are dropped and counted; the service is never delayed;
//! * without telemetry nothing changes: the last voltage stays in effect, and none before the first;
//! * without a command, failsafe values are sent; after `silence_after` the link's own failsafe is used as well.

#![warn(missing_docs)]

mod battery;
pub mod channel_map;
pub mod crazyflie;
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
pub mod telemetry;

/// Codes of the channels, in the link's units, from the first channel to the last.
pub type ChannelCodes = [u16; 16];

/// Error of bytes that are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Fewer or more bytes than a frame has.
    #[error("a frame has {expected} bytes, not {found}")]
    Length {
        /// Length of a frame.
        expected: usize,
        /// Number of bytes.
        found: usize,
    },
    /// A constant byte of the format has another value.
    #[error("unexpected byte {found:#04x} at offset {offset}")]
    Constant {
        /// Offset in the frame.
        offset: usize,
        /// The byte.
        found: u8,
    },
    /// The checksum does not match.
    #[error("the checksum does not match")]
    Checksum,
}
