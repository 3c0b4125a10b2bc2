//! `gerono report`: writes logs as one page, with the paper's figures.

use super::{Failure, log_path, note, print};
use crate::cli::ReportArguments;
use command_line::exit::Exit;
use report::ReportError;
use reproduce::log_figures::LogFigures;

/// `gerono report`.
///
/// # Errors
/// [`Failure`]. A log that breaks off after its first sample is no failure.
pub fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    let logs: Vec<_> = arguments.logs.iter().map(|path| log_path(path)).collect();
    let failure = |error| match error {
        ReportError::Write { .. } => Failure::not_written(error),
        _ => Failure::trouble(error),
    };
    let output = match &arguments.output {
        Some(output) => output.clone(),
        None => report::folder_beside(&logs[0]).map_err(failure)?,
    };
    let written = report::write(&logs, &output, &mut LogFigures::default()).map_err(failure)?;
    written.notes.iter().for_each(note);
    print(format!("{}\n", written.page.display()));
    for figure in &written.figures {
        print(format!("{}\n", figure.display()));
    }
    Ok(Exit::of_logs(written.is_whole))
}
