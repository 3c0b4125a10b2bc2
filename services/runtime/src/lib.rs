//! The frame every service runs in. It knows no control theory.
//!
//! A service's step logic ([`shared_types::Service`]) is pure; hosts decide which samples are delivered by
//! now, and they must agree to the byte:
//! * [`host::in_process`]: all services in one thread, no shared memory: sweeps, tests, and the reference that the
//!   others must equal;
//! * [`lock_step`]: one process per service, simulated time, no sample ever lost;
//! * [`real_time`]: one process per service, the system's clock, the newest sample wins;
//! * [`replaying`]: one process per service, told by the orchestrator, step by step, what a log has recorded.
//!
//! Under them lie [`ports`] (iceoryx2, in bytes), [`shared_memory`] (what there is of it, and what the dead were making), [`wait`] (yield once, then block on a doorbell),
//! [`shared_page`] (the words by which the processes of a run coordinate their waiting), [`checkpoints`] (what a
//! service knew, for whoever is born after its death; both are a [`shared_file`]), [`input_port`] (an input, also after a restart),
//! [`input_queue`] (an input in real time), [`output_ports`] (a service's
//! outputs), [`orchestrator_watchdog`] (when the orchestrator is gone), [`take_over`] (how another one takes its place), [`flight_clock`] (ticks on the system's clock),
//! [`seqlock`] (records that are copied beside their writer), [`step_log`] (what every step in real time was made of), [`status_cell`] (how what is connected to a service fares), [`control`] (the orchestrator's line to each service),
//! [`crash`] (deaths at chosen places), [`deployment`] (core, scheduler, parent's death), [`watchdog`] (work that takes too long), [`untrusted`] (samples of external programs), [`descriptors`] (what a started
//! process inherits), [`external_service`] (a program of one's own in place of a service) and [`process`] and [`launch`] (what
//! `gerono service NAME` runs).
//!
//! Failure policy: nothing waits without an end. A service ends when its orchestrator says so, when the
//! control channel closes, or when its parent dies; a number that is not finite is stopped at the service
//! that made it and never published.

mod atomics;
pub mod checkpoints;
pub mod control;
pub mod crash;
pub mod deployment;
pub mod descriptors;
pub mod doorbell;
pub mod external_service;
pub mod flight_clock;
pub mod flight_error;
pub mod input_port;
pub mod input_queue;
pub mod launch;
pub mod lock_step;
pub mod orchestrator_watchdog;
pub mod output_ports;
pub mod ports;
pub mod process;
mod process_error;
pub mod real_time;
pub mod replaying;
pub mod ring_order;
pub mod seqlock;
pub mod shared_file;
pub mod shared_memory;
pub mod shared_page;
pub mod status_cell;
pub mod step_log;
pub mod take_over;
pub mod untrusted;
pub mod wait;
pub mod wait_policy;
pub mod watchdog;
