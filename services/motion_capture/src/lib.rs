//! Everything between a laboratory's network and a pose of the vehicle.
//!
//! * [`wire`]: what decoders share, with the limits on what a stranger may send;
//! * [`vicon_udp`], [`vrpn`], [`natnet`]: from bytes to frames of poses, pure;
//! * [`transport`]: sockets that never block, and what to wait on;
//! * [`clock`]: the sender's clock as seen from here;
//! * [`conventions`]: from the capture system's axes to the paper's;
//! * [`feed`]: from frames to poses of the vehicle that can be believed, with their capture times;
//! * [`figures`]: rate, latency, jitter and noise of what arrives;
//! * [`sender`]: the same formats the other way, for tests and simulated laboratories.
//!
//! Failure policy: what cannot be read, believed or timed is counted, dropped, and never an end of anything. All but the
//! transports is a function of bytes and arrival times.

pub mod clock;
pub mod conventions;
mod counts;
pub mod feed;
pub mod figures;
pub mod natnet;
pub mod sender;
pub mod transport;
pub mod vicon_udp;
pub mod vrpn;
pub mod wire;
