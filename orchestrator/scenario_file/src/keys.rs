//! Keys of scenarios as described by the schema, for the advice in errors and for the documentation.

use std::fmt::Write;
use std::sync::LazyLock;

use scenario::schema::{resolved, schema, type_name};
use scenario::{Key, Range};
use serde_json::Value;

use super::setting::path_of;

/// Placeholder for a position in an array.
const ANY_POSITION: &str = "N";
/// Placeholder for the name of a service, topic or edge.
const ANY_NAME: &str = "NAME";

/// Key of a value, not of a table.
#[derive(Debug)]
struct KeyInfo {
    key: Key,
    /// Description with the unit.
    description: String,
    /// Form of the value.
    kind: String,
    /// Value unless stated.
    default: Default,
    /// `true` if the value may change in flight.
    is_tunable: bool,
}

#[derive(Debug)]
enum Default {
    /// The key must be stated in its table.
    Required,
    /// A value, unless its table is stated, which must be whole then.
    OfTable(String),
    /// A value.
    Value(String),
    /// As stated by the description.
    None,
}

/// Returns advice on the value of a key.
pub(super) fn advice(key: &Key) -> String {
    let keys = all();
    if let Some(info) = keys.iter().find(|info| matches(key, &info.key)) {
        return format!("`{key}` is {}: {}", info.kind, info.description);
    }
    let names = names_inside(keys, key);
    if names.is_empty() {
        "see docs/scenarios.md for the keys of a scenario".to_owned()
    } else {
        format!("`{key}` is a table that holds {}", names.join(", "))
    }
}

/// Returns the names of the keys of a table, in quotes.
pub(super) fn names_at(key: &Key) -> Vec<String> {
    names_inside(all(), key)
}

/// Returns all keys of a section (a table of the scenario, or `""` for top-level keys) as a Markdown table.
#[must_use]
pub fn key_table(section: &str) -> String {
    let mut table = "| key | value | what it is, unit | default |\n| --- | --- | --- | --- |\n".to_owned();
    for info in all() {
        let belongs = match info.key.segments() {
            [_] => section.is_empty(),
            [first, ..] => first == section,
            [] => false,
        };
        if belongs {
            let default = match &info.default {
                Default::Required => "must be stated".to_owned(),
                Default::OfTable(value) => format!("`{value}`, or the whole table is stated"),
                Default::Value(value) => format!("`{value}`"),
                Default::None => String::new(),
            };
            let (key, kind, description) = (&info.key, &info.kind, &info.description);
            let tunable = if info.is_tunable { " (tunable)" } else { "" };
            writeln!(table, "| `{key}` | {kind} | {description}{tunable} | {default} |")
                .expect("a String takes all");
        }
    }
    table
}

/// Units in the descriptions of keys, before an explanation or at the end.
const UNITS: [&str; 37] = [
    "V",
    "s",
    "m",
    "kg",
    "N",
    "rad",
    "1/s",
    "m/s",
    "m/s²",
    "rad/s",
    "N m",
    "kg m²",
    "1/kg",
    "N s/m",
    "N s²/m²",
    "1/s²",
    "s³",
    "1/(N² s)",
    "Hz",
    "bits",
    "baud",
    "bytes",
    "(m/s²)²/Hz",
    "(m/s³)²/Hz",
    "(m/s)²/Hz",
    "(rad/s)²/Hz",
    "(rad/s²)²/Hz",
    "degrees",
    "G",
    "G/√s",
    "m/√s",
    "m per (m/s)²",
    "rad/s/√Hz",
    "rad/s/√s",
    "m/s²/√Hz",
    "m/s²/√s",
    "rad/s per m/s²",
];

/// Returns the unit of a key, or of a number inside its value; `None` without a unit.
#[must_use]
pub fn unit_of_key(name: &str) -> Option<&'static str> {
    let key = path_of(name)?;
    let keys = all();
    let description = &keys.iter().find(|info| matches(&key, &info.key))?.description;
    let after_commas = description.split(", ").skip(1);
    let parts: Vec<&str> = after_commas
        .map(|part| part.split([';', ':']).next().unwrap_or(part))
        .collect();
    UNITS.into_iter().find(|unit| parts.contains(unit))
}

/// Returns the keys that may change in flight.
pub(super) fn tunable() -> impl Iterator<Item = Key> {
    all()
        .iter()
        .filter(|info| info.is_tunable)
        .map(|info| info.key.clone())
}

/// Returns whether a key, or a number inside its value, may change in flight; `None` for an unknown key.
pub(super) fn is_tunable(key: &Key) -> Option<bool> {
    let keys = all();
    let info = keys.iter().find(|info| matches(key, &info.key));
    info.map(|info| info.is_tunable)
}

/// Returns the keys without free names, with their descriptions; positions in arrays are 0.
#[must_use]
pub fn keys_for_completion() -> Vec<(String, String)> {
    let keys = all().iter();
    let writable = keys.filter(|info| !info.key.segments().iter().any(|segment| segment == ANY_NAME));
    writable
        .map(|info| {
            let segments = info.key.segments().iter();
            let first = |segment: &String| if segment == ANY_POSITION { "0" } else { segment }.to_owned();
            (
                segments.map(first).collect::<Key>().to_string(),
                info.description.clone(),
            )
        })
        .collect()
}

/// Returns whether a key matches a pattern, or is a number inside its value.
fn matches(key: &Key, pattern: &Key) -> bool {
    let (key, pattern) = (key.segments(), pattern.segments());
    let is_position = |segment: &String| segment.parse::<usize>().is_ok();
    pattern.len() <= key.len()
        && key[pattern.len()..].iter().all(is_position)
        && key
            .iter()
            .zip(pattern)
            .all(|(segment, pattern)| match pattern.as_str() {
                ANY_POSITION => is_position(segment),
                ANY_NAME => true,
                name => segment == name,
            })
}

fn names_inside(keys: &[KeyInfo], table: &Key) -> Vec<String> {
    let depth = table.segments().len();
    let mut names: Vec<String> = Vec::new();
    for info in keys {
        let segments = info.key.segments();
        let is_inside = segments.len() > depth
            && matches(table, &segments[..depth].iter().cloned().collect())
            && segments[depth] != ANY_POSITION;
        let name = is_inside.then(|| format!("`{}`", segments[depth]));
        names.extend(name.filter(|name| !names.contains(name)));
    }
    names
}

/// Returns all keys, which are collected on first use.
fn all() -> &'static [KeyInfo] {
    static ALL: LazyLock<Vec<KeyInfo>> = LazyLock::new(|| {
        let mut keys = Vec::new();
        push_table(schema().as_value(), &Key::root(), &Value::Null, &mut keys);
        keys
    });
    &ALL
}

/// Adds the keys of a table of the schema, sorted by name, then those of its alternatives, as declared. `default` is that of the
/// whole table.
fn push_table(table: &Value, at: &Key, default: &Value, keys: &mut Vec<KeyInfo>) {
    let required = table["required"].as_array();
    let is_required =
        |name: &str| required.is_some_and(|names| names.iter().any(|required| required == name));
    // Whether JSON objects are sorted depends on the features of serde_json that other crates enable.
    let mut properties: Vec<_> = table["properties"].as_object().into_iter().flatten().collect();
    properties.sort_by_key(|(name, _)| name.as_str());
    for (name, property) in properties {
        push_property(property, &at.then(name), is_required(name), &default[name], keys);
    }
    for variant in table["oneOf"].as_array().into_iter().flatten() {
        for (name, property) in variant["properties"].as_object().into_iter().flatten() {
            push_property(property, &at.then(name), false, &Value::Null, keys);
        }
    }
}

fn push_property(property: &Value, key: &Key, required: bool, of_table: &Value, keys: &mut Vec<KeyInfo>) {
    let target = resolved(property);
    let element = resolved(&target["items"]);
    let named = resolved(&target["additionalProperties"]);
    if is_table(target) {
        push_table(target, key, &property["default"], keys);
    } else if is_table(element) {
        push_table(element, &key.then(ANY_POSITION), &Value::Null, keys);
    } else if is_table(named) {
        push_table(named, &key.then(ANY_NAME), &Value::Null, keys);
    } else {
        let of_names = target["additionalProperties"].is_object();
        keys.push(KeyInfo {
            key: if of_names { key.then(ANY_NAME) } else { key.clone() },
            // In one line, because a line break ends a table's row.
            description: property["description"]
                .as_str()
                .unwrap_or_default()
                .trim_end_matches('.')
                .replace('\n', " "),
            kind: kind(if of_names {
                &target["additionalProperties"]
            } else {
                target
            }),
            default: match &property["default"] {
                _ if required && !of_table.is_null() => Default::OfTable(toml_text(of_table)),
                _ if required => Default::Required,
                Value::Null => Default::None,
                Value::Object(_) => Default::None,
                value => Default::Value(toml_text(value)),
            },
            is_tunable: property["x-tunable"] == true,
        });
    }
}

/// Returns whether a part of the schema is a table, or a choice of tables.
pub(super) fn is_table(part: &Value) -> bool {
    let variants = part["oneOf"].as_array();
    let is_choice_of_tables =
        variants.is_some_and(|variants| variants.iter().any(|variant| variant["properties"].is_object()));
    part["properties"].is_object() || is_choice_of_tables
}

/// Describes the form of a value.
fn kind(part: &Value) -> String {
    if let Some(variants) = part["oneOf"].as_array() {
        let words = variants.iter().map(|variant| toml_text(&variant["const"]));
        return words.collect::<Vec<_>>().join(" or ");
    }
    let in_range = |noun: &str, part| {
        format!("{noun} {}", Range::from_schema(part))
            .trim_end()
            .to_owned()
    };
    match (type_name(part), part["maxItems"].as_u64()) {
        (Some("array"), Some(count)) => in_range(&format!("{count} numbers"), &part["items"]),
        (Some("array"), None) => format!("an array, each element {}", kind(&part["items"])),
        (Some("number"), _) => in_range("a number", part),
        (Some("integer"), _) => in_range("a whole number", part),
        (Some("boolean"), _) => "`true` or `false`".to_owned(),
        (Some("string"), _) => "a string".to_owned(),
        _ => "a value".to_owned(),
    }
}

/// Formats a value of the schema as TOML; numbers, strings and arrays have the same form in JSON and TOML.
fn toml_text(value: &Value) -> String {
    match value {
        Value::Array(elements) => {
            let elements: Vec<String> = elements.iter().map(toml_text).collect();
            format!("[{}]", elements.join(", "))
        }
        value => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(dotted: &str) -> Key {
        dotted.split('.').collect()
    }

    #[test]
    fn a_key_of_a_whole_table_has_its_default_in_the_table() {
        let table = key_table("navigation");
        let line = |key: &str| table.lines().find(|line| line.contains(key)).unwrap();
        let fixed = line("`navigation.rtk_fixed.position_white`");
        assert!(
            fixed.ends_with("| `0.008`, or the whole table is stated |"),
            "{fixed}"
        );
        let alone = line("`navigation.single_point.position_white`");
        assert!(alone.contains("| `0.15`, or"), "{alone}");
    }

    #[test]
    fn advice_says_what_a_value_is_and_its_unit() {
        assert_eq!(
            advice(&key("vehicle.mass")),
            "`vehicle.mass` is a number above 0: m, kg"
        );
        assert_eq!(
            advice(&key("vehicle.change.3.mass")),
            "`vehicle.change.3.mass` is a number above 0: New m, kg"
        );
        assert_eq!(
            advice(&key("vehicle.inertia.1")),
            "`vehicle.inertia.1` is 3 numbers above 0: Diagonal of J, kg m²"
        );
        assert_eq!(
            advice(&key("path.mode")),
            "`path.mode` is \"following\" or \"trajectory_tracking\": Path following, in which the path waits for the vehicle, or the paper's trajectory tracking"
        );
    }

    #[test]
    fn units_are_those_of_the_descriptions() {
        for (key, unit) in [
            ("vehicle.mass", Some("kg")),
            ("vehicle.change.3.mass", Some("kg")),
            ("vehicle.drag.0", Some("N s/m")),
            ("vehicle.actuators.thrust_lag", Some("s")),
            ("schedule.latency.\"rc/frame -> plant\"", Some("s")),
            ("rc_output.rate_slope.2", Some("rad/s")),
            ("vehicle.wind.gusts.deviation", None),
            ("vehicle.actuators.thrust_factor", None),
            ("controller.law", None),
            ("arm_x", None),
        ] {
            assert_eq!(unit_of_key(key), unit, "{key}");
        }
    }

    #[test]
    fn advice_on_a_table_names_its_keys() {
        assert_eq!(
            advice(&key("path.curve")),
            "`path.curve` is a table that holds `tilted_eight`, `hover`, `circle`, `line`, `lissajous`, `waypoints`"
        );
    }

    #[test]
    fn advice_on_what_is_in_an_optional_table_is_as_on_all_else() {
        assert_eq!(
            advice(&key("cameras.occlusion.2.lasts")),
            "`cameras.occlusion.2.lasts` is a number above 0: Duration, s"
        );
        assert_eq!(
            advice(&key("rc_output.thrust_range")),
            "`rc_output.thrust_range` is 2 numbers from -1 to 1: Range of the thrust channel; the paper states [0, 1], with which its vehicle could not hover"
        );
        assert_eq!(
            advice(&key("vehicle.fan.off_at")),
            "`vehicle.fan.off_at` is a number of 0 or more: Time at which the fan is switched off, s; never unless stated"
        );
        assert_eq!(
            advice(&key("vehicle.turbulence")),
            "`vehicle.turbulence` is a table that holds `correlation_time`, `deviation`"
        );
        assert_eq!(
            advice(
                &["safety", "vehicle/state -> controller", "jump"]
                    .into_iter()
                    .collect()
            ),
            "`safety.\"vehicle/state -> controller\".jump` is a number from 0.005 to 10: Maximum distance of a state from the prediction of the last valid one, m; unlimited unless stated"
        );
        assert_eq!(
            advice(&key("estimator")),
            "`estimator` is a table that holds `kalman`"
        );
    }

    #[test]
    fn every_key_says_what_it_is() {
        for info in all() {
            assert!(!info.description.is_empty(), "{}", info.key);
            assert_ne!(info.kind, "a value", "{}", info.key);
        }
    }
}
