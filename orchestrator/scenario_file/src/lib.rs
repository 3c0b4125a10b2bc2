//! Reads a scenario file with the changes of the command line, and reports every wrong line with the reason and the fix.
//!
//! The steps are: read the file ([`ScenarioError::Unreadable`]), parse TOML, apply the `--set` arguments (`setting`), check
//! keys and types (`structure`), read the file of the path (`curve_file`), and check the values ([`Scenario::problems`]).
//! All errors of a step are reported together. The document stores the position of every value, also in arguments
//! (`sources`).

mod beyond_end;
mod curve_file;
mod document;
mod error;
pub mod gain_rules;
mod keys;
pub mod printable;
mod read;
mod read_files;
mod setting;
pub mod slips;
mod snippet;
mod sources;
mod structure;
pub mod tuning;
pub mod units;
pub mod values;
pub mod warnings;

use std::path::Path;

use scenario::{Problem, Scenario};
use shared_types::ServiceId;
use toml::de::DeTable;

pub use error::{Finding, ScenarioError};
pub use keys::{key_table, keys_for_completion, unit_of_key};
pub use read::find;
pub use read_files::{ReadFile, files_of};
pub use setting::{concerns, key_of_setting, path_of};
use sources::Sources;

/// Reads a scenario file. `sets` (such as `controller.k1=5`) and the seed override its values.
///
/// # Errors
/// [`ScenarioError`] if the file cannot be read, or the scenario cannot be flown.
pub fn load(path: &Path, sets: &[String], seed: Option<u64>) -> Result<Scenario, ScenarioError> {
    load_from(path, &read::text(path)?, sets, seed)
}

/// As [`load`], but a duration in `sets` leaves out what the file plans after it. Returns a note about what was left out, if any.
///
/// # Errors
/// [`ScenarioError`] if the file cannot be read, or the scenario cannot be flown.
pub fn load_shortened(
    path: &Path,
    sets: &[String],
    seed: Option<u64>,
) -> Result<(Scenario, Option<String>), ScenarioError> {
    let text = read::text(path)?;
    let mut note = None;
    let scenario = load_from_file(path, &text, sets, seed, Some(&mut note))?;
    refuse_unused_gains(&scenario, path, &text, sets)?;
    Ok((scenario, note))
}

/// As [`load`], for the text of a file.
///
/// # Errors
/// [`ScenarioError`] if the scenario cannot be flown.
pub fn load_from(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    let scenario = load_drawn(path, text, sets, seed)?;
    refuse_unused_gains(&scenario, path, text, sets)?;
    Ok(scenario)
}

/// As [`load_from`], but accepts gains that the law does not use, for settings that are shared by several laws.
///
/// # Errors
/// [`ScenarioError`] if the scenario cannot be flown.
pub fn load_drawn(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    load_from_file(path, text, sets, seed, None)
}

/// Reads the text of a file, and what is relative to its folder. With `note` as [`load_shortened`].
fn load_from_file(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
    note: Option<&mut Option<String>>,
) -> Result<Scenario, ScenarioError> {
    // Without a working directory relative paths cannot be resolved anyway.
    let file = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let folder = file.parent().unwrap_or(Path::new("/"));
    let mut scenario = load_in(Some(folder), path, text, sets, seed, note)?;
    if let Some(programs) = &mut scenario.programs {
        programs.anchor(folder);
    }
    if let Some(plugins) = &mut scenario.plugins {
        plugins.anchor(folder);
    }
    if let Some(file) = scenario
        .flight
        .as_mut()
        .and_then(|flight| flight.hand_test.as_mut())
    {
        *file = folder.join(&*file).display().to_string();
    }
    plugin::library_file::pin(&mut scenario)?;
    Ok(scenario)
}

/// Returns the refusal of a scenario file that [`load`] accepts, for a problem of its use, at the position of the key.
#[must_use]
pub fn refusal(path: &Path, sets: &[String], problem: &Problem) -> ScenarioError {
    let text = match read::text(path) {
        Ok(text) => text,
        Err(error) => return error,
    };
    let file = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let name = path.display().to_string();
    let further = std::slice::from_ref(problem);
    let read = scenario_from_text(&name, &text, sets, file.parent(), further, Some(&mut None));
    ScenarioError::refused(path, read.expect_err("the problem is a finding"))
}

/// As [`load`], for a text that already contains the content of other files, such as that of a log. Errors name it `path`.
///
/// # Errors
/// [`ScenarioError`] if the scenario cannot be flown.
pub fn load_text(
    path: &Path,
    text: &str,
    sets: &[String],
    seed: Option<u64>,
) -> Result<Scenario, ScenarioError> {
    let scenario = load_in(None, path, text, sets, seed, None)?;
    refuse_unused_gains(&scenario, path, text, sets)?;
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
fn refuse_unused_gains(
    scenario: &Scenario,
    path: &Path,
    text: &str,
    sets: &[String],
) -> Result<(), ScenarioError> {
    // A plug-in or program in place of the controller receives the scenario, and may use its gains.
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
    note: Option<&mut Option<String>>,
) -> Result<Scenario, ScenarioError> {
    let refused = |findings| ScenarioError::refused(path, findings);
    let name = path.display().to_string();
    let mut scenario = scenario_from_text(&name, text, sets, folder, &[], note).map_err(refused)?;
    scenario.seed = seed.unwrap_or(scenario.seed);
    Ok(scenario)
}

/// Refuses settings of Gerono's own law for a flight with the caller's controller, on which they have no effect.
///
/// # Errors
/// [`ScenarioError`] that names the settings.
pub fn refuse_own_law(path: &Path, text: &str, sets: &[String]) -> Result<(), ScenarioError> {
    let sources = Sources::new(&path.display().to_string(), text, sets);
    let findings = setting::of_own_law(&sources, "the caller's controller flies");
    refuse_if_any(path, findings)
}

/// Returns the JSON Schema of scenario files, for completion and checks in editors.
///
/// # Panics
/// Never: the schema can always be serialised.
#[must_use]
pub fn json_schema() -> String {
    let mut text =
        serde_json::to_string_pretty(scenario::schema::schema()).expect("the schema can be serialised");
    text.push('\n');
    text
}

/// Returns the fix for a number with a comma or a unit on the line of an offset.
fn slip_on_line(text: &str, offset: usize) -> Option<String> {
    let before = text.get(..offset)?;
    let line = &text[before.rfind('\n').map_or(0, |end| end + 1)..];
    let (_, value) = line.lines().next()?.split_once('=')?;
    slips::advice(value.split('#').next()?, None)
}

/// Returns the finding about the definition of a sweep, which has no key of a scenario that must be stated.
fn sweep_finding(name: &str, sources: &Sources, document: &DeTable<'_>) -> Option<Finding> {
    let (key, _) = document
        .get_key_value("scenario")
        .filter(|_| !document.contains_key("vehicle"))?;
    let fix = format!("gerono sweep run {name}");
    let reason = "a sweep names the scenario of its flights here";
    Some(sources.finding(key.span(), "this is a sweep, not a scenario", reason, fix))
}

/// Reads a scenario from a text, and the file of its path relative to `folder`. `further` are problems beside its own. With `note` as
/// [`load_shortened`].
fn scenario_from_text(
    name: &str,
    text: &str,
    sets: &[String],
    folder: Option<&Path>,
    further: &[Problem],
    note: Option<&mut Option<String>>,
) -> Result<Scenario, Vec<Finding>> {
    let sources = Sources::new(name, text, sets);
    let values = setting::placed_values(&sources);
    let mut document = DeTable::parse(text).map_err(|error| {
        let span = error.span().unwrap_or_default();
        let fix = slip_on_line(text, span.start).unwrap_or_else(|| {
            "see https://toml.io for the syntax of TOML, or a committed scenario".to_owned()
        });
        vec![sources.finding(span, "this is not TOML", error.message(), fix)]
    })?;
    if let Some(finding) = sweep_finding(name, &sources, document.get_ref()) {
        return Err(vec![finding]);
    }
    setting::apply_all(&sources, &values, document.get_mut())?;
    if let Some(note) = note {
        *note = beyond_end::remove(&sources, &mut document);
    }

    let (mut scenario, mut findings) = structure::read(&sources, &mut document);
    if let (Some(scenario), Some(folder)) = (&mut scenario, folder)
        && let Err(finding) = curve_file::read_into(scenario, folder, &sources, &document)
    {
        findings.push(*finding);
        // Without its points the path would be refused again.
        return Err(findings);
    }
    if let Some(scenario) = &scenario
        && scenario.has_plugin(ServiceId::Controller)
    {
        // Unlike a plug-in, a program receives the scenario, and may use its gains.
        let what = "a plug-in flies in place of the controller";
        findings.extend(setting::of_own_law(&sources, what));
    }
    let problems = scenario.as_ref().map(Scenario::problems).unwrap_or_default();
    findings.extend(
        problems
            .into_iter()
            .chain(further.iter().cloned())
            .map(|problem| {
                let span = document::deepest_span(&document, &problem.key);
                let title = format!("`{}` cannot be flown", problem.key);
                Finding {
                    is_of_values: true,
                    ..sources.finding(span, title, problem.reason, problem.fix)
                }
            }),
    );
    scenario.filter(|_| findings.is_empty()).ok_or(findings)
}

#[cfg(test)]
mod tests;
