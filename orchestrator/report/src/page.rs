//! The page: one self-contained file. Its content security policy forbids the browser to fetch anything.

use scenario::Fence;
use serde::Serialize;
use serde_json::Value;
use shared_types::Topic;

use super::assets::{self, escaped_json, escaped_text, filled_in};
use super::encoding::base64_text;
use super::figures::Figure;
use super::flight::Flight;
use super::latency::Histogram;
use super::marks::{self, Mark, Span};
use super::panels::panels;
use super::run_facts::RunFacts;
use super::table::PageTable;
use super::track::PageTrack;
use metrics::loss::Loss;
use metrics::stretch::Metrics;
use metrics::summary::faults::FaultReport;
use metrics::summary::innovations::SourceInnovations;
use metrics::summary::{Kill, Phase, TopicCount};
use metrics::tracker::StateSource;

/// The page with placeholders `{{name}}`.
const PAGE: &str = include_str!("assets/page.html");

/// Fixed replacements of the placeholders.
const PARTS: [(&str, &str); 6] = [
    ("uplot.css", assets::UPLOT_STYLE),
    ("report.css", assets::STYLE),
    ("uplot.js", assets::UPLOT),
    ("common.js", assets::COMMON),
    ("orbit.js", assets::ORBIT),
    ("report.js", include_str!("assets/report.js")),
];

/// Data of the page's script.
#[derive(Serialize)]
struct Data<'a> {
    version: &'static str,
    panels: Vec<Value>,
    flights: Vec<PageFlight<'a>>,
    figures: Vec<PageFigure<'a>>,
}

#[derive(Serialize)]
struct PageFlight<'a> {
    label: &'a str,
    description: &'a str,
    seed: u64,
    /// Planned duration of the flight, s.
    duration: f64,
    /// Time of the last recorded tick, s.
    flown: f64,
    bound: Option<f64>,
    lost: Option<LostInWords<'a>>,
    killed: Option<&'a Kill>,
    /// That no take-off led to the path, and why not.
    failed_take_off: Option<&'a str>,
    /// A wrong axis or sign in the response to the first commands.
    response: Option<&'a str>,
    envelope_box: Option<&'a Fence>,
    source: StateSource,
    steady: Option<&'a Metrics>,
    metrics: Option<&'a Metrics>,
    broken: Option<&'a str>,
    scenario: String,
    facts: Option<&'a RunFacts>,
    phases: &'a [Phase],
    faults: &'a [FaultReport],
    innovations: &'a [SourceInnovations],
    /// What is wrong with sources of inertial navigation.
    navigation: Option<String>,
    topics: &'a [TopicCount],
    marks: &'a [Mark],
    spans: Vec<Span>,
    tables: Vec<NamedTable<'a>>,
    track: &'a PageTrack,
    histograms: &'a [Histogram],
}

/// The loss of a vehicle, with its description.
#[derive(Serialize)]
struct LostInWords<'a> {
    words: String,
    #[serde(flatten)]
    loss: &'a Loss,
}

impl<'a> LostInWords<'a> {
    fn new(loss: &'a Loss) -> Self {
        Self {
            words: loss.to_string(),
            loss,
        }
    }
}

#[derive(Serialize)]
struct NamedTable<'a> {
    topic: &'static str,
    #[serde(flatten)]
    table: &'a PageTable,
}

#[derive(Serialize)]
struct PageFigure<'a> {
    #[serde(flatten)]
    drawn: &'a Figure,
    /// The drawing in base 64.
    svg: String,
}

/// Returns the page of these flights and figures.
pub(super) fn html(flights: &[Flight], figures: &[Figure]) -> String {
    let names = flights
        .iter()
        .flat_map(|flight| &flight.scenario.controller.telemetry);
    let telemetry = names.map(String::as_str).collect();
    let data = Data {
        version: env!("CARGO_PKG_VERSION"),
        panels: panels(&telemetry),
        flights: flights.iter().map(page_flight).collect(),
        figures: figures
            .iter()
            .map(|drawn| PageFigure {
                drawn,
                svg: base64_text(&drawn.svg),
            })
            .collect(),
    };
    let labels: Vec<_> = flights.iter().map(|flight| flight.label.as_str()).collect();
    let title = escaped_text(&format!("{} · gerono", labels.join(", ")));
    let data = escaped_json(&serde_json::to_string(&data).expect("names and numbers are JSON"));
    filled_in(PAGE, |name| {
        let part = PARTS.into_iter().find(|(part, _)| *part == name);
        match (name, part) {
            ("title", _) => &title,
            ("data", _) => &data,
            (_, Some((_, text))) => text,
            (_, None) => unreachable!("the page has no placeholder `{name}`"),
        }
    })
}

fn page_flight(flight: &Flight) -> PageFlight<'_> {
    let scenario = &flight.scenario;
    PageFlight {
        label: &flight.label,
        description: &scenario.description,
        seed: scenario.seed,
        duration: scenario.duration,
        flown: flight.summary.simulated_seconds,
        bound: flight.summary.ultimate_bound,
        lost: flight.summary.lost.as_ref().map(LostInWords::new),
        killed: flight.summary.killed.as_ref(),
        failed_take_off: flight.summary.failed_take_off.as_deref(),
        response: flight.summary.response.as_deref(),
        envelope_box: scenario
            .envelope
            .as_ref()
            .and_then(|envelope| envelope.r#box.as_ref()),
        source: flight.summary.source,
        steady: flight.summary.steady.as_ref(),
        metrics: flight.summary.metrics.as_ref(),
        broken: flight.broken.as_deref(),
        scenario: scenario_file::to_toml(scenario).unwrap_or_else(|error| format!("# {error}")),
        facts: flight.facts.as_ref(),
        phases: &flight.summary.phases,
        faults: &flight.summary.faults,
        innovations: &flight.summary.innovations,
        navigation: flight.summary.navigation_problems(),
        topics: &flight.summary.topics,
        marks: &flight.marks,
        spans: marks::spans(scenario),
        tables: flight.tables.iter().map(named).collect(),
        track: &flight.track,
        histograms: &flight.histograms,
    }
}

fn named((topic, table): &(Topic, PageTable)) -> NamedTable<'_> {
    NamedTable {
        topic: topic.name(),
        table,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mark_of_the_page_has_a_part_and_every_part_a_mark() {
        let mut names: Vec<_> = PAGE
            .split("{{")
            .skip(1)
            .map(|piece| piece.split_once("}}").unwrap().0)
            .collect();
        names.sort_unstable();
        let mut known: Vec<_> = PARTS
            .iter()
            .map(|(name, _)| *name)
            .chain(["title", "data"])
            .collect();
        known.sort_unstable();
        assert_eq!(names, known);
    }

    #[test]
    fn no_part_ends_the_element_that_it_stands_in() {
        for (name, text) in PARTS {
            assert!(!text.contains("</script") && !text.contains("</style"), "{name}");
        }
    }

    #[test]
    fn text_in_json_comes_back_and_cannot_end_a_script() {
        let text = "</script><!-- <script> {{data}} & \u{2028}";
        let json = escaped_json(&serde_json::to_string(text).unwrap());
        assert!(!json.contains('<'));
        assert_eq!(serde_json::from_str::<String>(&json).unwrap(), text);
    }
}
