//! Runtime in which every service executes. It contains no control theory.
//!
//! A service's step logic ([`shared_types::Service`]) is pure. Hosts decide which samples are delivered at a step, and
//! they must agree to the byte:
//! * [`host::in_process`]: all services in one thread, no shared memory: sweeps, tests, and the reference that the
//!   others must equal;
//! * [`lock_step`]: one process per service, simulated time, no sample ever lost;
//! * [`real_time`]: one process per service, the system's clock, the newest sample wins;
//! * [`replaying`]: one process per service, which executes recorded steps in the orchestrator's order.
//!
//! Ports and inputs:
//! * [`ports`]: iceoryx2 ports, in bytes;
//! * [`input_port`]: an input in lock step, also after a restart;
//! * [`input_queue`]: an input in real time;
//! * [`output_ports`]: a service's outputs;
//! * [`untrusted`]: samples of external services.
//!
//! Shared memory and coordination:
//! * [`shared_page`]: control block, the words by which the processes of a run coordinate;
//! * [`wait`]: yield, then sleep on a [`doorbell`];
//! * [`wait_policy`]: yield or sleep;
//! * [`checkpoints`]: states of the services, for restarts;
//! * [`step_log`]: record of every step in real time;
//! * [`status_cell`]: status of a service's hardware;
//! * [`seqlock`]: records that are copied while their writer runs;
//! * [`shared_file`]: the mapped files of all of these;
//! * [`shared_memory`]: named shared memory of a run, and its leftovers.
//!
//! Processes:
//! * [`process`] and [`launch`]: `gerono service NAME`, from start to end;
//! * [`control`]: control channel between the orchestrator and each service;
//! * [`deployment`]: core, scheduler, memory, death of the parent;
//! * [`descriptors`]: inherited file descriptors;
//! * [`external_service`]: an external program in place of a service;
//! * [`activity`]: run state and CPU time of a process;
//! * [`flight_clock`]: ticks on the system's clock;
//! * [`orchestrator_watchdog`] and [`take_over`]: loss of the orchestrator, and its replacement;
//! * [`watchdog`]: end of a process whose work takes too long;
//! * [`crash`]: deaths at chosen points, for tests.
//!
//! Failure policy: every wait ends. A service ends when its orchestrator requests it, when the control channel closes, or
//! when its parent dies. A service stops at a number that is not finite and never publishes it.

#![warn(missing_docs)]

pub mod activity;
mod announcement;
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
pub mod peer;
pub mod ports;
pub mod process;
mod process_error;
pub mod real_time;
pub mod reaper;
pub mod replaying;
pub mod ring_order;
pub mod seqlock;
pub mod shared_file;
pub mod shared_memory;
pub mod shared_page;
pub mod status_cell;
pub mod step_log;
pub mod take_over;
pub mod tuning;
pub mod untrusted;
pub mod wait;
pub mod wait_policy;
pub mod watchdog;
