//! What is generated from the code: the JSON Schema of scenarios, completions for shells.

use std::io;

use clap::CommandFactory;
use clap_complete::Shell;

use super::print;
use crate::cli::Cli;

/// `gerono schema`.
pub fn schema() {
    print(scenario_file::json_schema());
}

/// `gerono completions`.
pub fn completions(shell: Shell) {
    clap_complete::generate(shell, &mut Cli::command(), "gerono", &mut io::stdout());
}
