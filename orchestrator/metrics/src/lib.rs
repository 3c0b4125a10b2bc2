//! The vehicle's distance from its path, its effort, and its loss: measured in one place, for
//! the summary, the fault matrix, the report, the plots and the reproduced figures alike, and for every controller alike.
//!
//! * [`path_clock`]: where the path was at any moment;
//! * [`tracker`]: the vehicle beside it, as the truth has it, or the estimator where nobody knows the truth;
//! * [`stretch`]: the numbers of a stretch of the flight;
//! * [`steady`]: the phases of the flight, each a transient and a steady state;
//! * [`loss`]: whether the vehicle was lost;
//! * [`statistics`], [`percentiles`]: a stream of numbers in fixed memory.
//!
//! Nothing rests on what a controller says of itself. All of it is fed with samples in the order of the log, while a flight
//! goes on or from its log, and allocates nothing while it is.

#![warn(missing_docs)]

pub mod loss;
pub mod path_clock;
pub mod percentiles;
pub mod statistics;
pub mod steady;
pub mod stretch;
pub mod summary;
pub mod tracker;

use scenario::Scenario;
use shared_types::Sample;

/// The length of a stretch's end that counts as its ultimate behaviour, s: what the paper's figures show.
pub const ULTIMATE_WINDOW: f64 = 5.0;

/// Distance from the path below which the vehicle counts as settled on it, m: the theorem's bound for the paper's gains and
/// a fifth.
pub const SETTLED: f64 = 0.02;

/// Confidence of the interval that is stated of an identified number.
pub const CONFIDENCE: f64 = 0.95;

/// Confidence of the interval outside of which a stated number differs from the identified one: a 95 % interval misses five
/// of a hundred numbers by chance, and advice is to come of none of them. How many half-widths of the stated interval this is
/// depends on the degrees of freedom: 1.7 with many, 2.3 with seven, 4 with three.
pub const CERTAIN: f64 = 0.999;

/// The sample in bytes that a host or a log hands out.
///
/// # Panics
/// If the bytes are those of another type.
#[inline]
pub fn read<T: Sample>(bytes: &[u8]) -> T {
    T::read_from_bytes(bytes).expect("hosts hand out samples of their topic")
}

/// Looks at a sample in place, or at a copy where its bytes are not aligned.
///
/// # Panics
/// If the bytes are those of another type.
#[inline]
pub fn view<T: Sample, R>(bytes: &[u8], look: impl FnOnce(&T) -> R) -> R {
    match T::ref_from_bytes(bytes) {
        Ok(sample) => look(sample),
        Err(_) => look(&read(bytes)),
    }
}

/// Returns when a scenario changes the vehicle or the air around it, s.
pub fn changes(scenario: &Scenario) -> impl Iterator<Item = f64> {
    let vehicle = scenario.vehicle.change.iter().map(|change| change.at);
    let fan = scenario.vehicle.fan.iter();
    vehicle.chain(fan.flat_map(|fan| std::iter::once(fan.on_at).chain(fan.off_at)))
}
