//! From a scenario file, and what the command line changes of it, to a scenario that can be flown, or to a
//! report that shows every line that is wrong, the reason and the fix.
//!
//! A file is read in the order of what can go wrong: it is there ([`ScenarioError::Unreadable`]), it is TOML,
//! the `--set` arguments fit into it (`setting`), its keys and types are those of a scenario (`structure`), the
//! file of its path holds points (`curve_file`), and its values can be flown ([`Scenario::problems`]). What comes of
//! one of these steps is reported all at once. The document keeps the place of every value, that of an argument included
//! (`sources`).

mod curve_file;
mod document;
mod error;
pub mod gain_rules;
mod keys;
pub mod printable;
mod read;
mod read_files;
mod setting;
mod snippet;
mod sources;
mod structure;
pub mod tuning;
pub mod values;
pub mod warnings;

use std::path::Path;

use scenario::Scenario;
use shared_types::ServiceId;
use toml::de::DeTable;

pub use error::{Finding, ScenarioError};
pub use keys::{key_table, keys_for_completion, unit_of_key};
pub use read_files::{ReadFile, files_of};
pub use setting::{concerns, key_of_setting, path_of};
use sources::Sources;

/// Reads a scenario file, with the values of `sets` (such as `controller.k1=5`) and the seed in place of the
/// file's own.
///
/// # Errors
/// [`ScenarioError`] if the file cannot be read or if what it and the arguments say cannot be flown.
pub fn load(path: &Path, sets: &[String], seed: Option<u64>) -> Result<Scenario, ScenarioError> {
    load_from(path, &read::text(path)?, sets, seed)
}

/// As [`load`], of a file whose text has been read.
///
/// # Errors
/// [`ScenarioError`] if what it and the arguments say cannot be flown.
pub fn load_from(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    let scenario = load_drawn(path, text, sets, seed)?;
    refuse_another_law(&scenario, path, text, sets)?;
    Ok(scenario)
}

/// As [`load_from`], with settings of which some were drawn for several laws: gains that the law does not use are no error.
///
/// # Errors
/// [`ScenarioError`] if what it and the arguments say cannot be flown.
pub fn load_drawn(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    // Without a working folder there is no file to be found in it either.
    let file = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let folder = file.parent().unwrap_or(Path::new("/"));
    let mut scenario = load_in(Some(folder), path, text, sets, seed)?;
    if let Some(programs) = &mut scenario.programs {
        programs.anchor(folder);
    }
    if let Some(plugins) = &mut scenario.plugins {
        plugins.anchor(folder);
    }
    plugin::library_file::pin(&mut scenario)?;
    Ok(scenario)
}

/// As [`load`], of a scenario whose text is at hand and has all that files gave to it, as that of a log; `path` is what
/// errors call it.
///
/// # Errors
/// [`ScenarioError`] if what it and the arguments say cannot be flown.
pub fn load_text(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    let scenario = load_in(None, path, text, sets, seed)?;
    refuse_another_law(&scenario, path, text, sets)?;
    Ok(scenario)
}

/// Returns the text of a scenario, which [`load_text`] reads.
///
/// # Errors
/// If it has a value that TOML does not have.
pub fn to_toml(scenario: &Scenario) -> Result<String, toml::ser::Error> {
    let mut text = toml::ser::Buffer::new();
    // The derived function, not that of serde's trait, which does not keep the order of the keys.
    Scenario::serialize(scenario, toml::Serializer::new(&mut text))?;
    Ok(text.to_string())
}

/// Refuses settings of gains that the law of a scenario does not use.
fn refuse_another_law(
    scenario: &Scenario,
    path: &Path,
    text: &str,
    sets: &[String],
) -> Result<(), ScenarioError> {
    // What else flies in place of the controller is given the scenario, and may fly with its gains.
    if scenario.is_foreign(ServiceId::Controller) {
        return Ok(());
    }
    let sources = Sources::new(&path.display().to_string(), text, sets);
    let findings = setting::of_another_law(&sources, scenario.controller.law);
    refuse_if_any(path, findings)
}

fn refuse_if_any(path: &Path, findings: Vec<Finding>) -> Result<(), ScenarioError> {
    match findings.is_empty() {
        true => Ok(()),
        false => Err(ScenarioError::refused(path, findings)),
    }
}

fn load_in(
    folder: Option<&Path>,
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    let refused = |findings| ScenarioError::refused(path, findings);
    let name = path.display().to_string();
    let mut scenario = scenario_from_text(&name, text, sets, folder).map_err(refused)?;
    scenario.seed = seed.unwrap_or(scenario.seed);
    Ok(scenario)
}

/// Refuses settings of Gerono's own law for a flight of a controller of the caller's, which they would not concern.
///
/// # Errors
/// [`ScenarioError`] that names the settings.
pub fn refuse_own_law(path: &Path, text: &str, sets: &[String]) -> Result<(), ScenarioError> {
    let sources = Sources::new(&path.display().to_string(), text, sets);
    let findings = setting::of_own_law(&sources, "a controller of the caller's flies");
    refuse_if_any(path, findings)
}

/// The JSON Schema of scenario files, with which editors complete and check them.
///
/// # Panics
/// Never: a schema is made of names and numbers.
#[must_use]
pub fn json_schema() -> String {
    let mut text = serde_json::to_string_pretty(scenario::schema::schema())
        .expect("a schema is made of names and numbers");
    text.push('\n');
    text
}

/// The scenario of a text; the file of its path is read in `folder`.
fn scenario_from_text(
    name: &str,
    text: &str,
    sets: &[String],
    folder: Option<&Path>,
) -> Result<Scenario, Vec<Finding>> {
    let sources = Sources::new(name, text, sets);
    let values = setting::placed_values(&sources);
    let mut document = DeTable::parse(text).map_err(|error| {
        let span = error.span().unwrap_or_default();
        let fix = "see https://toml.io for how TOML is written, or a scenario that works";
        vec![sources.finding(span, "this is not TOML", error.message(), fix)]
    })?;
    setting::apply_all(&sources, &values, document.get_mut())?;

    let (mut scenario, mut findings) = structure::read(&sources, &mut document);
    if let (Some(scenario), Some(folder)) = (&mut scenario, folder)
        && let Err(finding) = curve_file::read_into(scenario, folder, &sources, &document)
    {
        findings.push(*finding);
        // Without its points the path could only be refused once more.
        return Err(findings);
    }
    if let Some(scenario) = &scenario
        && scenario.has_plugin(ServiceId::Controller)
    {
        // A program is given the scenario, and may fly with its gains.
        let what = "a plug-in flies in place of the controller";
        findings.extend(setting::of_own_law(&sources, what));
    }
    let problems = scenario.as_ref().map(Scenario::problems).unwrap_or_default();
    findings.extend(problems.into_iter().map(|problem| {
        let span = document::deepest_span(&document, &problem.key);
        let title = format!("`{}` cannot be flown", problem.key);
        Finding {
            is_of_values: true,
            ..sources.finding(span, title, problem.reason, problem.fix)
        }
    }));
    scenario.filter(|_| findings.is_empty()).ok_or(findings)
}

#[cfg(test)]
mod tests;
