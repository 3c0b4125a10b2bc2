//! Whether this machine is fit for a flight: what is good, what is poor, what would not work, and the fix.
//!
//! A check is a function of what a [`HostFacts`] shows (files of /proc and /sys, free space) and of what the flight needs
//! ([`Needs`]), or of a measurement; it returns a [`Check`] and changes nothing. Measurements are made apart from
//! their judgement: [`wake_up::measure`], [`disk::measure`].
//!
//! * [`memory`]: shared memory, locked memory, huge pages;
//! * [`scheduling`]: real-time priority and throttling;
//! * [`processor`]: cores and their isolation, governor, clock source;
//! * [`disk`], [`runs`], [`wake_up`]: the folder of the results, other runs, how late a sleeper wakes;
//! * [`report`]: for people and for programs.
//!
//! Failure policy: what cannot be read is not good; it is told as such and never ends the examination.

pub mod check;
pub mod disk;
pub mod host;
pub mod memory;
pub mod needs;
pub mod processor;
pub mod report;
pub mod runs;
pub mod scheduling;
pub mod wake_up;

pub use check::{Check, CheckOutcome};
pub use host::HostFacts;
pub use needs::Needs;

/// Everything that can be told without measuring, in the order in which it is shown.
#[must_use]
pub fn examine(host: &HostFacts, needs: &Needs) -> Vec<Check> {
    vec![
        memory::shared(host, needs),
        memory::locked(host, needs),
        memory::huge_pages(host),
        scheduling::priority(host, needs),
        scheduling::throttling(host, needs),
        processor::cores(host, needs),
        processor::isolation(host, needs),
        processor::governor(host),
        processor::clock_source(host),
    ]
}
