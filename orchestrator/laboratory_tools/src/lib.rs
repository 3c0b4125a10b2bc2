//! Tools for a laboratory without a flight.
//!
//! * [`mocap_probe`]: listens to a motion-capture system;
//! * [`mocap_send`]: emulates one;
//! * [`rc_probe`]: tries a radio link on the ground.

pub mod mocap_probe;
pub mod mocap_send;
pub mod rc_probe;
