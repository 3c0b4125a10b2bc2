//! `sweep.toml`: the definition of a sweep.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use scenario::suggest::nearest;
use scenario_file::values::plain_name;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use shared_types::sample::hex;
use statistics::distribution::Distribution;
use toml::{Table, Value};

use crate::error::SweepError;
use crate::expression::is_name;
use crate::row::present_name;

/// Content of a sweep's file.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Path of the varied scenario, relative to the file.
    pub scenario: PathBuf,
    /// Number of samples; for a grid it follows from the levels.
    #[serde(default)]
    pub samples: Option<u64>,
    /// Seed of the samples and of their flights.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Sampling method.
    #[serde(default)]
    pub method: Method,
    /// Settings of all flights, as for `--set`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Varied values: keys of the scenario, and names for expressions.
    #[serde(default)]
    pub vary: Table,
    /// Conditions that a sample must meet; other samples are counted and not flown.
    #[serde(default)]
    pub require: Vec<String>,
    /// Settings or control laws that fly the same samples; the first is the reference of all differences.
    #[serde(default)]
    pub compare: Vec<Entry>,
    /// Identity of the caller's controller that flies every sample, if `compare` is empty.
    #[serde(default)]
    pub own: Option<String>,
    /// Criteria on the results of a flight, by name.
    #[serde(default)]
    pub judge: BTreeMap<String, String>,
    /// Result by which the entries are ranked; smaller is better [default: `steady_rmse`].
    #[serde(default = "steady_rmse")]
    pub rank: String,
    /// Data stored for a flight besides its row.
    #[serde(default)]
    pub keep: Keep,
    /// Maps of a result over two varied values.
    #[serde(default)]
    pub map: Vec<Map>,
}

fn first_seed() -> u64 {
    1
}

fn steady_rmse() -> String {
    "steady_rmse".to_owned()
}

/// Sampling method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Independent draws: the only method for which confidence intervals of the pass rate hold.
    #[default]
    Random,
    /// Owen-scrambled Sobol points.
    Sobol,
    /// Latin hypercube.
    Latin,
    /// Every combination of levels.
    Grid,
}

/// Settings that fly every sample.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Name in tables.
    pub name: String,
    /// Settings, as for `--set`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Identity of the caller's controller that replaces the scenario's; only for sweeps run through the library.
    #[serde(default)]
    pub own: Option<String>,
}

impl Entry {
    /// Returns the name as a part of file names.
    #[must_use]
    pub fn file_name(&self) -> String {
        file_name_part(&self.name)
    }

    /// Checks the name, which is used in tables and file names.
    fn check(&self, others: &[Self]) -> Result<(), String> {
        plain_name(&self.name).map_err(|error| error.to_string())?;
        match others.iter().find(|other| other.file_name() == self.file_name()) {
            None => Ok(()),
            Some(other) => Err(format!("its file names would equal those of `{}`", other.name)),
        }
    }
}

/// Returns a text as a part of file names.
#[must_use]
pub fn file_name_part(text: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-.".contains(letter);
    let letters = text.chars();
    letters
        .map(|letter| if is_plain(letter) { letter } else { '_' })
        .collect()
}

/// Data stored besides the rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Keep {
    /// Flights whose logs are stored.
    pub logs: KeptLogs,
}

/// Flights whose logs are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum KeptLogs {
    /// No flights; every flight can be repeated.
    #[default]
    None,
    /// Flights that were lost, failed or missed a criterion.
    Failed,
    /// All flights.
    All,
}

/// Map of a result over two varied values.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Map {
    /// Varied value along x.
    pub x: String,
    /// Varied value along y.
    pub y: String,
    /// Criterion or result shown as colour [default: `survived`].
    #[serde(default = "survived")]
    pub value: String,
    /// `true` for logarithmic axes.
    #[serde(default)]
    pub log: bool,
    /// Lines, by name: y as an expression of x.
    #[serde(default)]
    pub line: BTreeMap<String, String>,
    /// Points, by name.
    #[serde(default)]
    pub point: BTreeMap<String, [f64; 2]>,
}

fn survived() -> String {
    "survived".to_owned()
}

/// How a value is varied.
#[derive(Clone, Debug, PartialEq)]
pub enum Vary {
    /// Drawn from a distribution, or one of its levels in a grid.
    Draw(Distribution, u32),
    /// One of these values.
    Choice(Vec<Value>),
    /// An expression of other varied values.
    Expression(String),
    /// An array of varied values.
    Array(Vec<Vary>),
}

/// Default number of levels of a distribution in a grid.
const LEVELS: u32 = 5;

/// A sweep with its texts: with the program, they determine all rows.
#[derive(Clone, Debug)]
pub struct Source {
    pub definition: Definition,
    /// Text of the sweep's file.
    pub text: String,
    /// Path of the scenario.
    pub scenario_path: PathBuf,
    /// Text of the scenario.
    pub scenario_text: String,
}

impl Source {
    /// Reads a sweep and its scenario.
    ///
    /// # Errors
    /// [`SweepError`] with the location and the fix.
    pub fn read(path: &Path) -> Result<Self, SweepError> {
        let text = read_text(
            path,
            "give the path of a sweep, such as scenarios/sweeps/vehicles.toml",
        )?;
        let scenario = Definition::parse(&text, path)?.scenario;
        let folder = path.parent().unwrap_or(Path::new(""));
        let scenario_path = folder.join(scenario);
        let fix = "`scenario` is relative to the sweep's file";
        let scenario_text = read_text(&scenario_path, fix)?;
        let scenario_path = scenario_path.canonicalize().map_err(SweepError::trouble)?;
        Self::new(path, text, scenario_path, scenario_text)
    }

    /// Makes a sweep from texts; errors refer to it as `path`.
    ///
    /// # Errors
    /// [`SweepError`] with the location and the fix.
    pub fn new(
        path: &Path,
        text: String,
        scenario_path: PathBuf,
        scenario_text: String,
    ) -> Result<Self, SweepError> {
        Ok(Self {
            definition: Definition::parse(&text, path)?,
            text,
            scenario_path,
            scenario_text,
        })
    }

    /// Returns the SHA-256 over both texts, in hexadecimal.
    #[must_use]
    pub fn identity(&self) -> String {
        let mut hash = Sha256::new();
        for text in [&self.text, &self.scenario_text] {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text);
        }
        hex(&hash.finalize())
    }
}

/// Describes an error of the text, with the known name that is nearest to an unknown one.
fn with_nearest_name(error: &toml::de::Error) -> String {
    let quoted: Vec<&str> = error.message().split('`').skip(1).step_by(2).collect();
    match quoted.split_first() {
        Some((unknown, known)) if error.message().starts_with("unknown") => {
            match nearest(unknown, known.iter().copied()) {
                Some(nearest) => format!("{}\ndid you mean `{nearest}`?", error.to_string().trim_end()),
                None => error.to_string(),
            }
        }
        _ => error.to_string(),
    }
}

fn read_text(path: &Path, fix: &str) -> Result<String, SweepError> {
    std::fs::read_to_string(path)
        .map_err(|error| SweepError::bad_input(format!("cannot read {}: {error}; {fix}", path.display())))
}

impl Definition {
    /// Parses the text of a sweep and makes the checks that do not need its scenario.
    fn parse(text: &str, path: &Path) -> Result<Self, SweepError> {
        let refused = |reason: String| SweepError::bad_input(format!("{}: {reason}", path.display()));
        let is_scenario = text
            .parse::<Table>()
            .is_ok_and(|table| table.contains_key("vehicle"));
        if is_scenario {
            let run = format!("`gerono run {}`", path.display());
            return Err(refused(format!(
                "this is a scenario, not a sweep: {run} flies it, and a sweep names it in `scenario`"
            )));
        }
        let mut definition: Self =
            toml::from_str(text).map_err(|error| refused(with_nearest_name(&error)))?;
        definition.check().map_err(refused)?;
        let map_values = definition.map.iter_mut().map(|map| &mut map.value);
        for name in map_values.chain([&mut definition.rank]) {
            *name = present_name(name).to_owned();
        }
        Ok(definition)
    }

    fn check(&self) -> Result<(), String> {
        match (self.method, self.samples) {
            (Method::Grid, Some(_)) => {
                return Err(
                    "`samples` cannot be stated for a grid: its levels determine the number; remove it"
                        .to_owned(),
                );
            }
            (Method::Random | Method::Sobol | Method::Latin, None | Some(0)) => {
                return Err("there are no samples; state `samples = 1000`".to_owned());
            }
            _ => {}
        }
        let states_levels = |value: &Value| value.get("levels").is_some();
        for (name, value) in &self.vary {
            let parts = value.as_array();
            let is_stated =
                states_levels(value) || parts.is_some_and(|parts| parts.iter().any(states_levels));
            if is_stated && self.method != Method::Grid {
                return Err(format!(
                    "`levels` of `vary.{name}` apply to a grid only; remove them, or state `method = \"grid\"`"
                ));
            }
        }
        for (name, _) in self.varied()? {
            if !is_name(&name) && !name.contains('.') && name != "duration" {
                return Err(format!(
                    "`vary.{name}` is neither a key of the scenario, such as \"vehicle.mass\", nor a name for expressions"
                ));
            }
        }
        for (index, entry) in self.compare.iter().enumerate() {
            if entry.name.is_empty() {
                return Err(format!("`compare.{index}` needs a `name`"));
            }
            if let Some(first) = self.compare[..index]
                .iter()
                .position(|other| other.name == entry.name)
            {
                return Err(format!(
                    "the name `{}` is stated twice, by `compare.{first}` and `compare.{index}`; give each of them its own",
                    entry.name
                ));
            }
            let checked = entry.check(&self.compare[..index]);
            checked.map_err(|reason| format!("`compare.{index}`: {reason}"))?;
            let flies_as =
                |other: &Entry| other.set == entry.set && entry.own.is_none() && other.own.is_none();
            if let Some(same) = self.compare[..index].iter().position(flies_as) {
                return Err(format!(
                    "`{}` flies the same as `{}` (`compare.{index}`, `compare.{same}`): change its `set`, or remove it",
                    entry.name, self.compare[same].name
                ));
            }
        }
        if let Some(name) = self.judge.keys().find(|name| !is_name(name)) {
            return Err(format!("`judge.{name}` is no name: use letters, digits and `_`"));
        }
        Ok(())
    }

    /// Returns the varied values with their names.
    ///
    /// # Errors
    /// The reason and the fix.
    pub fn varied(&self) -> Result<Vec<(String, Vary)>, String> {
        let vary = self.vary.iter().map(|(name, value)| {
            let vary = Vary::read(value).map_err(|reason| format!("`vary.\"{name}\"`: {reason}"))?;
            Ok((name.clone(), vary))
        });
        vary.collect()
    }

    /// Returns the entries that fly every sample; a single one with the unchanged settings if `compare` is empty.
    #[must_use]
    pub fn entries(&self) -> Vec<Entry> {
        if self.compare.is_empty() {
            return vec![Entry {
                name: "as stated".to_owned(),
                set: Vec::new(),
                own: self.own.clone(),
            }];
        }
        self.compare.clone()
    }
}

impl Entry {
    /// Returns the value by which this entry overrides a varied key or element of an array.
    pub(crate) fn stated(&self, column: &str) -> Option<Value> {
        let value_of = |column: &str| {
            let key = scenario_file::path_of(column)?;
            let sets_key = |setting: &&String| scenario_file::key_of_setting(setting).as_ref() == Some(&key);
            let (_, value) = self.set.iter().rev().find(sets_key)?.split_once('=')?;
            let parsed = toml::from_str::<Table>(&format!("value = {value}"));
            let parsed = parsed.ok().and_then(|mut table| table.remove("value"));
            Some(parsed.unwrap_or_else(|| Value::String(value.to_owned())))
        };
        let value_of_element = || {
            let (array, index) = column.rsplit_once('.')?;
            value_of(array)?.get(index.parse::<usize>().ok()?).cloned()
        };
        value_of(column).or_else(value_of_element)
    }
}

const KINDS: &str = "write { uniform = [a, b] }, { log_uniform = [a, b] }, { normal = [mean, deviation] }, { choice = […] }, \
                     an expression in quotes, or an array of these";

impl Vary {
    fn read(value: &Value) -> Result<Self, String> {
        match value {
            Value::String(text) => Ok(Self::Expression(text.clone())),
            Value::Array(parts) => {
                let parts: Result<Vec<_>, _> = parts.iter().map(Self::read).collect();
                match parts? {
                    parts if parts.is_empty() => Err(format!("the array is empty; {KINDS}")),
                    parts => Ok(Self::Array(parts)),
                }
            }
            Value::Table(table) => Self::from_table(table),
            Value::Integer(_) | Value::Float(_) | Value::Boolean(_) => Ok(Self::Choice(vec![value.clone()])),
            Value::Datetime(_) => Err(format!("a date cannot be varied; {KINDS}")),
        }
    }

    fn from_table(table: &Table) -> Result<Self, String> {
        let kinds = ["uniform", "log_uniform", "normal", "choice"];
        let mut stated = kinds.into_iter().filter(|kind| table.contains_key(*kind));
        let (Some(kind), None) = (stated.next(), stated.next()) else {
            return Err(KINDS.to_owned());
        };
        let further: &[&str] = if kind == "normal" {
            &["min", "max", "levels"]
        } else {
            &["levels"]
        };
        if let Some(key) = table
            .keys()
            .find(|key| *key != kind && !further.contains(&key.as_str()))
        {
            return Err(format!("`{kind}` has no `{key}`; {KINDS}"));
        }
        if kind == "choice" {
            return match &table[kind] {
                Value::Array(values) if !values.is_empty() => Ok(Self::Choice(values.clone())),
                _ => Err("`choice` is an array of at least one value".to_owned()),
            };
        }
        let [first, second] =
            two_numbers(&table[kind]).ok_or_else(|| format!("`{kind}` is an array of two numbers"))?;
        let limit = |key| match table.get(key) {
            None => Ok(None),
            Some(value) => number(value)
                .map(Some)
                .ok_or_else(|| format!("`{key}` is a number")),
        };
        let distribution = match kind {
            "uniform" => Distribution::Uniform {
                low: first,
                high: second,
            },
            "log_uniform" => Distribution::LogUniform {
                low: first,
                high: second,
            },
            _ => Distribution::Normal {
                mean: first,
                deviation: second,
                low: limit("min")?,
                high: limit("max")?,
            },
        };
        distribution.check().map_err(|error| error.to_string())?;
        let levels = match table.get("levels") {
            None => LEVELS,
            Some(value) => value
                .as_integer()
                .and_then(|levels| u32::try_from(levels).ok())
                .filter(|levels| *levels > 0)
                .ok_or("`levels` is a whole number above 0")?,
        };
        Ok(Self::Draw(distribution, levels))
    }
}

fn two_numbers(value: &Value) -> Option<[f64; 2]> {
    let [first, second] = value.as_array()?.as_slice() else {
        return None;
    };
    Some([number(first)?, number(second)?])
}

#[expect(clippy::cast_precision_loss, reason = "ranges of whole numbers are small")]
fn number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|number| number as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        let error = Definition::parse(text, Path::new("s.toml")).unwrap_err();
        error.to_string()
    }

    #[test]
    fn bad_input_is_refused_with_its_place_and_a_fix() {
        let head = "scenario = \"fig1.toml\"\nsamples = 10\n";
        for (text, reason) in [
            ("scenario = \"fig1.toml\"\n", "there are no samples"),
            (
                "scenario = \"fig1.toml\"\nsamples = 10\nmethod = \"grid\"\n",
                "cannot be stated for a grid",
            ),
            (
                "scenario = \"a\"\nsamples = 10\nsample = 3\n",
                "unknown field `sample`",
            ),
            (
                &format!("{head}[vary]\n\"vehicle.mass\" = {{ uniform = [2.0, 1.0] }}\n"),
                "`vary.\"vehicle.mass\"`",
            ),
            (
                &format!("{head}[vary]\nm = {{ uniform = [1.0, 2.0], min = 1.0 }}\n"),
                "`uniform` has no `min`",
            ),
            (
                &format!("{head}[vary]\nm = {{ even = [1.0, 2.0] }}\n"),
                "write { uniform",
            ),
            (
                &format!("{head}[vary]\n\"2m\" = {{ uniform = [1.0, 2.0] }}\n"),
                "neither a key",
            ),
            (&format!("{head}[judge]\n\"a b\" = \"max < 1\"\n"), "is no name"),
            (
                &format!("{head}[[compare]]\nname = \"a\"\n[[compare]]\nname = \"a\"\n"),
                "the name `a` is stated twice, by `compare.0` and `compare.1`; give each of them its own",
            ),
            (
                &format!("{head}[[compare]]\nname = \"../a\"\n"),
                "is not valid for a file",
            ),
            (
                &format!("{head}[[compare]]\nname = \"a b\"\n[[compare]]\nname = \"a_b\"\n"),
                "file names would equal",
            ),
        ] {
            let refusal = refused(text);
            assert!(refusal.contains(reason), "{text}\n{refusal}");
        }
    }

    #[test]
    fn a_law_states_a_varied_key_however_it_is_written() {
        let set = [
            "vehicle.\"mass\" = 0.2",
            "vehicle.inertia=[1.0, 2.0, 3.0]",
            "controller.law=indi",
        ];
        let entry = Entry {
            name: "heavy".to_owned(),
            set: set.map(str::to_owned).to_vec(),
            own: None,
        };
        assert_eq!(entry.stated("vehicle.mass"), Some(Value::Float(0.2)));
        assert_eq!(entry.stated("vehicle.inertia.2"), Some(Value::Float(3.0)));
        assert_eq!(
            entry.stated("controller.law"),
            Some(Value::String("indi".to_owned()))
        );
        assert_eq!(entry.stated("vehicle.drag.0"), None);
    }
}
