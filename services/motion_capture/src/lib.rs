//! Motion capture: from a laboratory's network to poses of the vehicle.
//!
//! * [`wire`]: common parts of the decoders, with the limits on untrusted input;
//! * [`protocol`]: the trait of a capture system; [`vicon_udp`], [`vrpn`], [`natnet`]: its implementations, each with
//!   decoder, sockets and sender;
//! * [`transport`]: sockets that never block, and their descriptors for waiting;
//! * [`clock`]: the estimate of the sender's clock, and `frame_clock`: stamps for frames that have only numbers;
//! * [`conventions`]: from the capture system's axes to the paper's;
//! * [`feed`]: from frames to accepted poses of the vehicle, with their capture times;
//! * [`refusals`]: counts of refusals by reason, and [`diagnosis`]: the message why the vehicle is not tracked;
//! * [`figures`]: rate, latency and jitter of arrivals;
//! * [`server`]: a simulated system, for tests and simulated laboratories.
//!
//! Failure policy: a packet that cannot be read, accepted or timed is counted by reason and dropped; the next one is
//! processed. All modules except the sockets are functions of bytes and arrival times.

#![warn(missing_docs)]

pub mod clock;
pub mod conventions;
pub mod diagnosis;
pub mod feed;
pub mod figures;
mod frame_clock;
pub mod natnet;
pub mod protocol;
pub mod refusals;
pub mod server;
pub mod transport;
pub mod vicon_udp;
pub mod vrpn;
pub mod wire;
