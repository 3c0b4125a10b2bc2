//! The paper's figures that the logs have: drawn of a log alone, as `gerono reproduce` draws them.

use scenario::Scenario;
use serde::Serialize;

use crate::reproduce::column::Column;
use crate::reproduce::drawings::{DRAWINGS, Drawing, TraceBook};
use crate::reproduce::figures::Figure;
use crate::reproduce::traces::Traces;

/// A figure.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Drawn {
    pub(super) file: &'static str,
    pub(super) title: &'static str,
    #[serde(skip)]
    pub(super) svg: String,
}

/// Returns the paper's figure that shows the flight of this scenario, whatever its seed and its length; none if it is
/// not one of theirs.
pub(super) fn name_in_the_paper(flown: &Scenario) -> Option<String> {
    let recipes = Figure::ALL
        .into_iter()
        .flat_map(|figure| figure.experiment().specifications);
    let mut names = recipes.filter_map(|specification| {
        let stated = specification.load(Column::Baseline, flown.seed).ok()?;
        let stated = Scenario {
            duration: flown.duration,
            ..stated.experiment()
        };
        (stated == *flown).then_some(specification.name)
    });
    names.next()
}

/// Every figure whose first flight is among these; of other flights that it is made of, those that are. Of several logs of
/// one flight the first is drawn.
pub(super) fn drawn<'a>(of_the_paper: impl Iterator<Item = &'a (String, Traces)>) -> Vec<Drawn> {
    let mut book = TraceBook::new();
    for (name, traces) in of_the_paper {
        book.entry(name.clone()).or_insert_with(|| traces.clone());
    }
    let has_flight = |drawing: &&Drawing| {
        let first = drawing.flights.first();
        first.is_some_and(|&flight| book.contains_key(flight))
    };
    let drawings = DRAWINGS.iter().filter(has_flight).map(|drawing| Drawn {
        file: drawing.file,
        title: drawing.title,
        svg: drawing.svg(&book),
    });
    drawings.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reproduce::flight::{FlightSpecification, ScenarioSource};

    #[test]
    fn a_flight_of_the_paper_is_known_by_its_scenario_whatever_its_seed_and_length() {
        let specification = FlightSpecification::plain(ScenarioSource::FIG7);
        let mut scenario = specification.load(Column::Baseline, 7).unwrap().experiment();
        scenario.duration = 35.0;
        assert_eq!(name_in_the_paper(&scenario).as_deref(), Some("fig7"));
        scenario.vehicle.mass *= 2.0;
        assert_eq!(name_in_the_paper(&scenario), None);
    }
}
