//! What was found beside what the scenario states.

use std::fmt;

use comfy_table::{Table, presets};
use serde::Serialize;

/// Deviation of the marker offset with which it is identified, m: markers are glued within three of it.
pub const MARKER_OFFSET_DEVIATION: f64 = 0.02;

/// Standard error above which an offset counts as unknown, m.
const OFFSET_UNKNOWN: f64 = 0.005;

/// Deviation of an offset beside what the filter knows of it, m: a link of 11 bits and a flight of small tilts draw it
/// towards zero by up to 3 mm.
pub const OFFSET_SYSTEMATIC: f64 = 0.002;

/// Standard errors by which a value may differ from the stated one by chance.
const BY_CHANCE: f64 = 2.0;

/// A number of the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantity {
    /// As the scenario states it.
    pub stated: f64,
    /// As the flight shows it.
    pub found: f64,
    /// Standard error of that.
    pub error: f64,
}

/// The result of an identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// Point that the cameras track, seen from the centre of mass, in {B}, m.
    pub marker_offset: [Quantity; 3],
    /// Time from the sending of a frame to its acting, as captures show it, s.
    pub radio_latency: Quantity,
    /// Standard deviation of a captured position, each component, m.
    pub position_deviation: Quantity,
    /// Standard deviation of a captured attitude about each axis, rad.
    pub attitude_deviation: Quantity,
}

/// Judgement of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    AsStated,
    Differs,
    Unknown,
}

impl Quantity {
    /// Returns the judgement of a number that matters if it is wrong by more than `matters`.
    fn verdict(&self, matters: f64, unknown: f64) -> Verdict {
        if self.error > unknown {
            Verdict::Unknown
        } else if (self.found - self.stated).abs() > matters.max(BY_CHANCE * self.error) {
            Verdict::Differs
        } else {
            Verdict::AsStated
        }
    }
}

impl Identification {
    /// Returns the lines of a table: key, number, unit in which it is shown with its size, and judgement.
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
            delay.verdict(0.002, 0.01),
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

    /// Returns the lines of a scenario that state what was found.
    fn snippet(&self) -> String {
        let [x, y, z] = self
            .marker_offset
            .map(|quantity| match quantity.verdict(0.0, OFFSET_UNKNOWN) {
                Verdict::Unknown => quantity.stated,
                Verdict::AsStated | Verdict::Differs => quantity.found,
            });
        format!(
            "[model]\nmarker_offset = [{x:.3}, {y:.3}, {z:.3}]\nradio_latency = {:.5}\n\n\
             [estimator.kalman]\nposition_deviation = {:.2e}\nattitude_deviation = {:.2e}\n",
            self.radio_latency.found, self.position_deviation.found, self.attitude_deviation.found
        )
    }
}

impl fmt::Display for Identification {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(["key", "stated", "found", "standard error", "unit", ""]);
        let lines = self.lines();
        for (key, quantity, unit, size, verdict) in &lines {
            let shown =
                [quantity.stated, quantity.found, quantity.error].map(|value| format!("{:.2}", value / size));
            let verdict = match verdict {
                Verdict::AsStated => "as stated",
                Verdict::Differs => "differs",
                Verdict::Unknown => "unknown",
            };
            let [stated, found, error] = shown;
            table.add_row([key, &stated, &found, &error, *unit, verdict]);
        }
        writeln!(formatter, "{table}")?;
        if lines.iter().any(|line| line.4 == Verdict::Unknown) {
            writeln!(
                formatter,
                "\nUnknown: the vehicle did not turn enough about two axes; fly a figure such as the eight."
            )?;
        }
        if lines.iter().any(|line| line.4 == Verdict::Differs) {
            write!(formatter, "\nPut into the scenario:\n\n{}", self.snippet())?;
        }
        Ok(())
    }
}
