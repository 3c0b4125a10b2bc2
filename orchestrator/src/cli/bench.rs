//! Measuring the speed of this machine.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use scenario_file::values::between;

/// Arguments of `gerono bench`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Bench {
    /// Another measurement.
    #[command(subcommand)]
    pub measurement: Option<BenchMeasurement>,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Simulated seconds of each lock-step flight.
    #[arg(long, default_value_t = 20.0, value_parser = between(1.0, 3600.0, "s"))]
    pub duration: f64,
    /// Also write the results as JSON to this file.
    #[arg(long)]
    pub json: Option<PathBuf>,
}

/// Measurements of `gerono bench` other than simulated seconds per wall second.
#[derive(Debug, Subcommand)]
pub enum BenchMeasurement {
    /// Measure the latency from a capture to its radio frame, in real time.
    ///
    /// Flies Fig. 1's ideal profile at 1 kHz with all services on one core: estimator, path generator, controller and rc
    /// output, four hops from process to process, each with a step and its samples. The floor is a bare chain: five processes on
    /// that core pass on an iceoryx2 event four times, once per millisecond. Both are measured in turn: on idle cores, with a
    /// busy process on another core, and with one on each of both; as ordinary processes, and under SCHED_FIFO if that is
    /// permitted.
    ///
    /// Times depend on the machine and its other load; the ratios to the floor much less. Shown are medians of the repetitions
    /// and of their pairwise ratios. p50 is the median of the frames, p99 their 99th percentile. On a quiet machine expect some
    /// ten microseconds per hop. With a load on their core ordinary processes wait milliseconds for their turn: SCHED_FIFO
    /// avoids that (docs/deployment.md).
    ///
    /// Takes 12 × REPETITIONS × SECONDS, or half of it without SCHED_FIFO.
    #[command(after_help = BenchLatency::EXAMPLES)]
    Latency(BenchLatency),
}

/// Arguments of `gerono bench latency`.
#[derive(Debug, Args)]
pub struct BenchLatency {
    /// Duration of each measurement, s, with a thousand frames per second.
    #[arg(long, value_name = "S", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Also write the results as JSON to this file: times in s, and for every service its wake-up latency and step duration.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchLatency {
    /// The end of `gerono bench latency --help`.
    const EXAMPLES: &str = "Examples:\n  \
        gerono bench latency\n  \
        gerono bench latency --seconds 60 --repetitions 3 --json latency.json";
}
