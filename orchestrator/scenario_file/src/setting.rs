//! The `--set section.key=value` arguments: values in place of the file's own, or beside them.

use std::borrow::Cow;
use std::net::{IpAddr, SocketAddr};
use std::ops::Range;

use scenario::{Key, LawKind};
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::Finding;
use super::sources::Sources;

/// Name under which [`placed_values`] puts each value.
const VALUE: &str = "v";

/// The values of all arguments as TOML documents, each behind so many blanks that the value stands at the
/// offset at which the sources have it: a parser then gives it the right span.
pub(super) fn placed_values(sources: &Sources) -> Vec<String> {
    let values = sources.arguments().map(|(start, argument)| {
        let (key, value) = argument.split_once('=').unwrap_or((argument, ""));
        // Not by a width of a format, which ends at 65,535: a scenario may be longer.
        let blanks = " ".repeat((start + key.len()).saturating_sub(VALUE.len()));
        format!("{blanks}{VALUE}={value}")
    });
    values.collect()
}

/// Puts the values of all arguments, as [`placed_values`] makes them, into the document.
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

/// Keys of `[controller]` that concern any controller; the others are for Gerono's own laws.
const OF_ANY_CONTROLLER: [&str; 2] = ["rates", "telemetry"];

/// Finds the arguments that choose Gerono's own law or its gains, of a flight of another controller: what they name does
/// not fly.
pub(super) fn of_own_law(sources: &Sources, what_flies: &str) -> Vec<Finding> {
    let reason = format!("{what_flies}, and not Gerono's law, which this would change");
    let is_of_any = |names: &[&str]| OF_ANY_CONTROLLER.contains(&names[0]);
    without_effect(
        sources,
        is_of_any,
        &reason,
        "leave it out, or let Gerono's law fly",
    )
}

/// Finds the arguments that state gains of another law than the one that flies.
pub(super) fn of_another_law(sources: &Sources, law: LawKind) -> Vec<Finding> {
    let name = serde_json::to_value(law).expect("a law has a name");
    let name = name.as_str().unwrap_or_default();
    let reason = format!("the law `{name}` flies, and does not use it");
    let fix = "leave it out, or choose the law with `controller.law`";
    without_effect(sources, |names| law.uses(names), &reason, fix)
}

/// Finds the arguments of `[controller]` whose names, after that of the section, `has_effect` denies.
fn without_effect(
    sources: &Sources,
    has_effect: impl Fn(&[&str]) -> bool,
    reason: &str,
    fix: &str,
) -> Vec<Finding> {
    let without = sources
        .arguments()
        .filter(|(_, argument)| keys_of(argument).iter().any(|key| is_without(key, &has_effect)));
    let finding = |(start, argument): (usize, &str)| {
        let span = start..start + argument.len();
        sources.finding(span, "this argument has no effect", reason, fix)
    };
    without.map(finding).collect()
}

/// An argument: the names and positions that lead to the place, and the value.
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
    /// Reads an argument whose first character has the offset `start`, and its value where it is placed.
    fn parse(argument: &str, start: usize, value: &'i str) -> Result<Self, Refusal> {
        let Some((key, _)) = argument.split_once('=') else {
            return Err(Refusal::new(
                start..start + argument.len(),
                "there is no `=`",
                "write the place and the value, such as `controller.k1=5`",
            ));
        };
        Ok(Self {
            path: parse_path(key, start)?,
            value: parse_value(value)?,
        })
    }

    fn apply(self, document: &mut DeTable<'i>) -> Result<(), Refusal> {
        assign_in_table(document, &Key::root(), &self.path, self.value)
    }
}

/// Returns the key that a text names, if it names one.
#[must_use]
pub fn path_of(text: &str) -> Option<Key> {
    let path = parse_path(text, 0).ok()?;
    Some(path.into_iter().map(Spanned::into_inner).collect())
}

/// Returns whether a setting `KEY=VALUE` concerns a flight of a law.
#[must_use]
pub fn concerns(setting: &str, law: LawKind) -> bool {
    !keys_of(setting)
        .iter()
        .any(|key| is_without(key, |names| law.uses(names)))
}

/// Returns whether a key is one of `[controller]` whose names, after that of the section, `has_effect` denies.
fn is_without(key: &Key, has_effect: impl Fn(&[&str]) -> bool) -> bool {
    let names: Vec<_> = key.segments().iter().map(String::as_str).collect();
    matches!(&names[..], ["controller", rest @ ..] if !rest.is_empty() && !has_effect(rest))
}

/// Returns the keys that an argument assigns: of a table those inside.
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
        // A word without its quotes.
        None => keys.push(key),
    }
    keys
}

/// Returns the key that a setting `KEY=VALUE` assigns, if it names one.
#[must_use]
pub fn key_of_setting(setting: &str) -> Option<Key> {
    path_of(setting.split_once('=')?.0.trim())
}

/// The names and positions of a dotted key, as TOML reads it.
fn parse_path(key: &str, start: usize) -> Result<Vec<Spanned<String>>, Refusal> {
    let refused = |span: Range<usize>, reason: &str| {
        Refusal::new(
            start + span.start..start + span.end,
            reason,
            "write the names with dots between them, such as `vehicle.change.0.at`, and those that are not of letters, digits, `_` and `-` in quotes",
        )
    };
    let assignment = format!("{key}=0");
    let table = DeTable::parse(&assignment).map_err(|error| {
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

/// A value as TOML reads it, or a word as a string without its quotes; `placed` as [`placed_values`] makes it.
fn parse_value(placed: &str) -> Result<Spanned<DeValue<'_>>, Refusal> {
    let behind_sign = placed.find('=').map_or(0, |sign| sign + 1);
    let text = placed[behind_sign..].trim();
    let start = placed.len() - placed[behind_sign..].trim_start().len();
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
    Err(Refusal::new(
        span,
        format!("this is not a TOML value: {reason}"),
        "write a number, `true` or `false`, a word, or an array such as `[0.0, 0.0, -1.0]`",
    ))
}

/// Returns whether a value that TOML does not understand is plainly meant as a string: a word, a path or an address.
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
    if let Some(place) = table.get_mut(name.get_ref().as_str()) {
        return assign(place, &key, rest, value);
    }
    let place = built(&key, rest, value)?;
    table.insert(
        Spanned::new(name.span(), Cow::Owned(name.get_ref().clone())),
        place,
    );
    Ok(())
}

/// Puts a value where `path` leads to from `place`, whose key is `at`.
fn assign<'i>(
    place: &mut Spanned<DeValue<'i>>,
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<(), Refusal> {
    let Some(name) = path.first() else {
        *place = value;
        return Ok(());
    };
    match place.get_mut() {
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
        array.push(built(&key, rest, value)?);
        Ok(())
    } else {
        Err(Refusal::new(
            position.span(),
            format!(
                "`{at}` has {count} elements, and none of them is `{}`",
                position.get_ref()
            ),
            format!("choose a position from 0 to {count}, where {count} adds one"),
        ))
    }
}

/// The tables and arrays that `path` leads through from a place that does not exist yet, around the value.
fn built<'i>(
    at: &Key,
    path: &[Spanned<String>],
    value: Spanned<DeValue<'i>>,
) -> Result<Spanned<DeValue<'i>>, Refusal> {
    let Some(name) = path.first() else {
        return Ok(value);
    };
    // No key of a scenario is a number: a number is a position.
    let mut place = if name.get_ref().parse::<usize>().is_ok() {
        Spanned::new(name.span(), DeValue::Array(DeArray::new()))
    } else {
        Spanned::new(name.span(), DeValue::Table(DeTable::new()))
    };
    assign(&mut place, at, path, value)?;
    Ok(place)
}
