//! The paper's figures drawn from logs, as `gerono reproduce` draws them.

use host::in_process::TickSink;
use report::figures::{Figure as Drawn, Figures};
use scenario::Scenario;
use shared_types::{Schedule, Topic};

use super::column::Column;
use super::drawings::{DRAWINGS, Drawing, TraceBook};
use super::figures::Figure;
use super::traces::Tracer;

/// The paper's figures of a set of logs: every figure whose first flight is among them, with the other flights found. Of
/// several logs of one flight the first is drawn.
#[derive(Default)]
pub struct LogFigures {
    flights: TraceBook,
    /// Name and tracer of the flight that is being read; `None` if it is not a flight of the paper.
    flight: Option<(String, Tracer)>,
}

impl LogFigures {
    fn end(&mut self) {
        if let Some((name, tracer)) = self.flight.take() {
            self.flights.entry(name).or_insert_with(|| tracer.finish());
        }
    }
}

impl Figures for LogFigures {
    fn begin(&mut self, scenario: &Scenario, schedule: &Schedule) {
        self.end();
        let name = name_in_the_paper(scenario);
        self.flight = name.map(|name| (name, Tracer::new(scenario, schedule)));
    }

    fn sample(&mut self, topic: Topic, bytes: &[u8]) {
        if let Some((_, tracer)) = &mut self.flight {
            let Ok(()) = tracer.sample(topic, bytes);
        }
    }

    fn draw(&mut self) -> Vec<Drawn> {
        self.end();
        let has_flight = |drawing: &&Drawing| {
            let first = drawing.flights.first();
            first.is_some_and(|&flight| self.flights.contains_key(flight))
        };
        let drawings = DRAWINGS.iter().filter(has_flight).map(|drawing| Drawn {
            file: drawing.file,
            title: drawing.title,
            svg: drawing.svg(&self.flights),
        });
        drawings.collect()
    }
}

/// Returns the name of the paper's flight with this scenario, for any seed and duration; `None` if there is none.
fn name_in_the_paper(flown: &Scenario) -> Option<String> {
    let specifications = Figure::ALL
        .into_iter()
        .flat_map(|figure| figure.experiment().specifications);
    let mut names = specifications.filter_map(|specification| {
        let stated = specification.load(Column::Baseline, flown.seed).ok()?;
        let stated = Scenario {
            duration: flown.duration,
            ..stated.experiment()
        };
        (stated == *flown).then_some(specification.name)
    });
    names.next()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::{FlightSpecification, ScenarioSource};

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
