//! Positions in a TOML document.

use std::ops::Range;

use scenario::Key;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Returns the span of a key's value, or of the innermost existing table on its path.
pub(super) fn deepest_span(document: &Spanned<DeTable<'_>>, key: &Key) -> Range<usize> {
    let mut segments = key.segments().iter();
    let Some(mut value) = segments
        .next()
        .and_then(|name| document.get_ref().get(name.as_str()))
    else {
        return document.span();
    };
    for segment in segments {
        match child(value.get_ref(), segment) {
            Some(child) => value = child,
            None => break,
        }
    }
    value.span()
}

/// Returns whether the document states a value for a key.
pub(super) fn states(document: &Spanned<DeTable<'_>>, key: &Key) -> bool {
    let Some((first, rest)) = key.segments().split_first() else {
        return true;
    };
    let first = document.get_ref().get(first.as_str());
    let found = rest
        .iter()
        .try_fold(first, |value, segment| Some(child(value?.get_ref(), segment)));
    found.flatten().is_some()
}

fn child<'a, 'i>(value: &'a DeValue<'i>, segment: &str) -> Option<&'a Spanned<DeValue<'i>>> {
    match value {
        DeValue::Table(table) => table.get(segment),
        DeValue::Array(array) => array.get(segment.parse::<usize>().ok()?),
        _ => None,
    }
}

/// Removes the value of a key.
pub(super) fn remove(table: &mut DeTable<'_>, segments: &[String]) {
    match segments {
        [] => {}
        [name] => {
            table.remove(name.as_str());
        }
        [name, rest @ ..] => {
            if let Some(value) = table.get_mut(name.as_str()) {
                remove_inside(value.get_mut(), rest);
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
