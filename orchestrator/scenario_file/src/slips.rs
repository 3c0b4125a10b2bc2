//! Slips in numbers that people write: a comma as the decimal sign, and a unit.

use std::borrow::Cow;

/// Words of units, with the unit of scenarios and the factor to it.
const UNITS: [(&str, &str, f64); 34] = [
    ("s", "s", 1.0),
    ("sec", "s", 1.0),
    ("second", "s", 1.0),
    ("seconds", "s", 1.0),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("min", "s", 60.0),
    ("kg", "kg", 1.0),
    ("g", "kg", 1e-3),
    ("m", "m", 1.0),
    ("cm", "m", 1e-2),
    ("mm", "m", 1e-3),
    ("in", "inch", 1.0),
    ("inch", "inch", 1.0),
    ("inches", "inch", 1.0),
    ("\"", "inch", 1.0),
    ("rad", "rad", 1.0),
    ("deg", "rad", std::f64::consts::PI / 180.0),
    ("°", "rad", std::f64::consts::PI / 180.0),
    ("rad/s", "rad/s", 1.0),
    ("deg/s", "rad/s", std::f64::consts::PI / 180.0),
    ("°/s", "rad/s", std::f64::consts::PI / 180.0),
    ("m/s", "m/s", 1.0),
    ("km/h", "m/s", 1.0 / 3.6),
    ("m/s²", "m/s²", 1.0),
    ("m/s^2", "m/s²", 1.0),
    ("N", "N", 1.0),
    ("mN", "N", 1e-3),
    ("Hz", "Hz", 1.0),
    ("kHz", "Hz", 1e3),
    ("1/s", "1/s", 1.0),
    ("kg m²", "kg m²", 1.0),
    ("kg m^2", "kg m²", 1.0),
];

/// Returns what to write instead of a text that is a number but for a decimal comma or a unit. `unit` is that of the value,
/// if known.
#[must_use]
pub fn advice(text: &str, unit: Option<&str>) -> Option<String> {
    let text = text.trim();
    if text.parse::<f64>().is_ok() {
        return None;
    }
    let with_point: Cow<'_, str> = match text.split_once(',') {
        Some((whole, rest))
            if !text.contains('.')
                && whole.ends_with(|last: char| last.is_ascii_digit())
                && rest.starts_with(|first: char| first.is_ascii_digit())
                && !rest.contains(',') =>
        {
            format!("{whole}.{rest}").into()
        }
        _ => text.into(),
    };
    if with_point.parse::<f64>().is_ok() {
        return Some(format!("the decimal sign is a point: write {with_point}"));
    }
    let (number, value, meant, factor) = UNITS.iter().find_map(|&(word, meant, factor)| {
        let number = with_point.strip_suffix(word)?.trim_end();
        Some((number, number.parse::<f64>().ok()?, meant, factor))
    })?;
    match unit {
        Some(unit) if unit == meant && factor == 1.0 => Some(format!(
            "the value is in {unit}, without the unit: write {number}"
        )),
        Some(unit) if unit == meant => Some(format!(
            "the value is in {unit}, without the unit: write {}",
            rounded(value * factor)
        )),
        Some(unit) => Some(format!(
            "the value is in {unit}, without the unit: write a number only"
        )),
        None if factor == 1.0 => Some(format!("a value has no unit here: write {number}")),
        None => Some("a value has no unit here: write a number only, in SI units".to_owned()),
    }
}

/// Returns a number without the rounding errors of a conversion.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comma_and_a_unit_are_named_with_what_to_write() {
        for (text, unit, expected) in [
            ("0,19", Some("kg"), "the decimal sign is a point: write 0.19"),
            ("60s", Some("s"), "the value is in s, without the unit: write 60"),
            ("60 s", None, "a value has no unit here: write 60"),
            (
                "200g",
                Some("kg"),
                "the value is in kg, without the unit: write 0.2",
            ),
            (
                "1,5 m",
                Some("m"),
                "the value is in m, without the unit: write 1.5",
            ),
            (
                "20 ms",
                Some("s"),
                "the value is in s, without the unit: write 0.02",
            ),
            (
                "45°",
                Some("rad"),
                "the value is in rad, without the unit: write 0.785398163397",
            ),
            (
                "3kg",
                Some("s"),
                "the value is in s, without the unit: write a number only",
            ),
            (
                "20ms",
                None,
                "a value has no unit here: write a number only, in SI units",
            ),
        ] {
            assert_eq!(advice(text, unit).as_deref(), Some(expected), "{text}");
        }
        for text in [
            "0.19",
            "",
            "1,2,3",
            "10.0.0.1",
            "60parsec",
            "s",
            "following",
            "[1, 2",
            "1,",
        ] {
            assert_eq!(advice(text, Some("s")), None, "{text}");
        }
    }
}
