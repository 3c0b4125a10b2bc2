//! The JSON Schema of scenarios: the single source of keys, types, defaults, ranges and descriptions.

use std::sync::LazyLock;

use schemars::Schema;
use serde_json::Value;

use crate::Scenario;

/// Returns the schema of a scenario, which is built on first use.
pub fn schema() -> &'static Schema {
    static SCHEMA: LazyLock<Schema> = LazyLock::new(|| schemars::schema_for!(Scenario));
    &SCHEMA
}

/// Resolves the reference of a part of the schema. Returns the part itself if it has none.
#[must_use]
pub fn resolved(part: &Value) -> &Value {
    // An optional table is "any of" the table and null, which TOML does not have.
    let choices = part["anyOf"].as_array();
    let stated = choices.and_then(|choices| choices.iter().find(|choice| choice["type"] != "null"));
    let part = stated.unwrap_or(part);
    let reference = part["$ref"].as_str();
    let pointer = reference.and_then(|reference| reference.strip_prefix('#'));
    pointer
        .and_then(|pointer| schema().pointer(pointer))
        .unwrap_or(part)
}

/// Returns the type of a value; an optional one may also be null, which TOML does not have.
#[must_use]
pub fn type_name(part: &Value) -> Option<&str> {
    part["type"].as_str().or_else(|| part["type"][0].as_str())
}
