//! Decisions of the supervisor of a flight's processes, as a state machine.
//!
//! What happened, with its time, goes in ([`Supervision::handle`](supervision::Supervision::handle)); what is to be done
//! comes out ([`Action`](event::Action)). There is no clock, process, descriptor or shared memory in here: the supervisor
//! makes events of signals, messages and timers, and performs the actions; a simulator does the same a million times a
//! minute.

pub mod arming;
pub mod conduct;
pub mod event;
pub mod failure;
pub mod heartbeat;
mod member;
pub mod moment;
pub mod presentable;
pub mod process;
mod restart;
pub mod restart_policy;
pub mod shutdown;
mod standby;
mod starting;
pub mod supervision;

pub use member::Phase;
