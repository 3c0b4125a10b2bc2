//! Texts generated from the code: the JSON Schema of scenarios, completions for shells, man pages.

use super::{Failure, print};
use crate::cli::ManArguments;
use crate::cli::groups::command;

/// `gerono schema`.
pub fn schema() {
    print(scenario_file::json_schema());
}

/// `gerono header`.
pub fn header() {
    print(plugin::header::TEXT);
}

/// `gerono completions`.
///
/// # Errors
/// [`Failure`] for an unknown shell.
pub fn completions(shell: &str) -> Result<(), Failure> {
    let script = crate::manual::completion::script(shell).map_err(Failure::bad_input)?;
    print(String::from_utf8_lossy(&script));
    Ok(())
}

/// `gerono man`.
///
/// # Errors
/// [`Failure`] if the pages cannot be written.
pub fn man(arguments: &ManArguments) -> Result<(), Failure> {
    let command = command();
    match &arguments.out {
        Some(folder) => crate::manual::pages::write_man_pages(command, folder).map_err(Failure::not_written),
        None => {
            let page = crate::manual::pages::man_page(command).map_err(Failure::not_written)?;
            print(String::from_utf8_lossy(&page));
            Ok(())
        }
    }
}
