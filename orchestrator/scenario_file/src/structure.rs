//! Check of a document's keys and types, and conversion to a scenario.

use std::ops::Range;

use scenario::schema::{resolved, schema, type_name};
use scenario::{Key, MOVED_KEYS, Scenario, suggest};
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeArray, DeFloat, DeInteger, DeString, DeTable, DeValue, Deserializer};

use super::sources::Sources;
use super::{Finding, document, keys, slips};

/// Maximum number of reported findings: a text with more is probably not a scenario.
const MAX_FINDINGS: usize = 20;

/// Returns the scenario of a document, if it can be read, and the findings about its structure. Removes unknown keys, so
/// that the rest can be checked.
pub(super) fn read(
    sources: &Sources,
    document: &mut Spanned<DeTable<'_>>,
) -> (Option<Scenario>, Vec<Finding>) {
    let mut walk = Walk {
        sources,
        unknown: Vec::new(),
        findings: Vec::new(),
    };
    let whole = schema().as_value();
    walk.table(&Key::root(), document.get_ref(), document.span(), whole);
    let Walk {
        unknown,
        mut findings,
        ..
    } = walk;
    if findings.len() > unknown.len() || findings.len() == MAX_FINDINGS {
        return (None, findings);
    }
    for key in &unknown {
        document::remove(document.get_mut(), key.segments());
    }
    match Scenario::deserialize(Deserializer::from(document.clone())) {
        Ok(scenario) => (Some(scenario), findings),
        Err(error) => {
            let span = error.span().unwrap_or_default();
            let fix = "see docs/scenarios.md for the keys of a scenario";
            findings.push(sources.finding(span, "this cannot be read", error.message(), fix));
            (None, findings)
        }
    }
}

/// Walk through a document and the schema in parallel.
struct Walk<'a> {
    sources: &'a Sources,
    /// Unknown keys.
    unknown: Vec<Key>,
    findings: Vec<Finding>,
}

impl Walk<'_> {
    fn push(&mut self, span: Range<usize>, key: &Key, verdict: &str, reason: String, fix: String) {
        if self.findings.len() < MAX_FINDINGS {
            let title = format!("`{key}` {verdict}");
            self.findings.push(self.sources.finding(span, title, reason, fix));
        }
    }

    fn push_wrong_type(&mut self, span: Range<usize>, key: &Key, reason: String) {
        self.push(span, key, "has the wrong type", reason, keys::advice(key));
    }

    /// Checks a table.
    fn table(&mut self, at: &Key, table: &DeTable<'_>, span: Range<usize>, part: &Value) {
        for (name, value) in table {
            let key = at.then(name.get_ref());
            let any_name = Some(&part["additionalProperties"]).filter(|part| part.is_object());
            match part["properties"].get(name.get_ref().as_ref()).or(any_name) {
                Some(part) => self.value(&key, value, part),
                None => self.unknown_key(name, &key, part),
            }
        }
        let required = part["required"].as_array().into_iter().flatten();
        for name in required
            .filter_map(Value::as_str)
            .filter(|name| !table.contains_key(*name))
        {
            let key = at.then(name);
            let reason = format!("`{name}` must be stated here");
            self.push(span.clone(), &key, "is missing", reason, keys::advice(&key));
        }
    }

    fn unknown_key(&mut self, name: &Spanned<DeString<'_>>, key: &Key, table: &Value) {
        let fix = advice_on_table(key).unwrap_or_else(|| {
            let known = table["properties"].as_object().into_iter().flatten();
            let mut known: Vec<_> = known.map(|(name, _)| name).collect();
            known.sort();
            suggest::known_names(name.get_ref(), &known)
        });
        let reason = format!("there is no key `{}` here", name.get_ref());
        self.push(name.span(), key, "is unknown", reason, fix);
        self.unknown.push(key.clone());
    }

    fn value(&mut self, key: &Key, written: &Spanned<DeValue<'_>>, part: &Value) {
        let part = resolved(part);
        let (expected, span) = (expected(part), written.span());
        match (written.get_ref(), expected) {
            (DeValue::Table(table), Expected::Table) => self.table(key, table, span, part),
            (DeValue::Table(table), Expected::Choice(choices)) => self.choice(key, table, span, choices),
            (DeValue::Array(elements), Expected::Array) => self.array(key, elements, span, part),
            (DeValue::String(word), Expected::Word(choices)) => {
                let known: Vec<_> = choices
                    .iter()
                    .filter_map(|choice| choice["const"].as_str())
                    .collect();
                if !known.contains(&word.as_ref()) {
                    self.unknown_choice(span, key, word, &known);
                }
            }
            (DeValue::Float(number), Expected::Number) if overflows(number) => {
                let reason = "floating-point number overflowed".to_owned();
                self.push(span, key, "cannot be read", reason, keys::advice(key));
            }
            (DeValue::Float(_) | DeValue::Integer(_), Expected::Number)
            | (DeValue::Boolean(_), Expected::Boolean)
            | (DeValue::String(_), Expected::Text) => {}
            (DeValue::Integer(number), Expected::Integer) if is_natural(number, part) => {}
            (found, expected) => {
                let expected = match expected {
                    Expected::Table | Expected::Choice(_) => "a table",
                    Expected::Word(_) => "a word",
                    Expected::Array => array_in_words(part),
                    Expected::Number => "a number",
                    Expected::Integer => "a whole number of 0 or more",
                    Expected::Boolean => "`true` or `false`",
                    Expected::Text => "a string",
                };
                let reason = format!("{expected} is expected here, not {}", in_words(found));
                match slip_in(found, expected, key) {
                    Some(fix) => self.push(span, key, "has the wrong type", reason, fix),
                    None => self.push_wrong_type(span, key, reason),
                }
            }
        }
    }

    /// Checks a table that must contain exactly one of the choices.
    fn choice(&mut self, key: &Key, table: &DeTable<'_>, span: Range<usize>, choices: &[Value]) {
        let choices = choices
            .iter()
            .filter_map(|choice| choice["properties"].as_object());
        let choices: Vec<_> = choices.flatten().collect();
        let known: Vec<_> = choices.iter().map(|(name, _)| name).collect();
        let mut all_known = true;
        for (name, value) in table {
            let key = key.then(name.get_ref());
            match choices.iter().find(|(known, _)| *known == name.get_ref()) {
                Some((_, part)) => self.value(&key, value, part),
                None => {
                    self.unknown_choice(name.span(), &key, name.get_ref(), &known);
                    all_known = false;
                }
            }
        }
        if all_known && table.len() != 1 {
            let reason = "exactly one choice is expected here".to_owned();
            let fix = format!("state one of {}, and no other", keys::names_at(key).join(", "));
            self.push(span, key, "is not one choice", reason, fix);
        }
    }

    fn unknown_choice(&mut self, span: Range<usize>, key: &Key, found: &str, known: &[impl AsRef<str>]) {
        let reason = format!("`{found}` is not known here");
        let fix = suggest::known_names(found, known);
        self.push(span, key, "is none of the choices", reason, fix);
    }

    fn array(&mut self, key: &Key, elements: &DeArray<'_>, span: Range<usize>, part: &Value) {
        let count = elements.len();
        if let Some(expected) = part["maxItems"].as_u64().map(|expected| expected as usize) {
            let unread = elements.get(expected);
            if let Some(unread) = unread {
                let reason = format!("{expected} elements are expected here, not {count}");
                self.push_wrong_type(unread.span(), key, reason);
            } else if count < expected {
                let reason = format!(
                    "{} is expected here, not one of length {count}",
                    array_in_words(part)
                );
                self.push_wrong_type(span, key, reason);
            }
        }
        for (index, element) in elements.iter().enumerate() {
            self.value(&key.then(index), element, &part["items"]);
        }
    }
}

/// Form of a value that the schema requires.
#[derive(Clone, Copy)]
enum Expected<'a> {
    Table,
    /// A table with one of these.
    Choice(&'a [Value]),
    /// One of these.
    Word(&'a [Value]),
    Array,
    Number,
    Integer,
    Boolean,
    Text,
}

fn expected(part: &Value) -> Expected<'_> {
    if let Some(choices) = part["oneOf"].as_array() {
        return if keys::is_table(part) {
            Expected::Choice(choices)
        } else {
            Expected::Word(choices)
        };
    }
    match type_name(part) {
        Some("array") => Expected::Array,
        Some("number") => Expected::Number,
        Some("integer") => Expected::Integer,
        Some("boolean") => Expected::Boolean,
        Some("string") => Expected::Text,
        _ => Expected::Table,
    }
}

/// Returns the fix for a string that is a number but for a comma or a unit.
fn slip_in(found: &DeValue<'_>, expected: &str, key: &Key) -> Option<String> {
    match found {
        DeValue::String(text) if expected.contains("number") => {
            slips::advice(text, keys::unit_of_key(&key.to_string()))
        }
        _ => None,
    }
}

fn overflows(number: &DeFloat<'_>) -> bool {
    let text = number.as_str();
    !text.contains("inf") && text.parse().is_ok_and(f64::is_infinite)
}

fn is_natural(number: &DeInteger<'_>, part: &Value) -> bool {
    let most = if part["format"] == "uint32" {
        u32::MAX.into()
    } else {
        u64::MAX
    };
    let number = u64::from_str_radix(number.as_str(), number.radix());
    number.is_ok_and(|number| number <= most)
}

fn array_in_words(part: &Value) -> &'static str {
    match part["minItems"].as_u64() {
        Some(2) => "an array of two numbers",
        Some(3) => "an array of three numbers",
        Some(4) => "an array of four numbers",
        _ => "an array",
    }
}

fn in_words(found: &DeValue<'_>) -> String {
    match found {
        DeValue::Table(_) => "a table".to_owned(),
        DeValue::Array(_) => "an array".to_owned(),
        DeValue::String(text) => format!("the string {text:?}"),
        DeValue::Integer(number) => format!("integer `{number}`"),
        DeValue::Float(number) => format!("floating point `{number}`"),
        DeValue::Boolean(value) => format!("boolean `{value}`"),
        DeValue::Datetime(_) => "a date or time".to_owned(),
    }
}

/// Returns advice for an unknown key that belongs to an enclosing table: in TOML a key belongs to the last header above it.
fn advice_on_table(key: &Key) -> Option<String> {
    let (name, table) = key.segments().split_last()?;
    let below = |owner: &str| format!("`{name}` belongs to `{owner}`: write it directly below `[{owner}]`");
    let moved = MOVED_KEYS
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
