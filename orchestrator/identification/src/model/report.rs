//! The found values beside those that the scenario states.

use std::fmt;

use comfy_table::{Table, presets};
use serde::Serialize;

use super::answer::Answer;
use crate::rehearsal::{Rehearsal, advice};

/// Prior standard deviation of the marker offset in the identification, m: markers are within three of it.
pub const MARKER_OFFSET_DEVIATION: f64 = 0.02;

/// Half-width of an interval above which an offset counts as unknown, m.
const OFFSET_UNKNOWN: f64 = 0.01;

/// Half-width of an interval above which a delay counts as unknown, s.
const DELAY_UNKNOWN: f64 = 0.01;

/// Half-width of an interval above which the lag of the thrust counts as unknown, and difference up to which it is irrelevant, s.
const THRUST_LAG_UNKNOWN: f64 = 0.03;
const THRUST_LAG_MATTERS: f64 = 0.01;

/// Note on a flight whose lags were not found.
const EFFECTIVE: &str = "This flight does not tell delay and lags apart: fly again, 60 s in the air, in a hover or along a figure. The radio_latency is an effective delay: the \
                         radio's own, and all lag of thrust and body rates beyond what [model] states.";

/// Note on a delay that is not as stated, where the lags were found.
const NOT_SEPARABLE: &str = "The radio_latency includes what no flight distinguishes from the radio: waiting in the transmitter and \
                             on board, and captures that are later than their stamps.";

/// What is identified here, in words.
const VALUES: &str = "delay, lags, marker offset and noise";

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
    /// What replaced the laboratory; `None` for a laboratory, and for a scenario without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rehearsal: Option<Rehearsal>,
    /// `true` if the machine was late, so that nothing of it is fit for a scenario: not known to the samples.
    #[serde(skip)]
    pub is_late: bool,
    /// Tracked point relative to the centre of mass, in {B}, m.
    pub marker_offset: [Quantity; 3],
    /// Effective delay from sending a frame to its effect in the captures, s, with all lag beyond the model's: that of the radio
    /// link alone is in the answer.
    pub effective_delay: Quantity,
    /// Standard deviation of a captured position, each component, m.
    pub position_deviation: Quantity,
    /// Standard deviation of a captured attitude about each axis, rad.
    pub attitude_deviation: Quantity,
    /// The delay from a command to its answer in the captures, with its parts; `None` if the flight is too short for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub answer: Option<Answer>,
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

/// Row of the table.
struct Line {
    /// Table and key of the scenario.
    key: [&'static str; 2],
    /// Component of a vector.
    axis: Option<usize>,
    quantity: Quantity,
    unit: &'static str,
    verdict: Verdict,
}

impl Identification {
    /// Returns the rows of the table.
    fn lines(&self) -> Vec<Line> {
        let line = |key, axis, quantity: Quantity, unit, matters, unknown| Line {
            key,
            axis,
            quantity,
            unit,
            verdict: quantity.verdict(matters, unknown),
        };
        let mut lines: Vec<Line> = (0..3)
            .map(|axis| {
                let offset = self.marker_offset[axis];
                line(MARKER_OFFSET, Some(axis), offset, "mm", 0.002, OFFSET_UNKNOWN)
            })
            .collect();
        let delay = |key, quantity| line(["model", key], None, quantity, "ms", 0.002, DELAY_UNKNOWN);
        if let Some(answer) = &self.answer {
            lines.push(delay("radio_latency", answer.radio_latency));
            lines.push(delay("rate_lag", answer.rate_lag));
            let (matters, unknown) = (THRUST_LAG_MATTERS, THRUST_LAG_UNKNOWN);
            lines.push(line(
                ["model", "thrust_lag"],
                None,
                answer.thrust_lag,
                "ms",
                matters,
                unknown,
            ));
        } else {
            lines.push(delay("radio_latency", self.effective_delay));
        }
        for (key, quantity, unit) in [
            ("position_deviation", self.position_deviation, "mm"),
            ("attitude_deviation", self.attitude_deviation, "mrad"),
        ] {
            let matters = 0.5 * quantity.stated;
            lines.push(line(
                ["estimator.kalman", key],
                None,
                quantity,
                unit,
                matters,
                f64::INFINITY,
            ));
        }
        lines
    }

    /// Returns the lines of a scenario for the values that differ.
    fn snippet(&self) -> String {
        let lines = self.lines();
        let mut tables: [(&str, Vec<String>); 2] =
            ["model", "estimator.kalman"].map(|table| (table, Vec::new()));
        let offset = lines.iter().filter(|line| line.key == MARKER_OFFSET);
        if offset.clone().any(|line| line.verdict == Verdict::Differs) {
            let components = offset.map(|line| {
                let Quantity { stated, found, .. } = line.quantity;
                let differs = line.verdict == Verdict::Differs;
                format!("{:.4}", if differs { found } else { stated })
            });
            let components: Vec<String> = components.collect();
            tables[0]
                .1
                .push(format!("marker_offset = [{}]", components.join(", ")));
        }
        let others = lines.iter().filter(|line| line.axis.is_none());
        for line in others.filter(|line| line.verdict == Verdict::Differs) {
            let [table, key] = line.key;
            let found = line.quantity.found;
            let value = if table == "model" {
                format!("{found:.5}")
            } else {
                format!("{found:.2e}")
            };
            let keys = tables.iter_mut().find(|(name, _)| *name == table);
            keys.into_iter()
                .for_each(|(_, keys)| keys.push(format!("{key} = {value}")));
        }
        let stated = tables.iter().filter(|(_, keys)| !keys.is_empty());
        let stated = stated.map(|(table, keys)| format!("[{table}]\n{}\n", keys.join("\n")));
        stated.collect::<Vec<_>>().join("\n")
    }
}

/// Size of a displayed unit: mm, ms or mrad.
const UNIT: f64 = 1e-3;

/// Table and key of the marker offset.
const MARKER_OFFSET: [&str; 2] = ["model", "marker_offset"];

impl fmt::Display for Identification {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = table(&["key", "stated", "found", "95 % interval", "unit", ""]);
        let lines = self.lines();
        for line in &lines {
            let [section, key] = line.key;
            let axis = line.axis.map_or("", |axis| [", x", ", y", ", z"][axis]);
            let key = format!("{section}.{key}{axis}");
            let [stated, found, interval] = cells(&line.quantity);
            table.add_row([&key, &stated, &found, &interval, line.unit, line.verdict.word()]);
        }
        writeln!(formatter, "{table}")?;
        for verdict in [Verdict::Close, Verdict::NotCertain, Verdict::Unknown] {
            if lines.iter().any(|line| line.verdict == verdict) {
                writeln!(formatter, "\n{}", verdict.meaning())?;
            }
        }
        let delay = lines.iter().find(|line| line.key[1] == "radio_latency");
        if self.answer.is_none() {
            writeln!(formatter, "\n{EFFECTIVE}")?;
        } else if delay.is_some_and(|line| matches!(line.verdict, Verdict::NotCertain | Verdict::Differs)) {
            writeln!(formatter, "\n{NOT_SEPARABLE}")?;
        }
        if let Some(answer) = &self.answer {
            writeln!(formatter, "\n{answer}")?;
        }
        let advice = advice(self.rehearsal, self.is_late, VALUES, &self.snippet());
        if !advice.is_empty() {
            write!(formatter, "\n{advice}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Answer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = table(&["delay of a command, ms", "stated", "found", "95 % interval"]);
        let to_capture = Quantity {
            stated: self.to_rate.stated + self.capture_age,
            found: self.to_rate.found + self.capture_age,
            ..self.to_rate
        };
        for (what, quantity) in [
            ("to its thrust: radio_latency + thrust_lag", &self.to_thrust),
            ("to its body rate: radio_latency + rate_lag", &self.to_rate),
            ("to the capture that shows the rate", &to_capture),
        ] {
            let [stated, found, interval] = cells(quantity);
            table.add_row([what, &stated, &found, &interval]);
        }
        write!(
            formatter,
            "{table}\nThe last row has the age of a capture on arrival, {:.1} ms (median), as its stamp states it.",
            self.capture_age / UNIT
        )
    }
}

fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(header);
    table
}

/// Returns a quantity's stated value, found value and interval, in thousandths.
fn cells(quantity: &Quantity) -> [String; 3] {
    let Quantity {
        stated, found, error, ..
    } = quantity;
    let [stated, found, low, high] =
        [*stated, *found, found - error, found + error].map(|value| format!("{:.2}", value / UNIT));
    [stated, found, format!("{low} to {high}")]
}
