//! The header in the repository is made of the wiring table, and compiles as C and as C++.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use shared_types::sample::{Header, Member, Record};
use shared_types::{ServiceId, Topic};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/include/gerono.h");

/// Lines before and after what is made of the wiring table.
const BEGIN: &str =
    "/* Generated: the samples of the topics, and the inputs and outputs of the services. */\n\n";
const END: &str = "/* End of what is generated. */\n";

/// Returns what the samples of the topics and the services are in C.
fn generated() -> String {
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
                .or_insert_with(|| structure(&c_name(name), body, &Header::members(), None));
        }
        let name = c_name(topic.msg_name());
        let _ = writeln!(samples, "/* A sample of `{topic}`. */");
        samples += &structure(&name, body, &topic.members(), Some(topic.kind().size));
        let constant = c_name(topic.msg_name()).to_uppercase();
        let _ = writeln!(samples, "#define {constant}_LAYOUT \"{}\"\n", topic.layout_hash());
    }
    let nested: String = structures.into_values().collect();
    let roles: String = ServiceId::ALL.into_iter().map(ports).collect();
    nested + &samples + &roles
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

fn structure(name: &str, body: &str, described: &[Member], size: Option<usize>) -> String {
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
        let meaning = described.iter().find(|member| member.name == rest);
        let meaning = meaning.expect("a member of the definition").meaning;
        let declaration = format!("{} {rest}{length};", c_type(element));
        let _ = writeln!(members, "    {declaration:<35} /* {meaning} */");
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

#[test]
fn the_header_is_made_of_the_wiring_table() {
    let (before, rest) = plugin::header::TEXT.split_once(BEGIN).unwrap();
    let (_, after) = rest.split_once(END).unwrap();
    let text = format!("{before}{BEGIN}{}{END}{after}", generated());
    if std::env::var_os("GERONO_BLESS").is_some() {
        std::fs::write(PATH, &text).unwrap();
    } else {
        assert!(
            plugin::header::TEXT == text,
            "{PATH} is out of date: run with GERONO_BLESS=1"
        );
    }
}

#[test]
fn the_header_compiles_as_c_and_as_cpp() {
    for language in ["c", "c++"] {
        let mut command = Command::new("cc");
        command.args(["-x", language, "-fsyntax-only", "-Wall", "-Wextra", "-Werror"]);
        let output = command
            .arg(Path::new(PATH))
            .output()
            .expect("a C compiler links Rust too");
        let complaint = String::from_utf8_lossy(&output.stderr);
        let lacks = complaint.contains("cc1plus");
        assert!(output.status.success() || lacks, "{language}: {complaint}");
    }
}
