//! The commands of a few lines.

use std::io;

use clap::CommandFactory;
use clap_complete::Shell;

use super::{Failure, log_path, print};
use crate::cli::{Cli, Digest, Plot};
use command_line::exit::Exit;
use evaluation::plot;
use live::run_root;

/// `gerono plot`.
///
/// # Errors
/// [`Failure`].
pub fn plot(arguments: &Plot) -> Result<(), Failure> {
    let logs: Vec<_> = arguments.logs.iter().map(|path| log_path(path)).collect();
    let Plot { from, to, .. } = *arguments;
    if from.unwrap_or(0.0) >= to.unwrap_or(f64::INFINITY) {
        return Err(Failure::new(Exit::BadInput, "--from must be before --to"));
    }
    plot::distance(&logs, plot::Span { from, to }, &arguments.output)
        .map_err(|error| Failure::new(Exit::Trouble, error))
}

/// `gerono digest`.
///
/// # Errors
/// [`Failure`].
pub fn digest(arguments: &Digest) -> Result<(), Failure> {
    let digest =
        run_log::digest(&log_path(&arguments.log)).map_err(|error| Failure::new(Exit::Trouble, error))?;
    print(format!("{digest}\n"));
    Ok(())
}

/// `gerono schema`.
pub fn schema() {
    print(scenario_file::json_schema());
}

/// `gerono completions`.
pub fn completions(shell: Shell) {
    clap_complete::generate(shell, &mut Cli::command(), "gerono", &mut io::stdout());
}

/// `gerono service`.
///
/// # Errors
/// [`Failure`].
pub fn service(name: &str) -> Result<(), Failure> {
    runtime::process::run(name, experiment::build, laboratory::equip).map_err(|error| match error {
        runtime::process::ProcessError::NotSpawned => Failure::new(Exit::BadInput, error),
        error => Failure::new(Exit::FlightFailed, error),
    })
}

/// `gerono clean`.
///
/// # Errors
/// [`Failure`] if something cannot be removed.
pub fn clean() -> Result<(), Failure> {
    let swept = run_root::clean().map_err(|error| {
        let reason = format!("cannot remove what dead runs have left: {error}");
        Failure::new(Exit::Trouble, reason)
    })?;
    for place in &swept.removed {
        print(format!("removed {}\n", place.display()));
    }
    for place in &swept.live {
        print(format!("in use  {}\n", place.display()));
    }
    if swept.removed.is_empty() {
        print("nothing was left by dead runs\n");
    }
    Ok(())
}
