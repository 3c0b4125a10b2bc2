//! Numbers and text in few columns.

/// Formats a time in at most five columns: `850ns`, `45µs`, `1.2ms`, `35ms`, `2.5s`, `999s`.
pub fn short_time(seconds: f64) -> String {
    const UNITS: [(f64, &str); 3] = [(1e9, "ns"), (1e6, "µs"), (1e3, "ms")];
    let text = UNITS
        .into_iter()
        .find_map(|(scale, unit)| digits(seconds * scale).map(|number| number + unit));
    text.or_else(|| digits(seconds).map(|number| number + "s"))
        .unwrap_or_else(|| "long".to_owned())
}

/// Formats a number below 1000 in three columns, with one decimal from 1 to 10.
fn digits(number: f64) -> Option<String> {
    match number {
        _ if number < 0.95 => Some(format!("{number:.0}")),
        _ if number < 9.95 => Some(format!("{number:.1}")),
        _ if number < 999.5 => Some(format!("{number:.0}")),
        _ => None,
    }
}

/// Formats a count in at most four columns: `9999`, `12k`, `999M`.
pub fn short_count(count: u64) -> String {
    match count {
        0..10_000 => count.to_string(),
        10_000..1_000_000 => format!("{}k", count / 1000),
        1_000_000..1_000_000_000 => format!("{}M", count / 1_000_000),
        _ => "many".to_owned(),
    }
}

/// Truncates a text to `columns`, with an ellipsis.
pub fn cut(text: &str, columns: usize) -> String {
    if text.chars().count() <= columns {
        return text.to_owned();
    }
    let mut short: String = text.chars().take(columns.saturating_sub(1)).collect();
    short.push('…');
    short
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn times_are_readable() {
        let times = [
            0.0, 850e-9, 1.26e-6, 45.4e-6, 999.6e-6, 9.96e-3, 0.12, 2.46, 100.0, 5000.0,
        ];
        let words = times.map(short_time);
        let expected = [
            "0ns", "850ns", "1.3µs", "45µs", "1.0ms", "10ms", "120ms", "2.5s", "100s", "long",
        ];
        assert_eq!(words, expected);
    }

    #[test]
    fn counts_are_readable() {
        let words = [0, 9999, 10_000, 999_999, 1_000_000, u64::MAX].map(short_count);
        assert_eq!(words, ["0", "9999", "10k", "999k", "1M", "many"]);
    }

    proptest! {
        #[test]
        fn they_fit_their_columns(time in 0.0..1e9_f64, scale in 0..10_i32, count: u64, shift in 0..64_u32) {
            let time = time / libm::pow(10.0, f64::from(scale) * 2.0);
            prop_assert!(short_time(time).chars().count() <= 5, "{}", short_time(time));
            prop_assert!(short_count(count >> shift).len() <= 4);
        }

        #[test]
        fn what_is_cut_fits_and_says_so(text in "\\PC{0,40}", columns in 1..50_usize) {
            let short = cut(&text, columns);
            prop_assert!(short.chars().count() <= columns);
            prop_assert!(short == text || short.ends_with('…'));
        }
    }
}
