//! Questions to a live run.

use std::path::PathBuf;

use clap::Args;

use super::flight::{Host, RecordingArguments};

/// Arguments of the commands that ask something of a live run.
#[derive(Debug, Args)]
pub struct Operate {
    /// The run, if several are under way: its name, as `gerono doctor` shows it, or the number of one of its services'
    /// processes.
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
}

/// Arguments of `gerono attach`.
#[derive(Debug, Args)]
pub struct Attach {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Folder for the results; must be empty if it exists [default: the next free runs/attached-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// The writing of the logs.
    #[command(flatten)]
    pub recording: RecordingArguments,
    /// Say nothing unless something is wrong.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of `gerono postmortem`.
#[derive(Debug, Args)]
pub struct Postmortem {
    /// The host of the flight.
    #[arg(long, value_name = "HOST")]
    pub host: Host,
    /// Folder of its results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// A service in whose place a program flew.
    #[arg(long = "external-service", value_name = "SERVICE")]
    pub external_services: Vec<String>,
    /// The cause, as a fault tells it.
    #[arg(long, value_name = "CAUSE")]
    pub cause: String,
}

/// Arguments of `gerono top`.
#[derive(Debug, Args)]
pub struct Top {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Permit the keys that kill (`k`) and freeze (`f`) the selected service; without it they do nothing.
    #[arg(long, conflicts_with = "once")]
    pub allow_faults: bool,
    /// Print how the run is now, and no more; needs no terminal.
    #[arg(long)]
    pub once: bool,
    /// Print it as JSON, for other programs.
    #[arg(long, requires = "once")]
    pub json: bool,
}

impl Top {
    /// The end of `gerono top --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono top\n  \
        gerono top --allow-faults\n  \
        gerono top --once --json | jq '.services[] | {name, rate, wake: .wake.p99}'\n\n\
        Exit codes: 0 left by a key, or the run has ended; 1 there is no such run, or no terminal.";
}
