//! From a frame of the transmitter to bytes on a laboratory's serial line or socket.
//!
//! * [`sticks`]: what of an [`RcFrame`](shared_types::samples::RcFrame) a link needs, and a place where the newest
//!   waits for the sender;
//! * [`channel_map`]: which channel says what, with what travel;
//! * [`crsf`], [`sbus`], [`multi`], [`msp`], [`mavlink`]: frames of one link each, from numbers to bytes and back;
//! * [`encoder`]: sticks to a frame of whichever link a scenario states;
//! * [`port`]: a serial device or socket that never holds anybody up;
//! * [`sender`]: frames leave at exact times, from a thread of their own;
//! * [`receiver`]: the other end of a link, for whoever stands for the vehicle.
//!
//! The formats are written here, by hand: each is some 26 bytes of packing. The crates that there are for them encode into
//! memory of the heap or not at all (`sbus-rs` has no flags and is a decoder; it checks our frames in the tests), and bring
//! trees: `crsf` 2.0 a derive of error types, `mavlink` 0.21 a generator that compiles hundreds of messages of which we
//! send three, `serialport` 4.10 a second set of system calls beside `rustix`, which can do all that is needed here.
//!
//! Failure policy:
//! * a device that is not there, not permitted or in use when a link is opened is an error that names the fix;
//! * a device that vanishes later is opened again with back-off, in the sender's thread;
//! * a device that takes no bytes loses whole frames, which are counted, and never delays anybody;
//! * without a command, failsafe values are sent; after a while the link's own failsafe is used as well.

pub mod channel_map;
pub mod crsf;
pub mod encoder;
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

/// What a channel carries, in the link's own units, from the first channel to the last.
pub type ChannelCodes = [u16; 16];

/// Why bytes are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Fewer or more bytes than a frame has.
    #[error("a frame has {wanted} bytes, not {found}")]
    Length {
        /// How many a frame has.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// A byte that is the same in every frame is another one.
    #[error("byte {at} of a frame is not {found:#04x}")]
    Mark {
        /// Where it stands.
        at: usize,
        /// What stands there.
        found: u8,
    },
    /// The check sum is not that of the bytes.
    #[error("the check sum is not that of the bytes")]
    CheckSum,
}
