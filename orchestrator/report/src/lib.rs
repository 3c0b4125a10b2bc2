//! Flights as one page that needs nothing but a browser.
//!
//! * `flight`: what is shown of a log, gathered in one pass: `channels` over time in `table`s, the way
//!   through space, `marks`;
//! * `latency`: how the services kept time, of a flight in real time;
//! * `panels`: what is drawn beside what;
//! * [`figures`]: figures beside the page, drawn by the caller;
//! * `page`, `encoding`: all of it in one HTML file, which draws it ([`assets`]).
//!
//! Beside the page: [`plot`], the distance from the path as a figure; [`info`], the content of a log in words; and
//! [`text_table`], tables for a terminal, for pages and for papers.
//!
//! Failure policy: of a log that breaks off, what is whole is shown, and the page says so. A log of which nothing can be
//! read is an error.

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
use std::path::{Path, PathBuf};

use run_log::run_folder::summary_beside;
use run_log::{LogReadError, files_of_log, host_log_beside};
use scenario::Unflyable;

use crate::figures::Figures;
use crate::flight::Flight;

/// Name of the page.
pub const PAGE: &str = "report.html";

/// Reason why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// A log cannot be understood.
    #[error("the scenario of the log {} makes no schedule: {source}; use the program that wrote it", .path.display())]
    Scenario {
        /// The file.
        path: PathBuf,
        /// Reason why not.
        source: Unflyable,
    },
    /// A log has nothing to show.
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

/// The file that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub page: PathBuf,
    /// The figures beside it.
    pub figures: Vec<PathBuf>,
    /// Logs of which only a part is whole, with why.
    pub broken: Vec<String>,
}

/// Reads the logs and writes the page and the figures of them into the folder `out`, which is made if there is none.
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
    Ok(Written {
        page,
        figures,
        broken: flights.into_iter().filter_map(|flight| flight.broken).collect(),
    })
}

/// Reads a log and writes its page alone into the folder `out`, for callers that have drawn the figures already.
///
/// # Errors
/// [`ReportError`].
pub fn write_page(log: &Path, out: &Path) -> Result<PathBuf, ReportError> {
    let flight = Flight::read(log, table::buckets(1), &mut ())?;
    write_file(out, PAGE, &page::html(&[flight], &[]), &inputs_of(log))
}

/// Reads a log and returns its page, with the figures of it, and why only a part of the log is whole, if so.
///
/// # Errors
/// [`ReportError`].
pub fn page(log: &Path, figures: &mut dyn Figures) -> Result<(String, Option<String>), ReportError> {
    let flight = Flight::read(log, table::buckets(1), figures)?;
    let html = page::html(std::slice::from_ref(&flight), &figures.draw());
    Ok((html, flight.broken))
}

/// Returns the files that are read for the report of a log.
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
