//! Every number of a scenario against the range that its key declares, as the schema has it.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Bound;

use serde_json::{Value as Schema, json};
use toml::Value;

use crate::check::Findings;
use crate::schema::{resolved, schema, type_name};
use crate::{Key, Range, Scenario};

/// A number of a scenario: the way to it, and its range.
type Number = (Vec<String>, Range);

/// Makes a value of a part of the schema, with every key that there can be; of tables of which a value is one, the one
/// at `choice`. Notes the numbers.
fn whole(part: &Schema, choice: usize, at: &[String], numbers: &mut Vec<Number>) -> Value {
    let part = resolved(part);
    let mut inside = |part, name: &str| whole(part, choice, &[at, &[name.to_owned()]].concat(), numbers);
    if let Some(choices) = part["oneOf"].as_array() {
        return match choices[0]["const"].as_str() {
            Some(word) => word.into(),
            None => whole(&choices[choice % choices.len()], choice, at, numbers),
        };
    }
    match type_name(part).unwrap() {
        "object" if part["additionalProperties"].is_object() => {
            let named = inside(&part["additionalProperties"], "any name");
            Value::Table([("any name".to_owned(), named)].into_iter().collect())
        }
        "object" => {
            let keys = part["properties"].as_object().unwrap().iter();
            Value::Table(
                keys.map(|(name, part)| (name.clone(), inside(part, name)))
                    .collect(),
            )
        }
        "array" => {
            let count = part["minItems"].as_u64().unwrap_or(1);
            let elements = (0..count).map(|position| inside(&part["items"], &position.to_string()));
            Value::Array(elements.collect())
        }
        "boolean" => true.into(),
        "string" => "text".into(),
        _ => {
            let range = Range::from_schema(part);
            numbers.push((at.to_vec(), range));
            number(part, just_inside(&range)[0])
        }
    }
}

fn number(part: &Schema, value: f64) -> Value {
    match type_name(part) {
        Some("integer") => Value::Integer(value as i64),
        _ => Value::Float(value),
    }
}

fn just_inside(range: &Range) -> Vec<f64> {
    let (least, most) = (range.least, range.most);
    let edge = |bound, beside: fn(f64) -> f64, far| match bound {
        Bound::Included(edge) => edge,
        Bound::Excluded(edge) => beside(edge),
        Bound::Unbounded => far,
    };
    vec![edge(least, f64::next_up, -1e9), edge(most, f64::next_down, 1e9)]
}

fn just_outside(range: &Range) -> Vec<f64> {
    let step: [fn(f64) -> f64; 2] = match range.is_whole {
        true => [|edge| edge - 1.0, |edge| edge + 1.0],
        false => [f64::next_down, f64::next_up],
    };
    let edge = |bound, beside: fn(f64) -> f64, far: f64| match bound {
        Bound::Included(edge) => beside(edge),
        Bound::Excluded(edge) => edge,
        Bound::Unbounded => far,
    };
    let (least, most) = (range.least, range.most);
    let edges = [edge(least, step[0], -1.1e9), edge(most, step[1], 1.1e9)];
    match range.is_whole {
        // A whole number without a largest one may be any, and none is below 0.
        true => edges
            .into_iter()
            .filter(|edge| *edge >= 0.0 && *edge != 1.1e9)
            .collect(),
        false => [edges.as_slice(), &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]].concat(),
    }
}

fn place<'a>(value: &'a mut Value, way: &[String]) -> &'a mut Value {
    way.iter().fold(value, |value, name| match value {
        Value::Array(elements) => &mut elements[name.parse::<usize>().unwrap()],
        value => &mut value[name.as_str()],
    })
}

/// The keys of numbers out of their ranges. That times are whole ticks is another rule.
fn keys_out_of_range(scenario: &Scenario) -> Vec<String> {
    let mut problems = Findings::from_ranges(scenario).problems;
    problems.retain(|problem| !problem.reason.contains("is not a time") && !problem.reason.contains("ticks"));
    problems.iter().map(|problem| problem.key.to_string()).collect()
}

/// Calls a function with every scenario whose only number at the edge of its range is one, and with that number.
fn for_every_edge(edges: fn(&Range) -> Vec<f64>, mut check: impl FnMut(&Scenario, String, f64)) {
    let mut count = 0;
    for choice in 0..6 {
        let mut numbers = Vec::new();
        let whole = whole(schema().as_value(), choice, &[], &mut numbers);
        for (way, range) in numbers {
            for edge in edges(&range) {
                let mut spoilt = whole.clone();
                let place = place(&mut spoilt, &way);
                *place = match place {
                    Value::Integer(_) => Value::Integer(edge as i64),
                    _ => Value::Float(edge),
                };
                let scenario = Scenario::deserialize(spoilt).unwrap();
                let key: Key = way.iter().cloned().collect();
                check(&scenario, key.to_string(), edge);
                count += 1;
            }
        }
    }
    assert!(count > 2000, "only {count}");
}

#[test]
fn a_number_just_inside_of_its_range_is_accepted() {
    for_every_edge(just_inside, |scenario, key, edge| {
        assert_eq!(keys_out_of_range(scenario), [""; 0], "{key} = {edge:?}");
    });
}

#[test]
fn a_number_just_outside_of_its_range_is_refused_once_and_at_its_place() {
    for_every_edge(just_outside, |scenario, key, edge| {
        assert_eq!(keys_out_of_range(scenario), [key.as_str()], "{edge:?}");
    });
}

#[test]
fn a_refusal_says_what_is_wrong_and_what_is_right() {
    for (range, value, reason, fix) in [
        (
            json!({ "exclusiveMinimum": 0 }),
            -1.0,
            "k = -1.0 is not above 0",
            "give a number above 0",
        ),
        (
            json!({ "minimum": 0 }),
            -0.5,
            "k = -0.5 is below 0",
            "give 0 or a number above it",
        ),
        (
            json!({ "minimum": 0, "exclusiveMaximum": 1 }),
            1.0,
            "k = 1.0 is not below 1",
            "give a number from 0 to below 1",
        ),
        (
            json!({ "exclusiveMinimum": 0, "maximum": FRAC_PI_2 }),
            2.0,
            "k = 2.0 is above π/2",
            "give a number above 0 and at most π/2",
        ),
        (
            json!({ "type": "integer", "minimum": 1, "maximum": 99 }),
            0.0,
            "k = 0 is below 1",
            "give a whole number from 1 to 99",
        ),
        (
            json!({ "not": { "const": 0 } }),
            -0.0,
            "k is 0",
            "give a number other than 0",
        ),
        (
            json!({ "minimum": -TAU, "maximum": TAU }),
            -90.0,
            "-90.0 rad is more than a turn",
            "angles are in rad: give -1.5708 if -90.0° is meant, else an angle within ±2π",
        ),
        (
            json!({ "minimum": f64::MIN, "maximum": f64::MAX }),
            f64::NAN,
            "NaN is not a finite number",
            "give a finite number",
        ),
        (
            json!({ "exclusiveMinimum": 0 }),
            f64::INFINITY,
            "inf is not a finite number",
            "give a finite number of at most 1e9 in magnitude",
        ),
        (
            json!({}),
            -1e10,
            "-10000000000.0 is not plausible",
            "give a finite number of at most 1e9 in magnitude",
        ),
    ] {
        let range = Range::from_schema(&range);
        assert!(!range.allows(value), "{reason}");
        assert_eq!(range.refusal("k", value), (reason.to_owned(), fix.to_owned()));
    }
}
