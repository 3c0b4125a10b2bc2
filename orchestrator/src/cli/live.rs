//! Arguments of commands on a live run.

use std::ffi::OsStr;
use std::path::PathBuf;

use crate::manual::completion::tunable_setting;
use clap::{Args, Parser};

use super::flight::RecordingArguments;
use super::host::Host;
use scenario_file::values::ValueError;

/// Arguments of the requests to a live run.
#[derive(Debug, Args)]
pub struct Operate {
    /// The run, if several are live: its name, as `gerono doctor` shows it, or the PID of one of its services.
    #[arg(long, value_name = "ID")]
    pub run: Option<String>,
}

/// Arguments of `gerono set`.
#[derive(Debug, Args)]
pub struct Set {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Tunable keys with their new values.
    #[arg(value_name = "KEY=VALUE", required = true, value_parser = setting, add = tunable_setting())]
    pub settings: Vec<String>,
}

impl Set {
    /// The end of `gerono set --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono set controller.k1=3\n  \
        gerono set controller.k1=3 controller.k2=3.5\n  \
        gerono set controller.lambda_disturbance=[1.0, 1.0, 0.5]\n\n\
        Exit codes: 0 set; 1 there is no such run; 2 an argument is not KEY=VALUE; 7 refused, with the reason.";
}

/// Checks that an argument assigns a value; the run checks the rest.
fn setting(text: &str) -> Result<String, ValueError> {
    match text.split_once('=') {
        Some(_) => Ok(text.to_owned()),
        None => Err(ValueError::unfit(format!(
            "state the new value, such as `{text}=3`"
        ))),
    }
}

/// Arguments of `gerono get`.
#[derive(Debug, Args)]
pub struct Get {
    /// Which run.
    #[command(flatten)]
    pub run: Operate,
    /// Keys of the scenario [default: all tunable ones].
    #[arg(value_name = "KEY")]
    pub keys: Vec<String>,
}

impl Get {
    /// The end of `gerono get --help`.
    pub(super) const EXAMPLES: &str = "Examples:\n  \
        gerono get\n  \
        gerono get controller.k1 vehicle.mass\n\n\
        Exit codes: 0 printed; 1 there is no such run; 7 refused, with the reason.";
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
    /// Print only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of the post-mortem process, which an orchestrator becomes when it cannot continue.
#[derive(Debug, Parser)]
#[command(name = postmortem::NAME)]
pub struct Postmortem {
    /// The host of the flight.
    #[arg(long, value_name = "HOST")]
    pub host: Host,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// A service that was replaced by an external program.
    #[arg(long = "external-service", value_name = "SERVICE")]
    pub external_services: Vec<String>,
    /// The cause, as the fault handler encodes it.
    #[arg(long, value_name = "CAUSE")]
    pub cause: String,
}

impl Postmortem {
    /// Parses the arguments of this process if it is a post-mortem process.
    #[must_use]
    pub fn from_command_line() -> Option<Self> {
        let name = std::env::args_os().next();
        (name.as_deref() == Some(OsStr::new(postmortem::NAME))).then(Self::parse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_without_a_value_is_refused_before_a_run_is_asked() {
        assert_eq!(setting("controller.k1=3"), Ok("controller.k1=3".to_owned()));
        let refused = setting("controller.k1").unwrap_err().to_string();
        assert!(refused.contains("`controller.k1=3`"), "{refused}");
    }
}
