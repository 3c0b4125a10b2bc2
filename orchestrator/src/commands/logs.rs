//! Commands on a log without a flight: `gerono info`, `recover`, `export`, `digest` and `plot`.

use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};

use scenario::Scenario;

use super::{Failure, log_path, not_written, note, print};
use crate::cli::{Digest, Export, Info, Plot, Recover};
use command_line::exit::Exit;
use command_line::output::note_omissions;
use command_line::terminal::Terminal;
use report::plot::PlotError;
use report::{info, plot};
use result_file::ResultFile;
use run_log::run_folder::log_meant_by;
use run_log::{
    Ending, ExportError, LogReadError, LogReader, RecoverError, ViewError, ending, files_of_log,
    host_log_beside, is_whole, number_of, recovered_path, written_files,
};

/// `gerono plot`.
///
/// # Errors
/// [`Failure`].
pub fn plot(arguments: &Plot) -> Result<(), Failure> {
    let logs: Vec<_> = arguments.logs.iter().map(|path| log_path(path)).collect();
    let Plot { from, to, .. } = *arguments;
    if from.unwrap_or(0.0) >= to.unwrap_or(f64::INFINITY) {
        return Err(Failure::bad_input("--from must be before --to"));
    }
    let failure = |error| match error {
        PlotError::Write { .. } => Failure::not_written(error),
        PlotError::BeyondTheEnd { .. } => Failure::bad_input(error),
        _ => Failure::trouble(error),
    };
    let output = match &arguments.output {
        Some(output) => output.clone(),
        None => plot::file_beside(&logs[0]).map_err(failure)?,
    };
    let told = plot::distance(&logs, plot::Span { from, to }, &output).map_err(failure)?;
    told.into_iter().for_each(note);
    print(format!("{}\n", output.display()));
    Ok(())
}

/// `gerono digest`.
///
/// # Errors
/// [`Failure`].
pub fn digest(arguments: &Digest) -> Result<(), Failure> {
    let digest = run_log::digest(&log_path(&arguments.log)).map_err(Failure::trouble)?;
    print(format!("{digest}\n"));
    Ok(())
}

/// `gerono export`.
///
/// # Errors
/// [`Failure`].
pub fn export(arguments: &Export) -> Result<(), Failure> {
    let log = log_path(&arguments.log);
    if arguments.view {
        return export_view(&log, arguments.output.as_deref());
    }
    match arguments.output.as_deref().filter(|path| *path != Path::new("-")) {
        Some(path) => export_file(arguments, &log, path),
        None if io::stdout().is_terminal() => {
            export_lines(arguments, &log, Terminal::new(io::stdout().lock()))
        }
        None => export_lines(arguments, &log, io::stdout().lock()),
    }
}

/// Writes the samples of a log to a file. A log that breaks off makes no file, but `-` prints its intact part.
fn export_file(arguments: &Export, log: &Path, path: &Path) -> Result<(), Failure> {
    // Before the file is created, or a FIFO blocks, for an unreadable log.
    LogReader::open(log).map_err(Failure::trouble)?;
    let failed = |error: io::Error| not_written(path, &error);
    let mut file = ResultFile::create(path, &files_of_log(log)).map_err(failed)?;
    export_lines(arguments, log, &mut file)?;
    file.finish().map_err(failed)
}

fn export_lines(arguments: &Export, log: &Path, output: impl Write) -> Result<(), Failure> {
    let mut buffered = BufWriter::new(output);
    let exported = match arguments.topic {
        Some(topic) if arguments.csv => run_log::export_csv(log, topic, arguments.every, &mut buffered),
        topic => run_log::export_json(log, topic, arguments.every, &mut buffered),
    };
    match exported.and_then(|()| Ok(buffered.flush()?)) {
        // A reader that closes the pipe needs no more.
        Err(ExportError::Write(error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error @ ExportError::Write(_)) => Err(Failure::not_written(error)),
        Err(error @ ExportError::Read(_)) => Err(Failure::trouble(error)),
        Ok(()) => Ok(()),
    }
}

/// `gerono export --view`.
fn export_view(log: &Path, output: Option<&Path>) -> Result<(), Failure> {
    let target = output.map_or_else(|| run_log::view_path(log), Path::to_owned);
    if target == Path::new("-") {
        let reason = "a copy for viewers is a file, not lines; name one with `--out`";
        return Err(Failure::bad_input(reason));
    }
    run_log::export_view(log, &target).map_err(|error| match error {
        ViewError::Itself(_) | ViewError::Write(_) => Failure::not_written(error),
        ViewError::Read(_) | ViewError::Nowhere(_) => Failure::trouble(error),
    })?;
    print(format!("{}\n", target.display()));
    Ok(())
}

/// `gerono info`.
///
/// # Errors
/// [`Failure`].
pub fn info(arguments: &Info) -> Result<Exit, Failure> {
    let log = log_meant_by(&arguments.log);
    let info = info::Info::read(&log).map_err(Failure::trouble)?;
    let exit = Exit::of_logs(info.is_complete());
    note_omissions(&log, info.scenario.omissions());
    if arguments.json {
        let text = serde_json::to_string_pretty(&info).map_err(Failure::trouble)?;
        print(text + "\n");
    } else {
        print(info);
    }
    Ok(exit)
}

/// `gerono recover`.
///
/// # Errors
/// [`Failure`].
pub fn recover(arguments: &Recover) -> Result<(), Failure> {
    let scenario = match &arguments.scenario {
        Some(path) => {
            let scenario = scenario_file::load_shortened(path, &arguments.sets, arguments.seed);
            Some(scenario.map_err(Failure::from)?.0)
        }
        None => None,
    };
    let out = arguments.out.as_deref();
    if !arguments.log.is_dir() {
        let target = out.map_or_else(|| recovered_path(&arguments.log), Path::to_owned);
        return recover_one(&arguments.log, &target, scenario.as_ref()).map_err(refusal);
    }
    let logs = logs_of(&arguments.log);
    if logs.is_empty() {
        let reason = format!(
            "there is no run.mcap and no host.mcap in {}, closed or not; give the folder of a run, or a log",
            arguments.log.display()
        );
        return Err(Failure::trouble(reason));
    }
    if let Some(folder) = out {
        std::fs::create_dir_all(folder).map_err(|error| {
            let reason = format!("cannot create the folder {}: {error}", folder.display());
            Failure::not_written(reason)
        })?;
    }
    // A failure for one log does not prevent the recovery of the others.
    let results = recover_all(&logs, out, scenario.as_ref());
    let some_are_whole = results.iter().any(Result::is_ok);
    for result in results {
        match result {
            // A host log may still be empty at the start of a run.
            Err(error @ (RecoverError::Nothing(_) | RecoverError::Empty(_))) if some_are_whole => note(error),
            result => result.map_err(refusal)?,
        }
    }
    Ok(())
}

fn refusal(error: RecoverError) -> Failure {
    let exit = match error {
        RecoverError::Exists(_) | RecoverError::Write(_) => Exit::NotWritten,
        _ => Exit::Trouble,
    };
    Failure::new(exit, error)
}

/// Returns the log files in the folder of a run.
fn logs_of(folder: &Path) -> Vec<PathBuf> {
    let run = folder.join("run.mcap");
    let host = host_log_beside(&run);
    written_files(&run).into_iter().chain(host).collect()
}

/// Recovers the incomplete files, the last one first, and files of a split log whose successor is unreadable.
fn recover_all(
    logs: &[PathBuf],
    out: Option<&Path>,
    scenario: Option<&Scenario>,
) -> Vec<Result<(), RecoverError>> {
    let mut results = Vec::new();
    // The next file, if it is readable.
    let mut next: Option<&Path> = None;
    for log in logs.iter().rev() {
        let beside = recovered_path(log);
        let target = match out {
            Some(folder) => folder.join(beside.file_name().unwrap_or_default()),
            None => beside,
        };
        let result = match ending(log) {
            Ok(Ending::GoesOn(number)) if next.and_then(number_of) != Some(number) => {
                note(format_args!(
                    "{} continues in another file, which is missing or unreadable",
                    log.display()
                ));
                recover_broken(log, &target, scenario)
            }
            _ => recover_one(log, &target, scenario),
        };
        next = result.is_ok().then_some(log);
        results.push(result);
    }
    results.reverse();
    results
}

fn recover_one(log: &Path, target: &Path, scenario: Option<&Scenario>) -> Result<(), RecoverError> {
    match is_whole(log) {
        Ok(true) => {
            print(format!("{} is complete: nothing to recover\n", log.display()));
            Ok(())
        }
        Err(error @ LogReadError::Foreign { .. }) => Err(RecoverError::Other(error)),
        Ok(false) | Err(_) => recover_broken(log, target, scenario),
    }
}

fn recover_broken(log: &Path, target: &Path, scenario: Option<&Scenario>) -> Result<(), RecoverError> {
    let recovery = run_log::recover(log, target, scenario)?;
    print(format!(
        "{} from {}: {recovery}\n",
        target.display(),
        log.display()
    ));
    Ok(())
}
