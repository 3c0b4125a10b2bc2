//! Measuring speed; and the processes that only measurements start.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use scenario_file::values::between;

/// Arguments of `gerono bench`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Bench {
    /// The measurement to take instead.
    #[command(subcommand)]
    pub measurement: Option<Measurement>,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Simulated seconds of each lock-step flight.
    #[arg(long, default_value_t = 20.0)]
    pub duration: f64,
    /// Write the figures as JSON to this file as well.
    #[arg(long)]
    pub json: Option<PathBuf>,
}

/// Measurements of `gerono bench` other than simulated seconds per wall second.
#[derive(Debug, Subcommand)]
pub enum Measurement {
    /// Measure how long it is from a capture to the radio frame that comes of it, in real time.
    ///
    /// Flies Fig. 1's ideal profile at 1 kHz with all services on one core: estimator, path generator, controller and rc
    /// output, four hops from process to process, each with a step and its samples. The floor beside it is a bare chain: five
    /// processes on that core hand on a bare iceoryx2 event four times, once a millisecond, and do nothing else. Both are measured
    /// in turn: on idle cores, with a busy process on another core, and with one on each of both; as ordinary processes, and
    /// under SCHED_FIFO if that is permitted.
    ///
    /// Times depend on the machine and on what else it does; the ratios to the floor much less. Shown are medians of
    /// the repetitions, and of their ratios, pair by pair. p50 is what half of the frames do not exceed, p99 what 99 of 100
    /// do not. On a quiet machine expect some ten microseconds a hop. With a load on their own core ordinary processes wait
    /// for their turn, which is milliseconds: SCHED_FIFO is against that (docs/deployment.md).
    ///
    /// Takes 12 × REPETITIONS × SECONDS, or half of it without SCHED_FIFO.
    #[command(after_help = BenchLatency::EXAMPLES)]
    Latency(BenchLatency),
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

/// Arguments of `gerono bench sweep`.
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
    /// The end of `gerono bench sweep --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono bench sweep\n  \
        gerono bench sweep --beside 'mine=./my_simulator --steps 1000000'";
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

/// Arguments of `gerono bench laboratory`.
#[derive(Debug, Args)]
pub struct BenchLaboratory {
    /// For how long the vehicle tilts, s.
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Write the figures as JSON to this file as well: times in s.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

/// Arguments of `gerono bench recorder`.
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
    /// The end of `gerono bench recorder --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono bench recorder\n  \
        gerono bench recorder --repetitions 31 --minutes 60 --json recorder.json";
}

/// Arguments of `gerono bench deaths`.
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

/// Arguments of `gerono bench latency`.
#[derive(Debug, Args)]
pub struct BenchLatency {
    /// Length of each measurement, s: a thousand frames a second.
    #[arg(long, value_name = "S", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub seconds: u32,
    /// Repetitions of each measurement; medians are shown.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    pub repetitions: u32,
    /// Write the figures as JSON to this file as well: times in s, and of every service how late it woke and how long it stepped.
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

impl BenchLatency {
    /// The end of `gerono bench latency --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono bench latency\n  \
        gerono bench latency --seconds 60 --repetitions 3 --json latency.json";
}

/// Arguments of a ring of processes that exchange samples and nothing else.
#[derive(Debug, Args)]
pub struct Ring {
    /// Rounds to go.
    pub rounds: u64,
    /// The way to wait for the neighbour.
    #[arg(value_enum)]
    pub wait: RingWait,
    /// Core to run on.
    pub core: usize,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub fifo: bool,
}

/// Arguments of a member of such a ring.
#[derive(Debug, Args)]
pub struct RingMember {
    /// Place in the ring.
    pub place: usize,
    /// Rounds to go.
    pub rounds: u64,
    /// The way to wait for the neighbour.
    #[arg(value_enum)]
    pub wait: RingWait,
    /// Core to run on.
    pub core: usize,
    /// The iceoryx2 configuration of the ring.
    pub configuration: PathBuf,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub fifo: bool,
}

/// The way in which the members of such a ring wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RingWait {
    /// Yield the core until the neighbour has been there.
    Yield,
    /// Block on an eventfd.
    Eventfd,
}

impl RingWait {
    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Yield => "yield",
            Self::Eventfd => "eventfd",
        }
    }
}

/// Arguments of a member of a bare chain.
#[derive(Debug, Args)]
pub struct ChainMember {
    /// Place in the chain.
    pub place: usize,
    /// Number of times that the first sends.
    pub rounds: u64,
    /// Core to run on.
    pub core: u32,
    /// The iceoryx2 configuration of the chain.
    pub configuration: PathBuf,
    /// `true` to run under SCHED_FIFO.
    #[arg(long)]
    pub fifo: bool,
}
