//! The report of the matrix: the content of `faults.json` and of the table.
//!
//! It contains nothing of the machine: equal programs and scenarios write equal reports.

use serde::{Deserialize, Serialize};

use super::flight::FlightResult;
use super::plan::{MatrixCell, Times};
use super::survival::{MatrixLoss, Survival};
use super::{BESIDE, DELAY, FRACTION, RANGE, SURVIVES};
use metrics::SETTLED;
use metrics::summary::faults::FaultReport;

/// Report of a fault matrix.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatrixReport {
    /// Name of the scenario.
    pub scenario: String,
    pub seed: u64,
    #[serde(flatten)]
    pub times: Times,
    /// Parameters of the faults and of the verdicts.
    pub values: Values,
    /// Numbers of faults by verdict.
    pub counts: Counts,
    /// `true` if the cells were also flown as processes and had to be equal.
    pub compared_with_processes: bool,
    /// Cells whose processes differed from the flight in one process, as sentences.
    pub differences: Vec<String>,
    /// One row for each target and kind, the undisturbed flight first.
    pub rows: Vec<Row>,
}

/// Parameters of the faults and of the verdicts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Values {
    /// Delay of late samples, s.
    pub delay: f64,
    /// Fraction of intermittently lost samples.
    pub fraction: f64,
    /// Maximum magnitude of garbage in range.
    pub range: f64,
    /// Minimum of the bound, m.
    pub settled: f64,
    /// Maximum ratio to the bound for "survived".
    pub survives: f64,
    /// Half width of the window in which the undisturbed flight is compared, s.
    pub beside: f64,
}

impl Values {
    const ALL: Self = Self {
        delay: DELAY,
        fraction: FRACTION,
        range: RANGE,
        settled: SETTLED,
        survives: SURVIVES,
        beside: BESIDE,
    };
}

/// Numbers of faults by verdict, without the undisturbed flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    pub survived: usize,
    /// Left the bound and came back.
    pub degraded: usize,
    pub lost: usize,
    /// Detected by any service.
    pub noticed: usize,
}

/// Results of one kind of fault on one target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Service or edge; `None` in the undisturbed flight.
    pub target: Option<String>,
    /// `None` in the undisturbed flight.
    pub fault: Option<&'static str>,
    /// The worst verdict.
    pub worst: Survival,
    /// One cell for each injection time.
    pub cells: Vec<CellReport>,
}

/// Result of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellReport {
    /// Injection time, s.
    pub moment: f64,
    /// Verdict on the vehicle.
    pub verdict: Survival,
    /// Reason of a loss.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<MatrixLoss>,
    /// Effect of the fault; `None` if the flight ended before it.
    pub report: Option<FaultReport>,
}

/// Creates the report of cells and their results, in their order.
#[must_use]
pub fn report(
    scenario: &str,
    seed: u64,
    times: Times,
    cells: &[MatrixCell],
    flown: &[FlightResult],
) -> MatrixReport {
    let judged: Vec<_> = cells.iter().zip(flown).collect();
    let rows: Vec<Row> = judged.chunks(times.moments.len().max(1)).map(row).collect();
    MatrixReport {
        scenario: scenario.to_owned(),
        seed,
        times,
        values: Values::ALL,
        counts: count(&rows),
        compared_with_processes: false,
        differences: Vec::new(),
        rows,
    }
}

fn row(cells: &[(&MatrixCell, &FlightResult)]) -> Row {
    let case = cells.first().and_then(|(cell, _)| cell.case);
    let reports: Vec<_> = cells.iter().map(|(_, flown)| flown.cell.clone()).collect();
    let worst = reports.iter().map(|cell| cell.verdict).max();
    Row {
        target: case.map(|case| case.target.to_string()),
        fault: case.map(|case| case.fault.name()),
        worst: worst.unwrap_or(Survival::Survived),
        cells: reports,
    }
}

fn count(rows: &[Row]) -> Counts {
    let mut counts = Counts::default();
    let disturbed = rows.iter().filter(|row| row.fault.is_some());
    for cell in disturbed.flat_map(|row| &row.cells) {
        *match cell.verdict {
            Survival::Survived => &mut counts.survived,
            Survival::Degraded => &mut counts.degraded,
            Survival::Lost => &mut counts.lost,
        } += 1;
        let report = cell.report.as_ref();
        counts.noticed += usize::from(report.is_some_and(|report| report.detection.is_some()));
    }
    counts
}
