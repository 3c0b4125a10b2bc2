//! Tools for a laboratory without a flight.
//!
//! * [`gnss_probe`]: diagnoses a satellite receiver or an autopilot;
//! * [`hand_check`]: tests axes and signs of the cameras with the vehicle in the hand;
//! * [`mocap_probe`]: diagnoses a motion-capture system;
//! * [`mocap_send`]: emulates a motion-capture system;
//! * [`motor_test`]: compares the motors of a flight controller with the sticks;
//! * [`rc_probe`]: tests a radio link on the ground.

pub mod gnss_probe;
pub mod hand_check;
pub mod mocap_probe;
pub mod mocap_send;
pub mod motor_test;
pub mod rc_probe;
