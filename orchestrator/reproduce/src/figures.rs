//! The paper's figures: the flights and the numbers of each.

mod fig1;
pub mod fig10;
mod fig11;
mod fig2;
mod fig3_6;
mod fig7;
mod fig8;
mod fig9;
mod tracking;

use std::str::FromStr;

use super::column::Column;
use super::flight::{FlightSpecification, SeedResults};
use super::row::{MIN_SEEDS, Row};
use scenario_file::values::ValueError;

/// A figure of the paper, or a comparison made in its text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Figure {
    /// Simulation: the eight with a step of mass and inertia.
    Fig1,
    /// Simulation: starts far away.
    Fig2,
    /// The eight in the laboratory, with coins laid on.
    Fig3To6,
    /// Hover in the jet of a fan.
    Fig7,
    /// Hover in the jet of a fan, with the estimators off.
    Fig8,
    /// Hover in the jet of a fan that moves.
    Fig9,
    /// The mass estimate under a steady wind.
    Fig10,
    /// Steps of the yaw angle.
    Fig11,
    /// Path following against trajectory tracking.
    Tracking,
}

/// The parts of a figure.
#[derive(Debug)]
pub struct Experiment {
    /// Title of the figure.
    pub title: &'static str,
    /// Flights of the figure.
    pub specifications: Vec<FlightSpecification>,
    /// Numbers of the figure.
    pub rows: Vec<Row>,
}

impl Figure {
    /// All figures, in the paper's order.
    pub const ALL: [Self; 9] = [
        Self::Fig1,
        Self::Fig2,
        Self::Fig3To6,
        Self::Fig7,
        Self::Fig8,
        Self::Fig9,
        Self::Fig10,
        Self::Fig11,
        Self::Tracking,
    ];

    /// The short list: every kind of experiment once.
    pub const QUICK: [Self; 6] = [
        Self::Fig1,
        Self::Fig3To6,
        Self::Fig7,
        Self::Fig9,
        Self::Fig10,
        Self::Fig11,
    ];

    /// Returns the name on the command line and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fig1 => "1",
            Self::Fig2 => "2",
            Self::Fig3To6 => "3-6",
            Self::Fig7 => "7",
            Self::Fig8 => "8",
            Self::Fig9 => "9",
            Self::Fig10 => "10",
            Self::Fig11 => "11",
            Self::Tracking => "tracking",
        }
    }

    /// Returns the laboratories in which the figure is flown. The pure simulations have neither noise nor latency: one suffices.
    #[must_use]
    pub fn columns(self) -> &'static [Column] {
        match self {
            Self::Fig1 | Self::Fig2 => &Column::ALL[..1],
            _ => &Column::ALL,
        }
    }

    /// Returns the requested seeds that are flown. The pure simulations do not depend on the seed: the first suffices.
    #[must_use]
    pub fn seeds(self, requested: &[u64]) -> &[u64] {
        match self {
            Self::Fig1 | Self::Fig2 => &requested[..requested.len().min(1)],
            _ => requested,
        }
    }

    /// Returns the minimum number of seeds to judge a median: one where the flight does not depend on the seed.
    #[must_use]
    pub fn min_seeds(self) -> usize {
        match self {
            Self::Fig1 | Self::Fig2 => 1,
            _ => MIN_SEEDS,
        }
    }

    /// Returns the parts of the figure.
    #[must_use]
    pub fn experiment(self) -> Experiment {
        match self {
            Self::Fig1 => fig1::experiment(),
            Self::Fig2 => fig2::experiment(),
            Self::Fig3To6 => fig3_6::experiment(),
            Self::Fig7 => fig7::experiment(),
            Self::Fig8 => fig8::experiment(),
            Self::Fig9 => fig9::experiment(),
            Self::Fig10 => fig10::experiment(),
            Self::Fig11 => fig11::experiment(),
            Self::Tracking => tracking::experiment(),
        }
    }
}

impl FromStr for Figure {
    type Err = ValueError;

    fn from_str(name: &str) -> Result<Self, ValueError> {
        let found = Self::ALL.into_iter().find(|figure| figure.name() == name);
        found.ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|figure| figure.name()).collect();
            ValueError::Unknown {
                what: "figure",
                there_is: format!("there are {}", names.join(", ")),
            }
        })
    }
}

/// Settings of "paper mode": the paper's δ, with the resulting offset below the path kept.
const PAPER_MODE: [&str; 2] = ["controller.delta=0.1", "controller.remove_offset=false"];

/// Returns the ratio of a value of two flights.
fn ratio(
    flown: &SeedResults<'_>,
    larger: &str,
    smaller: &str,
    value: fn(&super::measure::Measured) -> f64,
) -> Result<f64, String> {
    Ok(value(flown.result(larger)?) / value(flown.result(smaller)?))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn figures_are_found_by_the_names_they_have() {
        for figure in Figure::ALL {
            assert_eq!(figure.name().parse(), Ok(figure));
        }
        assert!("12".parse::<Figure>().unwrap_err().to_string().contains("3-6"));
    }

    #[test]
    fn every_flight_of_every_figure_can_be_flown_in_every_laboratory() {
        for figure in Figure::ALL {
            for specification in figure.experiment().specifications {
                for &column in figure.columns() {
                    if let Err(error) = specification.load(column, 101) {
                        panic!(
                            "{}, {column:?}: {:?}",
                            specification.name,
                            miette::Report::from(error)
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn flights_of_one_name_are_one_flight() {
        let mut known: BTreeMap<String, FlightSpecification> = BTreeMap::new();
        for specification in Figure::ALL
            .into_iter()
            .flat_map(|figure| figure.experiment().specifications)
        {
            let first = known
                .entry(specification.name.clone())
                .or_insert_with(|| specification.clone());
            assert_eq!(*first, specification);
        }
    }

    #[test]
    fn a_number_is_named_once_in_its_figure() {
        for figure in Figure::ALL {
            let mut names: Vec<_> = figure.experiment().rows.iter().map(|row| row.quantity).collect();
            names.sort_unstable();
            let count = names.len();
            names.dedup();
            assert_eq!(names.len(), count, "{}", figure.name());
        }
    }
}
