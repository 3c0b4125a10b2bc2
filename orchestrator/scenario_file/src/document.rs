//! Places in a TOML document.

use std::ops::Range;

use scenario::Key;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Span of the deepest part of the document on the way to a key: of its value if the document has one, of the
/// table that it belongs to if not.
pub(super) fn deepest_span(document: &Spanned<DeTable<'_>>, key: &Key) -> Range<usize> {
    let mut segments = key.segments().iter();
    let Some(mut place) = segments
        .next()
        .and_then(|name| document.get_ref().get(name.as_str()))
    else {
        return document.span();
    };
    for segment in segments {
        match child(place.get_ref(), segment) {
            Some(child) => place = child,
            None => break,
        }
    }
    place.span()
}

fn child<'a, 'i>(value: &'a DeValue<'i>, segment: &str) -> Option<&'a Spanned<DeValue<'i>>> {
    match value {
        DeValue::Table(table) => table.get(segment),
        DeValue::Array(array) => array.get(segment.parse::<usize>().ok()?),
        _ => None,
    }
}

/// Key of the name that stands at a span.
pub(super) fn key_of_name(table: &DeTable<'_>, span: &Range<usize>) -> Option<Key> {
    entries(table)
        .find(|entry| entry.name_span.as_ref() == Some(span))
        .map(|entry| entry.key)
}

/// Key of the deepest value at a span whose names, without positions in arrays, are `names`.
pub(super) fn key_of_value(table: &DeTable<'_>, span: &Range<usize>, names: &str) -> Option<Key> {
    let is_position = |segment: &String| segment.parse::<usize>().is_ok();
    let named = |key: &Key| {
        let names = key.segments().iter().filter(|segment| !is_position(segment));
        names.cloned().collect::<Vec<_>>().join(".")
    };
    entries(table)
        .filter(|entry| entry.value.span() == *span && named(&entry.key) == names)
        .max_by_key(|entry| entry.key.segments().len())
        .map(|entry| entry.key)
}

/// Removes the value of a key.
pub(super) fn remove(table: &mut DeTable<'_>, segments: &[String]) {
    match segments {
        [] => {}
        [name] => {
            table.remove(name.as_str());
        }
        [name, rest @ ..] => {
            if let Some(place) = table.get_mut(name.as_str()) {
                remove_inside(place.get_mut(), rest);
            }
        }
    }
}

fn remove_inside(value: &mut DeValue<'_>, segments: &[String]) {
    match (value, segments) {
        (DeValue::Table(table), _) => remove(table, segments),
        (DeValue::Array(array), [index, rest @ ..]) => {
            let element = index.parse::<usize>().ok().and_then(|index| array.get_mut(index));
            if let Some(element) = element {
                remove_inside(element.get_mut(), rest);
            }
        }
        _ => {}
    }
}

/// A value of the document.
struct Entry<'a, 'i> {
    key: Key,
    /// Where its name stands; an element of an array has none.
    name_span: Option<Range<usize>>,
    value: &'a Spanned<DeValue<'i>>,
}

/// All values of a table and of the tables and arrays in it.
fn entries<'a, 'i>(table: &'a DeTable<'i>) -> impl Iterator<Item = Entry<'a, 'i>> {
    let mut entries = Vec::new();
    push_table(&Key::root(), table, &mut entries);
    entries.into_iter()
}

fn push_table<'a, 'i>(at: &Key, table: &'a DeTable<'i>, entries: &mut Vec<Entry<'a, 'i>>) {
    for (name, value) in table {
        push_value(at.then(name.get_ref()), Some(name.span()), value, entries);
    }
}

fn push_value<'a, 'i>(
    key: Key,
    name_span: Option<Range<usize>>,
    value: &'a Spanned<DeValue<'i>>,
    entries: &mut Vec<Entry<'a, 'i>>,
) {
    match value.get_ref() {
        DeValue::Table(table) => push_table(&key, table, entries),
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                push_value(key.then(index), None, element, entries);
            }
        }
        _ => {}
    }
    entries.push(Entry {
        key,
        name_span,
        value,
    });
}
