//! Which flights have to be flown: those of all figures asked for, each once.

use std::collections::BTreeMap;

use super::column::Column;
use super::figures::Figure;
use super::flight::{Job, Recipe};
use super::{ablation, observability};
use scenario_file::ScenarioError;

/// Gathers flights; one that several figures ask for is flown once.
#[derive(Debug, Default)]
pub struct Plan(BTreeMap<(Column, u64, String), Recipe>);

impl Plan {
    /// Adds the flights of a figure.
    pub fn add_figure(&mut self, figure: Figure, seeds: &[u64]) {
        for recipe in figure.experiment().recipes {
            for &column in figure.columns() {
                self.add(&recipe, column, figure.seeds(seeds));
            }
        }
    }

    /// Adds the flights that show what can be known of the mass.
    pub fn add_observability(&mut self, seeds: &[u64]) {
        for recipe in observability::recipes() {
            self.add(&recipe, Column::Baseline, observability::seeds(seeds));
        }
    }

    /// Adds the flights that show what each part of the design is worth.
    pub fn add_ablation(&mut self, seeds: &[u64]) {
        for recipe in ablation::recipes() {
            self.add(&recipe, Column::Baseline, seeds);
        }
    }

    fn add(&mut self, recipe: &Recipe, column: Column, seeds: &[u64]) {
        for &seed in seeds {
            let key = (column, seed, recipe.name.clone());
            self.0.entry(key).or_insert_with(|| recipe.clone());
        }
    }

    /// The flights, ready to be flown.
    ///
    /// # Errors
    /// [`ScenarioError`] if a setting does not fit into its scenario.
    pub fn jobs(self) -> Result<Vec<Job>, ScenarioError> {
        let jobs = self.0.into_iter().map(|((column, seed, name), recipe)| {
            recipe.load(column, seed).map(|scenario| Job {
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
    use crate::reproduce::seeds;

    #[test]
    fn a_flight_that_two_figures_share_is_flown_once() {
        let mut plan = Plan::default();
        plan.add_figure(Figure::Fig7, &[101]);
        let count = plan.0.len();
        let shared = Figure::Fig8.experiment().recipes;
        assert!(shared.iter().any(|recipe| recipe.name == "fig7"));
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
        assert_eq!(jobs.len(), 3 * 20 * Figure::Fig9.experiment().recipes.len());
        assert!(jobs.iter().all(|job| job.scenario.seed > 100));
    }
}
