//! Kill switch of the operator: a key of an input device, or a button at a serial line.
//!
//! * [`device`]: opens either, and reads what it sends;
//! * [`signal`]: what either sends, and what of it is a press;
//! * [`watch`]: a thread that waits for a press, tells of a loss, and opens the device again.

pub mod device;
pub mod signal;
pub mod watch;
