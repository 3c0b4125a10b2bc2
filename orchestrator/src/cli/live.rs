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
