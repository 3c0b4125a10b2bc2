//! The summary as a table for users: at most [`WIDTH`] columns wide, on any terminal.

use std::fmt::{Display, Formatter, Result};

use scenario::Vector;
use shared_types::FlightPhase;

use super::faults::{BEFORE, faults_in_words};
use super::flight::{self, NO_TAKE_OFF};
use super::innovations::{self, SourceInnovations};
use super::{AgainstBound, Outcome, Phase, Summary, TopicCount};
use crate::stretch::Metrics;
use crate::tracker::StateSource;
use crate::{SETTLED, ULTIMATE_WINDOW};

/// Maximum width, columns.
pub(super) const WIDTH: usize = 80;

/// Width of the names of quantities, columns.
const NAME: usize = 22;

/// Width of a value, columns.
const VALUE: usize = 19;

/// Maximum number of stretches side by side.
const BESIDE: usize = 3;

/// Text for a true value outside of simulations.
const UNKNOWN: &str = "unknown";

/// Time after a loss within which the end of the flight is attributed to it, s.
const AT_ONCE: f64 = 0.05;

impl Display for Summary {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        self.write_verdict(formatter)?;
        if self.metrics.is_some() || !self.phases.is_empty() {
            writeln!(formatter)?;
            self.write_metrics(formatter)?;
        }
        if !self.flight.is_empty() {
            writeln!(formatter, "{}", wrapped(&flight::in_words(&self.flight)))?;
        }
        if !self.faults.is_empty() {
            write!(formatter, "{}", faults_in_words(&self.faults))?;
            let back = format!(
                "Back: for good within {} or the largest distance of the {BEFORE} s before, counted from the fault's end. A fault is \
                 watched until the next planned event; distances count until it lands.",
                length(SETTLED)
            );
            writeln!(formatter, "{}\n", wrapped(&back))?;
        }
        if !self.innovations.is_empty() {
            writeln!(formatter, "{}\n", innovations::in_words(&self.innovations))?;
        }
        if let Some(battery) = &self.battery {
            writeln!(formatter, "{}", wrapped(&battery.to_string()))?;
        }
        if let Some(timing) = &self.run.timing {
            writeln!(formatter, "\n{timing}\n")?;
        }
        if let Some(laboratory) = &self.run.laboratory {
            writeln!(formatter, "{}", wrapped(&laboratory.to_string()))?;
        }
        write!(formatter, "{}", wrapped(&samples_in_words(self)))?;
        self.write_restarts(formatter)
    }
}

impl Summary {
    /// Writes the end of the run and the verdict on the vehicle. The lateness of the machine comes first: it may be the
    /// cause of the rest.
    fn write_verdict(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self { run, seed, .. } = self;
        if let Some(lateness) = self.lateness() {
            writeln!(formatter, "{}", wrapped(&lateness))?;
        }
        if let Some(late) = &self.late_cameras {
            writeln!(formatter, "{}", wrapped(&late.to_string()))?;
        }
        let flown = match &run.timing {
            Some(_) => format!(
                "{}, seed {seed}, {}: {:.3} s flown",
                run.scenario, run.host, self.simulated_seconds
            ),
            None => format!(
                "{}, seed {seed}, {}: {:.3} s simulated in {:.3} s ({:.0} times real time)",
                run.scenario, run.host, self.simulated_seconds, run.wall_seconds, self.real_time_factor
            ),
        };
        writeln!(formatter, "{}", wrapped(&flown))?;
        if self.began_at > 0.0 {
            let text = format!(
                "taken over at {:.3} s: what was flown before is not judged here; the log of the orchestrator that died has it up to its death",
                self.began_at
            );
            writeln!(formatter, "{}", wrapped(&text))?;
        }
        let is_whole = self.phases.last().is_none_or(|phase| phase.is_complete);
        match run.outcome {
            Outcome::Lost if !is_whole => {
                let lost_at = self.lost.as_ref().map_or(0.0, |loss| loss.time);
                let after = self.began_at + self.simulated_seconds - lost_at;
                if after < AT_ONCE {
                    writeln!(formatter, "ended when the vehicle was lost")?;
                } else {
                    writeln!(formatter, "ended {after:.1} s after the vehicle was lost")?;
                }
            }
            Outcome::Interrupted => {
                let text = format!("interrupted: {}", run.reason);
                writeln!(formatter, "{}", wrapped(&text))?;
            }
            Outcome::Completed if let Some(failed) = &self.failed_take_off => {
                writeln!(formatter, "{}", wrapped(failed))?;
            }
            // The command prints the reason of a failure.
            outcome => writeln!(formatter, "{outcome}")?,
        }
        if let Some(kill) = &self.killed {
            writeln!(formatter, "{}", wrapped(&format!("KILLED {kill}")))?;
        }
        match &self.failed_take_off {
            Some(failed) if run.outcome != Outcome::Completed => writeln!(formatter, "{}", wrapped(failed))?,
            None if self.has_stayed_on_the_ground() => writeln!(formatter, "{NO_TAKE_OFF}")?,
            _ => {}
        }
        if let Some(response) = &self.response {
            writeln!(formatter, "{}", wrapped(&format!("WRONG: {response}")))?;
        }
        if self.had_low_battery() {
            let text = "LOW BATTERY: below `rc_output.battery.lowest`";
            writeln!(formatter, "{}", wrapped(text))?;
        }
        if let Some(problems) = self.navigation_problems() {
            writeln!(formatter, "{}", wrapped(&format!("NAVIGATION: {problems}")))?;
        }
        if let Some(loss) = &self.lost {
            let text = format!("LOST at {} s: {loss}", loss.time);
            writeln!(formatter, "{}", wrapped(&text))?;
        } else if self.metrics.is_some() {
            let text = self.headline();
            writeln!(formatter, "{}", wrapped(&text))?;
        }
        Ok(())
    }

    /// Returns whether the vehicle of a flight with phases was on the ground all the time.
    fn has_stayed_on_the_ground(&self) -> bool {
        let is_on_the_ground = |phase: &str| {
            [FlightPhase::Disarmed, FlightPhase::Armed]
                .map(FlightPhase::name)
                .contains(&phase)
        };
        !self.flight.is_empty() && self.flight.iter().all(|begin| is_on_the_ground(begin.phase))
    }

    /// Returns whether the battery, measured or modelled, fell below its lowest voltage.
    #[must_use]
    pub fn had_low_battery(&self) -> bool {
        let measured = self.run.laboratory.as_ref();
        let measured = measured.and_then(|laboratory| laboratory.radio_link.as_ref()?.battery.as_ref());
        self.battery.is_some_and(|battery| battery.was_low) || measured.is_some_and(|battery| battery.was_low)
    }

    /// Describes what is wrong with the sources of inertial navigation; `None` if nothing is.
    #[must_use]
    pub fn navigation_problems(&self) -> Option<String> {
        let problems = self.innovations.iter().filter_map(SourceInnovations::problem);
        let problems: Vec<_> = problems.collect();
        (!problems.is_empty()).then(|| problems.join("; "))
    }

    /// Returns how the flight went other than as planned: killed, never in the air, wrong in its response, or lost.
    #[must_use]
    pub fn misfortunes(&self) -> Vec<String> {
        let killed = self.killed.as_ref().filter(|kill| !kill.after_landing);
        let killed = killed.map(|kill| format!("KILLED {kill}"));
        let grounded = self.failed_take_off.clone();
        let wrong = self
            .response
            .as_ref()
            .map(|response| format!("WRONG: {response}"));
        let lost = self.lost.as_ref();
        let lost = lost.map(|loss| format!("LOST at {} s: {loss}", loss.time));
        [killed, grounded, wrong, lost].into_iter().flatten().collect()
    }

    /// Returns the headline: the number by which a flight is judged.
    #[must_use]
    pub fn headline(&self) -> String {
        let Some(steady) = &self.steady else {
            return "No steady state was flown after the last change of the vehicle.".to_owned();
        };
        let [from, to] = steady.span;
        let source = match self.source {
            StateSource::Truth => "",
            StateSource::Estimate => ", as estimated",
        };
        let distance = length(steady.rmse);
        format!("{distance} from the path in steady state (root mean square, {from:.1} to {to:.1} s{source})")
    }

    /// Describes the lateness of the machine in a flight that was lost, killed or made to land, or in which the vehicle was not
    /// ready or answered wrongly.
    #[must_use]
    pub fn lateness(&self) -> Option<String> {
        let is_ordinary = self.lost.is_none()
            && self.killed.is_none()
            && self.response.is_none()
            && !self.flight.iter().any(|phase| phase.is_unasked);
        if is_ordinary {
            return None;
        }
        let lateness = self.run.lateness()?;
        Some(format!(
            "The {lateness}. Judge the flight accordingly; `gerono doctor` says what to do about the machine."
        ))
    }

    /// Writes the numbers of every phase and of the whole flight, side by side within the width.
    fn write_metrics(&self, formatter: &mut Formatter<'_>) -> Result {
        let mut columns: Vec<Column> = self.phases.iter().map(Column::of_phase).collect();
        match columns.as_mut_slice() {
            [only] => only.metrics = self.metrics,
            _ => columns.push(Column::of_all(self.metrics)),
        }
        for columns in columns.chunks(BESIDE) {
            write_columns(formatter, columns, self.source)?;
            writeln!(formatter)?;
        }
        if let Some(bound) = self.ultimate_bound {
            let text = format!("The theorem bounds the distance for t → ∞ by {}.", length(bound));
            writeln!(formatter, "{}", wrapped(&text))?;
        }
        if self
            .lost
            .as_ref()
            .is_some_and(|loss| loss.time < self.measured_until)
        {
            let text = "The numbers include what was flown after the loss.";
            writeln!(formatter, "{}", wrapped(text))?;
        }
        for estimate in &self.at_bound {
            writeln!(formatter, "{}", wrapped(&estimate.to_string()))?;
        }
        if self.source == StateSource::Estimate {
            let text = "Distances are estimated: in a laboratory nobody knows where the vehicle truly is.";
            writeln!(formatter, "{}", wrapped(text))?;
        }
        Ok(())
    }

    fn write_restarts(&self, formatter: &mut Formatter<'_>) -> Result {
        if let [first, others @ ..] = self.run.restarts.as_slice() {
            let mut text = first.to_string();
            if self.run.timing.is_none() {
                text += "; the log shows nothing of it";
            }
            if !others.is_empty() {
                text += &format!("; so did others, {} times (see host.mcap)", others.len());
            }
            write!(formatter, "\n{}", wrapped(&text))?;
        }
        Ok(())
    }
}

/// A stretch of the flight, as a column.
struct Column<'a> {
    head: String,
    metrics: Option<Metrics>,
    phase: Option<&'a Phase>,
}

impl<'a> Column<'a> {
    fn of_phase(phase: &'a Phase) -> Self {
        Self {
            head: format!("{} to {} s", phase.begins, phase.ends),
            metrics: phase.metrics,
            phase: Some(phase),
        }
    }

    fn of_all(metrics: Option<Metrics>) -> Self {
        Self {
            head: "all".to_owned(),
            metrics,
            phase: None,
        }
    }
}

/// Row: name, and value in a column, if any.
type Row = (&'static str, fn(&Column<'_>) -> Option<String>);

fn metric(column: &Column<'_>, of: fn(&Metrics) -> f64) -> Option<String> {
    column.metrics.as_ref().map(|metrics| length(of(metrics)))
}

fn steady(column: &Column<'_>, of: fn(&Metrics) -> f64) -> Option<String> {
    column.phase?.steady.as_ref().map(|metrics| length(of(metrics)))
}

const ROWS: [Row; 22] = [
    ("steady state, from", |column| {
        let [from, _] = column.phase?.steady?.span;
        Some(format!("{from:.3} s"))
    }),
    ("  root mean square", |column| {
        steady(column, |metrics| metrics.rmse)
    }),
    ("  95 %", |column| steady(column, |metrics| metrics.p95)),
    ("  largest", |column| steady(column, |metrics| metrics.max)),
    ("transient, rms", |column| {
        Some(length(column.phase?.transient?.rmse))
    }),
    ("whole, rms", |column| metric(column, |metrics| metrics.rmse)),
    ("  standard deviation", |column| {
        metric(column, |metrics| metrics.deviation)
    }),
    ("  median", |column| metric(column, |metrics| metrics.p50)),
    ("  95 %", |column| metric(column, |metrics| metrics.p95)),
    ("  99 %", |column| metric(column, |metrics| metrics.p99)),
    ("  largest", |column| metric(column, |metrics| metrics.max)),
    ("    at", |column| {
        Some(format!("{:.3} s", column.metrics?.time_of_max))
    }),
    ("  largest, last 5 s", |column| {
        let phase = column.phase?;
        Some(match phase.ultimate {
            Some(ultimate) => length(ultimate),
            None if phase.is_complete => "not on the path".to_owned(),
            None => "not flown to end".to_owned(),
        })
    }),
    ("  against theorem", |column| {
        Some(column.phase?.against_bound?.to_string())
    }),
    ("  below 2 cm after", |column| {
        // Not for the whole flight, where it would span all phases.
        let settled = column.phase?.metrics?.settling_time;
        Some(settled.map_or_else(|| "not settled".to_owned(), |time| format!("{time:.3} s")))
    }),
    ("thrust, mean", |column| {
        Some(physical(column.metrics?.thrust_mean, "N"))
    }),
    ("body rate, rms", |column| {
        Some(physical(column.metrics?.body_rate_rms, "rad/s"))
    }),
    ("frames at a limit", |column| {
        let share = column.metrics?.saturated_share?;
        Some(if share == 0.0 {
            "none".to_owned()
        } else {
            format!("{} %", significant(100.0 * share))
        })
    }),
    ("mass", |column| {
        let parameters = &column.phase?.parameters;
        grams(parameters.mass).or_else(|| parameters.mass_estimate.map(|_| UNKNOWN.to_owned()))
    }),
    ("  estimated", |column| {
        grams(column.phase?.parameters.mass_estimate)
    }),
    ("disturbance, m/s²", |column| {
        let parameters = &column.phase?.parameters;
        let unknown = parameters.disturbance_estimate.map(|_| UNKNOWN.to_owned());
        vector(parameters.disturbance).or(unknown)
    }),
    ("  estimated", |column| {
        vector(column.phase?.parameters.disturbance_estimate)
    }),
];

fn write_columns(formatter: &mut Formatter<'_>, columns: &[Column<'_>], source: StateSource) -> Result {
    const { assert!(ULTIMATE_WINDOW == 5.0 && SETTLED == 0.02, "the rows name them") };
    let name = match source {
        StateSource::Truth => "distance from path",
        StateSource::Estimate => "estimated distance",
    };
    write_row(formatter, name, columns.iter().map(|column| column.head.clone()))?;
    for (name, of) in ROWS {
        let values: Vec<_> = columns.iter().map(of).collect();
        if values.iter().any(Option::is_some) {
            write_row(formatter, name, values.into_iter().map(Option::unwrap_or_default))?;
        }
    }
    Ok(())
}

fn write_row(formatter: &mut Formatter<'_>, name: &str, values: impl Iterator<Item = String>) -> Result {
    let mut line = format!("{name:<NAME$}");
    for value in values {
        line += &format!("{value:<VALUE$}");
    }
    writeln!(formatter, "{}", line.trim_end())
}

/// Formats a length with four digits, in a convenient unit.
pub(super) fn length(metres: f64) -> String {
    let [value, unit] = if metres.abs() < 10.0 {
        [significant(100.0 * metres), "cm".to_owned()]
    } else {
        [significant(metres), "m".to_owned()]
    };
    format!("{value} {unit}")
}

/// Value above which a thrust in N or a body rate in rad/s is not physical for a small vehicle.
const DIVERGED: f64 = 1e3;

/// Formats a value with its unit, if it is physical.
fn physical(value: f64, unit: &str) -> String {
    if value.abs() < DIVERGED {
        format!("{value:.3} {unit}")
    } else {
        "diverged".to_owned()
    }
}

/// Formats a value with four significant digits.
fn significant(value: f64) -> String {
    let size = value.abs();
    if size >= 1e6 {
        return format!("{value:.3e}");
    }
    let decimals = match size {
        _ if size >= 999.95 => 0,
        _ if size >= 99.995 => 1,
        _ if size >= 9.9995 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

fn grams(mass: Option<f64>) -> Option<String> {
    mass.map(|kilograms| format!("{} g", significant(1e3 * kilograms)))
}

fn vector(value: Option<Vector>) -> Option<String> {
    value.map(|components| components.map(|component| format!("{component:.2}")).join(", "))
}

/// Wraps a text at [`WIDTH`] columns, keeping its line breaks and indentations.
pub(super) fn wrapped(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for stated in text.lines() {
        let indentation = &stated[..stated.len() - stated.trim_start().len()];
        let mut line = indentation.to_owned();
        for word in stated.trim_start().split(' ') {
            let has_words = line.len() > indentation.len();
            if has_words && line.chars().count() + 1 + word.chars().count() > WIDTH {
                lines.push(std::mem::replace(&mut line, indentation.to_owned()));
            }
            if line.len() > indentation.len() {
                line.push(' ');
            }
            line += word;
        }
        lines.push(line);
    }
    lines.join("\n")
}

impl Display for Outcome {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.pad(match self {
            Self::Completed => "completed",
            Self::Lost => "the vehicle was lost",
            Self::Killed => "the flight was killed",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
        })
    }
}

impl Display for AgainstBound {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.pad(match self {
            Self::Within => "within the bound",
            Self::Near => "near the bound",
            Self::Exceeded => "above the bound",
        })
    }
}

/// Describes the number of samples and the missing ones: not published, or published and not in the log.
fn samples_in_words(summary: &Summary) -> String {
    let topics = &summary.topics;
    let recorded: u64 = topics.iter().map(|topic| topic.recorded).sum();
    let mut text = match summary.run.in_log {
        Some(in_log) => {
            format!(
                "{recorded} samples received, of which {in_log} are in the log: it could not be written further."
            )
        }
        None => format!("{recorded} samples recorded"),
    };
    let missing = |of: fn(&TopicCount) -> u64| {
        let missing = topics.iter().filter(|topic| of(topic) > 0);
        let missing: Vec<_> = missing
            .map(|topic| format!("{} of {}", of(topic), topic.topic))
            .collect();
        missing.join(", ")
    };
    let not_recorded = missing(|topic| topic.not_recorded);
    if summary.run.in_log.is_none() {
        text += &if not_recorded.is_empty() {
            ", none lost.".to_owned()
        } else {
            format!("; published and not recorded: {not_recorded}.")
        };
    }
    let not_flown = missing(|topic| topic.not_flown);
    if !not_flown.is_empty() {
        text += &format!(" Not flown, because steps were left out: {not_flown}.");
    }
    text
}
