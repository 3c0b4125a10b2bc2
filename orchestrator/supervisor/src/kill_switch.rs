//! The operator's kill switch: a key of an input device, or a button on a serial line.
//!
//! * [`device`]: opens and reads both kinds;
//! * [`signal`]: their signals, and which of them are presses;
//! * [`watch`]: a thread that waits for a press, reports a loss, and reopens the device;

pub mod device;
pub mod signal;
pub mod watch;
