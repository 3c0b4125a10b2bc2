//! Arguments of `gerono-bench`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use scenario_file::values::between;

/// Measures what developers of Gerono need to know of it: costs beside their floors, on this machine.
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
    /// Measure what it costs to record a sample, beside the MCAP library alone, and whether memory grows.
    ///
    /// The writer of run.mcap and the library itself write the same messages of Fig. 1 to memory, in turn, uncompressed. Shown are
    /// medians of the repetitions, and the median of the ratios of CPU time, pair by pair. Then as many minutes of flight as
    /// asked for are recorded to nowhere, and the process's memory after a tenth of them stands beside that at their end.
    #[command(after_help = BenchRecorder::EXAMPLES)]
    Recorder(BenchRecorder),
    /// Measure what the deaths of services cost a flight in real time, and the others in it.
    ///
    /// Flies the paper's laboratory in hover twice: undisturbed, and with each service in its turn killing itself in the
    /// middle of a step (SIGKILL), 0.3 s apart. Says how soon another process flew in the dead one's place, how far the vehicle was
    /// from its point, and whether the other services kept their periods: those within 0.1 s of another's death beside all
    /// others of the same flight.
    ///
    /// Takes 2 × (4 + 0.3 × DEATHS) s.
    Deaths(BenchDeaths),
    /// Measure how long it is from a capture's packet on a socket to the serial frame that rests on it, in real time.
    ///
    /// Is a VRPN server and a receiver on a pseudo-terminal, and lets a flight take off between them that sees the vehicle as the
    /// server shows it, at 1 kHz. Then the vehicle seems to tilt by a little, to and fro, eight times a second: the first frame that
    /// answers a tilt rests on the capture in which it was seen. The bare hops beside it do nothing but hand bytes on: through TCP, four
    /// times from process to process, and through a pseudo-terminal.
    ///
    /// Takes SECONDS and some 20 s.
    Laboratory(BenchLaboratory),
    /// Measure how many vehicle steps a second the flights of a sweep make, beside other simulators.
    ///
    /// Flies Fig. 1 for 60 s at 1 kHz, on one core and on all: the five step functions called in a row, the same in the host of one
    /// process, and judged, which is all of a sweep's row but its text. With `--beside` other simulators run in turn with them: any
    /// command whose last line of output is the steps that it has made a second. tests/peers/run.sh brings two.
    #[command(after_help = BenchSweep::EXAMPLES)]
    Sweep(BenchSweep),
}

/// Arguments of `gerono-bench sweep`.
#[derive(Debug, Args)]
pub struct BenchSweep {
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Another simulator: its name, and the command that measures it.
    #[arg(long, value_name = "NAME=COMMAND", value_parser = str::parse::<Peer>)]
    pub beside: Vec<Peer>,
    /// Write the figures as JSON to this file as well.
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
    /// Its name.
    pub name: String,
    /// The command that prints its steps a second.
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
    /// For how long the vehicle tilts, s.
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Write the figures as JSON to this file as well: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

/// Arguments of `gerono-bench recorder`.
#[derive(Debug, Args)]
pub struct BenchRecorder {
    /// Repetitions of each measurement of time; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Length of the flight over which memory is watched, min at 1 kHz.
    #[arg(long, value_name = "MIN", default_value = "10", value_parser = between(0.1, 1440.0, "min"))]
    pub minutes: f64,
    /// Write the figures as JSON to this file as well: times in s, memory in bytes.
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
    /// The number of processes that die.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub deaths: u32,
    /// Fly under SCHED_FIFO (docs/deployment.md).
    #[arg(long)]
    pub fifo: bool,
    /// Write the figures as JSON to this file as well: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}
