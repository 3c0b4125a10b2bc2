//! The matrix as a table, for a terminal and for documents.

use std::fmt::{self, Display, Formatter};

use super::report::{CellReport, MatrixReport, Row};
use super::{BESIDE, SURVIVES};
use metrics::SETTLED;
use metrics::summary::faults::{BEFORE, Detection};
use report::text_table::TextTable;

/// Returns the table: a line for each target and kind.
#[must_use]
pub fn sheet(report: &MatrixReport) -> TextTable {
    let mut header = vec!["what fails".to_owned(), "how".to_owned()];
    header.extend(report.times.moments.iter().map(|moment| format!("at {moment} s")));
    header.extend(["peak ‖p − pd‖, m", "back after, s", "noticed after, s"].map(str::to_owned));
    TextTable::new("", &header, report.rows.iter().map(line))
}

/// Returns the legend of the table.
#[must_use]
pub fn key() -> String {
    format!(
        "Bound: the largest distance of the {BEFORE} s before, at least {SETTLED} m, and what the flight without a fault has within \
         {BESIDE} s of the same time. Survived: within {SURVIVES} times the bound; degraded: came back inside the bound, or was \
         made to land; LOST: did not, was lost by the limits of `[judge]`, a number was not finite, or a service died of it.\n\
         Peak, way back and notice are those of the worst moment."
    )
}

/// Returns the numbers of faults by verdict.
#[must_use]
pub fn counts(report: &MatrixReport) -> String {
    let counts = report.counts;
    let all = counts.survived + counts.degraded + counts.lost;
    format!(
        "{all} faults: {} survived, {} degraded, {} lost; {} noticed.",
        counts.survived, counts.degraded, counts.lost, counts.noticed
    )
}

/// Returns scenario, seed and injection times in a line.
#[must_use]
pub fn title(report: &MatrixReport) -> String {
    let moments: Vec<_> = report.times.moments.iter().map(f64::to_string).collect();
    format!(
        "{}, seed {}: faults of {} s at {} s",
        report.scenario,
        report.seed,
        report.times.lasts,
        moments.join(", ")
    )
}

/// Returns the report as a Markdown document.
#[must_use]
pub fn markdown(report: &MatrixReport) -> String {
    let mut text = format!(
        "# {}\n\n{}\n{}\n\n{}\n",
        title(report),
        sheet(report).markdown(),
        counts(report),
        key()
    );
    for line in remarks(report) {
        text += &format!("\n{line}\n");
    }
    text
}

impl Display for MatrixReport {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            formatter,
            "{}\n\n{}\n\n{}\n{}",
            title(self),
            sheet(self),
            key(),
            counts(self)
        )?;
        for line in remarks(self) {
            writeln!(formatter, "{line}")?;
        }
        Ok(())
    }
}

/// Returns the remarks: details of losses, and the comparison with processes.
fn remarks(report: &MatrixReport) -> Vec<String> {
    let mut lines = Vec::new();
    for row in &report.rows {
        for cell in &row.cells {
            if let Some(details) = cell.why.as_ref().and_then(|why| why.details.as_ref()) {
                let [target, fault] = names(row);
                lines.push(format!("{target}, {fault}, at {} s: {details}", cell.moment));
            }
        }
    }
    if report.compared_with_processes && report.differences.is_empty() {
        lines.push("As processes that really die, every flight had the same bytes.".to_owned());
    }
    lines.extend(report.differences.iter().cloned());
    lines
}

fn names(row: &Row) -> [String; 2] {
    match (&row.target, row.fault) {
        (Some(target), Some(fault)) => [target.clone(), fault.to_owned()],
        _ => ["nothing".to_owned(), "undisturbed".to_owned()],
    }
}

fn line(row: &Row) -> Vec<String> {
    let mut cells = names(row).to_vec();
    cells.extend(row.cells.iter().map(verdict));
    cells.extend([peak(row), back(row), noticed(row)]);
    cells
}

/// Formats the verdict of a cell, with the reason if there is one.
fn verdict(cell: &CellReport) -> String {
    let name = cell.verdict.name();
    match &cell.why {
        None => name.to_owned(),
        Some(why) => format!("{name}: {}", why.reason),
    }
}

fn peak(row: &Row) -> String {
    let peaks = row
        .cells
        .iter()
        .filter_map(|cell| cell.report.as_ref()?.peak_error);
    let largest = peaks.max_by(f64::total_cmp);
    largest.map_or_else(|| "–".to_owned(), |peak| format!("{peak:.4}"))
}

/// Formats the longest return time; "not back" if any cell has none.
fn back(row: &Row) -> String {
    let mut ways = row
        .cells
        .iter()
        .map(|cell| cell.report.as_ref().and_then(|report| report.back_after));
    let longest = ways.try_fold(0.0, |longest: f64, way| Some(longest.max(way?)));
    longest.map_or_else(|| "not back".to_owned(), |after| format!("{after:.3}"))
}

/// Formats the latest detection, with the number of cells that have one unless all have.
fn noticed(row: &Row) -> String {
    let notices: Vec<&Detection> = row
        .cells
        .iter()
        .filter_map(|cell| cell.report.as_ref()?.detection.as_ref())
        .collect();
    let latest = notices
        .iter()
        .max_by(|left, right| left.after.total_cmp(&right.after));
    let Some(Detection { after, by, sign }) = latest else {
        return "–".to_owned();
    };
    let share = if notices.len() < row.cells.len() {
        format!(" ({} of {})", notices.len(), row.cells.len())
    } else {
        String::new()
    };
    format!("{after} {by} {sign}{share}")
}
