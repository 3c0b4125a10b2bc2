//! The `--set section.key=value` arguments, which override or add values.

use std::borrow::Cow;
use std::net::{IpAddr, SocketAddr};
use std::ops::Range;

use scenario::{Key, LawKind};
use shared_types::Topic;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::sources::Sources;
use super::{Finding, keys, slips};

/// Key of each value in [`placed_values`].
const VALUE: &str = "v";

/// Returns the values of all arguments as TOML documents, each indented to its offset in the sources, so that the parser
/// gives it the right span.
pub(super) fn placed_values(sources: &Sources) -> Vec<String> {
    let values = sources.arguments().map(|(start, argument)| {
        let (key, value) = argument.split_once('=').unwrap_or((argument, ""));
        // The width of a format is limited to 65,535, and a scenario may be longer.
        let blanks = " ".repeat((start + key.len()).saturating_sub(VALUE.len()));
        format!("{blanks}{VALUE}={value}")
    });
    values.collect()
}

/// Writes the values of all arguments, made by [`placed_values`], into the document.
pub(super) fn apply_all<'i>(
    sources: &Sources,
    values: &'i [String],
    document: &mut DeTable<'i>,
) -> Result<(), Vec<Finding>> {
    let mut findings = Vec::new();
    for ((start, argument), value) in sources.arguments().zip(values) {
        let applied = Setting::parse(argument, start, value).and_then(|setting| setting.apply(document));
        if let Err(refusal) = applied {
            findings.push(sources.finding(
                refusal.span,
                "this argument cannot be used",
                refusal.reason,
                refusal.fix,
            ));
        }
    }
    if findings.is_empty() {
        Ok(())
    } else {
        Err(findings)
    }
}

/// Keys of `[controller]` that apply to any controller; the others apply to Gerono's own laws.
const OF_ANY_CONTROLLER: [&str; 2] = ["rates", "telemetry"];

/// Finds the arguments for Gerono's own law in a flight with another controller, on which they have no effect.
pub(super) fn of_own_law(sources: &Sources, what_flies: &str) -> Vec<Finding> {
    let reason = format!("{what_flies}, and not Gerono's law, which this would change");
    let is_of_any = |names: &[&str]| OF_ANY_CONTROLLER.contains(&names[0]);
    without_effect(sources, is_of_any, &reason, "leave it out, or fly Gerono's law")
}

/// Finds the arguments for gains that the law does not use.
pub(super) fn of_another_law(sources: &Sources, law: LawKind) -> Vec<Finding> {
    let name = serde_json::to_value(law).expect("a law has a name");
    let name = name.as_str().unwrap_or_default();
    let reason = format!("the law `{name}` flies, and does not use it");
    let fix = "leave it out, or choose the law with `controller.law`";
    without_effect(sources, |names| law.uses(names), &reason, fix)
}

/// Finds the arguments of `[controller]` without an effect, by the segments of their keys after the section.
fn without_effect(
    sources: &Sources,
    has_effect: impl Fn(&[&str]) -> bool,
    reason: &str,
    fix: &str,
) -> Vec<Finding> {
    let without = sources.arguments().filter(|(_, argument)| {
        keys_of(argument)
            .iter()
            .any(|key| is_without_effect(key, &has_effect))
    });
    let finding = |(start, argument): (usize, &str)| {
        let span = start..start + argument.len();
        sources.finding(span, "this argument has no effect", reason, fix)
    };
    without.map(finding).collect()
}

/// Argument: key and value.
struct Setting<'i> {
    path: Vec<Spanned<String>>,
    value: Spanned<DeValue<'i>>,
}

/// Reason why an argument cannot be used.
struct Refusal {
    span: Range<usize>,
    reason: String,
    fix: String,
}

impl Refusal {
    fn new(span: Range<usize>, reason: impl Into<String>, fix: impl Into<String>) -> Self {
        Self {
            span,
            reason: reason.into(),
            fix: fix.into(),
        }
    }
}

impl<'i> Setting<'i> {
    /// Parses an argument at the offset `start`, and its value as made by [`placed_values`].
    fn parse(argument: &str, start: usize, value: &'i str) -> Result<Self, Refusal> {
        let Some((key, _)) = argument.split_once('=') else {
            return Err(Refusal::new(
                start..start + argument.len(),
                "there is no `=`",
                "write key and value, such as `controller.k1=5`",
            ));
        };
        Ok(Self {
            path: parse_path(key, start)?,
            value: parse_value(value, key)?,
        })
    }

    fn apply(self, document: &mut DeTable<'i>) -> Result<(), Refusal> {
        assign_in_table(document, &Key::root(), &self.path, self.value)
    }
}

/// Parses a key; `None` if the text is not one.
#[must_use]
pub fn path_of(text: &str) -> Option<Key> {
    let path = parse_path(text, 0).ok()?;
    Some(path.into_iter().map(Spanned::into_inner).collect())
}

/// Returns whether a setting `KEY=VALUE` has an effect on a law.
#[must_use]
pub fn concerns(setting: &str, law: LawKind) -> bool {
    !keys_of(setting)
        .iter()
        .any(|key| is_without_effect(key, |names| law.uses(names)))
}

/// Returns whether a key of `[controller]` has no effect, by its segments after the section.
fn is_without_effect(key: &Key, has_effect: impl Fn(&[&str]) -> bool) -> bool {
    let names: Vec<_> = key.segments().iter().map(String::as_str).collect();
    matches!(&names[..], ["controller", rest @ ..] if !rest.is_empty() && !has_effect(rest))
}

/// Returns the keys that an argument assigns, including those inside a table.
fn keys_of(argument: &str) -> Vec<Key> {
    fn inside(at: Key, value: &toml::Value, keys: &mut Vec<Key>) {
        match value {
            toml::Value::Table(table) => {
                for (name, value) in table {
                    inside(at.then(name), value, keys);
                }
            }
            _ => keys.push(at),
        }
    }
    let mut keys = Vec::new();
    let Some(key) = key_of_setting(argument) else {
        return keys;
    };
    let value = argument.split_once('=').map_or("", |(_, value)| value);
    let table = toml::from_str::<toml::Table>(&format!("{VALUE}={value}"));
    match table.ok().and_then(|mut table| table.remove(VALUE)) {
        Some(value) => inside(key, &value, &mut keys),
        // A string without quotes.
        None => keys.push(key),
    }
    keys
}

/// Returns the key of a setting `KEY=VALUE`, if valid.
#[must_use]
pub fn key_of_setting(setting: &str) -> Option<Key> {
    path_of(setting.split_once('=')?.0.trim())
}

/// Parses a dotted key to its names and positions, with TOML's syntax.
fn parse_path(key: &str, start: usize) -> Result<Vec<Spanned<String>>, Refusal> {
    let refused = |span: Range<usize>, reason: &str| {
        Refusal::new(
            start + span.start..start + span.end,
            reason,
            "write names separated by dots, such as `vehicle.change.0.at`; quote names with other characters than letters, digits, `_` and `-`",
        )
    };
    let assignment = format!("{key}=0");
    let table = DeTable::parse(&assignment).map_err(|error| {
        if let Some(fix) = unquoted_name(key) {
            let span = error.span().unwrap_or_default();
            let span = start + span.start..start + span.end;
            return Refusal::new(span, format!("this is not a key: {}", error.message()), fix);
        }
        refused(
            error.span().unwrap_or_default(),
            &format!("this is not a key: {}", error.message()),
        )
    })?;
    let mut path = Vec::new();
    let mut table = table.get_ref();
    while let Some((name, value)) = table.iter().next() {
        let span = name.span();
        path.push(Spanned::new(
            start + span.start..start + span.end,
            name.get_ref().to_string(),
        ));
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            _ => return Ok(path),
        }
    }
    Err(refused(0..key.len(), "this is not a key"))
}

/// Returns the fix for a key such as `schedule.latency.rc/frame`, whose last name is a topic or an edge without quotes.
fn unquoted_name(key: &str) -> Option<String> {
    // Tables with free names that are topics, or edges of topics.
    const OF_TOPICS: [&str; 3] = ["schedule.period.", "schedule.phase.", "record.every."];
    const OF_EDGES: [&str; 2] = ["schedule.latency.", "safety."];
    let tables = OF_TOPICS.map(|table| (table, false)).into_iter();
    let mut tables = tables.chain(OF_EDGES.map(|table| (table, true)));
    let (table, is_of_edges) = tables.find(|(table, _)| key.starts_with(table))?;
    let name = key[table.len()..].trim().trim_matches('"');
    let topic = Topic::ALL
        .into_iter()
        .find(|topic| name.starts_with(topic.name()))?;
    let names: Vec<_> = if is_of_edges {
        topic
            .consumers()
            .map(|(service, _)| format!("{topic} -> {service}"))
            .filter(|edge| !name.contains("->") || edge == name)
            .collect()
    } else {
        vec![topic.to_string()]
    };
    let keys: Vec<_> = names.iter().map(|name| format!("`{table}\"{name}\"`")).collect();
    (!keys.is_empty()).then(|| format!("put the name in quotes: {}", keys.join(" or ")))
}

/// Parses a TOML value made by [`placed_values`], or a string without quotes.
fn parse_value<'i>(placed: &'i str, key: &str) -> Result<Spanned<DeValue<'i>>, Refusal> {
    let after_sign = placed.find('=').map_or(0, |sign| sign + 1);
    let text = placed[after_sign..].trim();
    let start = placed.len() - placed[after_sign..].trim_start().len();
    let span = start..start + text.len();
    if text.is_empty() {
        return Err(Refusal::new(
            span,
            "there is no value",
            "write a value after the `=`",
        ));
    }
    let reason = match DeTable::parse(placed).map(Spanned::into_inner) {
        Ok(mut table) if table.len() == 1 => match table.remove(VALUE) {
            Some(value) => return Ok(value),
            None => "more than a value".to_owned(),
        },
        Ok(_) => "more than a value".to_owned(),
        Err(_) if is_word(text) => return Ok(Spanned::new(span, DeValue::String(Cow::Borrowed(text)))),
        Err(error) => error.message().to_owned(),
    };
    if let Some(advice) = slips::advice(text, keys::unit_of_key(key)) {
        return Err(Refusal::new(span, "this is not a number", advice));
    }
    Err(Refusal::new(
        span,
        format!("this is not a TOML value: {reason}"),
        "write a number, `true` or `false`, a word, or an array such as `[0.0, 0.0, -1.0]`",
    ))
}

/// Returns whether an invalid TOML value is a string without quotes: a word, a path or an address.
fn is_word(text: &str) -> bool {
    let is_punctuation = |character| matches!(character, '"' | '\'' | '[' | ']' | '{' | '}' | '=');
    let is_address = text.parse::<IpAddr>().is_ok() || text.parse::<SocketAddr>().is_ok();
    let is_path =
        matches!(text, "." | "..") || ["/", "./", "../"].iter().any(|begin| text.starts_with(begin));
    is_address || (is_path || text.starts_with(char::is_alphabetic)) && !text.contains(is_punctuation)
}

fn assign_in_table<'i>(
    table: &mut DeTable<'i>,
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<(), Refusal> {
    let [name, rest @ ..] = path else {
        return Ok(());
    };
    let key = at.then(name.get_ref());
    if let Some(target) = table.get_mut(name.get_ref().as_str()) {
        return assign(target, &key, rest, value);
    }
    let target = nested(&key, rest, value)?;
    table.insert(
        Spanned::new(name.span(), Cow::Owned(name.get_ref().clone())),
        target,
    );
    Ok(())
}

/// Assigns a value at `path`, relative to `target`, whose key is `at`.
fn assign<'i>(
    target: &mut Spanned<DeValue<'i>>,
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<(), Refusal> {
    let Some(name) = path.first() else {
        *target = value;
        return Ok(());
    };
    match target.get_mut() {
        DeValue::Table(table) => assign_in_table(table, at, path, value),
        DeValue::Array(array) => assign_in_array(array, at, path, value),
        scalar => Err(Refusal::new(
            name.span(),
            format!(
                "`{at}` is one value ({}), so nothing is inside it",
                scalar.type_str()
            ),
            format!("set `{at}` itself"),
        )),
    }
}

fn assign_in_array<'i>(
    array: &mut DeArray<'i>,
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<(), Refusal> {
    let [position, rest @ ..] = path else {
        return Ok(());
    };
    let count = array.len();
    let key = at.then(position.get_ref());
    let index = position.get_ref().parse::<usize>().unwrap_or(usize::MAX);
    if let Some(element) = array.get_mut(index) {
        assign(element, &key, rest, value)
    } else if index == count {
        array.push(nested(&key, rest, value)?);
        Ok(())
    } else {
        Err(Refusal::new(
            position.span(),
            format!(
                "`{at}` has {count} element{}, and `{}` is none of its positions",
                if count == 1 { "" } else { "s" },
                position.get_ref()
            ),
            format!("choose a position from 0 to {count}, where {count} adds one"),
        ))
    }
}

/// Wraps a value in the tables and arrays of `path`.
fn nested<'i>(
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<Spanned<DeValue<'i>>, Refusal> {
    let Some(name) = path.first() else {
        return Ok(value);
    };
    // A number is always a position: no key of a scenario is a number.
    let mut target = if name.get_ref().parse::<usize>().is_ok() {
        Spanned::new(name.span(), DeValue::Array(DeArray::new()))
    } else {
        Spanned::new(name.span(), DeValue::Table(DeTable::new()))
    };
    assign(&mut target, at, path, value)?;
    Ok(target)
}
