//! `gerono.h`: the interface for C and C++, with the samples of all topics and their layout hashes.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use shared_types::{ServiceId, Topic};

use crate::abi;

/// Declarations that do not depend on the samples.
const INTERFACE: &str = include_str!("interface.h");

/// Returns the header.
#[must_use]
pub fn text() -> String {
    let mut structures = BTreeMap::new();
    let mut samples = String::new();
    for topic in Topic::ALL {
        let definition = topic.msg_definition();
        let separator = format!("{}\nMSG: ", "=".repeat(80));
        let mut parts = definition.split(&separator);
        let body = parts.next().unwrap_or_default();
        for nested in parts {
            let (name, body) = nested.split_once('\n').unwrap_or((nested, ""));
            structures
                .entry(c_name(name))
                .or_insert_with(|| structure(&c_name(name), body, None));
        }
        let name = c_name(topic.msg_name());
        let _ = writeln!(samples, "/* A sample of `{topic}`. */");
        samples += &structure(&name, body, Some(topic.kind().size));
        let constant = c_name(topic.msg_name()).to_uppercase();
        let _ = writeln!(samples, "#define {constant}_LAYOUT \"{}\"\n", topic.layout_hash());
    }
    let nested: String = structures.into_values().collect();
    let roles: String = ServiceId::ALL.into_iter().map(ports).collect();
    INTERFACE
        .replace("@VERSION@", &abi::VERSION.to_string())
        .replace("@SAMPLES@\n", &(nested + &samples))
        .replace("@PORTS@\n", &roles)
}

/// Returns the name in C of a type, such as `gerono_vehicle_state` of `gerono_msgs/msg/VehicleState`.
fn c_name(message: &str) -> String {
    let name = message.rsplit('/').next().unwrap_or(message);
    let mut text = "gerono".to_owned();
    for letter in name.chars() {
        if letter.is_uppercase() {
            text.push('_');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

fn structure(name: &str, body: &str, size: Option<usize>) -> String {
    let (mut members, mut constants) = (String::new(), String::new());
    for line in body.lines() {
        let Some((kind, rest)) = line.split_once(' ') else {
            continue;
        };
        if let Some((constant, value)) = rest.split_once('=') {
            let _ = writeln!(constants, "#define {}_{constant} {value}", name.to_uppercase());
            continue;
        }
        let (element, length) = match kind.split_once('[') {
            Some((element, length)) => (element, format!("[{length}")),
            None => (kind, String::new()),
        };
        let _ = writeln!(members, "    {} {rest}{length};", c_type(element));
    }
    let mut text = format!("typedef struct {{\n{members}}} {name};\n{constants}");
    if let Some(size) = size {
        let _ = writeln!(
            text,
            "GERONO_ASSERT(sizeof({name}) == {size}, \"another layout of {name}\");"
        );
    }
    text
}

fn c_type(element: &str) -> String {
    match element {
        "float64" => "double".to_owned(),
        "float32" => "float".to_owned(),
        "bool" => "uint8_t".to_owned(),
        record if record.contains('/') => c_name(record),
        integer => format!("{integer}_t"),
    }
}

/// Returns the positions of a service's inputs and outputs, and their layouts.
fn ports(role: ServiceId) -> String {
    let upper = role.name().to_uppercase();
    let mut text = format!("/* Inputs and outputs of `{role}`. */\nenum {{\n");
    let mut layouts = Vec::new();
    for (position, input) in role.inputs().iter().enumerate() {
        let _ = writeln!(
            text,
            "    GERONO_{upper}_IN_{} = {position},",
            input.name.to_uppercase()
        );
        layouts.push(format!(
            "{}_LAYOUT",
            c_name(input.topic.msg_name()).to_uppercase()
        ));
    }
    for (position, output) in role.outputs().iter().enumerate() {
        let _ = writeln!(
            text,
            "    GERONO_{upper}_OUT_{} = {position},",
            output.name.to_uppercase()
        );
        layouts.push(format!(
            "{}_LAYOUT",
            c_name(output.topic.msg_name()).to_uppercase()
        ));
    }
    let _ = writeln!(
        text,
        "}};\n#define GERONO_{upper}_LAYOUTS {{{}}}\n",
        layouts.join(", ")
    );
    text
}
