//! Planned events of a file after the end of a flight that a `--set` argument has shortened.

use std::ops::Range;

use scenario::Key;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::sources::Sources;

/// Time of an event in an array of events.
const AT: &str = "at";

/// Removes the events that the file states after a duration that an argument states. Returns a note about them, if any.
///
/// Events that an argument states stay, and are refused: the user has asked for both.
pub(super) fn remove(sources: &Sources, document: &mut Spanned<DeTable<'_>>) -> Option<String> {
    let of_arguments = sources.arguments().next()?.0;
    let stated = document.get_ref().get("duration")?;
    let duration = number(stated.get_ref()).filter(|_| stated.span().start >= of_arguments)?;
    let mut removal = Removal {
        duration,
        file: 0..of_arguments,
        removed: Vec::new(),
    };
    removal.table(&Key::root(), document.get_mut());
    (!removal.removed.is_empty()).then(|| {
        format!(
            "the duration of {duration:?} s is that of `--set`: left out what the scenario plans after it, {}",
            removal.removed.join(", ")
        )
    })
}

struct Removal {
    duration: f64,
    /// Offsets of the file's text.
    file: Range<usize>,
    removed: Vec<String>,
}

impl Removal {
    fn table(&mut self, at: &Key, table: &mut DeTable<'_>) {
        let mut names = Vec::new();
        for (name, value) in table.iter_mut() {
            let name = name.get_ref().to_string();
            if self.is_removed(&at.then(&name), &name, value) {
                names.push(name);
            }
        }
        for name in names {
            table.remove(name.as_str());
        }
    }

    /// Removes later events inside a value. Returns whether the value itself is to be removed.
    fn is_removed(&mut self, key: &Key, name: &str, value: &mut Spanned<DeValue<'_>>) -> bool {
        let time = match value.get_mut() {
            // Its fan would never be switched on.
            DeValue::Table(inner) => {
                let time = inner.get("on_at").and_then(|on_at| self.later(on_at));
                if time.is_none() {
                    self.table(key, inner);
                }
                time
            }
            DeValue::Array(elements) => {
                self.array(key, elements);
                None
            }
            _ if name.ends_with("_at") => self.later(value),
            _ => None,
        };
        self.removed
            .extend(time.map(|time| format!("`{key}` at {time:?} s")));
        time.is_some()
    }

    fn array(&mut self, key: &Key, elements: &mut DeArray<'_>) {
        let all = std::mem::replace(elements, DeArray::new());
        for mut element in all {
            let time = match element.get_mut() {
                DeValue::Table(event) => {
                    let time = event.get(AT).and_then(|time| self.later(time));
                    if time.is_none() {
                        self.table(key, event);
                    }
                    time
                }
                _ => None,
            };
            match time {
                Some(time) => self.removed.push(format!("`{key}` at {time:?} s")),
                None => elements.push(element),
            }
        }
    }

    /// Returns the time that the file states, if it is after the end.
    fn later(&self, time: &Spanned<DeValue<'_>>) -> Option<f64> {
        let stated = number(time.get_ref())?;
        (stated > self.duration && self.file.contains(&time.span().start)).then_some(stated)
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(number) => number.as_str().parse().ok(),
        DeValue::Integer(number) => number.as_str().parse().ok(),
        _ => None,
    }
}
