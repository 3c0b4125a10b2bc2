//! The flights of a campaign: those of all requested figures, each once.

use std::collections::BTreeMap;

use super::column::Column;
use super::figures::Figure;
use super::flight::{FlightSpecification, Job};
use super::{ablation, observability};
use scenario_file::ScenarioError;

/// Collects flights; a flight shared by several figures is flown once.
#[derive(Debug, Default)]
pub struct Plan(BTreeMap<(Column, u64, String), FlightSpecification>);

impl Plan {
    /// Adds the flights of a figure.
    pub fn add_figure(&mut self, figure: Figure, seeds: &[u64]) {
        for specification in figure.experiment().specifications {
            for &column in figure.columns() {
                self.add(&specification, column, figure.seeds(seeds));
            }
        }
    }

    /// Adds the flights of the observability table.
    pub fn add_observability(&mut self, seeds: &[u64]) {
        for specification in observability::specifications() {
            self.add(&specification, Column::Baseline, observability::seeds(seeds));
        }
    }

    /// Adds the flights of the ablation.
    pub fn add_ablation(&mut self, seeds: &[u64]) {
        for specification in ablation::specifications() {
            self.add(&specification, Column::Baseline, seeds);
        }
    }

    fn add(&mut self, specification: &FlightSpecification, column: Column, seeds: &[u64]) {
        for &seed in seeds {
            let key = (column, seed, specification.name.clone());
            self.0.entry(key).or_insert_with(|| specification.clone());
        }
    }

    /// Loads the scenarios of the flights.
    ///
    /// # Errors
    /// [`ScenarioError`] if a setting does not fit into its scenario.
    pub fn jobs(self) -> Result<Vec<Job>, ScenarioError> {
        let jobs = self.0.into_iter().map(|((column, seed, name), specification)| {
            specification.load(column, seed).map(|scenario| Job {
                name,
                column,
                scenario,
            })
        });
        jobs.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seeds;

    #[test]
    fn a_flight_that_two_figures_share_is_flown_once() {
        let mut plan = Plan::default();
        plan.add_figure(Figure::Fig7, &[101]);
        let count = plan.0.len();
        let shared = Figure::Fig8.experiment().specifications;
        assert!(shared.iter().any(|specification| specification.name == "fig7"));
        plan.add_figure(Figure::Fig8, &[101]);
        assert_eq!(plan.0.len(), count + 3 * (shared.len() - 1));
    }

    #[test]
    fn the_simulations_are_flown_once_and_the_laboratories_with_every_seed() {
        let mut plan = Plan::default();
        plan.add_figure(Figure::Fig1, &seeds(20));
        assert_eq!(plan.0.len(), 1);
        let mut plan = Plan::default();
        plan.add_figure(Figure::Fig9, &seeds(20));
        let jobs = plan.jobs().unwrap();
        assert_eq!(
            jobs.len(),
            3 * 20 * Figure::Fig9.experiment().specifications.len()
        );
        assert!(jobs.iter().all(|job| job.scenario.seed > 100));
    }
}
