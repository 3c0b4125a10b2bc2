//! Types that Gerono's services share: samples, wiring, schedule and contracts.
//!
//! * [`mod@sample`]: the macro that declares a sample (struct, `.msg` text, layout proof, layout hash);
//! * [`samples`]: the samples of the flight;
//! * [`wiring`]: which service publishes and consumes which topic, written once;
//! * [`service`]: the contract between a service's pure step logic and the hosts that run it;
//! * [`schedule`]: the steps of the services and the due samples at each, which every process can compute;
//! * [`battery`]: the battery's voltage beside a frame or in a status word;
//! * [`capture_figures`]: statistics of a laboratory's motion capture, and [`receiver_figures`] of receivers;
//! * [`checkpoint`]: the state of a service after a step;
//! * [`crazyflie_uri`], [`receiver_source`]: addresses of a vehicle and of what measures it;
//! * [`digest`]: the digest of an experiment; equal digests mean equal flights;
//! * [`flight_phase`]: the phases from disarmed to disarmed, in one table;
//! * [`input_validator`]: acceptance of samples; a service uses the last valid one;
//! * [`noise`]: random numbers as functions of seed, stream and tick;
//! * [`path_stop`]: the stop of a path without references or without a tracked vehicle;
//! * [`rotation`]: the conventions of attitude;
//! * [`tuning`]: gains that may change in flight.
//!
//! Nothing in this crate does input or output.

#![warn(missing_docs)]

pub mod battery;
pub mod capture_figures;
pub mod checkpoint;
pub mod crazyflie_uri;
pub mod digest;
mod earlier_layouts;
pub mod finiteness;
pub mod flight_phase;
pub mod geodesy;
pub mod gnss;
pub mod input_validator;
mod moment;
pub mod navigation_limits;
pub mod noise;
pub mod path_stop;
mod ports;
pub mod receiver_figures;
pub mod receiver_source;
pub mod rotation;
pub mod sample;
pub mod samples;
pub mod schedule;
pub mod service;
pub mod tuning;
pub mod wiring;

pub use flight_phase::FlightPhase;
pub use sample::{Header, Sample};
pub use schedule::Schedule;
pub use service::{Input, Now, Operator, Output, Service};
pub use tuning::Gains;
pub use wiring::{ExternalServices, Published, ServiceId, Topic};

/// Standard gravity as the paper uses it, m/s².
pub const GRAVITY: f64 = 9.81;
