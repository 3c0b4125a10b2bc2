//! Whether a document has the keys and types of a scenario, and the scenario that it then is.

use std::ops::Range;

use serde::Deserialize;
use serde_json::Value;
use shared_types::scenario::{Key, Scenario, suggest};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

use super::sources::Sources;
use super::{Finding, document, keys};

/// The scenario of a document, if it can be made out at all, and what is wrong with the document's structure.
/// Unknown keys are removed from it, so that all of them are found.
pub(super) fn read(
    sources: &Sources,
    document: &mut Spanned<DeTable<'_>>,
) -> (Option<Scenario>, Vec<Finding>) {
    let mut findings = Vec::new();
    loop {
        match Scenario::deserialize(Deserializer::from(document.clone())) {
            Ok(scenario) => {
                push_unread(sources, document.get_ref(), &scenario, &mut findings);
                return (Some(scenario), findings);
            }
            Err(error) => {
                let mistake = Mistake::of(document.get_ref(), &error);
                findings.push(mistake.finding(sources));
                match mistake.kind {
                    Kind::UnknownKey { .. } => document::remove(document.get_mut(), mistake.key.segments()),
                    _ => return (None, findings),
                }
            }
        }
    }
}

/// A mistake in the structure of a document.
struct Mistake {
    key: Key,
    span: Range<usize>,
    kind: Kind,
}

/// What serde and toml have to say, sorted. Their messages are the only form in which they say it.
enum Kind {
    UnknownKey { known: Vec<String> },
    UnknownVariant { found: String, known: Vec<String> },
    MissingKey,
    Unexpected { found: String, expected: String },
    NotOneOf,
    Other(String),
}

impl Mistake {
    fn of(document: &DeTable<'_>, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or_default();
        let message = error.message();
        let quoted: Vec<String> = message.split('`').skip(1).step_by(2).map(str::to_owned).collect();
        let value_key = || document::key_of_value(document, &span, &names_in(error)).unwrap_or_default();
        let (key, kind) = match (message, quoted.as_slice()) {
            (message, [_, known @ ..]) if message.starts_with("unknown field") => {
                match document::key_of_name(document, &span) {
                    Some(key) => (
                        key,
                        Kind::UnknownKey {
                            known: known.to_vec(),
                        },
                    ),
                    None => (value_key(), Kind::Other(message.to_owned())),
                }
            }
            (message, [found, known @ ..]) if message.starts_with("unknown variant") => {
                let key = document::key_of_name(document, &span).unwrap_or_else(value_key);
                let (found, known) = (found.clone(), known.to_vec());
                (key, Kind::UnknownVariant { found, known })
            }
            (message, [name]) if message.starts_with("missing field") => {
                (value_key().then(name), Kind::MissingKey)
            }
            (message, _) if message.starts_with("wanted exactly 1 element") => (value_key(), Kind::NotOneOf),
            (message, _) => (value_key(), unexpected(message)),
        };
        Self { key, span, kind }
    }

    fn finding(&self, sources: &Sources) -> Finding {
        let key = &self.key;
        let (title, reason, fix) = match &self.kind {
            Kind::UnknownKey { known } => {
                let name = key.segments().last().map_or("", String::as_str);
                let fix = suggest::known_names(name, known);
                (
                    format!("`{key}` is unknown"),
                    format!("there is no key `{name}` here"),
                    fix,
                )
            }
            Kind::UnknownVariant { found, known } => {
                let fix = suggest::known_names(found, known);
                (
                    format!("`{key}` is unknown"),
                    format!("`{found}` is none of the choices"),
                    fix,
                )
            }
            Kind::MissingKey => {
                let name = key.segments().last().map_or("", String::as_str);
                (
                    format!("`{key}` is missing"),
                    format!("`{name}` must be stated here"),
                    keys::advice(key),
                )
            }
            Kind::Unexpected { found, expected } => (
                format!("`{key}` has the wrong type"),
                format!("{expected} is wanted here, not {found}"),
                keys::advice(key),
            ),
            Kind::NotOneOf => (
                format!("`{key}` is not one choice"),
                "exactly one choice is wanted here".to_owned(),
                format!("state one of {}, and no other", keys::names_at(key).join(", ")),
            ),
            Kind::Other(message) => (
                format!("`{key}` cannot be read"),
                message.clone(),
                keys::advice(key),
            ),
        };
        sources.finding(self.span.clone(), title, reason, fix)
    }
}

/// The names that lead to the place of an error, with dots between them; toml tells them in its display only.
fn names_in(error: &toml::de::Error) -> String {
    let display = error.to_string();
    let names = display
        .lines()
        .last()
        .and_then(|line| line.strip_prefix("in `")?.strip_suffix('`'));
    names.unwrap_or_default().to_owned()
}

/// A message such as ``invalid type: string "a", expected f64`` in words for people who do not write Rust.
fn unexpected(message: &str) -> Kind {
    let Some((found, expected)) = message.split_once(", expected ") else {
        return Kind::Other(message.to_owned());
    };
    let expected = match expected {
        "f64" => "a number",
        "u64" => "a whole number of 0 or more",
        "a sequence" => "an array",
        "an array of length 3" => "an array of three numbers",
        "newtype variant" => "a table of this name",
        other if other.starts_with("struct ") => "a table",
        other => other,
    };
    let found = found
        .rsplit_once("invalid type: ")
        .map_or(found, |(_, found)| found);
    let found = match found
        .rsplit_once("invalid value: ")
        .map_or(found, |(_, found)| found)
    {
        "map" => "a table",
        "sequence" => "an array",
        "unit variant" => "a word",
        "newtype variant" => "a table",
        other => other,
    };
    let found = match (
        found.strip_prefix("invalid length "),
        found.strip_prefix("string "),
    ) {
        (Some(count), _) => format!("one of length {count}"),
        (_, Some(text)) => format!("the text {text}"),
        (None, None) => found.to_owned(),
    };
    Kind::Unexpected {
        found,
        expected: expected.to_owned(),
    }
}

/// Adds what serde does not: it reads the first three of four numbers and an array in place of a table.
fn push_unread(sources: &Sources, document: &DeTable<'_>, scenario: &Scenario, findings: &mut Vec<Finding>) {
    let read = serde_json::to_value(scenario).unwrap_or_default();
    for (name, value) in document {
        let key = Key::root().then(name.get_ref());
        push_unread_in(sources, &key, value, &read[name.get_ref().as_ref()], findings);
    }
}

fn push_unread_in(
    sources: &Sources,
    key: &Key,
    written: &Spanned<DeValue<'_>>,
    read: &Value,
    findings: &mut Vec<Finding>,
) {
    let mut refuse = |span, reason: String| {
        let title = format!("`{key}` has the wrong type");
        findings.push(sources.finding(span, title, reason, keys::advice(key)));
    };
    match (written.get_ref(), read) {
        (DeValue::Array(_), Value::Object(_)) => {
            refuse(written.span(), "a table is wanted here, not an array".to_owned())
        }
        (DeValue::Array(elements), Value::Array(read)) if elements.len() > read.len() => {
            let (wanted, found) = (read.len(), elements.len());
            refuse(
                elements[wanted].span(),
                format!("{wanted} elements are wanted here, not {found}"),
            );
        }
        (DeValue::Array(elements), Value::Array(read)) => {
            for (index, (element, read)) in elements.iter().zip(read).enumerate() {
                push_unread_in(sources, &key.then(index), element, read, findings);
            }
        }
        (DeValue::Table(table), Value::Object(read)) => {
            for (name, value) in table {
                let name = name.get_ref();
                let read = read.get(name.as_ref()).unwrap_or(&Value::Null);
                push_unread_in(sources, &key.then(name), value, read, findings);
            }
        }
        _ => {}
    }
}
