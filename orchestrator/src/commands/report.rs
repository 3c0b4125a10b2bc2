//! `gerono report`: logs as one page, and the paper's figures.

use std::path::{Path, PathBuf};

use super::{Failure, log_path, print};
use crate::cli::Report;
use crate::exit::Exit;
use crate::log::partial_path;
use crate::report::{self, ReportError};

/// `gerono report`.
///
/// # Errors
/// [`Failure`]; a log that breaks off is none, as long as it holds a sample.
pub fn report(arguments: &Report) -> Result<(), Failure> {
    let logs: Vec<_> = arguments.logs.iter().map(|path| any_log_path(path)).collect();
    let written = report::write(&logs, &arguments.output).map_err(|error| {
        let exit = match error {
            ReportError::Write { .. } => Exit::NotWritten,
            _ => Exit::Trouble,
        };
        Failure::new(exit, error)
    })?;
    for reason in &written.broken {
        eprintln!("warning: {reason}; the report shows that part");
    }
    print(format!("{}\n", written.page.display()));
    for figure in &written.figures {
        print(format!("{}\n", figure.display()));
    }
    Ok(())
}

/// The log that a path means, also one that was never completed.
fn any_log_path(path: &Path) -> PathBuf {
    let complete = log_path(path);
    let partial = partial_path(&complete);
    if path.is_dir() && !complete.exists() && partial.exists() {
        partial
    } else {
        complete
    }
}
