//! The found values beside those that the scenario states.

use std::fmt;

use comfy_table::{Table, presets};
use serde::Serialize;

/// Prior standard deviation of the marker offset in the identification, m: markers are within three of it.
pub const MARKER_OFFSET_DEVIATION: f64 = 0.02;

/// Half-width of an interval above which an offset counts as unknown, m.
const OFFSET_UNKNOWN: f64 = 0.01;

/// Half-width of an interval above which a delay counts as unknown, s.
const DELAY_UNKNOWN: f64 = 0.01;

/// Note on a delay that is not as stated.
const EFFECTIVE: &str = "The radio_latency is an effective delay: the radio's own, and all lag of thrust and body rates beyond \
                         what [model] states. The flight cannot distinguish them: check thrust_lag and rate_lag as well.";

/// An identified parameter of the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantity {
    /// Value in the scenario.
    pub stated: f64,
    /// Identified value.
    pub found: f64,
    /// Half-width of the 95 % interval; infinite if the parameter is not identifiable.
    pub error: f64,
    /// Half-width of the 99.9 % interval.
    pub certain: f64,
}

/// Result of an identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// Tracked point relative to the centre of mass, in {B}, m.
    pub marker_offset: [Quantity; 3],
    /// Effective delay from sending a frame to its effect in the captures, s, with all lag beyond the model's.
    pub radio_latency: Quantity,
    /// Standard deviation of a captured position, each component, m.
    pub position_deviation: Quantity,
    /// Standard deviation of a captured attitude about each axis, rad.
    pub attitude_deviation: Quantity,
}

/// Verdict on a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// The 95 % interval contains the stated value.
    AsStated,
    /// The 95 % interval excludes the stated value, but the difference is irrelevant.
    Close,
    /// The 95 % interval excludes the stated value, but the 99.9 % interval contains it.
    NotCertain,
    Differs,
    Unknown,
}

impl Verdict {
    const fn word(self) -> &'static str {
        match self {
            Self::AsStated => "as stated",
            Self::Close => "close",
            Self::NotCertain => "not certain",
            Self::Differs => "differs",
            Self::Unknown => "unknown",
        }
    }

    /// Returns the explanation below the table; empty if the word needs none.
    fn meaning(self) -> String {
        match self {
            Self::AsStated | Self::Differs => String::new(),
            Self::Close => "Close: the stated value is outside of the interval, but the difference is irrelevant: 2 mm, 2 ms or half of a \
                            stated noise."
                .to_owned(),
            Self::NotCertain => "Not certain: the stated value is outside of the interval, but within the one of 99.9 %, which \
                                 may be chance; fly for longer."
                .to_owned(),
            Self::Unknown => "Unknown: this flight does not determine it; fly a figure such as the eight, for longer or with \
                              more turns."
                .to_owned(),
        }
    }
}

impl Quantity {
    /// Returns the verdict, where differences up to `matters` are irrelevant and half-widths above `unknown` too wide.
    fn verdict(&self, matters: f64, unknown: f64) -> Verdict {
        let by = (self.found - self.stated).abs();
        if self.error > unknown || !self.error.is_finite() {
            Verdict::Unknown
        } else if by <= self.error {
            Verdict::AsStated
        } else if by <= matters {
            Verdict::Close
        } else if by <= self.certain {
            Verdict::NotCertain
        } else {
            Verdict::Differs
        }
    }
}

impl Identification {
    /// Returns the rows of the table: key, parameter, display unit with its size, and verdict.
    fn lines(&self) -> Vec<(String, Quantity, &'static str, f64, Verdict)> {
        let mut lines = Vec::new();
        for (axis, quantity) in ["x", "y", "z"].into_iter().zip(self.marker_offset) {
            let verdict = quantity.verdict(0.002, OFFSET_UNKNOWN);
            lines.push((
                format!("model.marker_offset, {axis}"),
                quantity,
                "mm",
                1e-3,
                verdict,
            ));
        }
        let delay = self.radio_latency;
        lines.push((
            "model.radio_latency".to_owned(),
            delay,
            "ms",
            1e-3,
            delay.verdict(0.002, DELAY_UNKNOWN),
        ));
        let deviations = [
            (
                "estimator.kalman.position_deviation",
                self.position_deviation,
                "mm",
            ),
            (
                "estimator.kalman.attitude_deviation",
                self.attitude_deviation,
                "mrad",
            ),
        ];
        for (key, quantity, unit) in deviations {
            let verdict = quantity.verdict(0.5 * quantity.stated, f64::INFINITY);
            lines.push((key.to_owned(), quantity, unit, 1e-3, verdict));
        }
        lines
    }

    /// Returns the lines of a scenario for the values that differ.
    fn snippet(&self) -> String {
        let lines = self.lines();
        let differs = |line: usize| lines[line].4 == Verdict::Differs;
        let mut model = Vec::new();
        if (0..3).any(differs) {
            let offset = [0, 1, 2].map(|axis| {
                let Quantity { stated, found, .. } = self.marker_offset[axis];
                format!("{:.4}", if differs(axis) { found } else { stated })
            });
            model.push(format!("marker_offset = [{}]", offset.join(", ")));
        }
        if differs(3) {
            model.push(format!("radio_latency = {:.5}", self.radio_latency.found));
        }
        let mut kalman = Vec::new();
        for (line, key, quantity) in [
            (4, "position_deviation", self.position_deviation),
            (5, "attitude_deviation", self.attitude_deviation),
        ] {
            if differs(line) {
                kalman.push(format!("{key} = {:.2e}", quantity.found));
            }
        }
        let tables = [("[model]", model), ("[estimator.kalman]", kalman)];
        let stated = tables.iter().filter(|(_, keys)| !keys.is_empty());
        let stated = stated.map(|(table, keys)| format!("{table}\n{}\n", keys.join("\n")));
        stated.collect::<Vec<_>>().join("\n")
    }
}

impl fmt::Display for Identification {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(["key", "stated", "found", "95 % interval", "unit", ""]);
        let lines = self.lines();
        for (key, quantity, unit, size, verdict) in &lines {
            let Quantity {
                stated, found, error, ..
            } = quantity;
            let [low, high] = [found - error, found + error].map(|value| format!("{:.2}", value / size));
            let [stated, found] = [stated, found].map(|value| format!("{:.2}", value / size));
            let interval = format!("{low} to {high}");
            table.add_row([key, &stated, &found, &interval, *unit, verdict.word()]);
        }
        writeln!(formatter, "{table}")?;
        for verdict in [Verdict::Close, Verdict::NotCertain, Verdict::Unknown] {
            if lines.iter().any(|line| line.4 == verdict) {
                writeln!(formatter, "\n{}", verdict.meaning())?;
            }
        }
        if matches!(lines[3].4, Verdict::NotCertain | Verdict::Differs) {
            writeln!(formatter, "\n{EFFECTIVE}")?;
        }
        if lines.iter().any(|line| line.4 == Verdict::Differs) {
            write!(formatter, "\nPut into the scenario:\n\n{}", self.snippet())?;
        }
        Ok(())
    }
}
