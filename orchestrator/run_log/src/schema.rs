//! Parser of this program's message definitions, and decoder of samples by their schema.
//!
//! Samples have no implicit padding, so that a decoder only reads the members in order.

use scenario::Scenario;
use serde_json::{Map, Value};
use shared_types::Topic;
use shared_types::samples::ControlTelemetry;

/// Name of padding members.
const PADDING: &str = "pad0";

/// Returns the message definition of a topic in a flight of `scenario`, which names the numbers of telemetry.
#[must_use]
pub fn definition(topic: Topic, scenario: &Scenario) -> String {
    const NUMBERS: usize = ControlTelemetry::NUMBERS;
    let definition = topic.msg_definition();
    if topic != Topic::ControlTelemetry {
        return definition;
    }
    let names = scenario.controller.telemetry.iter().take(NUMBERS);
    let mut members: String = names.clone().map(|name| format!("float64 {name}\n")).collect();
    if names.len() < NUMBERS {
        members += &format!("float64[{}] {PADDING}\n", NUMBERS - names.len());
    }
    definition.replace(&format!("float64[{NUMBERS}] values\n"), &members)
}

/// Record type: its members in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Schema {
    members: Vec<Member>,
}

#[derive(Clone, Debug, PartialEq)]
struct Member {
    name: String,
    kind: Kind,
    /// Length of a fixed array.
    length: Option<usize>,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Bool,
    /// Unsigned integer with this number of bytes.
    Unsigned(usize),
    Int64,
    Float32,
    Float64,
    Record(Schema),
}

impl Schema {
    /// Returns the schema of a topic in a flight of `scenario`.
    pub(super) fn of(topic: Topic, scenario: &Scenario) -> Self {
        Self::parse(&definition(topic, scenario)).expect("our own definitions are well-formed")
    }

    /// Reads a definition of [`shared_types::sample::msg_definition`]; `None` for any other text.
    pub(super) fn parse(definition: &str) -> Option<Self> {
        let ruler = format!("{}\n", "=".repeat(80));
        let mut sections = definition.split(ruler.as_str());
        let root = sections.next()?;
        let nested: Vec<(&str, &str)> = sections
            .map(|section| section.strip_prefix("MSG: ")?.split_once('\n'))
            .collect::<Option<_>>()?;
        // The depth is limited by the number of types, which excludes recursive types.
        Self::parse_body(root, &nested, nested.len())
    }

    fn parse_body(body: &str, nested: &[(&str, &str)], depth: usize) -> Option<Self> {
        let members = body
            .lines()
            .filter(|line| !line.contains('='))
            .map(|line| Member::parse(line, nested, depth))
            .collect::<Option<_>>()?;
        Some(Self { members })
    }

    /// Returns the names of the numbers and texts in a value, in order, without padding.
    pub(super) fn columns(&self) -> Vec<String> {
        let members = self.members.iter().filter(|member| !member.is_padding());
        members.flat_map(Member::columns).collect()
    }

    /// Decodes a value from the beginning of `bytes`, as the numbers and texts of [`columns`](Self::columns).
    pub(super) fn cells(&self, bytes: &mut &[u8]) -> Option<Vec<Value>> {
        let mut cells = Vec::new();
        for member in &self.members {
            if member.is_padding() {
                for _ in 0..member.length.unwrap_or(1) {
                    member.kind.decode(bytes)?;
                }
                continue;
            }
            if member.is_text() {
                let (text, rest) = bytes.split_at_checked(member.length?)?;
                *bytes = rest;
                let text = String::from_utf8_lossy(text);
                cells.push(Value::from(text.trim_end_matches('\0')));
                continue;
            }
            for _ in 0..member.length.unwrap_or(1) {
                match &member.kind {
                    Kind::Record(schema) => cells.extend(schema.cells(bytes)?),
                    kind => cells.push(kind.decode(bytes)?),
                }
            }
        }
        Some(cells)
    }

    /// Decodes a value from the beginning of `bytes`.
    pub(super) fn decode(&self, bytes: &mut &[u8]) -> Option<Value> {
        let mut object = Map::new();
        for member in &self.members {
            let value = match member.length {
                None => member.kind.decode(bytes)?,
                Some(length) => (0..length)
                    .map(|_| member.kind.decode(bytes))
                    .collect::<Option<_>>()?,
            };
            object.insert(member.name.clone(), value);
        }
        Some(Value::Object(object))
    }
}

impl Member {
    /// Returns whether the member is UTF-8 padded with zeros: the only byte arrays of samples.
    fn is_text(&self) -> bool {
        self.kind == Kind::Unsigned(1) && self.name == "text" && self.length.is_some()
    }

    fn is_padding(&self) -> bool {
        self.name == PADDING
    }

    fn columns(&self) -> Vec<String> {
        let names: Vec<_> = match self.length {
            Some(length) if !self.is_text() => (0..length)
                .map(|index| format!("{}.{index}", self.name))
                .collect(),
            _ => vec![self.name.clone()],
        };
        let Kind::Record(schema) = &self.kind else {
            return names;
        };
        let inner = schema.columns();
        let of = |name: &String| {
            inner
                .iter()
                .map(move |column| format!("{name}.{column}"))
                .collect::<Vec<_>>()
        };
        names.iter().flat_map(of).collect()
    }

    /// Parses `type name` or `type[length] name`.
    fn parse(line: &str, nested: &[(&str, &str)], depth: usize) -> Option<Self> {
        let (kind, name) = line.split_once(' ')?;
        let (element, length) = match kind.split_once('[') {
            Some((element, rest)) => (element, Some(rest.strip_suffix(']')?.parse().ok()?)),
            None => (kind, None),
        };
        Some(Self {
            name: name.to_owned(),
            kind: Kind::parse(element, nested, depth)?,
            length,
        })
    }
}

impl Kind {
    fn parse(element: &str, nested: &[(&str, &str)], depth: usize) -> Option<Self> {
        Some(match element {
            "bool" => Self::Bool,
            "uint8" => Self::Unsigned(1),
            "uint16" => Self::Unsigned(2),
            "uint32" => Self::Unsigned(4),
            "uint64" => Self::Unsigned(8),
            "int64" => Self::Int64,
            "float32" => Self::Float32,
            "float64" => Self::Float64,
            name => {
                let (_, body) = nested.iter().find(|(nested_name, _)| *nested_name == name)?;
                Self::Record(Schema::parse_body(body, nested, depth.checked_sub(1)?)?)
            }
        })
    }

    fn decode(&self, bytes: &mut &[u8]) -> Option<Value> {
        Some(match self {
            Self::Bool => Value::from(take::<1>(bytes)? != [0]),
            Self::Unsigned(size) => {
                let (value, rest) = bytes.split_at_checked(*size)?;
                *bytes = rest;
                let mut whole = [0; 8];
                whole[..*size].copy_from_slice(value);
                Value::from(u64::from_le_bytes(whole))
            }
            Self::Int64 => Value::from(i64::from_le_bytes(take(bytes)?)),
            Self::Float32 => float(f64::from(f32::from_le_bytes(take(bytes)?))),
            Self::Float64 => float(f64::from_le_bytes(take(bytes)?)),
            Self::Record(schema) => schema.decode(bytes)?,
        })
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (taken, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*taken)
}

/// Converts a number with full precision; numbers that are not finite become strings, because JSON lacks them.
fn float(number: f64) -> Value {
    serde_json::Number::from_f64(number).map_or_else(|| Value::from(number.to_string()), Value::Number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::Topic;
    use shared_types::sample::{Flag, Header, msg_definition};
    use zerocopy::IntoBytes;

    shared_types::sample! {
        /// A member of every kind.
        pub struct Everything {
            /// Header.
            pub header: Header,
            /// Record array.
            pub earlier: [Header; 2],
            /// Array.
            pub floats: [f64; 3],
            /// Signed.
            pub signed: i64,
            /// Narrow float.
            pub narrow: f32,
            #[values(CHOICE_A = 1, CHOICE_B = 2)]
            /// Choice.
            pub choice: u32,
            /// Half words.
            pub halves: [u16; 2],
            /// Byte.
            pub byte: u8,
            /// Flag.
            pub raised: Flag,
            /// Explicit padding.
            pub pad0: [u8; 2],
        }
    }

    fn header() -> impl Strategy<Value = Header> {
        any::<(u64, u64, u64)>().prop_map(|(tick, stamp_ns, seq)| Header { tick, stamp_ns, seq })
    }

    fn as_json(header: &Header) -> Value {
        serde_json::json!({ "tick": header.tick, "stamp_ns": header.stamp_ns, "seq": header.seq })
    }

    proptest! {
        #[test]
        fn decoding_by_schema_finds_every_member_to_the_bit(
            (header, earlier) in (header(), [header(), header()]),
            floats in [any::<f64>(), any::<f64>(), any::<f64>()],
            (signed, narrow, byte) in any::<(i64, f32, u8)>(),
            (choice, halves, raised) in any::<(u32, [u16; 2], bool)>(),
        ) {
            let sample = Everything {
                header, earlier, floats, signed, narrow, choice, halves, byte, raised: raised.into(), pad0: [7, 9],
            };
            let schema = Schema::parse(&msg_definition::<Everything>()).unwrap();
            let mut bytes = sample.as_bytes();
            let value = schema.decode(&mut bytes).unwrap();
            prop_assert!(bytes.is_empty());
            let text = serde_json::to_string(&value).unwrap();
            let value: Value = serde_json::from_str(&text).unwrap();
            prop_assert_eq!(&value["header"], &as_json(&header));
            prop_assert_eq!(&value["earlier"], &Value::from(earlier.iter().map(as_json).collect::<Vec<_>>()));
            for (read, written) in value["floats"].as_array().unwrap().iter().zip(floats) {
                prop_assert_eq!(read.as_f64().unwrap().to_bits(), written.to_bits());
            }
            prop_assert_eq!(value["signed"].as_i64(), Some(signed));
            prop_assert_eq!(value["narrow"].as_f64(), Some(f64::from(narrow)));
            prop_assert_eq!(value["choice"].as_u64(), Some(u64::from(choice)));
            prop_assert_eq!(&value["halves"], &Value::from(halves.to_vec()));
            prop_assert_eq!(value["byte"].as_u64(), Some(u64::from(byte)));
            prop_assert_eq!(value["raised"].as_bool(), Some(raised));
            prop_assert_eq!(&value["pad0"], &serde_json::json!([7, 9]));
            prop_assert_eq!(value.as_object().unwrap().len(), 10);
        }
    }

    #[test]
    fn every_topic_is_decoded_to_its_last_byte() {
        for topic in Topic::ALL {
            let schema = Schema::parse(&topic.msg_definition()).unwrap();
            let sample = vec![0; topic.kind().size];
            let mut bytes = sample.as_slice();
            assert!(schema.decode(&mut bytes).is_some(), "{topic}");
            assert!(bytes.is_empty(), "{topic}");
            assert_eq!(schema.decode(&mut &sample[1..]), None, "{topic}");
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_written_as_a_word() {
        let words = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(float);
        assert_eq!(words, ["NaN", "inf", "-inf"].map(Value::from));
    }

    #[test]
    fn a_definition_that_holds_itself_is_refused() {
        let ruler = "=".repeat(80);
        let text = format!("a/B b\n{ruler}\nMSG: a/B\na/B b\n");
        assert_eq!(Schema::parse(&text), None);
    }
}
