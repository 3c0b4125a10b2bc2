//! The summary as people read it.

use std::fmt::{Display, Formatter, Result};

use comfy_table::{Table, presets};
use shared_types::scenario::Vector;

use super::faults::{BEFORE, fault_table};
use super::flight;
use super::{Outcome, Phase, SETTLED, Summary, TopicCount, ULTIMATE_WINDOW, Verdict};

impl Display for Summary {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self { run, seed, .. } = self;
        writeln!(
            formatter,
            "{}, seed {seed}, {}: {:.3} s simulated in {:.3} s ({:.0} times real time), {}",
            run.scenario,
            run.host,
            self.simulated_seconds,
            run.wall_seconds,
            self.real_time_factor,
            run.outcome
        )?;
        if !run.reason.is_empty() {
            writeln!(formatter, "{}", run.reason)?;
        }
        writeln!(formatter, "\n{}\n", phase_table(&self.phases))?;
        writeln!(
            formatter,
            "‖z1‖: distance from the path. Ultimate: largest in a phase's last {ULTIMATE_WINDOW} s; the theorem bounds it by {:.5} m.",
            self.ultimate_bound
        )?;
        if !self.flight.is_empty() {
            writeln!(formatter, "{}", flight::in_words(&self.flight))?;
        }
        if !self.faults.is_empty() {
            writeln!(formatter, "\n{}\n", fault_table(&self.faults))?;
            writeln!(
                formatter,
                "‖p − pd‖: true distance from the path's point. Back: for good within {SETTLED} m or the largest distance of the {BEFORE} s before, counted from the fault's end."
            )?;
        }
        if let Some(timing) = &run.timing {
            writeln!(formatter, "\n{timing}\n")?;
        }
        if let Some(laboratory) = &run.laboratory {
            writeln!(formatter, "{laboratory}")?;
        }
        write!(formatter, "{}", samples_in_words(&self.topics))?;
        if let [first, others @ ..] = run.rebirths.as_slice() {
            write!(formatter, "\n{first}")?;
            if run.timing.is_none() {
                write!(formatter, "; the log shows nothing of it")?;
            }
            if !others.is_empty() {
                write!(
                    formatter,
                    "; so did others, {} times (see host.mcap)",
                    others.len()
                )?;
            }
        }
        Ok(())
    }
}

impl Display for Outcome {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.pad(match self {
            Self::Completed => "completed",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
        })
    }
}

impl Display for Verdict {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        formatter.pad(match self {
            Self::Within => "within the bound",
            Self::Near => "near the bound",
            Self::Exceeded => "above the bound",
        })
    }
}

fn phase_table(phases: &[Phase]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header([
        "phase, s".to_owned(),
        "peak ‖z1‖, m".to_owned(),
        "ultimate ‖z1‖, m".to_owned(),
        format!("settled below {SETTLED} m after, s"),
        "mass, kg: true, estimated".to_owned(),
        "disturbance, m/s²: true, estimated".to_owned(),
        "γ".to_owned(),
    ]);
    for phase in phases {
        table.add_row(phase_row(phase));
    }
    table
}

fn phase_row(phase: &Phase) -> [String; 7] {
    let parameters = &phase.parameters;
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.4}"));
    let ultimate = match (phase.ultimate, phase.verdict) {
        (Some(ultimate), Some(verdict)) => format!("{ultimate:.5}\n{verdict}"),
        _ if phase.is_complete => "–\nthe law was not asked".to_owned(),
        _ => "–\nnot flown to its end".to_owned(),
    };
    let settling = phase
        .settling_time
        .map_or_else(|| "not settled".to_owned(), |time| format!("{time:.3}"));
    [
        format!("{} to {}", phase.begins, phase.ends),
        format!("{:.4}", phase.peak),
        ultimate,
        settling,
        format!(
            "{}\n{}",
            number(parameters.mass),
            number(parameters.mass_estimate)
        ),
        format!(
            "{}\n{}",
            vector(parameters.disturbance),
            vector(parameters.disturbance_estimate)
        ),
        number(phase.gamma),
    ]
}

fn vector(value: Option<Vector>) -> String {
    value.map_or_else(|| "–".to_owned(), |[x, y, z]| format!("[{x:.3}, {y:.3}, {z:.3}]"))
}

/// How many samples there are, and which are missing.
fn samples_in_words(topics: &[TopicCount]) -> String {
    let recorded: u64 = topics.iter().map(|topic| topic.recorded).sum();
    let lost: Vec<_> = topics
        .iter()
        .filter(|topic| topic.lost > 0)
        .map(|topic| format!("{} of {}", topic.lost, topic.topic))
        .collect();
    if lost.is_empty() {
        format!("{recorded} samples recorded, none lost.")
    } else {
        format!("{recorded} samples recorded, lost: {}.", lost.join(", "))
    }
}
