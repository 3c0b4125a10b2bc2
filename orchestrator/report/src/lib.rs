//! Reports of flights: one self-contained HTML page.
//!
//! * `flight`: the page's data of a log, collected in one pass: `channels` over time in `table`s, the `track`, `marks`;
//! * `latency`: timing of the services, for a flight in real time;
//! * `panels`: the arrangement of the plots;
//! * [`figures`]: figures beside the page, drawn by the caller;
//! * `page`, `encoding`: the HTML file, whose scripts ([`assets`]) draw the data.
//!
//! Beside the page: [`plot`], the distance from the path as a figure; [`info`], the content of a log as text; and
//! [`text_table`], tables for a terminal, for pages and for papers.
//!
//! Failure policy: of a log that breaks off, the intact part is shown, and the page says so. A log without a readable sample
//! is an error.

pub mod assets;
pub mod channels;
mod encoding;
pub mod figures;
mod flight;
pub mod info;
mod latency;
pub mod marks;
mod page;
pub mod panels;
pub mod plot;
mod run_facts;
mod table;
pub mod text_table;
mod track;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use run_log::run_folder::summary_beside;
use run_log::{LogReadError, files_of_log, host_log_beside};
use scenario::Unflyable;

use crate::figures::Figures;
use crate::flight::Flight;

/// File name of the page.
pub const PAGE: &str = "report.html";

/// Reason why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// The scenario of a log makes no schedule.
    #[error("the scenario of the log {} makes no schedule: {source}; use the program that wrote it", .path.display())]
    Scenario {
        /// The file.
        path: PathBuf,
        /// Reason why not.
        source: Unflyable,
    },
    /// A log has no sample.
    #[error("the log {} holds no sample: nothing to show", .0.display())]
    Empty(PathBuf),
    /// A file cannot be written.
    #[error("cannot write {}: {source}; choose a folder that you may write to with `-o`", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
}

/// The files that were written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub page: PathBuf,
    /// The figures beside it.
    pub figures: Vec<PathBuf>,
    /// `true` if no log breaks off.
    pub is_whole: bool,
    /// A line for each log that breaks off, with its reading error, and for each flight that went other than as planned.
    pub notes: Vec<String>,
}

/// Returns the folder of a report whose user states none: beside the log, and empty or that of an earlier report.
///
/// # Errors
/// [`ReportError::Write`] if something else has its name.
pub fn folder_beside(log: &Path) -> Result<PathBuf, ReportError> {
    let path = log.with_file_name("report");
    let is_free = match fs::read_dir(&path) {
        Ok(mut entries) => path.join(PAGE).is_file() || entries.next().is_none(),
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    };
    if is_free {
        return Ok(path);
    }
    let reason = "it is there already and holds no report";
    let source = io::Error::new(io::ErrorKind::AlreadyExists, reason);
    Err(ReportError::Write { path, source })
}

/// Reads the logs and writes their page and figures into the folder `out`, which is created if missing.
///
/// # Errors
/// [`ReportError`].
pub fn write(logs: &[PathBuf], out: &Path, figures: &mut dyn Figures) -> Result<Written, ReportError> {
    let flights: Vec<Flight> = logs
        .iter()
        .map(|log| Flight::read(log, table::buckets(logs.len()), figures))
        .collect::<Result<_, _>>()?;
    let figures = figures.draw();
    let inputs: Vec<_> = logs.iter().flat_map(|log| inputs_of(log)).collect();
    let page = write_file(out, PAGE, &page::html(&flights, &figures), &inputs)?;
    let figures = figures
        .iter()
        .map(|figure| write_file(out, figure.file, &figure.svg, &inputs))
        .collect::<Result<_, _>>()?;
    let broken = flights.iter().filter_map(|flight| flight.broken.as_ref());
    let broken = broken.map(|reason| format!("{reason}; the report shows the part before it"));
    let misfortunes = flights.iter().filter_map(Flight::misfortunes);
    Ok(Written {
        page,
        figures,
        is_whole: flights.iter().all(|flight| flight.broken.is_none()),
        notes: broken.chain(misfortunes).collect(),
    })
}

/// Reads a log and writes only its page into the folder `out`, after which the flight is named: for callers that drew the
/// figures already, and whose log has no name.
///
/// # Errors
/// [`ReportError`].
pub fn write_page(log: &Path, out: &Path) -> Result<PathBuf, ReportError> {
    let mut flight = Flight::read(log, table::buckets(1), &mut ())?;
    flight.label = out.file_name().unwrap_or_default().to_string_lossy().into_owned();
    write_file(out, PAGE, &page::html(&[flight], &[]), &inputs_of(log))
}

/// Reads a log and returns its page with figures, and the reading error if the log breaks off.
///
/// # Errors
/// [`ReportError`].
pub fn page(log: &Path, figures: &mut dyn Figures) -> Result<(String, Option<String>), ReportError> {
    let flight = Flight::read(log, table::buckets(1), figures)?;
    let html = page::html(std::slice::from_ref(&flight), &figures.draw());
    Ok((html, flight.broken))
}

/// Returns the files that the report of a log is made from.
fn inputs_of(log: &Path) -> Vec<PathBuf> {
    let mut files = files_of_log(log);
    files.extend(host_log_beside(log));
    files.push(summary_beside(log));
    files
}

fn write_file(folder: &Path, name: &str, text: &str, inputs: &[PathBuf]) -> Result<PathBuf, ReportError> {
    let path = folder.join(name);
    let written = fs::create_dir_all(folder).and_then(|()| result_file::write(&path, text, inputs));
    match written {
        Ok(()) => Ok(path),
        Err(source) => Err(ReportError::Write { path, source }),
    }
}
