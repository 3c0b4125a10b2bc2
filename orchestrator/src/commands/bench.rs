//! `gerono bench`: the speed of this machine.

use super::Failure;
use crate::cli::{Bench, BenchMeasurement};

/// `gerono bench`.
///
/// # Errors
/// [`Failure`] if a measurement fails.
pub fn bench(arguments: &Bench) -> Result<(), Failure> {
    match &arguments.measurement {
        Some(BenchMeasurement::Latency(arguments)) => bench::latency(
            arguments.seconds,
            arguments.repetitions,
            arguments.json.as_deref(),
        ),
        None => bench::throughput(
            arguments.repetitions,
            arguments.duration,
            arguments.json.as_deref(),
        ),
    }
}
