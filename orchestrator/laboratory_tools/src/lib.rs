//! Tools for a laboratory without a flight.
//!
//! * [`mocap_probe`]: diagnoses a motion-capture system;
//! * [`mocap_send`]: emulates a motion-capture system;
//! * [`rc_probe`]: tests a radio link on the ground.

pub mod mocap_probe;
pub mod mocap_send;
pub mod rc_probe;
