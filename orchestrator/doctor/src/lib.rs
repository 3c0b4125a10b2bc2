//! Fitness of this machine for a flight: findings, verdicts and fixes.
//!
//! A check is a function of the machine's facts ([`HostFacts`]: files of /proc and /sys, free space) and the needs of
//! the flight ([`Needs`]), or of a measurement. It returns a [`Check`] and changes nothing. Measurements are separate
//! from their verdicts: [`wake_up::measure`], [`disk::measure`].
//!
//! * [`memory`]: shared memory, locked memory, huge pages;
//! * [`scheduling`]: real-time priority and throttling;
//! * [`processor`]: cores and their isolation, governor, clock source;
//! * [`dongle`]: USB dongle of a Crazyflie;
//! * [`disk`], [`runs`], [`wake_up`]: disk of the results, other runs, wake-up latency;
//! * [`report`]: the report as text and JSON.
//!
//! Failure policy: a fact that cannot be read is a finding that is not green; it never ends the examination.

pub mod check;
pub mod disk;
pub mod dongle;
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

/// Returns all checks that need no measurement, in the order of the report.
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
