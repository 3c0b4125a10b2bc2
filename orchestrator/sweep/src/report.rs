//! What can be said of a sweep: pass rates with intervals, quantiles, and paired differences.

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
use crate::row::{Cell, Kind, Layout, Row};

/// Confidence of all intervals.
pub const CONFIDENCE: f64 = 0.95;

/// Parts into which a varied value is divided to see who wins where.
const BINS: usize = 4;

/// Most failures that are listed.
const LISTED: usize = 20;

/// Most failures in the brief tables, and characters of their reasons.
const BRIEF_FAILURES: usize = 5;
const BRIEF_REASON: usize = 60;

/// Most lines of a brief table.
const BRIEF_LINES: usize = 20;

/// A result whose quantiles and differences are shown.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Its column.
    pub name: String,
    /// Its title with the unit.
    pub title: String,
    /// The unit, of the column's.
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

    /// Returns what is shown of a sweep: first what its entries are ranked by, last what maps show besides.
    fn of(definition: &Definition) -> Vec<Self> {
        let rank = definition.rank.as_str();
        let known = [
            ("steady_rmse", "RMS distance in steady state, cm"),
            ("rmse", "RMS distance in all of the flight, cm"),
            ("steady_p95", "95 % of the distances in steady state, cm"),
            ("transient_max", "largest distance in the transient, cm"),
            ("max", "largest distance, cm"),
            ("ultimate", "largest of the last 5 s, cm"),
            ("settling_time", "settling time of the last phase, s"),
            ("steady_body_rate_rms", "body rates in steady state, rad/s"),
            ("energy", "energy of a hover"),
        ];
        let shown = |name: &str| match known.iter().find(|(known, _)| *known == name) {
            Some((_, title)) => Self::new(name, title),
            None if is_distance(name) => Self::new(name, &format!("{name}, cm")),
            None => Self::new(name, name),
        };
        let of_map = definition.map.iter().map(|map| map.value.as_str());
        // Those of all of the flight only if they are asked for.
        let names = std::iter::once(rank)
            .chain(known[2..].iter().map(|(name, _)| *name))
            .chain(of_map);
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
    let of_phase = || {
        name.strip_prefix("phase")?
            .split_once('_')
            .map(|(_, result)| result)
    };
    let result = result.or_else(of_phase).unwrap_or(name);
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

/// The results that the report is made of, column by column: memory for a few numbers a row.
#[derive(Clone, Debug)]
pub struct Results {
    /// By entry: flags by criterion, and numbers by shown result.
    pub entries: Vec<EntryResults>,
    /// Flights that were refused.
    pub refused: u64,
    /// What is shown; the first is what entries are ranked by.
    pub shown: Vec<Shown>,
    /// Places of the columns.
    places: Places,
    /// Failures that are listed.
    failures: Vec<Failed>,
    further_failures: u64,
}

/// Results of an entry, sample by sample.
#[derive(Clone, Debug, Default)]
pub struct EntryResults {
    /// Flights by their end: completed, lost, failed, refused.
    pub outcomes: [u64; 4],
    /// By column of the plan, the varied number of each sample; none of a key that the entry states itself, or that has
    /// no numbers.
    pub varied: Vec<Vec<f64>>,
    /// `true` for each sample that was flown.
    pub is_flown: Vec<bool>,
    /// By criterion, whether each sample meets it.
    pub criteria: Vec<Vec<bool>>,
    /// By shown result, its value; NaN of a flight that was not completed.
    pub numbers: Vec<Vec<f64>>,
}

impl EntryResults {
    /// Returns the median of the first result in a part of a varied value, and the number of flights without a result there.
    fn of_part(&self, column: usize, is_in: impl Fn(f64) -> bool) -> (Option<f64>, usize) {
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

#[derive(Clone, Debug)]
struct Places {
    /// By entry, the columns of its varied numbers, each with its place among the varied.
    varied: Vec<Vec<(usize, usize)>>,
    outcome: usize,
    reason: usize,
    criteria: Vec<usize>,
    numbers: Vec<usize>,
}

/// A flight that did not meet a criterion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failed {
    /// The sample.
    pub sample: u64,
    /// The entry.
    pub law: String,
    /// The flight's seed.
    pub seed: u64,
    /// How it ended, and why.
    pub reason: String,
}

impl Failed {
    /// Returns it with no more of its reason than fits beside the rest.
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

/// Names of the outcomes, in the order of [`EntryResults::outcomes`].
const OUTCOMES: [&str; 4] = ["completed", "lost", "failed", "refused"];

impl Results {
    /// Makes results of no row.
    ///
    /// # Panics
    /// Never: every layout has these columns.
    #[must_use]
    pub fn new(plan: &Plan, layout: &Layout) -> Self {
        let place = |name: &str| layout.place(name).expect("every layout has this column");
        let shown = Shown::of(&plan.source.definition);
        let columns: Vec<_> = plan.columns().zip(&layout.columns[3..]).collect();
        let varied_of = |entry: &Entry| {
            let columns = columns.iter().enumerate();
            let own = columns
                .filter(|(_, (name, column))| column.kind == Kind::Number && entry.stated(name).is_none());
            own.map(|(place, _)| (place, 3 + place)).collect()
        };
        let places = Places {
            varied: plan.entries.iter().map(varied_of).collect(),
            outcome: place("outcome"),
            reason: place("reason"),
            criteria: layout.criteria().map(place).collect(),
            numbers: shown.iter().map(|shown| place(&shown.name)).collect(),
        };
        let entry = EntryResults {
            varied: vec![Vec::new(); columns.len()],
            criteria: vec![Vec::new(); places.criteria.len()],
            numbers: vec![Vec::new(); shown.len()],
            ..EntryResults::default()
        };
        Self {
            entries: vec![entry; plan.entries.len()],
            refused: 0,
            shown,
            places,
            failures: Vec::new(),
            further_failures: 0,
        }
    }

    /// Takes a row; rows come in the order of samples and entries.
    pub fn take(&mut self, row: &Row) {
        let counts = self.entries.iter().map(|entry| entry.is_flown.len());
        let place = counts
            .enumerate()
            .min_by_key(|(_, count)| *count)
            .map_or(0, |(place, _)| place);
        let places = &self.places;
        let outcome = OUTCOMES
            .iter()
            .position(|name| row[places.outcome] == Cell::Text((*name).to_owned()));
        let outcome = outcome.unwrap_or(2);
        self.refused += u64::from(outcome == 3);
        let entry = &mut self.entries[place];
        for &(varied, column) in &places.varied[place] {
            entry.varied[varied].push(row[column].number());
        }
        entry.outcomes[outcome] += 1;
        entry.is_flown.push(outcome != 3);
        for (flags, &place) in entry.criteria.iter_mut().zip(&places.criteria) {
            flags.push(row[place] == Cell::Flag(true));
        }
        for (numbers, &place) in entry.numbers.iter_mut().zip(&places.numbers) {
            numbers.push(if outcome == 0 {
                row[place].number()
            } else {
                f64::NAN
            });
        }
        let meets = places
            .criteria
            .iter()
            .all(|&place| row[place] == Cell::Flag(true));
        if outcome != 3 && !meets {
            self.list_failure(row);
        }
    }

    /// Returns the varied numbers of a column, of each sample; none if it has no numbers, or if every entry states its own.
    #[must_use]
    pub fn varied(&self, column: usize) -> &[f64] {
        let of_entries = self.entries.iter().map(|entry| entry.varied[column].as_slice());
        of_entries.max_by_key(|values| values.len()).unwrap_or_default()
    }

    fn list_failure(&mut self, row: &Row) {
        if self.failures.len() == LISTED {
            self.further_failures += 1;
            return;
        }
        let text = |place: usize| {
            if let Cell::Text(text) = &row[place] {
                text.clone()
            } else {
                String::new()
            }
        };
        let whole = |place: usize| {
            if let Cell::Integer(number) = row[place] {
                number
            } else {
                0
            }
        };
        let reason = match text(self.places.reason) {
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

/// The content of `sweep.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// What is shown.
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
    /// Who has the smallest median of what entries are ranked by in which part of a varied value.
    pub winners: Vec<Winner>,
    /// Flights that did not meet a criterion, the first of them.
    pub failures: Vec<Failed>,
    /// Number of failures that are not listed.
    pub further_failures: u64,
}

/// What came of an entry.
#[derive(Clone, Debug, Serialize)]
pub struct LawReport {
    /// Its name.
    pub name: String,
    /// Flights that were completed.
    pub completed: u64,
    /// Flights in which the vehicle was lost.
    pub lost: u64,
    /// Flights that failed for another reason.
    pub failed: u64,
    /// Flights that were refused: they count nowhere else.
    pub refused: u64,
    /// The criteria.
    pub criteria: Vec<CriterionReport>,
    /// Quantiles of results, over the flights that were completed.
    pub quantiles: Vec<QuantileReport>,
}

impl LawReport {
    /// Returns the number of flights that were flown.
    #[must_use]
    pub fn flown(&self) -> u64 {
        self.completed + self.lost + self.failed
    }
}

/// How many flights meet a criterion.
#[derive(Clone, Debug, Serialize)]
pub struct CriterionReport {
    /// Its name.
    pub name: String,
    /// Flights that meet it, and that were flown.
    pub met: u64,
    /// Flights that were flown.
    pub flown: u64,
    /// Their share; none if nothing was flown.
    pub rate: Option<f64>,
    /// Interval of Wilson; only of independent samples.
    pub wilson: Option<[f64; 2]>,
    /// Exact interval of Clopper and Pearson; only of independent samples.
    pub clopper_pearson: Option<[f64; 2]>,
    /// One-sided exact lower bound; only of independent samples.
    pub at_least: Option<f64>,
}

/// Quantiles of a result.
#[derive(Clone, Debug, Serialize)]
pub struct QuantileReport {
    /// Its column.
    pub name: String,
    /// Flights that have it.
    pub count: usize,
    /// 0, 5, 25, 50, 75, 95 and 100 %, in the column's unit.
    pub values: [f64; 7],
}

/// Shares of [`QuantileReport::values`].
const SHARES: [f64; 7] = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0];

/// Difference of an entry from the first: negative where it is smaller.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// The entry.
    pub law: String,
    /// The first one.
    pub reference: String,
    /// The result.
    pub name: String,
    /// Samples that both completed.
    pub completed: usize,
    /// Those of them of which both have the result: a flight that does not settle has no settling time.
    pub pairs: usize,
    /// Samples that the entry lost and the reference did not.
    pub only_law_failed: u64,
    /// Samples that the reference lost and the entry did not.
    pub only_reference_failed: u64,
    /// p of McNemar's exact test of these two numbers, two-sided.
    pub mcnemar_p: f64,
    /// Median of the differences, in the column's unit; none without a pair, as all that follows.
    pub median: Option<f64>,
    /// Bootstrap interval of the median.
    pub interval: Option<[f64; 2]>,
    /// Mean of the differences.
    pub mean: Option<f64>,
    /// Samples in which the entry is smaller, larger, equal.
    pub won: u64,
    /// The same, larger.
    pub lost: u64,
    /// The same, equal.
    pub tied: u64,
    /// p of the exact sign test, two-sided.
    pub sign_p: Option<f64>,
    /// p of Wilcoxon's signed-rank test, two-sided.
    pub wilcoxon_p: Option<f64>,
}

/// The best entries in a part of a varied value.
#[derive(Clone, Debug, Serialize)]
pub struct Winner {
    /// The varied value.
    pub varied: String,
    /// From and to.
    pub range: [f64; 2],
    /// By entry, the median, in the column's unit; none if nothing was completed.
    pub medians: Vec<Option<f64>>,
    /// By entry, the flights without the result: lost ones, and those that do not have it.
    pub without: Vec<usize>,
    /// Name of the entry with the fewest flights without the result and, among those, the smallest median; several names
    /// if they are equal.
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

    /// Returns the tables that a person reads at once: of several laws the result by which they are ranked, the first
    /// failures, and no table that is too long.
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
        let of_result = |shown| self.laws.iter().filter_map(move |law| quantile_line(law, shown));
        let head = [
            "result", "law", "flights", "least", "5 %", "25 %", "median", "75 %", "95 %", "largest",
        ];
        TextTable::new("Results", &head, shown.iter().flat_map(of_result))
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
            "only it / only the reference failed",
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
            "Who is best where: fewest flights without a result, then the median of {}",
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

/// The name of a varied value with its unit, if it is a key that has one.
pub(crate) fn with_unit(name: &str) -> String {
    match unit_of_key(name) {
        Some(unit) => format!("{name}, {unit}"),
        None => name.to_owned(),
    }
}

/// A number with as many digits as a person reads.
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
            // Losses are compared even if one of both never flew to the end: beside the first result.
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

/// Returns the number of samples in which the first alone did not survive, and in which the second alone did not, of
/// those that both flew.
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

/// Returns a p-value, none of which is 0.
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
        let parts = Parts::of(results.varied(column), BINS);
        if parts.ranges().len() < 2 || !plan.is_drawn(column) {
            continue;
        }
        for (part, &range) in parts.ranges().iter().enumerate() {
            let is_in = |value: f64| !value.is_nan() && parts.place(value) == part;
            let of_entries = results.entries.iter().map(|entry| entry.of_part(column, is_in));
            let (medians, without): (Vec<_>, Vec<_>) = of_entries.unzip();
            let rank = |place: usize| Some((without[place], medians[place]?));
            let ranks = (0..medians.len()).filter_map(rank);
            let best = ranks.min_by(|(few, a), (many, b)| few.cmp(many).then(a.total_cmp(b)));
            let Some(best) = best else {
                // No flight with such a value was completed.
                continue;
            };
            let best = (0..medians.len()).filter(|&place| rank(place) == Some(best));
            let names: Vec<_> = best.map(|place| plan.entries[place].name.as_str()).collect();
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
