//! Checking the machine.

use std::path::PathBuf;

use crate::manual::completion::setting;
use clap::Args;

use scenario_file::values::between;

/// Arguments of `gerono doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// The scenario to be flown [default: a minute at 1 kHz without special requirements].
    pub scenario: Option<PathBuf>,
    /// Change a value of the scenario, for example `--set deployment.core=1`; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", add = setting(), requires = "scenario")]
    pub sets: Vec<String>,
    /// Duration of the wake-up measurement, s; longer measurements catch rarer delays.
    #[arg(long, value_name = "T", default_value = "3", value_parser = between(0.01, 3600.0, "s"))]
    pub seconds: f64,
    /// The folder into which runs write.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub runs: PathBuf,
    /// Print the results as JSON, for other programs.
    #[arg(long)]
    pub json: bool,
}

impl Doctor {
    /// The end of `gerono doctor --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono doctor\n  \
        gerono doctor scenarios/fig1.toml --set deployment.core=1 --set deployment.priority=20\n  \
        gerono doctor scenarios/fig1.toml --seconds 60 --runs /data/runs\n  \
        gerono doctor --json | jq '.checks[] | select(.verdict != \"green\")'\n\n\
        Exit codes: 0 nothing is red; 2 the scenario is invalid; 6 something is red: the flight would fail or be useless.";
}
