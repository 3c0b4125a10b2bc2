//! Rows of a sweep: one for each flight.

use metrics::stretch::Metrics;
use metrics::summary::{self, Phase, Summary};
use serde::{Deserialize, Serialize};

use crate::definition::{Entry, KeptLogs};
use crate::expression::{Expression, ExpressionError};
use crate::plan::{Plan, Sample};

/// Type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers.
    Integer,
    /// Numbers, which may be missing.
    Number,
    /// Text.
    Text,
    /// `true` or `false`; missing for a refused flight.
    Flag,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name of the column.
    pub name: String,
    /// Type of its cells.
    pub kind: Kind,
}

/// The value of a row in a column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// `true` or `false`.
    Flag(bool),
    /// Whole number.
    Integer(u64),
    /// Number; `None` if it is missing.
    Number(Option<f64>),
    /// Text.
    Text(String),
}

/// A row: a cell for every column.
pub type Row = Vec<Cell>;

/// End of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Flown to the end.
    Completed,
    /// The vehicle was lost, or a kill ended the flight before it had landed.
    Lost,
    /// Ended early: by a failure of a plug-in, or by a number that is not finite.
    Failed,
    /// Refused by the scenario's checks or a requirement of the sweep.
    Refused,
}

impl From<summary::Outcome> for Outcome {
    fn from(outcome: summary::Outcome) -> Self {
        match outcome {
            summary::Outcome::Completed => Self::Completed,
            summary::Outcome::Lost | summary::Outcome::Killed => Self::Lost,
            summary::Outcome::Interrupted | summary::Outcome::Failed => Self::Failed,
        }
    }
}

impl Outcome {
    /// All, in the order in which tables count them.
    pub const ALL: [Self; 4] = [Self::Completed, Self::Lost, Self::Failed, Self::Refused];

    /// Returns the name in the rows.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Lost => "lost",
            Self::Failed => "failed",
            Self::Refused => "refused",
        }
    }
}

/// Result of a flight.
#[derive(Clone, Debug)]
pub struct Flown {
    pub outcome: Outcome,
    /// Reason, if the flight was not completed.
    pub reason: String,
    /// Metrics; `None` for a refused flight.
    pub summary: Option<Summary>,
    /// Mean of (T/(m g))^1.5.
    pub energy: Option<f64>,
    /// SHA-256 over the vehicle, path, estimates and frames of the whole seconds, in hexadecimal.
    pub digest: String,
    /// Steps of the vehicle.
    pub steps: u64,
}

/// A result of a flight: its name and its computation from the summary.
type FlightResult = (&'static str, fn(&Summary) -> Option<f64>);

macro_rules! of_metrics {
    ($($name:ident),+ $(,)?) => { [$((stringify!($name), |summary: &Summary| summary.metrics.map(|metrics: Metrics| metrics.$name))),+] };
}

macro_rules! of_part {
    ($($name:literal: $part:ident.$metric:ident),+ $(,)?) => {
        [$(($name, |summary: &Summary| summary.phases.last()?.$part.map(|metrics: Metrics| metrics.$metric))),+]
    };
}

/// Results of the steady state of the last phase and of the transient before it.
const PARTS: [FlightResult; 6] = of_part![
    "steady_rmse": steady.rmse,
    "steady_p95": steady.p95,
    "steady_max": steady.max,
    "steady_body_rate_rms": steady.body_rate_rms,
    "transient_rmse": transient.rmse,
    "transient_max": transient.max,
];

/// Results over the whole flight.
const METRICS: [FlightResult; 10] = of_metrics![
    rmse,
    mean,
    deviation,
    p50,
    p95,
    p99,
    max,
    time_of_max,
    thrust_mean,
    body_rate_rms,
];

/// Further results; estimates are those at the end.
const RESULTS: [FlightResult; 10] = [
    ("settling_time", |summary| {
        summary.phases.last()?.metrics?.settling_time
    }),
    ("saturated_share", |summary| summary.metrics?.saturated_share),
    ("ultimate", |summary| summary.phases.last()?.ultimate),
    ("ultimate_bound", |summary| summary.ultimate_bound),
    ("mass", |summary| summary.phases.last()?.parameters.mass),
    ("mass_estimate", |summary| {
        summary.phases.last()?.parameters.mass_estimate
    }),
    ("disturbance_estimate.0", |summary| estimate(summary, 0)),
    ("disturbance_estimate.1", |summary| estimate(summary, 1)),
    ("disturbance_estimate.2", |summary| estimate(summary, 2)),
    ("gamma", |summary| summary.phases.last()?.gamma),
];

/// Returns the current name of a column that was renamed.
#[must_use]
pub(crate) fn present_name(name: &str) -> &str {
    match name {
        "disturbance_estimate_x" => "disturbance_estimate.0",
        "disturbance_estimate_y" => "disturbance_estimate.1",
        "disturbance_estimate_z" => "disturbance_estimate.2",
        name => name,
    }
}

/// A result of a phase: its name and its computation.
type PhaseResult = (&'static str, fn(&Phase) -> Option<f64>);

/// Results of each phase of a flight with several.
const OF_PHASE: [PhaseResult; 5] = [
    ("steady_rmse", |phase| Some(phase.steady?.rmse)),
    ("rmse", |phase| Some(phase.metrics?.rmse)),
    ("max", |phase| Some(phase.metrics?.max)),
    ("settling_time", |phase| phase.metrics?.settling_time),
    ("ultimate", |phase| phase.ultimate),
];

/// Returns the results of a flight in the order of their columns.
fn results() -> impl Iterator<Item = &'static FlightResult> {
    PARTS.iter().chain(&METRICS).chain(&RESULTS)
}

fn estimate(summary: &Summary, axis: usize) -> Option<f64> {
    Some(summary.phases.last()?.parameters.disturbance_estimate?[axis])
}

/// Columns of a sweep; makes rows of flights.
#[derive(Debug)]
pub struct Layout {
    /// The columns, in their order.
    pub columns: Vec<Column>,
    phases: usize,
    criteria: Vec<Criterion>,
}

/// A criterion over the numbers of a row.
#[derive(Debug)]
struct Criterion {
    name: String,
    expression: Expression,
    /// `true` if the expression itself handles a flight that was not completed.
    judges_end: bool,
}

/// Columns about the end of a flight. A criterion that uses none of them fails for a flight that was not completed.
const OF_END: [&str; 3] = ["ended", "lost", "survived"];

impl Criterion {
    /// Judges a flight by its outcome and the numbers of its row; missing for a refused flight.
    fn judge(&self, outcome: Outcome, numbers: &[f64]) -> Cell {
        let is_judged = outcome == Outcome::Completed || self.judges_end;
        flag_of(outcome, is_judged && self.expression.is_true(numbers))
    }
}

/// Returns a flag of a flight; missing for a refused flight.
fn flag_of(outcome: Outcome, is_true: bool) -> Cell {
    match outcome {
        Outcome::Refused => Cell::Number(None),
        _ => Cell::Flag(is_true),
    }
}

impl Layout {
    /// Makes the layout of a sweep.
    ///
    /// # Errors
    /// [`ExpressionError`] if a criterion is invalid.
    pub fn new(plan: &Plan) -> Result<Self, ExpressionError> {
        let definition = &plan.source.definition;
        let phases = plan.phases();
        let column = |name: &str, kind| Column {
            name: name.to_owned(),
            kind,
        };
        let mut columns = vec![
            column("sample", Kind::Integer),
            column("law", Kind::Text),
            column("seed", Kind::Integer),
        ];
        for (index, name) in plan.columns().enumerate() {
            let kind = if plan.is_number(index) {
                Kind::Number
            } else {
                Kind::Text
            };
            columns.push(column(name, kind));
        }
        columns.extend([column("outcome", Kind::Text), column("reason", Kind::Text)]);
        let results = results().map(|(name, _)| (*name).to_owned());
        let of_phases = (1..=phases).filter(|_| phases > 1).flat_map(|phase| {
            let names = OF_PHASE
                .iter()
                .map(move |(name, _)| format!("phase{phase}_{name}"));
            names.collect::<Vec<_>>()
        });
        let numbers = ["ended".to_owned(), "energy".to_owned()];
        let numbers = numbers.into_iter().chain(results).chain(of_phases);
        columns.extend(numbers.map(|name| column(&name, Kind::Number)));
        columns.extend(["lost", "survived"].map(|name| column(name, Kind::Flag)));
        let index = |name: &str| {
            let matches = |column: &Column| column.name == present_name(name) && column.kind != Kind::Text;
            columns.iter().position(matches)
        };
        let criteria = definition.judge.iter().map(|(name, text)| {
            let expression = Expression::parse(text, index)?;
            let used = expression.indices();
            Ok(Criterion {
                name: name.clone(),
                judges_end: used
                    .iter()
                    .any(|&column| OF_END.contains(&columns[column].name.as_str())),
                expression,
            })
        });
        let criteria = criteria.collect::<Result<Vec<_>, ExpressionError>>()?;
        columns.extend(
            criteria
                .iter()
                .map(|criterion| column(&criterion.name, Kind::Flag)),
        );
        columns.push(column("digest", Kind::Text));
        Ok(Self {
            columns,
            phases,
            criteria,
        })
    }

    /// Returns the index of a column.
    #[must_use]
    pub fn index(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Returns the names of the criteria, `survived` first.
    pub fn criteria(&self) -> impl Iterator<Item = &str> {
        std::iter::once("survived").chain(self.criteria.iter().map(|criterion| criterion.name.as_str()))
    }

    /// Returns the row of a flight.
    #[must_use]
    pub fn row(&self, sample: &Sample, entry: &Entry, flown: &Flown) -> Row {
        let summary = flown.summary.as_ref();
        let number = |value: Option<f64>| Cell::Number(value.filter(|value| value.is_finite()));
        let mut row = vec![
            Cell::Integer(sample.index),
            Cell::Text(entry.name.clone()),
            Cell::Integer(sample.seed),
        ];
        row.extend(
            sample
                .values
                .iter()
                .zip(&self.columns[3..])
                .map(|(value, column)| {
                    let stated = entry.stated(&column.name);
                    let value = stated.as_ref().unwrap_or(value);
                    if column.kind == Kind::Number {
                        #[expect(clippy::cast_precision_loss, reason = "choices of whole numbers are small")]
                        let whole = value.as_integer().map(|number| number as f64);
                        number(value.as_float().or(whole))
                    } else {
                        Cell::Text(value.as_str().map_or_else(|| value.to_string(), str::to_owned))
                    }
                }),
        );
        row.extend([
            Cell::Text(flown.outcome.name().to_owned()),
            Cell::Text(flown.reason.clone()),
        ]);
        row.push(number(summary.map(|summary| summary.simulated_seconds)));
        row.push(number(flown.energy));
        row.extend(results().map(|(_, result)| number(summary.and_then(result))));
        for phase in (0..self.phases).filter(|_| self.phases > 1) {
            let phase = summary.and_then(|summary| summary.phases.get(phase));
            row.extend(OF_PHASE.iter().map(|(_, result)| number(phase.and_then(result))));
        }
        let outcome = flown.outcome;
        row.push(flag_of(outcome, outcome == Outcome::Lost));
        row.push(flag_of(outcome, outcome == Outcome::Completed));
        let numbers: Vec<f64> = row.iter().map(Cell::number).collect();
        let judged = self
            .criteria
            .iter()
            .map(|criterion| criterion.judge(outcome, &numbers));
        row.extend(judged);
        row.push(Cell::Text(flown.digest.clone()));
        debug_assert_eq!(row.len(), self.columns.len());
        row
    }

    /// Returns whether the log of a flight is kept.
    #[must_use]
    pub fn keeps_log(&self, kept: KeptLogs, row: &Row) -> bool {
        let failed = || self.criteria().any(|name| self.flag(row, name) == Some(false));
        match kept {
            KeptLogs::None => false,
            KeptLogs::Failed => self.text(row, "outcome") != Some("refused") && failed(),
            KeptLogs::All => self.text(row, "outcome") != Some("refused"),
        }
    }

    /// Returns a flag of a row.
    #[must_use]
    pub fn flag(&self, row: &Row, name: &str) -> Option<bool> {
        match row.get(self.index(name)?)? {
            Cell::Flag(flag) => Some(*flag),
            _ => None,
        }
    }

    /// Returns a text of a row.
    #[must_use]
    pub fn text<'a>(&self, row: &'a Row, name: &str) -> Option<&'a str> {
        match row.get(self.index(name)?)? {
            Cell::Text(text) => Some(text),
            _ => None,
        }
    }
}

impl Cell {
    /// Returns the number of a cell; NaN if it has none.
    #[must_use]
    pub fn number(&self) -> f64 {
        match self {
            Self::Flag(flag) => f64::from(u8::from(*flag)),
            #[expect(clippy::cast_precision_loss, reason = "indices and seeds have 53 bits")]
            Self::Integer(number) => *number as f64,
            Self::Number(number) => number.unwrap_or(f64::NAN),
            Self::Text(_) => f64::NAN,
        }
    }

    /// Converts the cell to the type of a column: JSON does not distinguish 1.0 from 1. `None` if the types do not match.
    #[must_use]
    pub fn into_kind(self, kind: Kind) -> Option<Self> {
        match (kind, self) {
            #[expect(clippy::cast_precision_loss, reason = "written as such a number")]
            (Kind::Number, Self::Integer(number)) => Some(Self::Number(Some(number as f64))),
            (Kind::Number, cell @ Self::Number(_))
            | (Kind::Integer, cell @ Self::Integer(_))
            | (Kind::Text, cell @ Self::Text(_))
            | (Kind::Flag, cell @ (Self::Flag(_) | Self::Number(None))) => Some(cell),
            _ => None,
        }
    }
}
