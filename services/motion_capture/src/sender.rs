//! Senders of the same formats, as a motion-capture system would send them. They serve tests, trials and simulated
//! laboratories; no decoder uses them.

pub mod natnet;
pub mod server;
pub mod vicon_udp;
pub mod vrpn;
