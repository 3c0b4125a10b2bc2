//! What travels between Gerono's services and what everyone agrees on.
//!
//! * [`mod@sample`]: the macro that declares a sample once (struct, `.msg` text, layout proof, layout hash);
//! * [`samples`]: the samples of the flight;
//! * [`wiring`]: which service publishes and consumes which topic, written once;
//! * [`service`]: the contract between a service's pure step logic and the hosts that run it;
//! * [`schedule`]: who steps when, and which sample is due where, computable by everyone;
//! * [`digest`]: the digest of an experiment, by which two flights are the same;
//! * [`flight_phase`]: from disarmed to disarmed, one table;
//! * [`input_validator`]: which sample of an input a service uses: the last one that can be true;
//! * [`noise`]: random numbers as functions of seed, stream and tick;
//! * [`rotation`]: the conventions of attitude.
//!
//! Nothing in this crate does input or output.

pub mod digest;
pub mod finiteness;
pub mod flight_phase;
pub mod input_validator;
mod moment;
pub mod noise;
mod ports;
pub mod rotation;
pub mod sample;
pub mod samples;
pub mod schedule;
pub mod service;
pub mod wiring;

pub use flight_phase::FlightPhase;
pub use sample::{Header, Sample};
pub use schedule::Schedule;
pub use service::{Input, Now, Operator, Output, Service};
pub use wiring::{ExternalServices, Published, ServiceId, Topic};

/// Standard gravity as the paper uses it, m/s².
pub const GRAVITY: f64 = 9.81;
