//! Statistics of a sweep: pass rates with intervals, quantiles, and paired differences.

use std::fmt::{Display, Formatter};

use report::text_table::TextTable;
use scenario_file::unit_of_key;
use serde::Serialize;
use statistics::interval::{clopper_pearson, lower_bound, wilson};
use statistics::paired::{Paired, sign_test};
use statistics::quantile::{median, quantile, sorted};

use crate::definition::{Definition, Entry, Method};
use crate::parts::{self, Parts};
use crate::plan::Plan;
use crate::row::{Cell, Kind, Layout, Outcome, Row};

/// Confidence of all intervals.
pub const CONFIDENCE: f64 = 0.95;

/// Number of bins of a varied value in the table of the best laws.
const BINS: usize = 4;

/// Maximum number of listed failures.
const LISTED: usize = 20;

/// Maximum number of failures in the brief tables, and of characters of their reasons.
const BRIEF_FAILURES: usize = 5;
const BRIEF_REASON: usize = 60;

/// Maximum number of rows of a brief table.
const BRIEF_LINES: usize = 20;

/// A result whose quantiles and differences are shown.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Name of the column.
    pub name: String,
    /// Title with the unit.
    pub title: String,
    /// Factor from the column's unit to that of the title.
    pub factor: f64,
}

impl Shown {
    fn new(name: &str, title: &str) -> Self {
        Self {
            name: name.to_owned(),
            title: title.to_owned(),
            factor: if title.ends_with(", cm") { 100.0 } else { 1.0 },
        }
    }

    /// Returns the results that the report shows: first the rank, last further results of maps.
    fn all(definition: &Definition) -> Vec<Self> {
        let rank = definition.rank.as_str();
        let known = [
            ("steady_rmse", "RMS distance in steady state, cm"),
            ("rmse", "RMS distance over the whole flight, cm"),
            ("steady_p95", "95 % of the distances in steady state, cm"),
            ("transient_max", "largest distance in the transient, cm"),
            ("max", "largest distance, cm"),
            ("ultimate", "largest of the last 5 s, cm"),
            ("settling_time", "settling time of the last phase, s"),
            ("steady_body_rate_rms", "body rates in steady state, rad/s"),
            ("energy", "energy relative to hover"),
        ];
        let shown = |name: &str| match known.iter().find(|(known, _)| *known == name) {
            Some((_, title)) => Self::new(name, title),
            None if is_distance(name) => Self::new(name, &format!("{name}, cm")),
            None => Self::new(name, name),
        };
        let map_values = definition.map.iter().map(|map| map.value.as_str());
        // The first two are shown only as rank or in a map.
        let names = std::iter::once(rank)
            .chain(known[2..].iter().map(|(name, _)| *name))
            .chain(map_values);
        let mut all: Vec<Self> = Vec::new();
        for name in names {
            if all.iter().all(|other| other.name != name) {
                all.push(shown(name));
            }
        }
        all
    }
}

/// Returns whether a column holds a distance from the path, m.
fn is_distance(name: &str) -> bool {
    let result = ["steady_", "transient_"]
        .iter()
        .find_map(|part| name.strip_prefix(part));
    let phase_result = || {
        name.strip_prefix("phase")?
            .split_once('_')
            .map(|(_, result)| result)
    };
    let result = result.or_else(phase_result).unwrap_or(name);
    [
        "rmse",
        "mean",
        "deviation",
        "p50",
        "p95",
        "p99",
        "max",
        "ultimate",
        "ultimate_bound",
        "steady_rmse",
    ]
    .contains(&result)
}

/// Results for the report, column by column: a few numbers for each row.
#[derive(Clone, Debug)]
pub struct Results {
    /// By entry: flags by criterion, and numbers by shown result.
    pub entries: Vec<EntryResults>,
    /// Number of refused flights.
    pub refused: u64,
    /// Shown results; entries are ranked by the first one.
    pub shown: Vec<Shown>,
    indices: ColumnIndices,
    /// Listed failures.
    failures: Vec<Failed>,
    further_failures: u64,
}

/// Results of an entry, sample by sample.
#[derive(Clone, Debug, Default)]
pub struct EntryResults {
    /// Number of flights by outcome, in the order of [`Outcome::ALL`].
    pub outcomes: [u64; 4],
    /// By column of the plan, the varied number of each sample; empty for a key that the entry overrides or that is not numeric.
    pub varied: Vec<Vec<f64>>,
    /// `true` for each sample that was flown.
    pub is_flown: Vec<bool>,
    /// By criterion, whether each sample meets it.
    pub criteria: Vec<Vec<bool>>,
    /// By shown result, its value; NaN for a flight that was not completed.
    pub numbers: Vec<Vec<f64>>,
}

impl EntryResults {
    /// Returns the median of the first result in a bin of a varied value, and the number of flights in it without a result.
    fn part_median(&self, column: usize, is_in: impl Fn(f64) -> bool) -> (Option<f64>, usize) {
        let samples = self.varied[column]
            .iter()
            .zip(&self.numbers[0])
            .zip(&self.is_flown);
        let results = samples.filter(|((value, _), is_flown)| is_in(**value) && **is_flown);
        let (found, without): (Vec<f64>, Vec<f64>) = results
            .map(|((_, result), _)| *result)
            .partition(|result| result.is_finite());
        (median(&sorted(found)), without.len())
    }
}

/// Indices of the columns.
#[derive(Clone, Debug)]
struct ColumnIndices {
    /// By entry, its varied numbers: the index among the varied values and that of the column.
    varied: Vec<Vec<(usize, usize)>>,
    outcome: usize,
    reason: usize,
    criteria: Vec<usize>,
    numbers: Vec<usize>,
}

/// A flight that did not meet a criterion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failed {
    /// Index of the sample.
    pub sample: u64,
    /// Name of the entry.
    pub law: String,
    /// Seed of the flight.
    pub seed: u64,
    /// Reason of the outcome.
    pub reason: String,
}

impl Failed {
    /// Returns the failure with a reason short enough for a table.
    fn shortened(&self) -> Self {
        let mut reason: String = self.reason.chars().take(BRIEF_REASON).collect();
        if reason.len() < self.reason.len() {
            reason.push('…');
        }
        Self {
            reason,
            ..self.clone()
        }
    }
}

impl Results {
    /// Makes empty results.
    ///
    /// # Panics
    /// If the layout lacks a standard column.
    #[must_use]
    pub fn new(plan: &Plan, layout: &Layout) -> Self {
        let index = |name: &str| layout.index(name).expect("every layout has this column");
        let shown = Shown::all(&plan.source.definition);
        let columns: Vec<_> = plan.columns().zip(&layout.columns[3..]).collect();
        let varied_of = |entry: &Entry| {
            let columns = columns.iter().enumerate();
            let varied = columns
                .filter(|(_, (name, column))| column.kind == Kind::Number && entry.stated(name).is_none());
            varied.map(|(index, _)| (index, 3 + index)).collect()
        };
        let indices = ColumnIndices {
            varied: plan.entries.iter().map(varied_of).collect(),
            outcome: index("outcome"),
            reason: index("reason"),
            criteria: layout.criteria().map(index).collect(),
            numbers: shown.iter().map(|shown| index(&shown.name)).collect(),
        };
        let entry = EntryResults {
            varied: vec![Vec::new(); columns.len()],
            criteria: vec![Vec::new(); indices.criteria.len()],
            numbers: vec![Vec::new(); shown.len()],
            ..EntryResults::default()
        };
        Self {
            entries: vec![entry; plan.entries.len()],
            refused: 0,
            shown,
            indices,
            failures: Vec::new(),
            further_failures: 0,
        }
    }

    /// Adds a row; rows come in the order of samples and entries.
    pub fn add(&mut self, row: &Row) {
        let counts = self.entries.iter().map(|entry| entry.is_flown.len());
        let index = counts
            .enumerate()
            .min_by_key(|(_, count)| *count)
            .map_or(0, |(index, _)| index);
        let indices = &self.indices;
        let outcome = Outcome::ALL
            .iter()
            .position(|outcome| row[indices.outcome] == Cell::Text(outcome.name().to_owned()));
        let outcome = outcome.unwrap_or(2);
        self.refused += u64::from(outcome == 3);
        let entry = &mut self.entries[index];
        for &(varied, column) in &indices.varied[index] {
            entry.varied[varied].push(row[column].number());
        }
        entry.outcomes[outcome] += 1;
        entry.is_flown.push(outcome != 3);
        for (flags, &column) in entry.criteria.iter_mut().zip(&indices.criteria) {
            flags.push(row[column] == Cell::Flag(true));
        }
        for (numbers, &column) in entry.numbers.iter_mut().zip(&indices.numbers) {
            numbers.push(if outcome == 0 {
                row[column].number()
            } else {
                f64::NAN
            });
        }
        let meets = indices
            .criteria
            .iter()
            .all(|&column| row[column] == Cell::Flag(true));
        if outcome != 3 && !meets {
            self.list_failure(row);
        }
    }

    /// Returns the varied number of each sample in a column; empty if the column is not numeric or every entry overrides it.
    #[must_use]
    pub fn varied(&self, column: usize) -> &[f64] {
        let columns = self.entries.iter().map(|entry| entry.varied[column].as_slice());
        columns.max_by_key(|values| values.len()).unwrap_or_default()
    }

    fn list_failure(&mut self, row: &Row) {
        if self.failures.len() == LISTED {
            self.further_failures += 1;
            return;
        }
        let text = |column: usize| {
            if let Cell::Text(text) = &row[column] {
                text.clone()
            } else {
                String::new()
            }
        };
        let whole = |column: usize| {
            if let Cell::Integer(number) = row[column] {
                number
            } else {
                0
            }
        };
        let reason = match text(self.indices.reason) {
            reason if reason.is_empty() => "it did not meet a criterion".to_owned(),
            reason => reason,
        };
        self.failures.push(Failed {
            sample: whole(0),
            law: text(1),
            seed: whole(2),
            reason,
        });
    }
}

/// Content of `sweep.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Shown results.
    #[serde(skip)]
    shown: Vec<Shown>,
    /// SHA-256 of sweep and scenario.
    pub sweep: String,
    /// Method of the samples.
    pub method: Method,
    /// Number of samples.
    pub samples: u64,
    /// Confidence of all intervals.
    pub confidence: f64,
    /// The entries.
    pub laws: Vec<LawReport>,
    /// Differences of the others from the first, sample by sample.
    pub differences: Vec<Difference>,
    /// Best entries in each bin of a varied value, by the result of the rank.
    pub winners: Vec<Winner>,
    /// The first flights that did not meet a criterion.
    pub failures: Vec<Failed>,
    /// Number of failures that are not listed.
    pub further_failures: u64,
}

/// Results of an entry.
#[derive(Clone, Debug, Serialize)]
pub struct LawReport {
    /// Name of the entry.
    pub name: String,
    /// Completed flights.
    pub completed: u64,
    /// Flights in which the vehicle was lost.
    pub lost: u64,
    /// Flights that failed for another reason.
    pub failed: u64,
    /// Refused flights, which count nowhere else.
    pub refused: u64,
    /// Pass rates of the criteria.
    pub criteria: Vec<CriterionReport>,
    /// Quantiles of results over the completed flights.
    pub quantiles: Vec<QuantileReport>,
}

impl LawReport {
    /// Returns the number of flown samples.
    #[must_use]
    pub fn flown(&self) -> u64 {
        self.completed + self.lost + self.failed
    }
}

/// Pass rate of a criterion.
#[derive(Clone, Debug, Serialize)]
pub struct CriterionReport {
    /// Name of the criterion.
    pub name: String,
    /// Flown samples that meet the criterion.
    pub met: u64,
    /// Flown samples.
    pub flown: u64,
    /// Pass rate; `None` if no sample was flown.
    pub rate: Option<f64>,
    /// Wilson interval; only for independent samples.
    pub wilson: Option<[f64; 2]>,
    /// Exact Clopper–Pearson interval; only for independent samples.
    pub clopper_pearson: Option<[f64; 2]>,
    /// One-sided exact lower bound; only for independent samples.
    pub at_least: Option<f64>,
}

/// Quantiles of a result.
#[derive(Clone, Debug, Serialize)]
pub struct QuantileReport {
    /// Name of the column.
    pub name: String,
    /// Number of flights with this result.
    pub count: usize,
    /// The quantiles 0, 5, 25, 50, 75, 95 and 100 %, in the column's unit.
    pub values: [f64; 7],
}

/// Shares of [`QuantileReport::values`].
const SHARES: [f64; 7] = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0];

/// Paired difference of an entry from the first one; negative if the entry's result is smaller.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// Name of the entry.
    pub law: String,
    /// Name of the first entry.
    pub reference: String,
    /// Name of the result.
    pub name: String,
    /// Samples that both completed.
    pub completed: usize,
    /// Completed samples for which both have the result: a flight that does not settle has no settling time.
    pub pairs: usize,
    /// Samples that the entry lost and the reference did not.
    pub only_law_failed: u64,
    /// Samples that the reference lost and the entry did not.
    pub only_reference_failed: u64,
    /// Two-sided p-value of McNemar's exact test of these two counts.
    pub mcnemar_p: f64,
    /// Median of the differences, in the column's unit; without a pair this and all following statistics are `None`.
    pub median: Option<f64>,
    /// Bootstrap interval of the median.
    pub interval: Option<[f64; 2]>,
    /// Mean of the differences.
    pub mean: Option<f64>,
    /// Samples in which the entry's result is smaller.
    pub won: u64,
    /// Samples in which the entry's result is larger.
    pub lost: u64,
    /// Samples in which both results are equal.
    pub tied: u64,
    /// Two-sided p-value of the exact sign test.
    pub sign_p: Option<f64>,
    /// Two-sided p-value of Wilcoxon's signed-rank test.
    pub wilcoxon_p: Option<f64>,
}

/// The best entries in a bin of a varied value.
#[derive(Clone, Debug, Serialize)]
pub struct Winner {
    /// Name of the varied value.
    pub varied: String,
    /// Range of the bin.
    pub range: [f64; 2],
    /// By entry, the median, in the column's unit; `None` if no flight was completed.
    pub medians: Vec<Option<f64>>,
    /// By entry, the number of flights without the result, lost ones among them.
    pub without: Vec<usize>,
    /// Name of the entry with the fewest flights without the result and, among equals, the smallest median; several names if
    /// they tie.
    pub law: String,
}

impl Report {
    /// Makes the report of all results.
    #[must_use]
    pub fn new(plan: &Plan, layout: &Layout, results: &Results) -> Self {
        let definition = &plan.source.definition;
        let is_random = definition.method == Method::Random;
        let names = plan.entries.iter().map(|entry| entry.name.clone());
        let laws = names
            .zip(&results.entries)
            .map(|(name, entry)| law_report(name, layout, entry, &results.shown, is_random));
        Self {
            shown: results.shown.clone(),
            sweep: plan.source.identity(),
            method: definition.method,
            samples: plan.samples,
            confidence: CONFIDENCE,
            laws: laws.collect(),
            differences: differences(plan, results),
            winners: winners(plan, results),
            failures: results.failures.clone(),
            further_failures: results.further_failures,
        }
    }

    /// Returns the tables as Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let tables = self.tables();
        tables.iter().map(|table| table.markdown() + "\n").collect()
    }

    /// Returns all tables.
    #[must_use]
    pub fn tables(&self) -> Vec<TextTable> {
        self.tables_of(&self.shown, &self.failures)
    }

    /// Returns tables short enough for a terminal: for several laws only the result of the rank, the first failures, and no
    /// long table.
    #[must_use]
    pub fn brief_tables(&self) -> Vec<TextTable> {
        let shown = if self.laws.len() > 1 { 1 } else { self.shown.len() };
        let failures = self.failures.iter().take(BRIEF_FAILURES).map(Failed::shortened);
        let mut tables = self.tables_of(&self.shown[..shown], &failures.collect::<Vec<_>>());
        tables.retain(|table| table.lines.len() <= BRIEF_LINES.max(2 * self.laws.len()));
        tables
    }

    fn tables_of(&self, shown: &[Shown], failures: &[Failed]) -> Vec<TextTable> {
        let mut tables = vec![self.rates(), self.quantile_table(shown)];
        if !self.differences.is_empty() {
            tables.push(self.difference_table(shown));
        }
        if self.laws.len() > 1 && !self.winners.is_empty() {
            tables.push(self.winner_table());
        }
        if !failures.is_empty() {
            tables.push(self.failure_table(failures));
        }
        tables
    }

    fn quantile_table(&self, shown: &[Shown]) -> TextTable {
        let result_lines = |shown| self.laws.iter().filter_map(move |law| quantile_line(law, shown));
        let head = [
            "result", "law", "flights", "smallest", "5 %", "25 %", "median", "75 %", "95 %", "largest",
        ];
        TextTable::new("Results", &head, shown.iter().flat_map(result_lines))
    }

    fn rates(&self) -> TextTable {
        let percent = |value: Option<f64>| {
            value.map_or_else(|| "–".to_owned(), |value| format!("{:.2} %", 100.0 * value))
        };
        let range = |range: Option<[f64; 2]>| {
            range.map_or_else(
                || "–".to_owned(),
                |[low, high]| format!("{:.2} to {:.2} %", 100.0 * low, 100.0 * high),
            )
        };
        let lines = self.laws.iter().flat_map(|law| {
            law.criteria.iter().map(move |criterion| {
                vec![
                    law.name.clone(),
                    criterion.name.clone(),
                    format!("{} of {}", criterion.met, criterion.flown),
                    percent(criterion.rate),
                    range(criterion.wilson),
                    range(criterion.clopper_pearson),
                    percent(criterion.at_least),
                    law.refused.to_string(),
                ]
            })
        });
        let head = [
            "law",
            "criterion",
            "met",
            "share",
            "Wilson",
            "Clopper–Pearson",
            "at least",
            "refused",
        ];
        let title = format!("Criteria, with intervals of {:.0} %", 100.0 * self.confidence);
        TextTable::new(&title, &head, lines)
    }

    fn difference_table(&self, shown: &[Shown]) -> TextTable {
        let lines = self.differences.iter().filter_map(|difference| {
            let shown = shown.iter().find(|shown| shown.name == difference.name)?;
            let scaled = |value: f64| format!("{:+.3}", shown.factor * value);
            let missing = || "–".to_owned();
            Some(vec![
                difference.law.clone(),
                shown.title.clone(),
                if difference.pairs == difference.completed {
                    difference.pairs.to_string()
                } else {
                    format!("{} of {}", difference.pairs, difference.completed)
                },
                difference.median.map_or_else(missing, scaled),
                difference.interval.map_or_else(missing, |[low, high]| {
                    format!("{} to {}", scaled(low), scaled(high))
                }),
                format!("{} / {} / {}", difference.won, difference.lost, difference.tied),
                difference.sign_p.map_or_else(missing, probability),
                difference.wilcoxon_p.map_or_else(missing, probability),
                format!(
                    "{} / {}",
                    difference.only_law_failed, difference.only_reference_failed
                ),
                probability(difference.mcnemar_p),
            ])
        });
        let reference = self.laws.first().map_or("", |law| law.name.as_str());
        let head = [
            "law",
            "result",
            "pairs",
            "median difference",
            "interval",
            "smaller / larger / equal",
            "sign test, p",
            "Wilcoxon, p",
            "only this law / only the reference failed",
            "McNemar, p",
        ];
        let title = format!("Differences from `{reference}`, sample by sample");
        TextTable::new(&title, &head, lines)
    }

    fn winner_table(&self) -> TextTable {
        let rank = &self.shown[0];
        let mut head = ["varied value", "where", "best"].map(str::to_owned).to_vec();
        head.extend(self.laws.iter().map(|law| law.name.clone()));
        let lines = self.winners.iter().map(|winner| {
            let mut line = vec![
                with_unit(&winner.varied),
                parts::label(winner.range),
                winner.law.clone(),
            ];
            let medians = winner.medians.iter().zip(&winner.without);
            line.extend(medians.map(|(median, &without)| {
                let median = median.map(|value| format!("{:.2}", rank.factor * value));
                let median = median.unwrap_or_else(|| "–".to_owned());
                match without {
                    0 => median,
                    _ => format!("{median} ({without} without)"),
                }
            }));
            line
        });
        let title = format!(
            "Best law by varied value: fewest flights without a result, then smallest median of {}",
            rank.title
        );
        TextTable::new(&title, &head, lines)
    }

    fn failure_table(&self, failures: &[Failed]) -> TextTable {
        let lines = failures.iter().map(|failure| {
            vec![
                failure.sample.to_string(),
                failure.law.clone(),
                failure.seed.to_string(),
                failure.reason.clone(),
            ]
        });
        let further = match self.further_failures + (self.failures.len() - failures.len()) as u64 {
            0 => String::new(),
            count => format!(", and {count} more in results.parquet"),
        };
        let title = format!("Flights that did not meet a criterion{further}");
        TextTable::new(&title, &["sample", "law", "seed", "reason"], lines)
    }
}

/// Returns the name of a varied value, with its unit if it is a key that has one.
pub(crate) fn with_unit(name: &str) -> String {
    match unit_of_key(name) {
        Some(unit) => format!("{name}, {unit}"),
        None => name.to_owned(),
    }
}

/// Formats a number with few digits.
pub(crate) fn digits(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) {
        format!("{value:.2e}")
    } else {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}

fn law_report(
    name: String,
    layout: &Layout,
    entry: &EntryResults,
    shown: &[Shown],
    is_random: bool,
) -> LawReport {
    let [completed, lost, failed, refused] = entry.outcomes;
    let flown = completed + lost + failed;
    let criteria = layout.criteria().zip(&entry.criteria).map(|(name, flags)| {
        let met = flags
            .iter()
            .zip(&entry.is_flown)
            .filter(|(met, flown)| **met && **flown)
            .count() as u64;
        let known = is_random && flown > 0;
        CriterionReport {
            name: name.to_owned(),
            met,
            flown,
            #[expect(clippy::cast_precision_loss, reason = "few flights")]
            rate: (flown > 0).then(|| met as f64 / flown as f64),
            wilson: known.then(|| wilson(met, flown, CONFIDENCE)),
            clopper_pearson: known.then(|| clopper_pearson(met, flown, CONFIDENCE)),
            at_least: known.then(|| lower_bound(met, flown, CONFIDENCE)),
        }
    });
    let quantiles = shown.iter().zip(&entry.numbers).filter_map(|(shown, numbers)| {
        let numbers = sorted(numbers.iter().copied());
        (!numbers.is_empty()).then(|| QuantileReport {
            name: shown.name.clone(),
            count: numbers.len(),
            values: SHARES.map(|share| quantile(&numbers, share).unwrap_or(f64::NAN)),
        })
    });
    LawReport {
        name,
        completed,
        lost,
        failed,
        refused,
        criteria: criteria.collect(),
        quantiles: quantiles.collect(),
    }
}

fn quantile_line(law: &LawReport, shown: &Shown) -> Option<Vec<String>> {
    let found = law
        .quantiles
        .iter()
        .find(|quantiles| quantiles.name == shown.name)?;
    let mut line = vec![shown.title.clone(), law.name.clone(), found.count.to_string()];
    line.extend(found.values.map(|value| format!("{:.3}", shown.factor * value)));
    Some(line)
}

fn differences(plan: &Plan, results: &Results) -> Vec<Difference> {
    let seed = plan.source.definition.seed;
    let mut differences = Vec::new();
    let Some((reference, others)) = results.entries.split_first() else {
        return differences;
    };
    for (entry, other) in plan.entries[1..].iter().zip(others) {
        let survived = other.criteria[0].iter().zip(&reference.criteria[0]);
        let completed = survived.filter(|(one, other)| **one && **other).count();
        let [only_law_failed, only_reference_failed] = failed_alone(other, reference);
        for (index, shown) in results.shown.iter().enumerate() {
            let both = other.numbers[index]
                .iter()
                .copied()
                .zip(reference.numbers[index].iter().copied());
            let pairs: Vec<(f64, f64)> = both.filter(|(a, b)| a.is_finite() && b.is_finite()).collect();
            let paired = Paired::of(&pairs, seed);
            // The first result is listed even without a pair, for its comparison of losses.
            if paired.is_none() && index > 0 {
                continue;
            }
            let counts = paired
                .as_ref()
                .map_or([0; 3], |paired| [paired.won, paired.lost, paired.tied]);
            let [won, lost, tied] = counts;
            differences.push(Difference {
                law: entry.name.clone(),
                reference: plan.entries[0].name.clone(),
                name: shown.name.clone(),
                completed,
                pairs: pairs.len(),
                only_law_failed,
                only_reference_failed,
                mcnemar_p: sign_test::p_value(only_law_failed, only_reference_failed),
                median: paired.as_ref().map(|paired| paired.median),
                interval: paired.as_ref().map(|paired| paired.median_interval),
                mean: paired.as_ref().map(|paired| paired.mean),
                won,
                lost,
                tied,
                sign_p: paired.as_ref().map(|paired| paired.sign_p),
                wilcoxon_p: paired.as_ref().map(|paired| paired.signed_rank_p),
            });
        }
    }
    differences
}

/// Returns, of the samples that both flew, the numbers that only the first and only the second did not survive.
fn failed_alone(one: &EntryResults, other: &EntryResults) -> [u64; 2] {
    // `survived` is the first criterion.
    let [survived, other_survived] = [one, other].map(|entry| entry.criteria[0].iter());
    let is_flown = one.is_flown.iter().zip(&other.is_flown);
    let pairs = survived.zip(other_survived).zip(is_flown);
    let pairs = pairs.filter(|(_, (one, other))| **one && **other);
    pairs.fold([0, 0], |[first, second], ((&one, &other), _)| {
        [
            first + u64::from(!one && other),
            second + u64::from(one && !other),
        ]
    })
}

/// Formats a p-value, never as 0.
fn probability(p: f64) -> String {
    if p < f64::MIN_POSITIVE {
        "< 1e-300".to_owned()
    } else {
        format!("{p:.2e}")
    }
}

fn winners(plan: &Plan, results: &Results) -> Vec<Winner> {
    let mut winners = Vec::new();
    for (column, name) in plan.columns().enumerate() {
        let parts = Parts::new(results.varied(column), BINS);
        if parts.ranges().len() < 2 || !plan.is_drawn(column) {
            continue;
        }
        for (part, &range) in parts.ranges().iter().enumerate() {
            let is_in = |value: f64| !value.is_nan() && parts.index(value) == part;
            let medians = results
                .entries
                .iter()
                .map(|entry| entry.part_median(column, is_in));
            let (medians, without): (Vec<_>, Vec<_>) = medians.unzip();
            let rank = |index: usize| Some((without[index], medians[index]?));
            let ranks = (0..medians.len()).filter_map(rank);
            let best = ranks.min_by(|(few, a), (many, b)| few.cmp(many).then(a.total_cmp(b)));
            let Some(best) = best else {
                // No flight in this bin was completed.
                continue;
            };
            let best = (0..medians.len()).filter(|&index| rank(index) == Some(best));
            let names: Vec<_> = best.map(|index| plan.entries[index].name.as_str()).collect();
            winners.push(Winner {
                varied: name.to_owned(),
                range,
                law: names.join(", "),
                medians,
                without,
            });
        }
    }
    winners
}

impl Display for Report {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        for table in self.brief_tables() {
            writeln!(formatter, "{table}\n")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pairs_that_both_flew_count_as_lost_by_one_alone() {
        let entry = |survived: &[bool], is_flown: &[bool]| EntryResults {
            criteria: vec![survived.to_vec()],
            is_flown: is_flown.to_vec(),
            ..EntryResults::default()
        };
        let one = entry(
            &[true, false, false, true, false, true],
            &[true, true, true, true, true, true],
        );
        let other = entry(
            &[true, true, true, false, false, false],
            &[true, true, true, true, true, false],
        );
        assert_eq!(failed_alone(&one, &other), [2, 1]);
        assert_eq!(failed_alone(&other, &one), [1, 2]);
    }
}
