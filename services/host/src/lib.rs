//! Pure part of the hosts: one step of a service, and all services of a flight in one thread. It uses neither iceoryx2
//! nor the operating system: a flight is a function of the scenario alone.
//!
//! * [`step`]: one step, the same in every host;
//! * [`in_process`]: all services in one thread, and the [`TickSink`](in_process::TickSink) that receives their
//!   samples;
//! * [`activity`]: what the system says of a process;
//! * [`newest_wins`]: all services in one thread as in real time, where some may be absent;
//! * [`watchdog`]: detection of work in third-party code that does not end;
//! * [`kept_samples`]: the samples of an input in real time, of which the newest wins;
//! * [`edge_store`], [`sample_ring`], [`owned_sample`]: storage of samples.

#![warn(missing_docs)]

pub mod activity;
pub mod edge_store;
pub mod in_process;
pub mod kept_samples;
pub mod newest_wins;
pub mod owned_sample;
pub mod sample_ring;
pub mod step;
pub mod watchdog;
