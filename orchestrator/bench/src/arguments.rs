//! Arguments of `gerono-bench`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use scenario_file::values::between;

/// Benchmarks for developers of Gerono: costs on this machine, with the floor of each.
///
/// Flights are those of the program `gerono` beside this one.
#[derive(Debug, Parser)]
#[command(name = "gerono-bench", version)]
pub struct GeronoBench {
    /// The measurement.
    #[command(subcommand)]
    pub measurement: Measurement,
}

/// The measurements of `gerono-bench`.
#[derive(Debug, Subcommand)]
pub enum Measurement {
    /// Measure the cost of recording a sample, compared with the MCAP library alone, and the growth of memory.
    ///
    /// The writer of run.mcap and the library itself write the same messages of Fig. 1 to memory, in turn, uncompressed.
    /// Shown are medians of the repetitions, and the median of the pairwise ratios of CPU time. Then MIN minutes of flight
    /// are recorded to /dev/null, and the process's memory after a tenth of them is compared with that at the end.
    #[command(after_help = BenchRecorder::EXAMPLES)]
    Recorder(BenchRecorder),
    /// Measure the effect of crashing services on a flight in real time and on the other services.
    ///
    /// Flies the paper's laboratory in hover twice: undisturbed, and with each service in turn killing itself in the middle of a
    /// step (SIGKILL), 0.3 s apart. Shows the restart times, the largest distance of the vehicle from its point, and the periods
    /// of the other services within 0.1 s of a crash, compared with all others of the same flight.
    ///
    /// Takes 2 × (4 + 0.3 × DEATHS) s.
    Deaths(BenchDeaths),
    /// Measure the latency from a capture's packet on a socket to the serial frame that responds to it, in real time.
    ///
    /// Runs a VRPN server and a receiver on a pseudo-terminal, and between them a flight at 1 kHz that takes off by the poses
    /// of the server. Then the poses tilt slightly to and fro, eight times a second: the first frame that responds to a tilt
    /// is the response to its capture. The bare hops for comparison only pass bytes on: through TCP, four times from process
    /// to process, and through a pseudo-terminal.
    ///
    /// Takes SECONDS and some 20 s.
    Laboratory(BenchLaboratory),
    /// Measure the vehicle steps per second of a sweep's flights, compared with other simulators.
    ///
    /// Flies Fig. 1 for 60 s at 1 kHz, on one core and on all: by calling the five step functions in a row, in the in-process
    /// host, and judged, which is a sweep's row without its text. With `--beside` other simulators run in turn with them: any
    /// command whose last line of output is its number of steps per second. tests/peers/run.sh provides two.
    #[command(after_help = BenchSweep::EXAMPLES)]
    Sweep(BenchSweep),
}

/// Arguments of `gerono-bench sweep`.
#[derive(Debug, Args)]
pub struct BenchSweep {
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Another simulator: its name and the command that measures it.
    #[arg(long, value_name = "NAME=COMMAND", value_parser = str::parse::<Peer>)]
    pub beside: Vec<Peer>,
    /// Also write the results as JSON to this file.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchSweep {
    /// The end of `gerono-bench sweep --help`.
    const EXAMPLES: &str = "Examples:\n  \
        gerono-bench sweep\n  \
        gerono-bench sweep --beside 'mine=./my_simulator --steps 1000000'";
}

/// Another simulator.
#[derive(Clone, Debug)]
pub struct Peer {
    pub name: String,
    /// Command that prints its steps per second.
    pub command: String,
}

impl std::str::FromStr for Peer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, command) = text
            .split_once('=')
            .filter(|(name, command)| !name.is_empty() && !command.is_empty())
            .ok_or("write NAME=COMMAND")?;
        Ok(Self {
            name: name.to_owned(),
            command: command.to_owned(),
        })
    }
}

/// Arguments of `gerono-bench laboratory`.
#[derive(Debug, Args)]
pub struct BenchLaboratory {
    /// Duration of the tilts, s.
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Also write the results as JSON to this file: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

/// Arguments of `gerono-bench recorder`.
#[derive(Debug, Args)]
pub struct BenchRecorder {
    /// Repetitions of each measurement of time; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Duration of the flight for the memory measurement, min at 1 kHz.
    #[arg(long, value_name = "MIN", default_value = "10", value_parser = between(0.1, 1440.0, "min"))]
    pub minutes: f64,
    /// Also write the results as JSON to this file: times in s, memory in bytes.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchRecorder {
    /// The end of `gerono-bench recorder --help`.
    const EXAMPLES: &str = "Examples:\n  \
        gerono-bench recorder\n  \
        gerono-bench recorder --repetitions 31 --minutes 60 --json recorder.json";
}

/// Arguments of `gerono-bench deaths`.
#[derive(Debug, Args)]
pub struct BenchDeaths {
    /// Number of crashes.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub deaths: u32,
    /// Fly under SCHED_FIFO (docs/deployment.md).
    #[arg(long)]
    pub fifo: bool,
    /// Also write the results as JSON to this file: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}
