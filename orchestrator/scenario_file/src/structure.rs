//! Whether a document has the keys and types of a scenario, and the scenario that it then is.

use std::ops::Range;

use scenario::schema::{resolved, schema, type_name};
use scenario::{Key, MOVED_KEYS, Scenario, suggest};
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeArray, DeFloat, DeInteger, DeString, DeTable, DeValue, Deserializer};

use super::sources::Sources;
use super::{Finding, document, keys};

/// Most mistakes that are told: a text that has more is something else than a scenario.
const MOST_FINDINGS: usize = 20;

/// The scenario of a document, if it can be made out at all, and what is wrong with the document's structure.
/// Unknown keys are removed from it, so that the rest can be judged all the same.
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
    if findings.len() > unknown.len() || findings.len() == MOST_FINDINGS {
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

/// A walk through a document beside the schema of scenarios.
struct Walk<'a> {
    sources: &'a Sources,
    /// Keys of which there are none.
    unknown: Vec<Key>,
    findings: Vec<Finding>,
}

impl Walk<'_> {
    fn push(&mut self, span: Range<usize>, key: &Key, verdict: &str, reason: String, fix: String) {
        if self.findings.len() < MOST_FINDINGS {
            let title = format!("`{key}` {verdict}");
            self.findings.push(self.sources.finding(span, title, reason, fix));
        }
    }

    fn push_wrong_type(&mut self, span: Range<usize>, key: &Key, reason: String) {
        self.push(span, key, "has the wrong type", reason, keys::advice(key));
    }

    /// A table with the names that belong there.
    fn table(&mut self, at: &Key, table: &DeTable<'_>, span: Range<usize>, part: &Value) {
        for (name, value) in table {
            let key = at.then(name.get_ref());
            let of_any_name = Some(&part["additionalProperties"]).filter(|part| part.is_object());
            match part["properties"].get(name.get_ref().as_ref()).or(of_any_name) {
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
        let fix = place_in_enclosing_table(key).unwrap_or_else(|| {
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
        let (wanted, span) = (wanted(part), written.span());
        match (written.get_ref(), wanted) {
            (DeValue::Table(table), Wanted::Table) => self.table(key, table, span, part),
            (DeValue::Table(table), Wanted::Choice(choices)) => self.choice(key, table, span, choices),
            (DeValue::Array(elements), Wanted::Array) => self.array(key, elements, span, part),
            (DeValue::String(word), Wanted::Word(choices)) => {
                let known: Vec<_> = choices
                    .iter()
                    .filter_map(|choice| choice["const"].as_str())
                    .collect();
                if !known.contains(&word.as_ref()) {
                    self.unknown_choice(span, key, word, &known);
                }
            }
            (DeValue::Float(number), Wanted::Number) if overflows(number) => {
                let reason = "floating-point number overflowed".to_owned();
                self.push(span, key, "cannot be read", reason, keys::advice(key));
            }
            (DeValue::Float(_) | DeValue::Integer(_), Wanted::Number)
            | (DeValue::Boolean(_), Wanted::Boolean)
            | (DeValue::String(_), Wanted::Text) => {}
            (DeValue::Integer(number), Wanted::Integer) if is_natural(number, part) => {}
            (found, wanted) => {
                let wanted = match wanted {
                    Wanted::Table | Wanted::Choice(_) => "a table",
                    Wanted::Word(_) => "a word",
                    Wanted::Array => array_in_words(part),
                    Wanted::Number => "a number",
                    Wanted::Integer => "a whole number of 0 or more",
                    Wanted::Boolean => "`true` or `false`",
                    Wanted::Text => "a text",
                };
                let reason = format!("{wanted} is wanted here, not {}", in_words(found));
                self.push_wrong_type(span, key, reason);
            }
        }
    }

    /// A table with one of the names that may be in it.
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
            let reason = "exactly one choice is wanted here".to_owned();
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
        if let Some(wanted) = part["maxItems"].as_u64().map(|wanted| wanted as usize) {
            let unread = elements.get(wanted);
            if let Some(unread) = unread {
                let reason = format!("{wanted} elements are wanted here, not {count}");
                self.push_wrong_type(unread.span(), key, reason);
            } else if count < wanted {
                let reason = format!(
                    "{} is wanted here, not one of length {count}",
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

/// The schema's demand in a place.
#[derive(Clone, Copy)]
enum Wanted<'a> {
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

fn wanted(part: &Value) -> Wanted<'_> {
    if let Some(choices) = part["oneOf"].as_array() {
        return if keys::is_table(part) {
            Wanted::Choice(choices)
        } else {
            Wanted::Word(choices)
        };
    }
    match type_name(part) {
        Some("array") => Wanted::Array,
        Some("number") => Wanted::Number,
        Some("integer") => Wanted::Integer,
        Some("boolean") => Wanted::Boolean,
        Some("string") => Wanted::Text,
        _ => Wanted::Table,
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
        DeValue::String(text) => format!("the text {text:?}"),
        DeValue::Integer(number) => format!("integer `{number}`"),
        DeValue::Float(number) => format!("floating point `{number}`"),
        DeValue::Boolean(value) => format!("boolean `{value}`"),
        DeValue::Datetime(_) => "a date or time".to_owned(),
    }
}

/// Advice for an unknown key that belongs to a table around its own: in TOML a key belongs to the last header above it.
fn place_in_enclosing_table(key: &Key) -> Option<String> {
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
