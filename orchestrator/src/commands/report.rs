//! `gerono report`: logs as one page, and the paper's figures.

use super::{Failure, log_path, note, print};
use crate::cli::ReportArguments;
use command_line::exit::Exit;
use report::ReportError;
use reproduce::log_figures::LogFigures;

/// `gerono report`.
///
/// # Errors
/// [`Failure`]; a log that breaks off is none, as long as it holds a sample.
pub fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    let logs: Vec<_> = arguments.logs.iter().map(|path| log_path(path)).collect();
    let written =
        report::write(&logs, &arguments.output, &mut LogFigures::default()).map_err(|error| match error {
            ReportError::Write { .. } => Failure::not_written(error),
            _ => Failure::trouble(error),
        })?;
    for reason in &written.broken {
        note(format_args!("{reason}; the report shows that part"));
    }
    print(format!("{}\n", written.page.display()));
    for figure in &written.figures {
        print(format!("{}\n", figure.display()));
    }
    Ok(Exit::of_logs(written.broken.is_empty()))
}
