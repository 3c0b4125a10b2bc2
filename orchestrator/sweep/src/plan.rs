//! Samples of a sweep. Sample i is a function of the sweep and of i alone.

use std::collections::BTreeMap;
use std::ops::Range;

use ::flight::interrupt::Interrupt;
use ::flight::many;
use scenario::{Key, LawKind, Problem, Scenario};
use scenario_file::warnings::inertia_warnings;
use scenario_file::{ReadFile, ScenarioError, files_of, gain_rules};
use statistics::design::{Design, sample_seed};
use toml::Value;

use crate::definition::{Definition, Entry, Method, Source, Vary};
use crate::error::SweepError;
use crate::expression::Expression;

/// Maximum number of samples of a sweep in which a law without a flyable one is refused.
const TRIED: u64 = 10_000;

/// A sweep that is ready to be flown.
#[derive(Debug)]
pub struct Plan {
    /// Definition and texts.
    pub source: Source,
    /// Entries that fly every sample.
    pub entries: Vec<Entry>,
    /// Number of samples.
    pub samples: u64,
    design: Design,
    /// Numbers and choices of a sample, in the order in which they are computed.
    parts: Vec<Part>,
    /// Varied values with the indices of their parts.
    varied: Vec<Varied>,
    requirements: Vec<Expression>,
    phases: usize,
    /// `true` if a law commands torque, or a vehicle takes it: its inertia has an effect then.
    turns_by_torque: bool,
    /// SHA-256 of every file that flights read, by its purpose and law.
    files: BTreeMap<String, String>,
}

/// A varied value.
#[derive(Clone, Debug)]
pub struct Varied {
    /// Key of the scenario, or name in expressions.
    pub name: String,
    /// Indices of its parts: one, or those of an array.
    pub parts: Vec<usize>,
    /// `true` if it is an array.
    is_array: bool,
}

/// A number or a choice of a sample.
#[derive(Clone, Debug)]
struct Part {
    /// Name of the column.
    column: String,
    origin: Origin,
}

#[derive(Clone, Debug)]
enum Origin {
    /// A distribution, its number of levels, and a coordinate of the design's point.
    Draw(statistics::distribution::Distribution, u32, usize),
    Choice(Vec<Value>, usize),
    Expression(Expression),
}

/// A sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Index of the sample.
    pub index: u64,
    /// Seed of its flights.
    pub seed: u64,
    /// Values of its parts, in the order of the columns.
    pub values: Vec<Value>,
    /// Settings of the varied keys.
    pub settings: Vec<String>,
    /// The first requirement that it does not meet.
    pub unmet: Option<String>,
}

impl Plan {
    /// Makes the plan of a sweep.
    ///
    /// # Errors
    /// [`SweepError`] with the reason and the fix.
    pub fn new(source: Source) -> Result<Self, SweepError> {
        let definition = &source.definition;
        let (parts, varied) = parts(definition).map_err(SweepError::bad_input)?;
        let names = |name: &str| {
            let matches = |varied: &&Varied| varied.name == name && !varied.is_array;
            varied.iter().find(matches).map(|varied| varied.parts[0])
        };
        let requirement = |text: &String| Expression::parse(text, names);
        let requirements: Result<Vec<_>, _> = definition.require.iter().map(requirement).collect();
        let requirements =
            requirements.map_err(|error| SweepError::bad_input(format!("`require`: {error}")))?;
        check_uses(definition, &parts, &varied, &requirements).map_err(SweepError::bad_input)?;
        check_settings(definition, &varied).map_err(SweepError::bad_input)?;
        let (design, samples) = design(definition, &parts)?;
        let mut plan = Self {
            phases: 1,
            turns_by_torque: false,
            files: BTreeMap::new(),
            entries: definition.entries(),
            samples,
            design,
            parts,
            varied,
            requirements,
            source,
        };
        // The unchanged scenario must be flyable with every entry's settings and have all varied keys.
        let mut laws = Vec::new();
        for entry in &plan.entries {
            let settings = [plan.source.definition.set.as_slice(), entry.set.as_slice()].concat();
            let (path, text) = (&plan.source.scenario_path, &plan.source.scenario_text);
            let scenario = scenario_file::load_from(path, text, &settings, Some(1));
            let scenario = scenario.map_err(|error| error.with_settings_named(&settings_name(entry)))?;
            laws.push(scenario.controller.law);
            plan.turns_by_torque |=
                scenario.vehicle.actuators.is_none() || scenario.controller.rates.is_none();
            plan.phases = plan.phases.max(1 + scenario.vehicle.change.len());
            if let Some(index) = (0..plan.samples).next()
                && let Err(error) = plan.scenario(&plan.sample(index), entry)
                && !error.is_of_values()
            {
                return Err(error.into());
            }
        }
        plan.check_gains(&laws).map_err(SweepError::bad_input)?;
        plan.files = plan.read_files()?;
        Ok(plan)
    }

    /// Refuses to vary a gain that no law uses.
    fn check_gains(&self, laws: &[LawKind]) -> Result<(), String> {
        let is_law = |varied: &Varied| varied.name == "controller.law";
        if self.varied.iter().any(is_law) {
            return Ok(());
        }
        for Varied { name, .. } in &self.varied {
            let setting = format!("{name}=0");
            if !laws.iter().any(|&law| scenario_file::concerns(&setting, law)) {
                return Err(format!(
                    "`vary.\"{name}\"`: no law of the sweep uses it: it has no effect"
                ));
            }
        }
        Ok(())
    }

    /// Returns the number of phases of a flight: the scenario changes the vehicle between them.
    #[must_use]
    pub fn phases(&self) -> usize {
        self.phases
    }

    /// Returns the names of the columns of the varied values, in their order.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().map(|part| part.column.as_str())
    }

    /// Returns whether every value of a column is a number.
    #[must_use]
    pub fn is_number(&self, column: usize) -> bool {
        match &self.parts[column].origin {
            Origin::Draw(..) | Origin::Expression(_) => true,
            Origin::Choice(values, _) => values.iter().all(|value| value.is_float() || value.is_integer()),
        }
    }

    /// Returns whether a column is drawn or chosen: neither an expression nor a counter of repetitions.
    #[must_use]
    pub fn is_drawn(&self, column: usize) -> bool {
        let part = &self.parts[column];
        !matches!(part.origin, Origin::Expression(_)) && !is_counter(&self.source.definition, &part.column)
    }

    /// Returns a sample.
    #[must_use]
    pub fn sample(&self, index: u64) -> Sample {
        let definition = &self.source.definition;
        let (point, levels) = (self.design.point(index), self.design.levels(index));
        let mut numbers = Vec::with_capacity(self.parts.len());
        let mut values = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let value = match &part.origin {
                Origin::Draw(distribution, count, dimension) => Value::Float(match &levels {
                    Some(levels) => distribution.level(levels[*dimension], *count),
                    None => distribution.at(point[*dimension]),
                }),
                Origin::Choice(choices, dimension) => {
                    choices[choice(choices.len(), levels.as_deref(), &point, *dimension)].clone()
                }
                Origin::Expression(expression) => Value::Float(expression.value(&numbers)),
            };
            numbers.push(number_of(&value));
            values.push(value);
        }
        let requirements = self.requirements.iter().zip(&definition.require);
        let mut unmet = requirements.filter(|(requirement, _)| !requirement.is_true(&numbers));
        Sample {
            index,
            seed: sample_seed(definition.seed, index),
            settings: self.settings(&values),
            unmet: unmet.next().map(|(_, text)| text.clone()),
            values,
        }
    }

    /// Returns the settings of the varied keys.
    fn settings(&self, values: &[Value]) -> Vec<String> {
        let keys = self.varied.iter().filter(|varied| varied.is_key());
        let setting = |varied: &Varied| {
            let parts: Vec<_> = varied
                .parts
                .iter()
                .map(|&part| values[part].to_string())
                .collect();
            if varied.is_array {
                format!("{}=[{}]", varied.name, parts.join(", "))
            } else {
                format!("{}={}", varied.name, parts[0])
            }
        };
        keys.map(setting).collect()
    }

    /// Returns the SHA-256 of every file that flights read, by its purpose and law.
    #[must_use]
    pub fn files(&self) -> &BTreeMap<String, String> {
        &self.files
    }

    /// Refuses a flight that would read a file that changed since the start.
    ///
    /// # Errors
    /// [`SweepError`] with the file.
    pub fn check_files(&self, scenario: &Scenario, entry: &Entry) -> Result<(), SweepError> {
        let is_known = |what: &str, sha256: &str| {
            let known = self.files.get(&format!("{what} of `{}`", entry.name));
            known.is_some_and(|known| known.contains(sha256))
        };
        match files_of(scenario).find(|file| !is_known(&file.what, file.sha256)) {
            None => Ok(()),
            Some(ReadFile { what, .. }) => Err(SweepError::bad_input(format!(
                "{what} of `{}` was changed since the sweep began: its rows would mix two experiments; the rows so far belong \
                 to the first one",
                entry.name
            ))),
        }
    }

    fn read_files(&self) -> Result<BTreeMap<String, String>, ScenarioError> {
        let mut files = BTreeMap::new();
        let chooses_file = |varied: &Varied| {
            let is_plugin =
                varied.name.starts_with("plugins.") && !varied.name.starts_with("plugins.parameters");
            is_plugin || FILES_OF_PATH.contains(&varied.name.as_str())
        };
        let samples = if self.varied.iter().any(chooses_file) {
            self.samples
        } else {
            0
        };
        for entry in &self.entries {
            let stated = [self.source.definition.set.as_slice(), entry.set.as_slice()].concat();
            let mut add_files = |scenario: &Scenario| {
                for ReadFile { what, sha256, .. } in files_of(scenario) {
                    files
                        .entry(format!("{what} of `{}`", entry.name))
                        .and_modify(|known: &mut String| {
                            if !known.contains(sha256) {
                                known.push_str(sha256);
                            }
                        })
                        .or_insert_with(|| sha256.clone());
                }
            };
            add_files(&self.load(&stated, 1)?);
            for index in 0..samples {
                // A refused sample reads no file.
                if let Ok(scenario) = self.scenario(&self.sample(index), entry) {
                    add_files(&scenario);
                }
            }
        }
        Ok(files)
    }

    /// Checks the scenarios of samples before the first flight. Returns the number of refused flights, whose values cannot be
    /// flown or do not meet a requirement, and the reason of the first one.
    ///
    /// # Errors
    /// [`SweepError`] of the first scenario with a wrong key, type or file, or of the first sample of a law with which no
    /// sample of the sweep can be flown.
    pub fn check_flyable(
        &self,
        samples: Range<u64>,
        interrupt: &Interrupt,
    ) -> Result<(u64, Option<String>), SweepError> {
        let (mut all_refused, mut first) = (0, None);
        for entry in &self.entries {
            let (mut checked, mut refused, mut reason) = (0, 0, None);
            let check = |index| {
                let goes_on = interrupt.signal().is_none();
                goes_on.then(|| self.refusal(&self.sample(index), entry))
            };
            many::for_each(samples.clone(), many::cores(), check, |refusal| {
                if let Some(found) = refusal? {
                    refused += 1;
                    reason.get_or_insert_with(|| format!("sample {}: {found}", samples.start + checked));
                }
                checked += 1;
                Ok::<_, ScenarioError>(())
            })?;
            let may_fly = |index| matches!(self.refusal(&self.sample(index), entry), Ok(None));
            let are_all = refused > 0 && refused == samples.end - samples.start;
            if are_all && self.samples <= TRIED && !(0..self.samples).any(may_fly) {
                return Err(SweepError::bad_input(format!(
                    "none of the {} samples can be flown with `{}`; {}",
                    self.samples,
                    entry.name,
                    reason.unwrap_or_default()
                )));
            }
            all_refused += refused;
            first = first.or(reason.map(|reason| format!("`{}`, {reason}", entry.name)));
        }
        Ok((all_refused, first))
    }

    /// Returns why a sample is refused with an entry, if its values cannot be flown or do not meet a requirement.
    fn refusal(&self, sample: &Sample, entry: &Entry) -> Result<Option<String>, ScenarioError> {
        if let Some(unmet) = &sample.unmet {
            return Ok(Some(format!("it does not meet `{unmet}`")));
        }
        match self.scenario(sample, entry) {
            Ok(_) => Ok(None),
            Err(error) if error.is_of_values() => Ok(Some(error.without_positions())),
            Err(error) => Err(error),
        }
    }

    /// Returns all settings of a sample's flight with an entry.
    #[must_use]
    pub fn settings_of(&self, sample: &Sample, entry: &Entry) -> Vec<String> {
        let parts = [
            self.source.definition.set.as_slice(),
            sample.settings.as_slice(),
            entry.set.as_slice(),
        ];
        parts.concat()
    }

    /// Returns the scenario of a sample's flight with an entry.
    ///
    /// # Errors
    /// [`ScenarioError`] if the scenario cannot be flown.
    pub fn scenario(&self, sample: &Sample, entry: &Entry) -> Result<Scenario, ScenarioError> {
        let scenario = self.load(&self.settings_of(sample, entry), sample.seed);
        scenario.map_err(|error| error.with_settings_named(&settings_name(entry)))
    }

    /// Returns the first varied inertia where every vehicle follows body rates: its torque is not modelled, so it has no effect.
    #[must_use]
    pub fn idle_inertia(&self) -> Option<&str> {
        let names = self.varied.iter().map(|varied| varied.name.as_str());
        let mut inertias = names.filter(|name| name.starts_with("vehicle.") && name.contains(".inertia"));
        inertias.next().filter(|_| !self.turns_by_torque)
    }

    /// Returns the first warning about the first sample with an entry: an inertia in another unit, or a broken rule of tuning.
    #[must_use]
    pub fn warning(&self, entry: &Entry) -> Option<Problem> {
        let scenario = self.scenario(&self.sample(0), entry).ok()?;
        let rules = gain_rules::warnings(&scenario);
        inertia_warnings(&scenario).chain(rules).next()
    }

    fn load(&self, settings: &[String], seed: u64) -> Result<Scenario, ScenarioError> {
        let Source {
            scenario_path,
            scenario_text,
            ..
        } = &self.source;
        scenario_file::load_drawn(scenario_path, scenario_text, settings, Some(seed))
    }
}

impl Varied {
    /// Returns whether this is a key of the scenario, not only a name in expressions.
    fn is_key(&self) -> bool {
        self.name.contains('.') || self.name == "duration"
    }
}

/// Keys that select the file of a path.
const FILES_OF_PATH: [&str; 2] = ["path.curve", "path.curve.waypoints.file"];

/// Name of the counter of repetitions in a cell of a grid, which needs no use.
const REPETITION: &str = "flight";

/// Returns where the settings of a law's flights stand, for messages.
fn settings_name(entry: &Entry) -> String {
    format!("settings of the sweep with `{}`", entry.name)
}

/// Owner of the settings for all laws, in messages.
const THE_SWEEP: &str = "the sweep";

/// Parts of a scenario that define the measurement.
const MEASURE: [&str; 2] = ["judge", "duration"];

/// Refuses settings of the sweep or of a law with which the table would state other values than were flown.
///
/// Varied values override the sweep's settings: a setting may state the array of a varied element, but not a varied key or a
/// part of one. A law's settings override varied values: its rows state the setting, if the key is the same.
fn check_settings(definition: &Definition, varied: &[Varied]) -> Result<(), String> {
    let entries = definition.compare.iter();
    let entry_settings =
        entries.flat_map(|entry| entry.set.iter().map(|setting| (entry.name.as_str(), setting)));
    let sweep_settings = definition.set.iter().map(|setting| (THE_SWEEP, setting));
    for (owner, setting) in sweep_settings.chain(entry_settings) {
        let Some(key) = scenario_file::key_of_setting(setting) else {
            continue;
        };
        if key.segments() == ["seed"] {
            return Err(format!(
                "`set` of {owner} states `seed`, but every sample draws its own; change the `seed` of the sweep instead"
            ));
        }
        if owner != THE_SWEEP && MEASURE.contains(&key.segments()[0].as_str()) {
            return Err(format!(
                "`set` of {owner} states `{key}`, but the measurement is the same for all laws: state it in the sweep's `set`"
            ));
        }
        let is_refused = |varied_key: Key| {
            let is_overridden = if owner == THE_SWEEP {
                varied_key.segments().len() <= key.segments().len()
            } else {
                varied_key != key
            };
            varied_key.overlaps(&key) && is_overridden
        };
        let overlaps = |varied: &&Varied| {
            varied.is_key() && scenario_file::path_of(&varied.name).is_some_and(is_refused)
        };
        if let Some(Varied { name, .. }) = varied.iter().find(overlaps) {
            return Err(format!(
                "`set` of {owner} states `{key}`, and `vary` states `{name}`: remove one of them"
            ));
        }
    }
    let keys = varied.iter().filter(|varied| varied.is_key());
    let keys: Vec<_> = keys
        .filter_map(|varied| Some((&varied.name, scenario_file::path_of(&varied.name)?)))
        .collect();
    for (index, (name, key)) in keys.iter().enumerate() {
        if let Some((other, _)) = keys[..index].iter().find(|(_, other)| other.overlaps(key)) {
            return Err(format!(
                "`vary` states both `{other}` and `{name}`, of which one overrides the other: remove one of them"
            ));
        }
    }
    Ok(())
}

/// Returns whether a name is the counter of repetitions in a cell of a grid, which differ only in their seeds.
fn is_counter(definition: &Definition, name: &str) -> bool {
    name == REPETITION && definition.method == Method::Grid
}

/// Refuses a user-defined name that is not used: varying it would have no effect.
fn check_uses(
    definition: &Definition,
    parts: &[Part],
    varied: &[Varied],
    requirements: &[Expression],
) -> Result<(), String> {
    let in_parts = parts.iter().filter_map(|part| match &part.origin {
        Origin::Expression(expression) => Some(expression.indices()),
        _ => None,
    });
    let used: Vec<usize> = in_parts
        .chain(requirements.iter().map(Expression::indices))
        .flatten()
        .collect();
    // Criteria may use varied names as well.
    let is_in_criteria = |name: &str| {
        definition.judge.values().any(|text| {
            let mut words = text.split(|letter: char| !letter.is_alphanumeric() && letter != '_');
            words.any(|word| word == name)
        })
    };
    let is_unused = |varied: &&Varied| {
        !varied.is_key()
            && !is_counter(definition, &varied.name)
            && !varied.parts.iter().any(|part| used.contains(part))
            && !is_in_criteria(&varied.name)
    };
    let Some(Varied { name, .. }) = varied.iter().find(is_unused) else {
        return Ok(());
    };
    let keys = scenario_file::keys_for_completion()
        .into_iter()
        .map(|(key, _)| key);
    let similar = keys.filter(|key| key.split_once('.').is_some_and(|(_, last)| last == name));
    let meant: Vec<_> = similar.map(|key| format!("\"{key}\"")).collect();
    let fix = match meant.is_empty() {
        true => "use it in an expression, or remove it".to_owned(),
        false => format!("did you mean {}?", meant.join(" or ")),
    };
    Err(format!(
        "`vary.{name}`: no key of the scenario and no expression uses it: it has no effect; {fix}"
    ))
}

fn number_of(value: &Value) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "choices of whole numbers are small")]
    match value {
        Value::Float(number) => *number,
        Value::Integer(number) => *number as f64,
        _ => f64::NAN,
    }
}

fn choice(count: usize, levels: Option<&[u32]>, point: &[f64], dimension: usize) -> usize {
    let index = match levels {
        Some(levels) => levels[dimension] as usize,
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a coordinate in [0, 1) times a small count"
        )]
        None => (point[dimension] * count as f64) as usize,
    };
    index.min(count - 1)
}

/// Returns the parts of the varied values, with expressions after their operands.
fn parts(definition: &Definition) -> Result<(Vec<Part>, Vec<Varied>), String> {
    let mut parts = Vec::new();
    let mut varied = Vec::new();
    let mut expressions = Vec::new();
    let mut dimension = 0;
    for (name, vary) in definition.varied()? {
        let (elements, is_array) = match vary {
            Vary::Array(elements) => (elements, true),
            vary => (vec![vary], false),
        };
        let mut indices = Vec::new();
        for (index, element) in elements.into_iter().enumerate() {
            let column = if is_array {
                format!("{name}.{index}")
            } else {
                name.clone()
            };
            let origin = match element {
                Vary::Draw(distribution, levels) => Some(Origin::Draw(distribution, levels, dimension)),
                Vary::Choice(values) => Some(Origin::Choice(values, dimension)),
                Vary::Array(_) => {
                    return Err(format!(
                        "`vary.\"{name}\"`: an array within an array cannot be varied"
                    ));
                }
                Vary::Expression(text) => {
                    expressions.push((varied.len(), index, column.clone(), text));
                    None
                }
            };
            if let Some(origin) = origin {
                dimension += 1;
                indices.push(parts.len());
                parts.push(Part { column, origin });
            } else {
                indices.push(usize::MAX);
            }
        }
        varied.push(Varied {
            name,
            parts: indices,
            is_array,
        });
    }
    append_expressions(&mut parts, &mut varied, expressions)?;
    Ok((parts, varied))
}

/// Appends the expressions, each after its operands.
fn append_expressions(
    parts: &mut Vec<Part>,
    varied: &mut [Varied],
    mut waiting: Vec<(usize, usize, String, String)>,
) -> Result<(), String> {
    while !waiting.is_empty() {
        let mut later = Vec::new();
        let mut refusal = String::new();
        let before = waiting.len();
        for (name, index, column, text) in waiting {
            let known = |other: &str| {
                let matches = |varied: &&Varied| varied.name == other && !varied.is_array;
                varied.iter().find(matches).map(|varied| varied.parts[0])
            };
            let expression =
                Expression::parse(&text, known).map_err(|error| format!("`vary.\"{column}\"`: {error}"))?;
            if expression.indices().contains(&usize::MAX) {
                refusal = format!("`vary.\"{column}\"` is part of a cycle");
                later.push((name, index, column, text));
                continue;
            }
            varied[name].parts[index] = parts.len();
            parts.push(Part {
                column,
                origin: Origin::Expression(expression),
            });
        }
        if later.len() == before {
            return Err(refusal);
        }
        waiting = later;
    }
    Ok(())
}

/// Returns the design and the number of samples.
fn design(definition: &Definition, parts: &[Part]) -> Result<(Design, u64), SweepError> {
    let levels: Vec<u32> = parts
        .iter()
        .filter_map(|part| match &part.origin {
            Origin::Draw(_, levels, _) => Some(*levels),
            Origin::Choice(values, _) => Some(u32::try_from(values.len()).unwrap_or(u32::MAX)),
            Origin::Expression(_) => None,
        })
        .collect();
    let (seed, samples) = (definition.seed, definition.samples.unwrap_or(0));
    let refused = |error: statistics::design::DesignError| SweepError::bad_input(error.to_string());
    match definition.method {
        Method::Random => Ok((Design::random(seed, levels.len()), samples)),
        Method::Sobol => Ok((
            Design::sobol(seed, samples, levels.len()).map_err(refused)?,
            samples,
        )),
        Method::Latin => Ok((
            Design::latin(seed, samples, levels.len()).map_err(refused)?,
            samples,
        )),
        Method::Grid => {
            let count = levels
                .iter()
                .try_fold(1_u64, |count, &levels| count.checked_mul(u64::from(levels)));
            let count = count.ok_or_else(|| SweepError::bad_input("the grid has more than 2^64 samples"))?;
            Ok((Design::grid(levels).map_err(refused)?, count))
        }
    }
}
