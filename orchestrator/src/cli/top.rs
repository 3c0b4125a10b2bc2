//! Arguments of `gerono top`.

use clap::Args;

/// Arguments of `gerono top`.
#[derive(Debug, Args)]
pub struct Top {
    /// The run, if several are live: its name, as `gerono doctor` shows it, or the PID of one of its services.
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
    /// Enable the keys that kill (`k`) and freeze (`f`) the selected service.
    #[arg(long, conflicts_with = "once")]
    pub allow_faults: bool,
    /// Print the present state of the run once; needs no terminal.
    #[arg(long)]
    pub once: bool,
    /// Print JSON, for other programs.
    #[arg(long, requires = "once")]
    pub json: bool,
}

impl Top {
    /// The end of `gerono top --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono top\n  \
        gerono top --allow-faults\n  \
        gerono top --once --json | jq '.services[] | {name, rate, wake: .wake.p99}'\n\n\
        Exit codes: 0 left by a key, or the run has ended; 1 there is no such run, or no terminal.";
}
