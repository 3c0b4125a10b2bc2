//! Checks each number of a scenario against the range that its key declares, and each time against the base tick.
//!
//! The schema is compiled once to a tree of the keys with numbers. A check serialises the scenario along that tree, which
//! visits every stated number and allocates only for refused ones.

use std::fmt;
use std::sync::LazyLock;

use serde::Serialize;
use serde::ser::{Impossible, SerializeMap, SerializeSeq, SerializeStruct, SerializeTuple, Serializer};
use serde_json::Value;

use super::Findings;
use crate::schema::{resolved, schema, type_name};
use crate::serialized::AsDeclared;
use crate::timing::ticks::TickReader;
use crate::{Problem, Range, Scenario};

impl Findings {
    /// Finds the numbers of a scenario that are out of range.
    pub(super) fn from_ranges(scenario: &Scenario) -> Self {
        let ticks = TickReader::new(scenario.schedule.tick).ok();
        Self::collect(&AsDeclared(scenario), Some(rules()), Vec::new(), ticks)
    }

    /// Finds the numbers of one section that are out of range.
    pub(super) fn from_section(section: &impl Serialize, name: &'static str) -> Self {
        Self::collect(section, rules().inside(name), vec![Step::Name(name)], None)
    }

    fn collect(
        value: &impl Serialize,
        rule: Option<&'static Rule>,
        path: Vec<Step>,
        ticks: Option<TickReader>,
    ) -> Self {
        let mut problems = Vec::new();
        if let Some(rule) = rule {
            let mut walk = Walk {
                rule,
                path,
                name: String::new(),
                ticks,
                problems: &mut problems,
            };
            value.serialize(&mut walk).expect("numbers can be visited");
        }
        Self {
            out_of_range: problems.len(),
            problems,
        }
    }
}

/// Rule for the numbers at a key and inside of it.
#[derive(Debug)]
enum Rule {
    Number {
        range: Range,
        symbol: Option<String>,
        hint: Option<String>,
        /// Maximum number of base ticks of a time.
        ticks: Option<u64>,
    },
    Array(Box<Self>),
    /// Keys, sorted by name.
    Table(Vec<(String, Self)>),
    /// Keys with arbitrary names.
    Names(Box<Self>),
}

fn rules() -> &'static Rule {
    static RULES: LazyLock<Rule> = LazyLock::new(|| {
        Rule::from_schema(schema().as_value(), &Value::Null).expect("a scenario has numbers")
    });
    &RULES
}

impl Rule {
    /// Reads the rule of a part of the schema for a key, if it contains numbers.
    fn from_schema(part: &Value, key: &Value) -> Option<Self> {
        let part = resolved(part);
        let text = |name: &str| key[name].as_str().map(str::to_owned);
        match type_name(part) {
            Some("number" | "integer") => Some(Self::Number {
                range: Range::from_schema(part),
                symbol: text("x-symbol"),
                hint: text("x-hint"),
                ticks: key["x-ticks"].as_u64(),
            }),
            Some("array") => Self::from_schema(&part["items"], key)
                .map(Box::new)
                .map(Self::Array),
            _ if part["additionalProperties"].is_object() => {
                let named = Self::from_schema(&part["additionalProperties"], key);
                named.map(Box::new).map(Self::Names)
            }
            _ => {
                let variants = part["oneOf"].as_array().into_iter().flatten();
                let tables = std::iter::once(part).chain(variants);
                let keys = tables
                    .filter_map(|table| table["properties"].as_object())
                    .flatten();
                let rules = keys.filter_map(|(name, key)| Some((name.clone(), Self::from_schema(key, key)?)));
                let mut rules: Vec<_> = rules.collect();
                rules.sort_by(|(one, _), (other, _)| one.cmp(other));
                (!rules.is_empty()).then_some(Self::Table(rules))
            }
        }
    }

    /// Returns the rule of a name or position inside, if it contains numbers.
    fn inside(&self, name: &str) -> Option<&Self> {
        match self {
            Self::Number { .. } => None,
            Self::Array(element) | Self::Names(element) => Some(element),
            Self::Table(rules) => {
                let index = rules.binary_search_by(|(known, _)| known.as_str().cmp(name));
                index.ok().map(|index| &rules[index].1)
            }
        }
    }
}

/// Segment of a key.
#[derive(Clone, Debug)]
enum Step {
    Name(&'static str),
    Named(String),
    Position(usize),
}

impl fmt::Display for Step {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => formatter.write_str(name),
            Self::Named(name) => formatter.write_str(name),
            Self::Position(position) => position.fmt(formatter),
        }
    }
}

/// Serializer that checks numbers and writes nothing.
struct Walk<'a> {
    /// Rule of the next value.
    rule: &'static Rule,
    path: Vec<Step>,
    /// The last text: a key of a map.
    name: String,
    ticks: Option<TickReader>,
    problems: &'a mut Vec<Problem>,
}

impl Walk<'_> {
    fn check(&mut self, value: f64) {
        let Rule::Number {
            range,
            symbol,
            hint,
            ticks,
        } = self.rule
        else {
            return;
        };
        let refusal = if !range.allows(value) {
            let (reason, fix) = range.refusal(&self.symbol(symbol.as_deref()), value);
            let fix = hint.iter().fold(fix, |fix, hint| format!("{fix}; {hint}"));
            Some((reason, fix))
        } else if let (Some(most), Some(reader)) = (ticks, &self.ticks) {
            let least = u64::from(!range.allows(0.0));
            reader.whole_ticks(value, least..=*most).err()
        } else {
            None
        };
        if let Some((reason, fix)) = refusal {
            let key = self.path.iter().map(ToString::to_string).collect();
            self.problems.push(Problem::new(key, reason, fix));
        }
    }

    /// Returns the symbol of the current number: the declared one, numbered for an element, or the key's name.
    fn symbol(&self, stated: Option<&str>) -> String {
        match (stated, self.path.as_slice()) {
            (Some(symbol), [.., Step::Position(position)]) => format!("{symbol}{}", position + 1),
            (Some(symbol), _) => symbol.to_owned(),
            (None, [.., name, Step::Position(position)]) => format!("{name}.{position}"),
            (None, [.., name]) => name.to_string(),
            (None, []) => String::new(),
        }
    }

    /// Checks a value one level deeper.
    fn enter(&mut self, step: Step, value: &(impl Serialize + ?Sized)) -> Result<(), fmt::Error> {
        let outside = self.rule;
        let inside = match &step {
            Step::Name(name) => outside.inside(name),
            Step::Named(_) | Step::Position(_) => outside.inside(""),
        };
        let Some(inside) = inside else { return Ok(()) };
        self.rule = inside;
        self.path.push(step);
        value.serialize(&mut *self)?;
        self.path.pop();
        self.rule = outside;
        Ok(())
    }
}

/// Serializer of the elements of a value.
struct Inside<'w, 'a> {
    walk: &'w mut Walk<'a>,
    position: usize,
}

impl SerializeStruct for Inside<'_, '_> {
    type Ok = ();
    type Error = fmt::Error;

    fn serialize_field<T: Serialize + ?Sized>(&mut self, name: &'static str, value: &T) -> fmt::Result {
        self.walk.enter(Step::Name(name), value)
    }

    fn end(self) -> fmt::Result {
        Ok(())
    }
}

macro_rules! elements {
    ($($trait:ident)+) => {
        $(impl $trait for Inside<'_, '_> {
            type Ok = ();
            type Error = fmt::Error;

            fn serialize_element<T: Serialize + ?Sized>(&mut self, value: &T) -> fmt::Result {
                let step = Step::Position(self.position);
                self.position += 1;
                self.walk.enter(step, value)
            }

            fn end(self) -> fmt::Result {
                Ok(())
            }
        })+
    };
}
elements! { SerializeSeq SerializeTuple }

impl SerializeMap for Inside<'_, '_> {
    type Ok = ();
    type Error = fmt::Error;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, name: &T) -> fmt::Result {
        name.serialize(&mut *self.walk)
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> fmt::Result {
        let name = Step::Named(std::mem::take(&mut self.walk.name));
        self.walk.enter(name, value)
    }

    fn end(self) -> fmt::Result {
        Ok(())
    }
}

/// Values without numbers.
macro_rules! without_numbers {
    ($($method:ident($($value:ty),*))+) => {
        $(fn $method(self, $(_: $value),*) -> fmt::Result {
            Ok(())
        })+
    };
}

/// Numbers that convert to `f64` exactly.
macro_rules! numbers {
    ($($method:ident($value:ty))+) => {
        $(fn $method(self, value: $value) -> fmt::Result {
            self.serialize_f64(value.into())
        })+
    };
}

/// Values with elements.
macro_rules! inside {
    ($($method:ident($($value:ty),*) -> $inside:ident)+) => {
        $(fn $method(self, $(_: $value),*) -> Result<Self::$inside, fmt::Error> {
            Ok(Inside { walk: self, position: 0 })
        })+
    };
}

/// Forms of Rust values that do not occur in scenarios.
macro_rules! without_key {
    ($($method:ident($($value:ty),*) -> $inside:ident)+) => {
        $(fn $method(self, $(_: $value),*) -> Result<Self::$inside, fmt::Error> {
            Err(fmt::Error)
        })+
    };
}

impl<'w, 'a> Serializer for &'w mut Walk<'a> {
    type Ok = ();
    type Error = fmt::Error;
    type SerializeSeq = Inside<'w, 'a>;
    type SerializeTuple = Inside<'w, 'a>;
    type SerializeMap = Inside<'w, 'a>;
    type SerializeStruct = Inside<'w, 'a>;
    type SerializeTupleStruct = Impossible<(), fmt::Error>;
    type SerializeTupleVariant = Impossible<(), fmt::Error>;
    type SerializeStructVariant = Impossible<(), fmt::Error>;

    without_numbers! {
        serialize_bool(bool)
        serialize_char(char)
        serialize_bytes(&[u8])
        serialize_none()
        serialize_unit()
        serialize_unit_struct(&'static str)
        serialize_unit_variant(&'static str, u32, &'static str)
    }

    numbers! {
        serialize_i8(i8)
        serialize_i16(i16)
        serialize_i32(i32)
        serialize_u8(u8)
        serialize_u16(u16)
        serialize_u32(u32)
        serialize_f32(f32)
    }

    fn serialize_f64(self, value: f64) -> fmt::Result {
        self.check(value);
        Ok(())
    }

    fn serialize_i64(self, value: i64) -> fmt::Result {
        self.serialize_f64(value as f64)
    }

    // No range has a bound beyond 2⁵³, where conversion rounds.
    fn serialize_u64(self, value: u64) -> fmt::Result {
        self.serialize_f64(value as f64)
    }

    without_key! {
        serialize_tuple_struct(&'static str, usize) -> SerializeTupleStruct
        serialize_tuple_variant(&'static str, u32, &'static str, usize) -> SerializeTupleVariant
        serialize_struct_variant(&'static str, u32, &'static str, usize) -> SerializeStructVariant
    }

    fn serialize_str(self, text: &str) -> fmt::Result {
        text.clone_into(&mut self.name);
        Ok(())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> fmt::Result {
        value.serialize(self)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> fmt::Result {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> fmt::Result {
        self.enter(Step::Name(variant), value)
    }

    inside! {
        serialize_seq(Option<usize>) -> SerializeSeq
        serialize_tuple(usize) -> SerializeTuple
        serialize_map(Option<usize>) -> SerializeMap
        serialize_struct(&'static str, usize) -> SerializeStruct
    }
}
