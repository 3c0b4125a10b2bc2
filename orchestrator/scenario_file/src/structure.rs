//! Whether a document has the keys and types of a scenario, and the scenario that it then is.

use std::ops::Range;

use scenario::{Key, Scenario, Vector, suggest};
use serde::Deserialize;
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

use super::sources::Sources;
use super::{Finding, document, keys};

/// Most unknown keys that are looked for: a text that has more is something else than a scenario.
const MOST_UNKNOWN_KEYS: usize = 20;

/// The scenario of a document, if it can be made out at all, and what is wrong with the document's structure.
/// Unknown keys are removed from it, so that the next is found too.
pub(super) fn read(
    sources: &Sources,
    document: &mut Spanned<DeTable<'_>>,
) -> (Option<Scenario>, Vec<Finding>) {
    let mut findings = Vec::new();
    loop {
        match Scenario::deserialize(Deserializer::from(document.clone())) {
            Ok(scenario) => {
                let as_read = serde_json::to_value(&scenario).unwrap_or_default();
                push_unread(sources, &Key::root(), document.get_ref(), &as_read, &mut findings);
                return (Some(scenario), findings);
            }
            Err(error) => {
                let mistake = Mistake::of(document.get_ref(), &error);
                findings.push(mistake.finding(sources));
                match mistake.kind {
                    Kind::UnknownKey { .. } if findings.len() < MOST_UNKNOWN_KEYS => {
                        document::remove(document.get_mut(), mistake.key.segments());
                    }
                    _ => return (None, findings),
                }
            }
        }
    }
}

/// Keys that once stood elsewhere: table and name then, and the table now.
const MOVED: [(&str, &str, &str); 2] = [
    ("estimator", "source", "motion_capture"),
    ("estimator", "recording", "motion_capture"),
];

/// Numbers of a [`Vector`].
const LENGTH_OF_VECTOR: usize = std::mem::size_of::<Vector>() / std::mem::size_of::<f64>();

/// A mistake in the structure of a document.
struct Mistake {
    key: Key,
    span: Range<usize>,
    kind: Kind,
}

/// What serde and toml have to say, sorted. Their messages are the only form in which they say it.
enum Kind {
    UnknownKey { known: Vec<String> },
    UnknownChoice { found: String, known: Vec<String> },
    NotOneChoice,
    MissingKey,
    WrongType { found: String, wanted: String },
    Other(String),
}

impl Mistake {
    fn of(document: &DeTable<'_>, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or_default();
        let message = error.message();
        let quoted: Vec<String> = message.split('`').skip(1).step_by(2).map(str::to_owned).collect();
        let value_key = || document::key_of_value(document, &span, &names_in(error)).unwrap_or_default();
        let (key, kind) = match quoted.as_slice() {
            [_, known @ ..] if message.starts_with("unknown field") => {
                let known = known.to_vec();
                match document::key_of_name(document, &span) {
                    Some(key) => (key, Kind::UnknownKey { known }),
                    None => (value_key(), Kind::Other(message.to_owned())),
                }
            }
            [found, known @ ..] if message.starts_with("unknown variant") => {
                // The name of a table, such as a curve's, or a word.
                let key = document::key_of_name(document, &span).unwrap_or_else(value_key);
                let (found, known) = (found.clone(), known.to_vec());
                (key, Kind::UnknownChoice { found, known })
            }
            [name] if message.starts_with("missing field") => (value_key().then(name), Kind::MissingKey),
            [] if message.starts_with("wanted exactly 1 element") => (value_key(), Kind::NotOneChoice),
            _ => (value_key(), wrong_type(message)),
        };
        Self { key, span, kind }
    }

    fn finding(&self, sources: &Sources) -> Finding {
        let key = &self.key;
        let name = key.segments().last().map_or("", String::as_str);
        let (verdict, reason, fix) = match &self.kind {
            Kind::UnknownKey { known } => (
                "is unknown",
                format!("there is no key `{name}` here"),
                place_in_enclosing_table(key).unwrap_or_else(|| suggest::known_names(name, known)),
            ),
            Kind::UnknownChoice { found, known } => (
                "is none of the choices",
                format!("`{found}` is not known here"),
                suggest::known_names(found, known),
            ),
            Kind::NotOneChoice => (
                "is not one choice",
                "exactly one choice is wanted here".to_owned(),
                format!("state one of {}, and no other", keys::names_at(key).join(", ")),
            ),
            Kind::MissingKey => (
                "is missing",
                format!("`{name}` must be stated here"),
                keys::advice(key),
            ),
            Kind::WrongType { found, wanted } => (
                "has the wrong type",
                format!("{wanted} is wanted here, not {found}"),
                keys::advice(key),
            ),
            Kind::Other(message) => ("cannot be read", message.clone(), keys::advice(key)),
        };
        sources.finding(self.span.clone(), format!("`{key}` {verdict}"), reason, fix)
    }
}

/// Advice for an unknown key that belongs to a table around its own: in TOML a key belongs to the last header above it.
fn place_in_enclosing_table(key: &Key) -> Option<String> {
    let (name, table) = key.segments().split_last()?;
    let below = |owner: &str| format!("`{name}` belongs to `{owner}`: write it directly below `[{owner}]`");
    let moved = MOVED
        .iter()
        .find(|(then, moved, _)| table == [*then] && name == moved);
    if let Some((_, _, owner)) = moved {
        return Some(below(owner));
    }
    let enclosing = (0..table.len()).rev().map(|depth| &table[..depth]);
    let owner: Key = enclosing
        .map(|segments| segments.iter().cloned().collect::<Key>())
        .find(|owner| keys::names_at(owner).contains(&format!("`{name}`")))?;
    Some(if owner.segments().is_empty() {
        format!("`{name}` belongs to no table: write it above the first `[...]` of the file")
    } else {
        below(&owner.to_string())
    })
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
fn wrong_type(message: &str) -> Kind {
    let Some((found, wanted)) = message.split_once(", expected ") else {
        return Kind::Other(message.to_owned());
    };
    let wanted = match wanted {
        "f64" => "a number",
        "u32" | "u64" => "a whole number of 0 or more",
        "a boolean" => "`true` or `false`",
        "a sequence" => "an array",
        "an array of length 2" => "an array of two numbers",
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
    Kind::WrongType {
        found,
        wanted: wanted.to_owned(),
    }
}

/// Adds what serde does not find wrong: it reads the first three of four numbers, and an array in place of a
/// table. `read` is what it made of the table.
fn push_unread(sources: &Sources, at: &Key, table: &DeTable<'_>, read: &Value, findings: &mut Vec<Finding>) {
    for (name, value) in table {
        let name = name.get_ref();
        push_unread_value(sources, &at.then(name), value, &read[name.as_ref()], findings);
    }
}

fn push_unread_value(
    sources: &Sources,
    key: &Key,
    written: &Spanned<DeValue<'_>>,
    read: &Value,
    findings: &mut Vec<Finding>,
) {
    let wrong_type = |span, reason: String| {
        let title = format!("`{key}` has the wrong type");
        sources.finding(span, title, reason, keys::advice(key))
    };
    match (written.get_ref(), read) {
        (DeValue::Array(_), Value::Object(_)) => {
            let reason = "a table is wanted here, not an array".to_owned();
            findings.push(wrong_type(written.span(), reason));
        }
        (DeValue::Array(elements), Value::Array(_) | Value::Null) => {
            // Only a vector of zeros and an array of nothing are left out of what was read.
            let wanted = read.as_array().map_or(LENGTH_OF_VECTOR, Vec::len);
            for (index, element) in elements.iter().enumerate().take(wanted) {
                push_unread_value(sources, &key.then(index), element, &read[index], findings);
            }
            if let Some(unread) = elements.get(wanted) {
                let found = elements.len();
                let reason = format!("{wanted} elements are wanted here, not {found}");
                findings.push(wrong_type(unread.span(), reason));
            }
        }
        (DeValue::Table(table), _) => push_unread(sources, key, table, read, findings),
        _ => {}
    }
}
