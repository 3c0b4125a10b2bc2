//! The results of the cells: the content of `faults.json` and of the table.
//!
//! Nothing of the machine is in it: equal programs and scenarios write equal reports.

use serde::Serialize;

use super::flight::FlightResult;
use super::plan::{MatrixCell, Times};
use super::survival::{MatrixLoss, Survival, judge};
use super::{BESIDE, DELAY, FRACTION, RANGE, SURVIVES};
use metrics::SETTLED;
use metrics::summary::faults::FaultReport;

/// The whole of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatrixReport {
    /// Name of the scenario.
    pub scenario: String,
    /// Its seed.
    pub seed: u64,
    /// Time at which faults begin and how long they last.
    #[serde(flatten)]
    pub times: Times,
    /// The values of the faults and of their verdicts.
    pub values: Values,
    /// Number of faults that were survived, and so on.
    pub counts: Counts,
    /// `true` if the cells were flown as processes too, and had to be equal.
    pub compared_with_processes: bool,
    /// Place where processes differed from the flight in one process, in words.
    pub differences: Vec<String>,
    /// One for every target and kind, the undisturbed flight first.
    pub rows: Vec<Row>,
}

/// The values of the faults and of their verdicts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Values {
    /// By how much samples are late, s.
    pub delay: f64,
    /// Share of samples lost intermittently.
    pub fraction: f64,
    /// Largest magnitude of garbage in range.
    pub range: f64,
    /// Least bound, m.
    pub settled: f64,
    /// The largest ratio to the bound that counts as survived.
    pub survives: f64,
    /// The distance from a moment at which the undisturbed flight is looked at, s.
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

/// Number of faults by outcome; the undisturbed flight does not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Survived.
    pub survived: usize,
    /// Left the bound and came back.
    pub degraded: usize,
    /// Lost.
    pub lost: usize,
    /// Noticed by any service.
    pub noticed: usize,
}

/// The effect of one kind of fault on one target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Service or edge; none in the undisturbed flight.
    pub target: Option<String>,
    /// The kind of fault; none in the undisturbed flight.
    pub fault: Option<&'static str>,
    /// The worst of its verdicts.
    pub worst: Survival,
    /// One for every moment.
    pub cells: Vec<CellReport>,
}

/// The result of a flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellReport {
    /// Time at which the fault began, s.
    pub moment: f64,
    /// The verdict on the vehicle.
    pub verdict: Survival,
    /// Reason why it is lost, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<MatrixLoss>,
    /// The effect of the fault; none if the flight ended before it began.
    pub report: Option<FaultReport>,
}

/// Makes the report of cells and what they came to, in their order.
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
    let reports: Vec<CellReport> = cells
        .iter()
        .map(|(cell, flown)| {
            let (verdict, why) = judge(flown);
            CellReport {
                moment: cell.moment,
                verdict,
                why,
                report: flown.report.clone(),
            }
        })
        .collect();
    let worst = reports.iter().map(|cell| cell.verdict).max();
    Row {
        target: case.map(|case| case.target.to_string()),
        fault: case.map(|case| case.trouble.name()),
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
        let detection = cell.report.as_ref().and_then(|report| report.detection);
        counts.noticed += usize::from(detection.is_some());
    }
    counts
}
