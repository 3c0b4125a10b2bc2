//! Ranges of numbers. A key declares its range with its type, as a transform of its schema, which checks, documentation
//! and editors read.
//!
//! `x-symbol` is the symbol of the number in the paper, and `x-hint` further advice. A time with `x-ticks` is a whole
//! number of base ticks, and `x-ticks` is its maximum.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI, TAU};
use std::fmt::{Display, Formatter};
use std::ops::{Bound, RangeBounds};

use schemars::Schema;
use serde_json::Value;

use crate::check::six_digits;
use crate::schema::type_name;
use crate::timing::LONGEST_FLIGHT;

/// Maximum plausible magnitude of a number in a scenario; products of several remain finite.
const LARGEST: f64 = 1e9;

/// Range of a number. Displayed as a phrase that follows a noun, such as "above 0".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub(crate) least: Bound<f64>,
    pub(crate) most: Bound<f64>,
    /// `false` if 0 is excluded.
    pub(crate) has_zero: bool,
    pub(crate) is_whole: bool,
}

/// Declares numbers within bounds: those of a value, of the elements of an array, or of a table of names.
pub(crate) fn within<T: Copy + Into<Value>>(range: impl RangeBounds<T>) -> impl Fn(&mut Schema) {
    let least = match range.start_bound() {
        Bound::Included(&least) => Some(("minimum", least.into())),
        Bound::Excluded(&least) => Some(("exclusiveMinimum", least.into())),
        Bound::Unbounded => None,
    };
    let most = match range.end_bound() {
        Bound::Included(&most) => Some(("maximum", most.into())),
        Bound::Excluded(&most) => Some(("exclusiveMaximum", most.into())),
        Bound::Unbounded => None,
    };
    move |schema| declare(schema, &[&least, &most])
}

/// Declares numbers between inclusive bounds.
pub(crate) fn between<T: Copy + Into<Value>>(least: T, most: T) -> impl Fn(&mut Schema) {
    within(least..=most)
}

/// Declares numbers of `least` or more.
pub(crate) fn at_least<T: Copy + Into<Value>>(least: T) -> impl Fn(&mut Schema) {
    within(least..)
}

/// Declares numbers above 0.
pub(crate) fn positive(schema: &mut Schema) {
    within((Bound::Excluded(0.0), Bound::Unbounded))(schema);
}

/// Declares numbers above 0 with an inclusive upper bound.
pub(crate) fn positive_up_to(most: f64) -> impl Fn(&mut Schema) {
    within((Bound::Excluded(0.0), Bound::Included(most)))
}

/// Declares numbers of 0 or more.
pub(crate) fn not_negative(schema: &mut Schema) {
    within(0.0..)(schema);
}

/// Declares the time of an event in flight, s.
pub(crate) fn moment(schema: &mut Schema) {
    not_negative(schema);
    schema.insert("x-ticks".to_owned(), LONGEST_FLIGHT.into());
}

/// Declares a duration in flight, s.
pub(crate) fn length(schema: &mut Schema) {
    positive(schema);
    schema.insert("x-ticks".to_owned(), LONGEST_FLIGHT.into());
}

/// Declares numbers of 0 or more with an exclusive upper bound.
pub(crate) fn from_0_to_below(most: f64) -> impl Fn(&mut Schema) {
    within(0.0..most)
}

/// Declares shares from 0 to below 1.
pub(crate) fn share(schema: &mut Schema) {
    within(0.0..1.0)(schema);
    schema.insert("x-hint".to_owned(), "0.1 is one in ten".into());
}

/// Declares angles of at most a turn, rad.
pub(crate) fn angle(schema: &mut Schema) {
    within(-TAU..=TAU)(schema);
}

/// Declares numbers other than 0.
pub(crate) fn not_zero(schema: &mut Schema) {
    declare(schema, &[&Some(("not", serde_json::json!({ "const": 0.0 })))]);
}

/// Declares any finite number, without the limit of plausible magnitudes.
pub(crate) fn any_finite(schema: &mut Schema) {
    within(f64::MIN..=f64::MAX)(schema);
}

fn declare(schema: &mut Schema, bounds: &[&Option<(&str, Value)>]) {
    for inside in ["items", "additionalProperties"] {
        let part = schema.get_mut(inside);
        if let Some(part) = part.and_then(|part| <&mut Schema>::try_from(part).ok()) {
            return declare(part, bounds);
        }
    }
    for (name, value) in bounds.iter().copied().flatten() {
        schema.insert((*name).to_owned(), value.clone());
    }
}

impl Range {
    /// Reads the range of a number from its schema.
    #[must_use]
    pub fn from_schema(part: &Value) -> Self {
        let bound = |included: &str, excluded: &str| match (part[included].as_f64(), part[excluded].as_f64())
        {
            (_, Some(bound)) => Bound::Excluded(bound),
            (Some(bound), None) => Bound::Included(bound),
            (None, None) => Bound::Unbounded,
        };
        Self {
            least: bound("minimum", "exclusiveMinimum"),
            most: bound("maximum", "exclusiveMaximum"),
            has_zero: part["not"]["const"].as_f64() != Some(0.0),
            is_whole: type_name(part) == Some("integer"),
        }
    }

    /// Returns whether a number is in the range and plausible.
    #[must_use]
    pub fn allows(&self, value: f64) -> bool {
        let is_plausible = self.is_whole || !self.is_open() || value.abs() <= LARGEST;
        is_plausible && (self.least, self.most).contains(&value) && (self.has_zero || value != 0.0)
    }

    /// Returns the reason why a number is not allowed, and the fix.
    pub(crate) fn refusal(&self, symbol: &str, value: f64) -> (String, String) {
        let number = if self.is_whole {
            value.to_string()
        } else {
            format!("{value:?}")
        };
        let violated = match (self.least, self.most) {
            _ if !value.is_finite() => {
                let fix = if self.is_open() { plausible() } else { self.fix() };
                return (format!("{number} is not a finite number"), fix);
            }
            (_, Bound::Included(TAU)) => {
                let fix = format!(
                    "angles are in rad: give {} if {number}° is meant, else an angle within ±2π",
                    six_digits(value.to_radians())
                );
                return (format!("{number} rad is more than a turn"), fix);
            }
            (Bound::Excluded(least), _) if value <= least => format!("not above {}", bound(least)),
            (Bound::Included(least), _) if value < least => format!("below {}", bound(least)),
            (_, Bound::Excluded(most)) if value >= most => format!("not below {}", bound(most)),
            (_, Bound::Included(most)) if value > most => format!("above {}", bound(most)),
            _ if value == 0.0 => return (format!("{symbol} is 0"), self.fix()),
            _ => {
                return (format!("{number} is not plausible"), plausible());
            }
        };
        (format!("{symbol} = {number} is {violated}"), self.fix())
    }

    /// Returns whether the range is unbounded on a side.
    fn is_open(&self) -> bool {
        self.least == Bound::Unbounded || self.most == Bound::Unbounded
    }

    fn fix(&self) -> String {
        let noun = if self.is_whole {
            "a whole number"
        } else {
            "a number"
        };
        match (self.least, self.most) {
            (Bound::Included(0.0), Bound::Unbounded) => "give 0 or a number above it".to_owned(),
            (Bound::Included(f64::MIN), Bound::Included(f64::MAX)) => "give a finite number".to_owned(),
            _ => format!("give {noun} {self}"),
        }
    }
}

impl Display for Range {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let text = match (self.least, self.most) {
            (Bound::Included(f64::MIN), Bound::Included(f64::MAX)) => String::new(),
            (Bound::Unbounded, Bound::Unbounded) if self.has_zero => String::new(),
            (Bound::Unbounded, Bound::Unbounded) => "other than 0".to_owned(),
            // Implied by the unsigned type.
            (Bound::Included(0.0), Bound::Unbounded) if self.is_whole => String::new(),
            (Bound::Included(least), Bound::Unbounded) => format!("of {} or more", bound(least)),
            (Bound::Excluded(least), Bound::Unbounded) => format!("above {}", bound(least)),
            (Bound::Unbounded, Bound::Included(most)) => format!("of at most {}", bound(most)),
            (Bound::Unbounded, Bound::Excluded(most)) => format!("below {}", bound(most)),
            (Bound::Included(least), Bound::Included(most)) => {
                format!("from {} to {}", bound(least), bound(most))
            }
            (Bound::Included(least), Bound::Excluded(most)) => {
                format!("from {} to below {}", bound(least), bound(most))
            }
            (Bound::Excluded(least), Bound::Included(most)) => {
                format!("above {} and at most {}", bound(least), bound(most))
            }
            (Bound::Excluded(least), Bound::Excluded(most)) => {
                format!("above {} and below {}", bound(least), bound(most))
            }
        };
        formatter.write_str(&text)
    }
}

fn plausible() -> String {
    format!("give a finite number of at most {LARGEST:e} in magnitude")
}

/// Formats a bound, with π for its multiples.
fn bound(value: f64) -> String {
    let named = [(FRAC_PI_6, "π/6"), (FRAC_PI_2, "π/2"), (PI, "π"), (TAU, "2π")];
    let sign = if value < 0.0 { "-" } else { "" };
    match named.into_iter().find(|(number, _)| *number == value.abs()) {
        Some((_, name)) => format!("{sign}{name}"),
        None if value.fract() == 0.0 => format!("{value}"),
        None => format!("{value:?}"),
    }
}
