//! The same formats the other way: what a motion-capture system would send. For tests, try-outs and simulated
//! laboratories; no decoder uses anything of it.

pub mod natnet;
pub mod server;
pub mod vicon_udp;
pub mod vrpn;
