//! Arguments of `gerono grid`.

use std::path::PathBuf;

use clap::Args;
use command_line::failure::Failure;

use grid::FIRST_SEED;
use grid::conditions::{CONDITIONS, ConditionKind, MARGINS, Quantity};
use grid::laws::ControlLaw;

/// Arguments of `gerono grid`.
#[derive(Debug, Args)]
pub struct Grid {
    /// Scenario that the conditions change; it needs the sections of scenarios/fig3_6.toml [default: that scenario, for
    /// 60 s].
    pub scenario: Option<PathBuf>,
    /// Number of seeds, the same for every law [default: 20; with --quick 3].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub seeds: Option<u16>,
    /// First seed; the default ones were not used for tuning.
    #[arg(long, value_name = "SEED", default_value_t = FIRST_SEED)]
    pub first_seed: u64,
    /// Control law to compare, by name, or NAME:KEY=VALUE;KEY=VALUE for a user-defined one; may be given several times [default:
    /// all].
    #[arg(long = "law", value_name = "LAW", value_parser = str::parse::<ControlLaw>)]
    pub laws: Vec<ControlLaw>,
    /// Fly each law with five bandwidths of its position loop, for its front of error against delay, and search no other margins.
    #[arg(long)]
    pub along_bandwidth: bool,
    /// Condition to fly [default: all].
    #[arg(long = "condition", value_delimiter = ',', value_name = "NAME,…", value_parser = str::parse::<ConditionKind>)]
    pub conditions: Vec<ConditionKind>,
    /// Do not search the margins.
    #[arg(long)]
    pub no_margins: bool,
    /// Fly fewer seeds.
    #[arg(long)]
    pub quick: bool,
    /// Also write the tables as LaTeX, into grid.tex.
    #[arg(long)]
    pub latex: bool,
    /// Folder for the results: a new or empty one, or that of an interrupted command, which resumes [default: the next free
    /// runs/grid-N].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

impl Grid {
    /// The end of `gerono grid --help`.
    pub const EXAMPLES: &str = "Examples:\n  \
        gerono grid\n  \
        gerono grid --quick --law paper-18 --law indi --condition calm,gusts\n  \
        gerono grid --along-bandwidth --law indi --law composite-40 --condition calm,gusts\n  \
        gerono grid --law indi --law 'soft:controller.k1=2.0;controller.k2=2.0' --no-margins";

    /// Returns the seeds.
    ///
    /// # Errors
    /// [`Failure`] if they would exceed the largest number.
    pub fn seeds(&self) -> Result<Vec<u64>, Failure> {
        let count = self.seeds.unwrap_or(if self.quick { 3 } else { 20 });
        // There is at least one.
        let last = self.first_seed.checked_add(u64::from(count) - 1);
        let last = last.ok_or_else(|| {
            let reason = format!(
                "--seeds {count} from --first-seed {} on exceeds the largest seed, {}: give a smaller --first-seed",
                self.first_seed,
                u64::MAX
            );
            Failure::bad_input(reason)
        })?;
        Ok((self.first_seed..=last).collect())
    }

    /// Returns the laws.
    ///
    /// # Errors
    /// [`Failure`] if two laws have the same name.
    pub fn laws(&self) -> Result<Vec<ControlLaw>, Failure> {
        if self.laws.is_empty() {
            return Ok(ControlLaw::all());
        }
        for (index, law) in self.laws.iter().enumerate() {
            if self.laws[..index].iter().any(|other| other.name == law.name) {
                let reason = format!("two laws have the name `{}`: rename one of them", law.name);
                return Err(Failure::bad_input(reason));
            }
        }
        Ok(self.laws.clone())
    }

    /// Returns the quantities whose margins are searched: along the bandwidth only the delay, the axis of the front.
    #[must_use]
    pub fn quantities(&self) -> &'static [Quantity] {
        match (self.no_margins, self.along_bandwidth) {
            (true, _) => &[],
            (false, true) => &MARGINS[..1],
            (false, false) => &MARGINS,
        }
    }

    /// Returns the conditions, in the order of the table and each once.
    #[must_use]
    pub fn conditions(&self) -> Vec<ConditionKind> {
        let is_requested = |condition: &ConditionKind| {
            let mut requested = self.conditions.iter();
            self.conditions.is_empty() || requested.any(|requested| requested.name == condition.name)
        };
        CONDITIONS.into_iter().filter(is_requested).collect()
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        grid: Grid,
    }

    #[test]
    fn seeds_follow_the_first_and_do_not_begin_again_at_zero() {
        let seeds = |first: &str| {
            let line = Line::parse_from(["grid", "--first-seed", first, "--seeds", "3"]);
            line.grid.seeds()
        };
        assert_eq!(seeds("201").unwrap(), [201, 202, 203]);
        assert_eq!(seeds("18446744073709551613").unwrap()[2], u64::MAX);
        let refused = seeds("18446744073709551614").unwrap_err().report.to_string();
        assert!(refused.contains("a smaller --first-seed"), "{refused}");
    }
}
